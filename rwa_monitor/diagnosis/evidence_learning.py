"""What a window learns of itself while its samples come in: noise, what counts as a peak, the slope, certain jumps.

Compiled, plain functions over arrays; `evidence_kernel` says when each is called.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numba
import numpy as np
from scipy import special

from rwa_monitor.diagnosis.changepoints import contrast, kept_apart, order_in_turn
from rwa_monitor.diagnosis.estimation import slope_within
from rwa_monitor.diagnosis.noise import SMALLEST_STD, contrast_variances, quiet_levels, scale_variances
from rwa_monitor.diagnosis.peaks import peaks_above
from rwa_monitor.diagnosis.running_sums import SumArrays
from rwa_monitor.diagnosis.tails import quantile_bins
from rwa_monitor.diagnosis.wglr import (
    COUNT_CONFIRMED,
    COUNT_PEAKS,
    PEAK_INDEX,
    PEAK_JUMP,
    PEAK_SCALE,
    PEAK_STATISTIC,
    STEP,
    PeakArrays,
)
from rwa_monitor.samples import FloatArray, IntArray

CONFIRMED_RATE: Final = 1e-9  # false-alarm probability of a sample, as in the paper
CONFIRMED_STATISTIC: Final = float(special.chdtri(1, CONFIRMED_RATE))
KEPT_STATISTIC: Final = 12.0  # peaks below are not kept: no threshold at the close is as low
CERTAIN_STATISTIC: Final = 30.0  # peaks that split the window while its slope is first estimated
LEAST_SHARE: Final = 0.8  # of the variance by mean squares that a robust one may be: heavy tails make it smaller
SMALLEST_WEIGHT: Final = 1e-12  # W_b where nothing is known of the slope: only keeps 0/0 away
SMALLEST_SLOPE_SPREAD: Final = 0.05  # [of the slope] the slope known so far is never trusted further than that
ANY_SLOPE: Final = 3.0  # times the slope learned or nominal: no anomaly of viscous friction is further off
SMALLEST_SLOPE: Final = 0.1  # of the dry torque at nominal speed, for a wheel with next to no viscous friction
PAPER_WEIGHT: Final = 1e-4  # W_b, in the paper's units
FAR_AWAY: Final = -(2**40)  # a slot that lies near none


class Learned(NamedTuple):
    """What a window has learned of itself so far, brought up to date in place.

    Attributes
    ----------
    bars
        float64 (3, S), of each scale: the variance of its contrast, NaN where not known; and the statistics [torque²]
        from which a peak is kept, and is sure, infinite where not known.
    announced
        int64 (STEP + 1,): the last indices announced, in turns, and how many there were.
    numbers
        float64 (8,): centre and weight of the slope's prior, dead band, and speed from which its sign is certain, all
        normalised, the last two NaN until the first chunk is there; the three of `quantile_bins`; and the largest
        outlier of heavy tails, as the answer to HEAVY_TAILS, else NaN.
    """

    bars: FloatArray
    announced: IntArray
    numbers: FloatArray


VARIANCE: Final = 0  # rows of `Learned.bars`
FLOOR: Final = 1
SURE: Final = 2
SLOPE: Final = 0  # places in `Learned.numbers`
WEIGHT: Final = 1
BAND: Final = 2
CERTAIN: Final = 3
COUNTED: Final = 4
MIDDLE: Final = 5
END: Final = 6
OUTLIER: Final = 7


def nothing_learned(scales: int, slope: float) -> Learned:
    """Return what a window knows before its first sample: a centre for its slope."""
    announced: IntArray = np.full(STEP + 1, FAR_AWAY, dtype=np.int64)
    announced[STEP] = 0
    return Learned(
        bars=np.repeat([[np.nan], [np.inf], [np.inf]], scales, axis=1),
        announced=announced,
        numbers=np.array([slope, PAPER_WEIGHT, np.nan, np.nan, 0.0, 0.0, 0.0, np.nan]),
    )


# ---- noise -----------------------------------------------------------------------------------------------------------


@numba.njit(cache=True, error_model="numpy", nogil=True)
def learn_noise(
    block_sums: FloatArray,
    block_pairs: FloatArray,
    histogram: IntArray,
    scales: IntArray,
    start_variance: float,
) -> tuple[FloatArray, FloatArray, FloatArray, tuple[float, int, int]]:
    """Return what the noise is as far as a window has come.

    Parameters
    ----------
    block_sums, block_pairs
        Of the blocks that are complete, see `block_differences`.
    histogram, scales, start_variance
        As for `scale_variances`.

    Returns
    -------
    levels, counts, variances, quantiles
        As `quiet_levels` has them; float64 (S,), the variance of each scale's contrast; and `quantile_bins` of the
        narrowest scale's statistic.
    """
    levels, counts = quiet_levels(block_sums, block_pairs)
    variances, implied = scale_variances(histogram, scales, start_variance), contrast_variances(levels, scales)
    for s in range(scales.size):
        # On a coarse lattice neighbours are mostly equal and quantiles say little; mean squares then hold the variance.
        variances[s] = max(variances[s], LEAST_SHARE * implied[s])
    return levels, counts, variances, quantile_bins(histogram[0])


@numba.njit(cache=True, error_model="numpy", nogil=True)
def set_bars(learned: Learned, scales: IntArray, outlier: float, paper: bool) -> None:
    """Set the statistics from which a peak of each scale is sure, and from which it is kept.

    A tail is known to a factor: twice the largest outlier by chance is sure, half of it is worth keeping. The paper
    keeps what is sure.
    """
    for s in range(scales.size):
        variance = learned.bars[VARIANCE, s]
        if not np.isfinite(variance):
            learned.bars[FLOOR, s] = learned.bars[SURE, s] = np.inf
            continue
        by_chance = outlier**2 / (2.0 * scales[s])
        sure = max(CONFIRMED_STATISTIC * variance, 4.0 * by_chance)
        learned.bars[FLOOR, s] = sure if paper else max(KEPT_STATISTIC * variance, 0.25 * by_chance)
        learned.bars[SURE, s] = sure


# ---- slope -----------------------------------------------------------------------------------------------------------


@numba.njit(cache=True, error_model="numpy", nogil=True)
def first_weight(noise_std: float, prior_std: float, paper: bool) -> float:
    """Return the weight of the slope's prior before the window has shown anything of it; NaN: nothing known."""
    if np.isnan(prior_std):
        return SMALLEST_WEIGHT
    return PAPER_WEIGHT if paper else max(noise_std, SMALLEST_STD) ** 2 / prior_std**2


@numba.njit(cache=True, error_model="numpy", nogil=True)
def learn_slope(
    slots: int,
    peaks: PeakArrays,
    learned: Learned,
    sums: SumArrays,
    scales: IntArray,
    prior_mean: float,
    prior_std: float,
) -> None:
    """Centre the slope's prior on what the window has shown so far; takes effect with the next slot.

    Parameters
    ----------
    slots
        Slots of the window so far, which are in the sums.
    peaks, learned, sums, scales
        Of the window so far.
    prior_mean, prior_std
        What was known of the slope before it; NaN where nothing was.
    """
    variances, variance = learned.bars[VARIANCE], 0.0
    for s in range(scales.size):
        if np.isfinite(variances[s]):
            variance = max(variance, variances[s])
    if variance == 0.0:
        return
    count = peaks.counters[COUNT_PEAKS]
    index, scale, statistic, _ = peaks_above(peaks.slots, peaks.values, count, scales, variances, CERTAIN_STATISTIC)
    order = order_in_turn(scale, statistic)
    certain = kept_apart(index[order], scale[order])
    slope, std = slope_within(slots, certain, np.full(certain.size, STEP // 4), sums, variance, prior_mean, prior_std)
    if np.isfinite(std):
        spread = max(std, SMALLEST_SLOPE_SPREAD * abs(slope), SMALLEST_STD)
        learned.numbers[SLOPE], learned.numbers[WEIGHT] = slope, max(variance / spread**2, SMALLEST_WEIGHT)


# ---- jumps -----------------------------------------------------------------------------------------------------------


@numba.njit(cache=True, error_model="numpy", nogil=True)
def tell_confirmed(
    peaks: PeakArrays,
    learned: Learned,
    sums: SumArrays,
    scales: IntArray,
    nominal_slope: float,
    paper: bool,
    told: int,
) -> int:
    """Tell which of the peaks that the last scan confirmed are new, and sure whatever the slope is.

    In a slew, a slope that is off by some per cent looks like jumps: that of the nominal wheel while viscous friction
    is anomalous, that of an earlier part of the window while the anomaly grows. Only a peak that stays one for any
    slope is certain while the window is open; at its close the window's own slope decides. The paper's are told as
    they are.

    Parameters
    ----------
    peaks, learned, sums, scales
        Of the window so far. What is told goes behind the first `told` rows of `peaks.told` and `peaks.told_values`.
    nominal_slope
        0 where there is none.
    paper
        Whether to do as the paper does.
    told
        How many have been told already.

    Returns
    -------
    int
        How many have been told now.
    """
    slope, weight = learned.numbers[SLOPE], learned.numbers[WEIGHT]
    most_slope = ANY_SLOPE * max(abs(slope), abs(nominal_slope), SMALLEST_SLOPE)
    for row in range(peaks.counters[COUNT_CONFIRMED]):
        p = peaks.confirmed[row]
        s, index = peaks.slots[p, PEAK_SCALE], peaks.slots[p, PEAK_INDEX]
        variance, statistic, jump = (
            learned.bars[VARIANCE, s],
            peaks.values[p, PEAK_STATISTIC],
            peaks.values[p, PEAK_JUMP],
        )
        if not paper:
            if np.min(np.abs(learned.announced[:STEP] - index)) <= scales[s]:
                continue
            statistic, jump = contrast(index, scales[s], slope, min(weight, variance / most_slope**2), sums)
            if not statistic > learned.bars[SURE, s]:
                continue
            learned.announced[learned.announced[STEP] % STEP] = index
            learned.announced[STEP] += 1
        normalised = statistic / variance
        peaks.told[told] = index
        peaks.told_values[0, told], peaks.told_values[1, told] = jump, abs(jump) / np.sqrt(normalised)
        peaks.told_values[2, told] = normalised
        told += 1
    return told
