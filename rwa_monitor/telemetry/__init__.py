"""Telemetry of wheels from files, and the friction derived from its sensors.

In: tables (CSV, Parquet), CCSDS space packets, ROS 2 bags; label files. Out: `Samples` in SI units, and the friction
torque of each slot, less the effects that the wheel is known to have.

Read `reader.py` first: what every format returns, and maps for formats that do not name their channels. Then `table.py`
and the formats, each a file of its own; `slots.py`, which is pure: the processing of slots before they are diagnosed;
`files.py`: how files are read and written.
"""
