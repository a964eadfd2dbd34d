"""What people and their tools read: diagnoses as text and as rows of a table, and messages as Foxglove shows them.

In: messages of the bus. Out: text, rows, and the entries and layout of Foxglove. Each file stands for itself.
"""
