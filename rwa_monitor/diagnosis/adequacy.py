"""Does the friction model fit the window? A cheap check at every window close, from running sums alone.

The model says that between jumps friction is a level plus one viscous slope, and that jumps are as frequent as the
switching systems make them. A missing effect that depends on speed gives intervals at different speeds different
slopes; a smooth one is cut into steps, so that there are too many jumps, or jumps that no system made. The search of
the discrepancy room names the cause from the samples; here only a suspicion is raised.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import stats

from rwa_monitor.diagnosis.results import REJECTED, UNATTRIBUTED, Assignment, Estimate, Evidence
from rwa_monitor.physics.switching import jumping_chain_law
from rwa_monitor.physics.wheel import SwitchingSystem
from rwa_monitor.samples import FloatArray

# An interval disagrees when its slope is this many standard deviations from the common one: 1 in 16,000 by chance.
DISAGREEING_SIGMAS: Final = 4.0
# A single missed jump bends one or two intervals. Only more than these are held against the model.
DISAGREEING_INTERVALS: Final = 3
DISAGREEING_SHARE: Final = 0.25
# 225 healthy windows of the recipes paper, hard and derived had at most one unattributed jump, and at most 1.2 standard
# deviations more jumps than expected (their durations are more regular than a Poisson process, whose spread is used).
UNATTRIBUTED_JUMPS: Final = 3
EXCESS_SIGMAS: Final = 3.0
SYSTEMATIC_SHARE: Final = 0.5  # of all jumps unattributed: more than accidents of an assignment
MIN_INTERVAL: Final = 30  # samples: shorter intervals do not know their slope
CLEAR_TREND: Final = 0.6  # rank correlation of slope and speed from which its sign names an effect


@dataclass(frozen=True, slots=True)
class Adequacy:
    """Whether the friction model fits, which effect of the catalogue may be missing, and the finding in words."""

    adequate: bool
    suspected_effect: str | None
    finding: str


def check(
    evidence: Evidence, estimate: Estimate, assignment: Assignment, systems: Sequence[SwitchingSystem]
) -> Adequacy:
    """Check the friction model on one window.

    Parameters
    ----------
    evidence, estimate, assignment
        Results of the stages.
    systems
        Switching systems of the wheel; without any, jumps cannot be attributed and are not held against it.
    """
    unattributed = int((assignment.system == UNATTRIBUTED).sum())
    jumps = int((assignment.system != REJECTED).sum())
    expected = expected_jumps(systems, evidence.slots)
    odd_jumps = ""
    if systems and unattributed >= UNATTRIBUTED_JUMPS:
        odd_jumps = f"{unattributed} of {jumps} jumps fit no switching system"
    elif systems and jumps - expected > EXCESS_SIGMAS * np.sqrt(expected) + UNATTRIBUTED_JUMPS:
        odd_jumps = f"there are {jumps} jumps where the switching systems make about {expected:.0f}"
    deviation, speed = _slope_deviations(evidence, estimate)
    disagreeing = int((np.abs(deviation) > DISAGREEING_SIGMAS).sum())
    if disagreeing < max(DISAGREEING_INTERVALS, DISAGREEING_SHARE * deviation.size):
        # Jumps that no system made, and yet one slope everywhere: a system of their own, if not something narrow.
        suspect = "extra_switching_system" if unattributed > SYSTEMATIC_SHARE * jumps else None
        return Adequacy(not odd_jumps, suspect if odd_jumps else None, odd_jumps)
    finding = f"the viscous slope differs between intervals ({disagreeing} of {deviation.size})"
    trend = float(stats.spearmanr(speed, deviation).statistic) if np.ptp(speed) > 0 else 0.0
    if trend < -CLEAR_TREND:
        return Adequacy(False, "sublinear_viscous", finding)
    if trend > CLEAR_TREND:
        return Adequacy(False, "quadratic_drag", finding)
    return Adequacy(False, None, finding)


def expected_jumps(systems: Sequence[SwitchingSystem], slots: int) -> float:
    """Return how many jumps healthy or failing systems make in a window on average: slots over the mean sojourn."""
    total = 0.0
    for system in systems:
        means = np.array([law.mean() for law in system.durations])
        total += slots / float(jumping_chain_law(system) @ means)
    return total


def _slope_deviations(evidence: Evidence, estimate: Estimate) -> tuple[FloatArray, FloatArray]:
    """Return each interval's slope less the common one in standard deviations, and its mean speed; (intervals,)."""
    edges = np.concatenate([[0], estimate.index, [evidence.slots]]).astype(np.int64)
    edges = np.unique(edges)
    sums = evidence.sums.between(edges[:-1], edges[1:])
    n = np.maximum(sums.n, 1.0)
    spread = sums.xx - sums.x**2 / n
    # The slope must be known to a tenth of what speed spans: else rounding is read as a slope.
    usable = (sums.n >= MIN_INTERVAL) & (spread > 1e-9 * np.maximum(sums.xx, 1e-300))
    variance = evidence.noise.std**2 * max(evidence.noise.long_run_factor, 1.0)
    if int(usable.sum()) < 2 or not variance > 0:
        return np.zeros(0), np.zeros(0)
    spread, cross = spread[usable], (sums.xz - sums.x * sums.z / n)[usable]
    deviation = (cross / spread - cross.sum() / spread.sum()) * np.sqrt(spread / variance)
    return deviation, (sums.x / n)[usable]
