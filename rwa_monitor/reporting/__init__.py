"""What people and their tools read: the report of a search, diagnoses as text, and Foxglove.

In: a finished search; messages of the bus. Out: an HTML page with figures; text; the entries and layout of
Foxglove. Each file stands for itself.
"""
