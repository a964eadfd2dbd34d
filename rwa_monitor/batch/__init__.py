"""Thousands of recordings at once: one task for each recording, in several processes, results as Parquet.

`tasks.py` is what is done with one recording, and spreads it over processes for many; `store.py` keeps the results and
finds what is done already.
"""
