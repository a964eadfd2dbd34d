"""Thousands of recordings at once: one task for each recording, in several processes, results as Parquet.

In the order of the flow: `tasks.py` is what is done with one recording, `store.py` keeps its result and finds what is
done already, `cluster.py` spreads the tasks over processes.
"""
