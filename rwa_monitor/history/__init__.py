"""Diagnoses over months: what was found, when, what alarm it raised, and who has seen it.

In: messages of the bus or of recordings. Out: records as the API shows them. Read `alarms.py` (a pure state machine)
first, then `store.py` over `database.py`.
"""
