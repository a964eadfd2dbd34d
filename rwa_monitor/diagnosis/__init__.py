"""The four stages of the paper, one file each, and the window that runs them in order.

"Errata 9" and the like are rows of the table in docs/theory.md: what the paper leaves open, and what is done here.
"""
