"""The compiled loops of `evidence`: samples in, and all that a window keeps of them. Plain functions over arrays.

A batch of samples is a call of `take` and one of `advance`: each loop is a function of its own, but the way from Python
into compiled code costs as much as the work on 100 samples does. Groups of arrays come in as plain tuples, which are
unpacked in half the time that named ones take, and get their names here.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numba
import numpy as np
from scipy import special

from rwa_monitor.diagnosis.changepoints import contrast
from rwa_monitor.diagnosis.noise import (
    BLOCK,
    LAGS,
    block_differences,
    contrast_variances,
    quiet_levels,
    scale_variances,
)
from rwa_monitor.diagnosis.running_sums import SumArrays, extend_checkpoints, find_centre
from rwa_monitor.diagnosis.structure import StructureArrays, count_signs, extend_structure, pieces_before
from rwa_monitor.diagnosis.tails import quantile_bins
from rwa_monitor.diagnosis.wglr import (
    CHUNK,
    COUNT_CONFIRMED,
    PEAK_INDEX,
    PEAK_SCALE,
    STEP,
    PeakArrays,
    ScanSettings,
    ScanState,
    scan,
)
from rwa_monitor.samples import BoolArray, FloatArray, IntArray

CONFIRMED_RATE: Final = 1e-9  # false-alarm probability of a sample, as in the paper
CONFIRMED_STATISTIC: Final = float(special.chdtri(1, CONFIRMED_RATE))
KEPT_STATISTIC: Final = 12.0  # peaks below are not kept: no threshold at the close is as low
LEAST_SHARE: Final = 0.8  # of the variance by mean squares that a robust one may be: heavy tails make it smaller
LARGEST_VALUE: Final = 1e4  # normalised speed or friction beyond is a broken word of telemetry, not a wheel's


@numba.njit(cache=True, error_model="numpy", nogil=True)
def normalise(
    speed: FloatArray,
    torque: FloatArray,
    good: BoolArray,
    speed_unit: float,
    torque_unit: float,
    x: FloatArray,
    z: FloatArray,
    is_good: BoolArray,
) -> int:
    """Write x = |ω|/unit, z = sign(ω)·torque/unit and whether the slot is good; return the number of good slots.

    Where it is not good, x and z are zero.
    """
    count = 0
    most_speed, most_torque = LARGEST_VALUE * speed_unit, LARGEST_VALUE * torque_unit
    for k in range(speed.size):  # without branches: several slots at once
        # Written so that NaN fails.
        fits = good[k] & (abs(speed[k]) <= most_speed) & (abs(torque[k]) <= most_torque)
        is_good[k] = fits
        count += fits
        turning, friction = (speed[k] if fits else 0.0), (torque[k] if fits else 0.0)
        x[k] = abs(turning) / speed_unit
        z[k] = ((turning > 0.0) - (turning < 0.0)) * friction / torque_unit
    return count


class WindowArrays(NamedTuple):
    """What a window's slots go into, in the order in which `advance` takes it.

    Attributes
    ----------
    x, z, good, used
        (slots,), the samples, normalised; which are good, and which of those are used.
    checkpoints, centre, running
        See `RunningSums`.
    signs, counts, near_zero, zeros, ripple
        See `StructureArrays`.
    block_sums, block_pairs
        float64 (B, LAGS), see `block_differences`.
    prefix, histogram
        See `ScanState`.
    """

    x: FloatArray
    z: FloatArray
    good: BoolArray
    used: BoolArray
    checkpoints: FloatArray
    centre: FloatArray
    running: FloatArray
    signs: IntArray
    counts: IntArray
    near_zero: FloatArray
    zeros: FloatArray
    ripple: FloatArray
    block_sums: FloatArray
    block_pairs: FloatArray
    prefix: FloatArray
    histogram: IntArray


class WindowSettings(NamedTuple):
    """How a window's slots are taken; known once its first chunk is there.

    Attributes
    ----------
    band, certain
        Dead band, and the speed from which its sign is certain, normalised.
    angle_per_x
        Angle by which the wheel turns in one slot at x = 1 [rad].
    block_hop, stretch_hop
        Slots from one block of the noise, and one stretch of the structure, to the next.
    """

    band: float
    certain: float
    angle_per_x: float
    block_hop: int
    stretch_hop: int


@numba.njit(cache=True, error_model="numpy", nogil=True)
def take(
    speed: FloatArray,
    torque: FloatArray,
    good: BoolArray,
    first: int,
    speed_unit: float,
    torque_unit: float,
    samples: tuple[FloatArray, FloatArray, BoolArray],
    turns: tuple[IntArray, IntArray],
) -> int:
    """Take the slots from `first` on into x, z and good of a window, and their directions; return how many are good."""
    x, z, is_good = samples
    signs, counts = turns
    new = slice(first, first + speed.size)
    count = normalise(speed, torque, good, speed_unit, torque_unit, x[new], z[new], is_good[new])
    count_signs(first, speed, is_good[new], signs, counts)
    return count


@numba.njit(cache=True, error_model="numpy", nogil=True)
def advance(
    start: int,
    stop: int,
    arrays: tuple[Any, ...],
    window_settings: tuple[Any, ...],
    scan_settings: tuple[Any, ...],
    peak_arrays: tuple[Any, ...],
    chunk_peaks: int,
) -> tuple[int, int]:
    """Detect in the slots [start, stop) of a window and add them to all sums, as far as there is room for peaks.

    Parameters
    ----------
    start, stop
        The new slots, as for `scan`. Those of the first chunk are marked as used, and are in the histogram, already.
    arrays, window_settings, scan_settings, peak_arrays
        `WindowArrays`, `WindowSettings`, `ScanSettings` and `PeakArrays`, as plain tuples.
    chunk_peaks
        As for `scan`.

    Returns
    -------
    tuple[int, int]
        Where it ended, and the number of peaks that were confirmed.
    """
    window, settings = WindowArrays(*arrays), WindowSettings(*window_settings)
    scanning, peaks = ScanSettings(*scan_settings), PeakArrays(*peak_arrays)
    x, z, good, used = window.x, window.z, window.good, window.used
    if start >= CHUNK:
        mark_used(x, good, settings.band, start, stop, used)
    state = ScanState(window.prefix, window.histogram)
    end = scan(x, z, used, start, stop, start >= CHUNK, scanning, state, peaks, chunk_peaks)
    sums = SumArrays(window.checkpoints, x, z, used, window.centre)
    find_centre(sums, window.running, start, end)
    extend_checkpoints(sums, window.running, start, end)
    structure = StructureArrays(window.signs, window.counts, window.near_zero, window.zeros, window.ripple)
    extend_structure(
        x, z, good, used, start, end, settings.certain, settings.angle_per_x, settings.stretch_hop, structure
    )
    hop, blocks = settings.block_hop, window.block_sums.shape[0]
    first, last = pieces_before(start, BLOCK + LAGS, hop, blocks), pieces_before(end, BLOCK + LAGS, hop, blocks)
    if last > first:
        block_differences(
            x, z, used, first, last, hop, scanning.slope, scanning.weight, window.block_sums, window.block_pairs
        )
    return end, peaks.counters[COUNT_CONFIRMED]


@numba.njit(cache=True, error_model="numpy", nogil=True)
def mark_used(x: FloatArray, good: BoolArray, band: float, start: int, stop: int, used: BoolArray) -> None:
    """Mark the slots of [start, stop) that are good and turn faster than the dead band."""
    speed, there, out = x[start:stop], good[start:stop], used[start:stop]
    for k in range(speed.size):  # without branches: several slots at once
        out[k] = there[k] & (speed[k] >= band) & (speed[k] > 0.0)


@numba.njit(cache=True, error_model="numpy", nogil=True)
def median_bend(x: FloatArray, good: BoolArray) -> float:
    """Return the median size of the second differences of the good samples; 0 with less than three."""
    there = x[good]
    if there.size < 3:
        return 0.0
    steps = there[1:] - there[:-1]
    return float(np.median(np.abs(steps[1:] - steps[:-1])))


@numba.njit(cache=True, error_model="numpy", nogil=True)
def median_step(x: FloatArray, z: FloatArray, used: BoolArray, slope: float) -> float:
    """Return the median size of the differences of neighbouring used z - slope x; 0 with less than two."""
    residual = z[used] - slope * x[used]
    if residual.size < 2:
        return 0.0
    return float(np.median(np.abs(residual[1:] - residual[:-1])))


@numba.njit(cache=True, error_model="numpy", nogil=True)
def learn_noise(
    block_sums: FloatArray,
    block_pairs: FloatArray,
    histogram: IntArray,
    scales: IntArray,
    strides: IntArray,
    start_variance: float,
) -> tuple[FloatArray, FloatArray, FloatArray, tuple[float, int, int]]:
    """Return what the noise is as far as a window has come.

    Parameters
    ----------
    block_sums, block_pairs
        Of the blocks that are complete, see `block_differences`.
    histogram, scales, strides, start_variance
        As for `scale_variances`.

    Returns
    -------
    levels, counts, variances, quantiles
        As `quiet_levels` has them; float64 (S,), the variance of each scale's contrast; and `quantile_bins` of the
        narrowest scale's statistic.
    """
    levels, counts = quiet_levels(block_sums, block_pairs)
    variances, implied = scale_variances(histogram, scales, strides, start_variance), contrast_variances(levels, scales)
    for s in range(scales.size):
        # On a coarse lattice neighbours are mostly equal and quantiles say little; mean squares then hold the variance.
        variances[s] = max(variances[s], LEAST_SHARE * implied[s])
    return levels, counts, variances, quantile_bins(histogram[0])


@numba.njit(cache=True, error_model="numpy", nogil=True)
def bars(variances: FloatArray, scales: IntArray, outlier: float) -> tuple[FloatArray, FloatArray]:
    """Return the statistics [torque²] from which a peak of each scale is sure, and from which it is kept, (S,) each.

    A tail is known to a factor: twice the largest outlier by chance is sure, half of it is worth keeping. Infinite
    where the variance is not known.
    """
    sure, kept = np.full(scales.size, np.inf), np.full(scales.size, np.inf)
    for s in range(scales.size):
        if np.isfinite(variances[s]):
            by_chance = outlier**2 / (2.0 * scales[s])
            sure[s] = max(CONFIRMED_STATISTIC * variances[s], 4.0 * by_chance)
            kept[s] = max(KEPT_STATISTIC * variances[s], 0.25 * by_chance)
    return sure, kept


class Judge(NamedTuple):
    """How confirmed peaks are judged again.

    Attributes
    ----------
    scales, variances, sure
        (S,), the scales, the variance of each one's contrast, and the statistic from which it is sure.
    weight
        Weight of the slope's prior, as the scan has it.
    slope, most_slope
        Centre of the prior, and the largest slope that there may be.
    """

    scales: IntArray
    variances: FloatArray
    sure: FloatArray
    weight: float
    slope: float
    most_slope: float


@numba.njit(cache=True, error_model="numpy", nogil=True)
def judge_confirmed(
    peak_arrays: tuple[Any, ...], judge: tuple[Any, ...], sum_arrays: tuple[Any, ...], announced: IntArray
) -> tuple[IntArray, FloatArray]:
    """Judge the peaks that the last scan confirmed; return those that are new, and still sure whatever the slope is.

    Parameters
    ----------
    peak_arrays, judge, sum_arrays
        `PeakArrays`, `Judge` and `SumArrays`, as plain tuples.
    announced
        int64 (STEP + 1,): the last indices announced, in turns, and how many there were; brought up to date.

    Returns
    -------
    index, values
        int64 (n,), and float64 (3, n): jump, its standard deviation, and the normalised statistic.
    """
    peaks, by, sums = PeakArrays(*peak_arrays), Judge(*judge), SumArrays(*sum_arrays)
    most = peaks.counters[COUNT_CONFIRMED]
    found, values = np.empty(most, dtype=np.int64), np.empty((3, most))
    count = 0
    for row in range(most):
        p = peaks.confirmed[row]
        s, index = peaks.slots[p, PEAK_SCALE], peaks.slots[p, PEAK_INDEX]
        if np.min(np.abs(announced[:STEP] - index)) <= by.scales[s]:
            continue
        weight = min(by.weight, by.variances[s] / by.most_slope**2)
        statistic, jump = contrast(index, by.scales[s], by.slope, weight, sums)
        if statistic > by.sure[s]:
            announced[announced[STEP] % STEP] = index
            announced[STEP] += 1
            normalised = statistic / by.variances[s]
            found[count] = index
            values[0, count], values[1, count], values[2, count] = jump, abs(jump) / np.sqrt(normalised), normalised
            count += 1
    return found[:count], values[:, :count]
