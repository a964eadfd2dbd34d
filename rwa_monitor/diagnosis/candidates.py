"""The candidates of a closed window: of all its peaks those that stand beside all others, at the slope they leave."""

from __future__ import annotations

from typing import Final

import numpy as np

from rwa_monitor.diagnosis.changepoints import (
    in_turn,
    join,
    peaks_behind_gaps,
    select_candidates,
    suppress,
    variance_table,
)
from rwa_monitor.diagnosis.estimation import SlopePrior, default_exclusion, estimate_slope
from rwa_monitor.diagnosis.noise import ar_coefficient
from rwa_monitor.diagnosis.results import Candidates, Evidence
from rwa_monitor.diagnosis.tails import Tails
from rwa_monitor.diagnosis.wglr import STEP
from rwa_monitor.samples import FloatArray, IntArray

MOST_ROUNDS: Final = 3  # of slope and candidates in turns; two nearly always agree


def choose(
    evidence: Evidence, scales: IntArray, variances: FloatArray, tails: Tails, slope_prior: SlopePrior | None
) -> Candidates:
    """Choose among the peaks of a window, and the jumps behind its gaps.

    Parameters
    ----------
    evidence
        Of the window, all its peaks as candidates.
    scales, variances
        int64 and float64 (S,), half-widths of the scales [slots] and the variance of each one's contrast; NaN where it
        is not known.
    tails
        Of the noise.
    slope_prior
        What is known of the slope before the window, or None.
    """
    known = np.isfinite(variances)
    peaks = join(evidence.candidates, peaks_behind_gaps(evidence.sums))
    if len(peaks) == 0 or not known.any():
        return evidence.candidates
    peaks = in_turn(peaks)
    table = variance_table(scales[known], variances[known])
    colour = ar_coefficient(evidence.noise)
    index = suppress(peaks)
    margin: IntArray | int = STEP // 4
    candidates = peaks
    for _ in range(MOST_ROUNDS):
        slope, _ = estimate_slope(evidence.sums, evidence.noise, index, margin, slope_prior)
        candidates = select_candidates(peaks, evidence.sums, slope, table, evidence.threshold, tails, colour)
        if np.array_equal(candidates.index, index):
            break
        index = candidates.index
        margin = default_exclusion(candidates.scale)
    return candidates
