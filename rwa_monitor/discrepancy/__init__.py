"""What the simulation gets wrong: hypotheses searched by one likelihood, their gain, the model extended by them.

In: recordings of a wheel and its file. Out: a `Search` with the effects that are missing, the gain on held-out data,
the extended wheel, and the next manoeuvre to fly. Read `find.py` first: it runs all the rest; then `record.py` and
`problem.py` (the data), `base_fit.py`, `likelihood.py` and `score.py` (the model), `hypotheses.py`, `fitting.py` and
`search.py`, `explanation.py`, `found_effects.py`, `extended.py` and `plan.py`.
"""
