"""Simulated telemetry of wheels, with the whole truth beside it.

In: a wheel, a scenario and a random generator. Out: samples, their true components and jumps; labelled data sets.

Read in the order of the data: `scenario.py` (what happens; sensors, noise, faults), `motion.py` (speed),
`record.py` (one record, and what of it can be seen), `datasets.py` (many windows by recipe),
`demo_satellite.py`.
"""
