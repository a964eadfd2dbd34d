"""The live monitor: samples from the bus in, diagnoses, status and recordings out.

Read the pure part first: `core.py` (messages into slots into windows into diagnoses), with
`ingest/` before them, `events.py` behind. Then `service.py`, which serves a bus
(`bus.py`) and writes `recording/`; `replay.py` makes the decisions of a
recording again; `searches.py` searches for missing effects in another process.
"""
