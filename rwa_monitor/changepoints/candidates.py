"""From the peaks of the wGLR at all scales, kept compact and of bounded size, to the candidates of a closed window.

A big jump shows at every scale, with side lobes at half the scale's distance (errata 4), and two near jumps blur each
other at scales wider than their distance (errata 5). So peaks are taken narrow scale first, and each is judged *given*
the candidates already accepted: its halves end at its neighbours, the slope is the window's own. Positions are refined
by likelihood, and at last the weakest candidates are taken away until all that stay are significant by themselves.
Everything comes from running sums; a few samples are read around each candidate.
"""

from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np
from scipy import special

from rwa_monitor.changepoints.estimation import SlopePrior
from rwa_monitor.changepoints.noise import ar_coefficient
from rwa_monitor.changepoints.running_sums import RunningSums
from rwa_monitor.changepoints.stage_results import Candidates, Evidence
from rwa_monitor.kernels import changepoints as kernel
from rwa_monitor.kernels.running_sums import STRIDE
from rwa_monitor.kernels.wglr import MAX_SCALE
from rwa_monitor.samples import FloatArray, IntArray

# Tests that a window amounts to, per slot. The peaks of all scales are about 1.5 independent tests a slot, but a
# candidate must also stand between its final neighbours: simulated windows without a jump show this many.
TESTS_PER_SLOT: Final = 0.25
_BOUNDS: Final = (2.0, 12.0, 10_001)  # standard deviations: run lengths of 10 to 1e30 samples
_LOG_USED: Final[FloatArray] = np.log(np.maximum(np.arange(MAX_SCALE + 1), 1))  # of 0 … MAX_SCALE used samples


def choose(
    evidence: Evidence, scales: IntArray, variances: FloatArray, outlier: float, slope_prior: SlopePrior
) -> Candidates:
    """Choose among the peaks of a window, and the jumps behind its gaps.

    Parameters
    ----------
    evidence
        Of the window, all its peaks as candidates.
    scales, variances
        int64 and float64 (S,), half-widths of the scales [slots] and the variance of each one's contrast; NaN where it
        is not known.
    outlier
        See `noise.largest_outlier`.
    slope_prior
        What is known of the slope before the window.
    """
    known = np.isfinite(variances)
    found, behind = evidence.candidates, peaks_behind_gaps(evidence.sums)
    if len(found) + len(behind) == 0 or not known.any():
        return found
    table = variance_table(scales[known], variances[known])
    noise = evidence.noise
    chosen = kernel.choose(
        np.concatenate((found.index, behind.index)),
        np.concatenate((found.scale, behind.scale)),
        np.concatenate((found.statistic, behind.statistic)),
        evidence.slots,
        evidence.sums.arrays,
        Threshold(table, evidence.threshold, outlier),
        ar_coefficient(noise),
        noise.std**2 * noise.long_run_factor,
        *slope_prior,
    )
    return Candidates(*chosen)


def threshold_for(false_alarms: float, tests: float) -> float:
    """Return the χ² (one degree of freedom) threshold that `tests` independent tests exceed `false_alarms` times."""
    return float(special.chdtri(1, min(false_alarms / max(tests, 1.0), 0.5)))


@lru_cache
def threshold_of_run_length(run_length: float, half_widths: tuple[int, ...]) -> float:
    """Return the χ² threshold that the wGLR at these half-widths exceeds once in so many samples without a jump.

    At half-width w the contrast of both means is, over its standard deviation, a stationary process whose
    autocorrelation falls by α = 3/(2w) from slot to slot. Its maxima beyond ±b come 2·α·b·φ(b)·ν(b·√(2α)) times a slot,
    ν for the slots between which it is not seen (D. Siegmund, B. Yakir, The Statistics of Gene Mapping, Springer 2007,
    section 5.3).
    """
    b = np.linspace(*_BOUNDS)
    rate = np.zeros(b.size)
    for w in half_widths:
        alpha = 1.5 / w
        x = b * np.sqrt(2.0 * alpha)
        density, share = np.exp(-x * x / 8.0) / np.sqrt(2.0 * np.pi), special.ndtr(x / 2.0)
        unseen = (2.0 / x) * (share - 0.5) / (x / 2.0 * share + density)
        rate += 2.0 * alpha * b * np.exp(-b * b / 2.0) / np.sqrt(2.0 * np.pi) * unseen
    return float(np.interp(-np.log(run_length), np.log(rate[::-1]), b[::-1])) ** 2


def variance_table(scales: IntArray, variances: FloatArray) -> FloatArray:
    """Return v for a shorter half of 0 … MAX_SCALE used samples: the scales' variances, interpolated in log n."""
    return np.exp(np.interp(_LOG_USED, np.log(scales), np.log(variances)))


def peaks_behind_gaps(sums: RunningSums) -> Candidates:
    """Return a peak behind each long stretch without a used sample: gaps of telemetry, the dead band around zero.

    No contrast of the fixed scales spans such a stretch, so that a jump in it would never be seen. Its scale reaches
    MAX_SCALE slots beyond the stretch; whether there is a jump is for the selection to decide. The statistic is
    infinite, which only makes it the first of its scale to be tried.

    Parameters
    ----------
    sums
        Running sums of the window; their checkpoints alone show where no sample is used.
    """
    arrays, slots = sums.arrays, sums.slots
    count = arrays.checkpoints[: slots // STRIDE + 1, 0]
    empty = count[1:] == count[:-1]
    begin, end = STRIDE * np.flatnonzero(np.diff(np.concatenate(([False], empty, [False])))).reshape(-1, 2).T
    index, scale = [], []
    for first, stop in zip(begin.tolist(), end.tolist(), strict=True):
        there = np.flatnonzero(arrays.used[stop : min(stop + STRIDE, slots)])
        if first > 0 and stop - first >= MAX_SCALE // 2 and there.size:
            index.append(stop + int(there[0]))
            scale.append(stop - first + MAX_SCALE)
    found = np.array(index, dtype=np.int64)
    return Candidates(found, np.array(scale, dtype=np.int64), np.full(found.size, np.inf), np.zeros(found.size))


class Threshold(NamedTuple):
    """What a jump must clear to be a candidate.

    Attributes
    ----------
    variances
        float64 (MAX_SCALE + 1,), see `variance_table`.
    threshold
        χ² threshold of the normalised statistic.
    outlier
        See `noise.largest_outlier`.
    """

    variances: FloatArray
    threshold: float
    outlier: float
