"""The candidates of a closed window: of all its peaks those that stand beside all others, at the slope they leave."""

from __future__ import annotations

import math

import numpy as np

from rwa_monitor.changepoints.changepoints import (
    Bar,
    in_turn,
    join,
    peaks_behind_gaps,
    variance_table,
)
from rwa_monitor.changepoints.estimation import SlopePrior
from rwa_monitor.changepoints.noise import ar_coefficient
from rwa_monitor.changepoints.outlier_model import Tails
from rwa_monitor.changepoints.stage_results import Candidates, Evidence
from rwa_monitor.kernels import changepoints as kernel
from rwa_monitor.samples import FloatArray, IntArray


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
    index, scale, statistic, jump, read = kernel.choose(
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
