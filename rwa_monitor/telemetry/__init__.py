"""Telemetry of wheels from files, and the friction that its sensors show.

In: tables (CSV, Parquet), CCSDS space packets, ROS 2 bags; label files. Out: `Samples` in SI units, and the friction
torque of each slot, less the effects that the wheel is known to have.

Read `reader.py` first: what every format returns, and maps for formats that do not name their channels. Then `table.py`
and the formats, each a file of its own; `slots.py`, which is pure, for what happens to slots before they are diagnosed.
`files.py` is how files are read.
"""
