"""Thresholds of speed, read off the jumps: what switches within a slot passes for jumps until its speed is met exactly.

A profile over the threshold has no slope to follow: beside the true one no jump is explained. But the jumps that it
makes lie at its speed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from rwa_monitor.discrepancy.base_fit import Fit
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.discrepancy.terms import Term, make_background
from rwa_monitor.samples import IntArray

MOST_TRIED: Final = 60  # speeds
AT_THRESHOLD: Final = 8  # slots: a jump so near to a crossing of the threshold may be that crossing
FEWEST_CROSSED: Final = 3  # jumps at one speed that are no coincidence


def best_threshold(
    problem: Problem,
    chosen: Sequence[Term],
    fitted: Fit,
    make: Callable[[float], Term],
    limits: tuple[float, float] = (0.0, np.inf),
) -> tuple[Term, IntArray] | None:
    """Return the term whose threshold makes the most of the jumps superfluous, and the jumps that are left.

    Parameters
    ----------
    problem
        The data.
    chosen
        The terms already in the model.
    fitted
        Its fit.
    make
        Makes the term with a threshold at a speed [rad/s].
    limits
        Lowest and highest threshold [rad/s].
    """
    jumps = fitted.jumps[:: max(fitted.jumps.size // MOST_TRIED, 1)]
    best: tuple[float, Term, IntArray] | None = None
    for speed in 0.5 * (problem.speed[jumps - 1] + problem.speed[jumps]):
        crossed = np.flatnonzero(np.diff(problem.speed > speed)) + 1
        near = np.abs(fitted.jumps[:, None] - crossed[None, :]).min(axis=1, initial=problem.size) <= AT_THRESHOLD
        if not limits[0] <= speed <= limits[1] or np.count_nonzero(near) < FEWEST_CROSSED:
            continue
        term, left = make(float(speed)), fitted.jumps[~near]
        criterion = make_background(problem, chosen, left).criterion_with(term)
        if best is None or criterion < best[0]:
            best = criterion, term, left
    return best[1:] if best else None
