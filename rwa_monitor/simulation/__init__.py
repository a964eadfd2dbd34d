"""Simulated telemetry of wheels, together with the ground truth.

In: a wheel, a scenario and a random generator. Out: samples, their true components and jumps; labelled data sets.

Read in the order of the data: `scenario.py` (motion, sensors, noise, anomalies, faults), `motion.py` (speed),
`record.py` (one record, and which of its jumps are detectable), `datasets.py` (many windows by recipe),
`demo_satellite.py`.
"""
