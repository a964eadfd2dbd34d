"""The live monitor: samples from the bus in, diagnoses, status and recordings out.

Read the pure part first: `core.py` (messages into slots into windows into diagnoses), with `ingest.py`, which orders
messages and samples, and `stored.py` for dumps; `setup.py` has the wheel files and the model. Then `service.py`, which
serves a bus (`bus.py`; `backfill.py` closes gaps) and writes recordings (`recorder.py`; `recording.py` reads the parts
that pass their checksums); `replay.py` reproduces their diagnoses; `searches.py` searches for missing effects in a
child process.
"""
