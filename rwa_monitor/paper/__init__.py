"""The paper's own method where it differs from ours, plain numpy, to be read beside the paper.

In: the evidence of a window. Out: assignment and components as the paper prints them (`--method paper`), mended only
where they cannot run (errata 7 to 11, docs/theory.md).
"""
