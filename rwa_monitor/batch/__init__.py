"""Thousands of recordings at once: one task for each recording, in several processes, results as Parquet.

In the order of the flow: `tasks.py` says what is done with one recording, `store.py` keeps its result and knows what is
done already, `cluster.py` spreads the tasks over processes, `rows.py` turns results into the columns of a table.
"""
