"""The wheel: its constants, its friction as a sum of effects, its switching systems and their duration laws.

In: a wheel.toml as text. Out: an immutable `Wheel`, and objects of the effects that it names. Nothing is simulated
here.

Read `wheel.py` first: all constants with their units; then `durations.py` (how long a configuration lasts),
`switching_systems.py` (semi-Markov processes), `torque_balance.py` (the one place with the sign of friction), and
`effects/` with one class for each effect. `file_content.py` is how values are read and hashed.
"""
