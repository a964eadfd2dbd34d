"""The friction model of a wheel for other simulators: written in C from the classes of its effects, an FMU, Basilisk.

`recording.py` writes down what an effect's class computes, `model.py` puts a wheel's law together, and each format has
a file beside its template.
"""
