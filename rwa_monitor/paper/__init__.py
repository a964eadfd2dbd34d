"""The paper's method, section by section in plain numpy, to be read together with the paper (`--method paper`).

In: the samples of a window, the estimate of its noise, the wheel and its trained classifiers. Out: a diagnosis of the
same form as the default method's.

Read in the paper's order: `detection.py` (section IV-A), `estimation.py` (IV-B), `assignment.py` (IV-C and Algorithm
1), `classification.py` (IV-D); `method.py` runs them on a window. "Errata 7" and the like are rows of the table in
docs/theory.md: what the paper leaves open, and how it is corrected here where it cannot run as printed.
"""
