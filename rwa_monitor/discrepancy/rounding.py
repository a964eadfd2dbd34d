"""Rounding of the speed that passes for a mean effect.

Where the speed stands on one reading for longer than the derivative's filter is wide, the rounding error of derived
friction is no noise: it follows the acceleration, step by step. What lives in the acceleration cannot be told from it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from rwa_monitor.discrepancy.fitting import Fitting
from rwa_monitor.discrepancy.models import SearchResult
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.physics.effects.tachometer_quantisation import lattice_step

FOLLOW_ACCELERATION: Final = frozenset(
    {
        "inertia_error",
        "torque_constant_error",
        "torque_constant_temperature",
        "load_dependence",
        "lubricant_lag",
        "current_delay",
    }
)
MISSING: Final = "a tachometer with finer steps: the speed stands on one reading for longer than the derivative looks"


def without_rounding(problem: Problem, found: SearchResult) -> SearchResult:
    """Withdraw the effects that rounding errors imitate, where they are coarse; they become untestable."""
    if not any(_is_coarse(problem, index) for index in range(len(problem.records))):
        return found
    model = found.ladder[-1]
    follows = [term.effect.name in FOLLOW_ACCELERATION for term in model.terms]
    if not any(follows):
        return found
    kept = model.terms[: follows.index(True)]  # what came after was judged beside a wrong name
    withdrawn = tuple((term.effect.name, MISSING) for term in model.terms[len(kept) :])
    reduced = Fitting(problem, jumps=bool(model.fit.jumps.size)).refitted(kept, model) if kept else found.ladder[0]
    names = {term.effect.name for term in kept}
    shorter = (m for m in found.ladder if set(m.names) <= names and len(m.terms) < len(kept))
    return replace(
        found,
        ladder=(*shorter, reduced),
        found=tuple(entry for entry in found.found if entry.name in names),
        untestable=(*found.untestable, *withdrawn),
    )


def _is_coarse(problem: Problem, index: int) -> bool:
    """Say whether a record's speed crosses less than one step within the derivative's filter, half of the time."""
    record = problem.records[index]
    step = lattice_step(record.channels.speed_rad_s[np.isfinite(record.channels.speed_rad_s)])
    if not record.friction_is_derived or step is None:
        return False
    window_s = record.derivative_slots * record.channels.sample_period_s
    crossed = np.abs(record.channels.acceleration_rad_s2[record.used]) * window_s / step
    return bool(np.nanmedian(crossed) < 1.0)
