"""Effects on a wheel's friction, one class each: it simulates, gives columns, bounds its parameters, explains itself.

Read `base.py` first, then a short one such as `stribeck.py`; `noise_base.py` and `switching_base.py` are the other two
families, `catalogue.py` finds all of them.
"""
