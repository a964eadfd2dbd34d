"""The candidates of a closed window: of all its peaks those that stand beside all others, at the slope they leave."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numba import njit

from rwa_monitor.diagnosis.changepoints import (
    Bar,
    in_turn,
    join,
    kept_apart,
    peaks_behind_gaps,
    select,
    variance_table,
)
from rwa_monitor.diagnosis.estimation import SlopePrior, default_exclusion, slope_within
from rwa_monitor.diagnosis.noise import ar_coefficient
from rwa_monitor.diagnosis.results import Candidates, Evidence
from rwa_monitor.diagnosis.running_sums import SumArrays
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
    noise = evidence.noise
    index, scale, statistic, jump, read = _settle(
        peaks.index,
        peaks.scale,
        evidence.slots,
        evidence.sums.arrays,
        Bar(table, evidence.threshold, tails.largest_outlier),
        ar_coefficient(noise),
        noise.std**2 * noise.long_run_factor,
        *((math.nan, math.nan) if slope_prior is None else (slope_prior.mean, slope_prior.std)),
    )
    evidence.sums.samples_read += read
    return Candidates(index, scale, statistic, jump)


@njit(cache=True, error_model="numpy", nogil=True)
def _settle(
    peak_index: IntArray,
    peak_scale: IntArray,
    slots: int,
    sums: SumArrays,
    bar: Bar,
    correlation: float,
    variance: float,
    prior_mean: float,
    prior_std: float,
) -> tuple[IntArray, IntArray, FloatArray, FloatArray, int]:
    """Estimate the slope and choose candidates in turns, until they agree; parameters as for `select`, `slope_within`.

    Returns what `select` does.
    """
    index = kept_apart(peak_index, peak_scale)
    exclude = np.full(index.size, STEP // 4)
    scale, statistic, jump, read = peak_scale, np.empty(0), np.empty(0), 0
    for _ in range(MOST_ROUNDS):
        before = index
        slope, _ = slope_within(slots, index, exclude, sums, variance, prior_mean, prior_std)
        index, scale, statistic, jump, more = select(peak_index, peak_scale, slots, slope, correlation, sums, bar)
        read += more
        if np.array_equal(index, before):
            break
        exclude = default_exclusion(scale)
    return index, scale, statistic, jump, read
