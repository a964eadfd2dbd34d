"""Output for people and their tools: the report of a search, diagnoses as text, and Foxglove.

In: a finished search; messages of the bus. Out: an HTML page with figures; text; the messages and layout of
Foxglove. The files are independent of each other, but the report draws with `residual_views.py` and `figures.py`.
"""
