"""Diagnoses over months: their windows and estimates, the alarms that they raised, and who acknowledged them.

Input: messages of the bus or of recordings. Output: records for the API. Read `alarms.py` (a pure state machine)
first, then `store.py`, which uses `database.py`.
"""
