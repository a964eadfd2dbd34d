"""Stage 4 and the window as a whole: which anomalies are there, whether the model fits, and what an operator reads.

In: the `Evidence` of a closed window, the wheel, a `Model` and the carried state. Out: a `Diagnosis`, as on the bus.

Read `window.py` first: it runs all stages in order; then `features.py`, `classification.py`, `verdict.py`,
the words of an operator with it; `adequacy.py` tests whether the friction model fits; `model.py` is what was learned
from labelled windows, `training.py` how; `trend.py` follows a coefficient over windows.

"Errata 9" and the like are rows of the table in docs/theory.md: what the paper leaves open, and what is done here.
"""
