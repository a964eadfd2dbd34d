"""The live monitor: samples from the bus in, diagnoses, status and recordings out.

Read the pure part first: `core.py` (messages into slots into windows into diagnoses), with `ingest.py` before it,
`stored.py` beside it; `setup.py` is what they depend on, from wheel and model files. Then `service.py`, which serves a
bus (`bus.py`; `backfill.py` closes gaps) and writes recordings (`recorder.py`; `recording.py` reads them as far as they
pass their checksums); `replay.py` makes their decisions again; `searches.py` searches for missing effects in another
process.
"""
