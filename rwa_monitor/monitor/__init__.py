"""The live monitor: samples from the bus in, diagnoses, status and recordings out.

Read the pure part first: `core.py` (messages into slots into windows into diagnoses), with
`ingest/` before them, `events.py` behind. Then `service.py` and `monitor.py`, which serve a bus
(`bus.py`) and write `recording/`; `replay.py` and `state_recovery.py` make the decisions of a
recording again; `searches.py` searches for missing effects in another process.
"""
