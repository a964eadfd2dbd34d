"""What people and their tools read: diagnoses as rows of a table, and messages as Foxglove shows them.

In: messages of the bus. Out: rows, and the entries and layout of Foxglove. Each file stands for itself.
"""
