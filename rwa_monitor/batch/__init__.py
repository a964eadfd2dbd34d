"""Thousands of recordings at once: one task for each recording, in several processes, results as Parquet.

`tasks.py` has the task for one recording, and distributes it over processes for many; `store.py` keeps the results and
finds those that exist already.
"""
