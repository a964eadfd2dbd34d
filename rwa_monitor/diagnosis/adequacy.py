"""Does the friction model fit the window? A cheap check at every window close, from running sums alone.

The model says that between jumps friction is a level plus one viscous slope. A missing effect that depends on speed
gives intervals at different speeds different slopes; a missing switching system leaves jumps that no system made. The
search of the discrepancy room names the cause from the samples; here only a suspicion is raised.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import stats

from rwa_monitor.diagnosis.results import UNATTRIBUTED, Assignment, Estimate, Evidence
from rwa_monitor.samples import FloatArray

# An interval disagrees when its slope is this many standard deviations from the common one: 1 in 16,000 by chance.
DISAGREEING_SIGMAS: Final = 4.0
# A single missed jump bends one or two intervals. Only more than these are held against the model.
DISAGREEING_INTERVALS: Final = 3
DISAGREEING_SHARE: Final = 0.25
UNATTRIBUTED_JUMPS: Final = 5
UNATTRIBUTED_SHARE: Final = 0.5
MIN_INTERVAL: Final = 30  # samples: shorter intervals do not know their slope
CLEAR_TREND: Final = 0.6  # rank correlation of slope and speed from which its sign names an effect


@dataclass(frozen=True, slots=True)
class Adequacy:
    """Whether the friction model fits, which effect of the catalogue may be missing, and the finding in words."""

    adequate: bool
    suspected_effect: str | None
    finding: str


def check(evidence: Evidence, estimate: Estimate, assignment: Assignment, systems: int) -> Adequacy:
    """Check the friction model on one window.

    Parameters
    ----------
    evidence, estimate, assignment
        Results of the stages.
    systems
        Number of switching systems of the wheel; without any, jumps cannot be attributed and are not held against it.
    """
    accepted = int((assignment.direction != 0).sum())
    unattributed = int((assignment.system == UNATTRIBUTED).sum())
    if systems and unattributed >= max(UNATTRIBUTED_JUMPS, UNATTRIBUTED_SHARE * accepted):
        return Adequacy(False, "extra_switching_system", f"{unattributed} jumps fit no switching system")
    deviation, speed = _slope_deviations(evidence, estimate)
    disagreeing = int((np.abs(deviation) > DISAGREEING_SIGMAS).sum())
    if disagreeing < max(DISAGREEING_INTERVALS, DISAGREEING_SHARE * deviation.size):
        return Adequacy(True, None, "")
    finding = f"the viscous slope differs between intervals ({disagreeing} of {deviation.size})"
    trend = float(stats.spearmanr(speed, deviation).statistic) if np.ptp(speed) > 0 else 0.0
    if trend < -CLEAR_TREND:
        return Adequacy(False, "sublinear_viscous", finding)
    if trend > CLEAR_TREND:
        return Adequacy(False, "quadratic_drag", finding)
    return Adequacy(False, None, finding)


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
