"""Effects on a wheel's friction, one class each: it simulates, gives columns, bounds its parameters, explains itself.

Read `base.py` first (what all share, mean and noise effects), then a short one such as `Stribeck` in `drag_laws.py`;
`switching_base.py` is the third family, `catalogue.py` finds all of them.
"""
