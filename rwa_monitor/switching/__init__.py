"""Stage 3: which friction switching system made which jump, and how the friction splits into its parts.

In: the evidence of a window, the wheel, and the state after earlier windows (`carried_state.py`). Out: an `Assignment`
of jumps to systems and the `Components` of the friction.

Read `duration_likelihoods.py` (sojourns), `friction_model.py` (the linear model and its priors), `assignment.py` (the
decoder; levels between candidates are in `changepoints/estimation.py`), `components.py` (the split).
`jump_attribution.py` does the same for whole recordings of a wheel whose systems are not known yet.
"""
