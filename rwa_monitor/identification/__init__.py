"""A wheel learned from recordings of it: nominal friction, noise, switching systems and their duration laws.

In: samples of a healthy wheel. Out: a `Wheel`, with standard errors and data-quality warnings. Read `identify.py`,
which calls the others; `duration_laws.py` learns duration laws from few sojourns.
"""
