"""The compiled way of a window's samples: in, through detection, into all that the window keeps of them.

A batch of samples is one call of `gather`: the loops are functions of their own, but the way from Python into compiled
code costs as much as the work on 100 samples does. Groups of arrays come in as plain tuples, which are unpacked in half
the time that named ones take, and get their names here.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numba
import numpy as np
from scipy import special

from rwa_monitor.diagnosis.evidence_learning import (
    BAND,
    CERTAIN,
    COUNTED,
    END,
    FLOOR,
    MIDDLE,
    OUTLIER,
    SLOPE,
    SURE,
    VARIANCE,
    WEIGHT,
    Learned,
    first_weight,
    learn_noise,
    learn_slope,
    set_bars,
    tell_confirmed,
)
from rwa_monitor.diagnosis.medians import median
from rwa_monitor.diagnosis.noise import BLOCK, LAGS, block_differences
from rwa_monitor.diagnosis.running_sums import SumArrays, extend_checkpoints, find_centre
from rwa_monitor.diagnosis.structure import StructureArrays, count_signs, extend_structure, pieces_before
from rwa_monitor.diagnosis.tails import are_heavy
from rwa_monitor.diagnosis.wglr import (
    CHUNK,
    COUNT_CONFIRMED,
    COUNT_PEAKS,
    STEP,
    PeakArrays,
    ScanSettings,
    ScanState,
    scan,
)
from rwa_monitor.samples import BoolArray, FloatArray, IntArray

LARGEST_VALUE: Final = 1e4  # normalised speed or friction beyond is a broken word of telemetry, not a wheel's
SPEED_NOISES: Final = 5.0  # dead band in standard deviations of the speed's noise: the sign of ω is certain beyond
# Why `gather` comes back: all is done, there is no room for the peaks of the next chunk, or the tails of the noise look
# heavy: only Python knows Student's t, and how large an outlier then is.
ALL_DONE: Final = 0
NO_ROOM: Final = 1
HEAVY_TAILS: Final = 2

_NORMAL_MEDIAN: Final = float(special.ndtri(0.75))  # median of |N(0, 1)|


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
    """What a window's slots go into, in the order in which `gather` takes it.

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
    scales
        int64 (S,), half-widths of the scales [slots].
    bars, announced, numbers
        See `Learned`.
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
    scales: IntArray
    bars: FloatArray
    announced: IntArray
    numbers: FloatArray


class WindowSettings(NamedTuple):
    """How a window's slots are taken. What nobody knows is NaN.

    Attributes
    ----------
    speed_unit, torque_unit
        What x and z are normalised by [rad/s], [N m].
    dead_band
        Normalised; NaN: what the speed's noise asks for.
    angle_per_x
        Angle by which the wheel turns in one slot at x = 1 [rad].
    block_hop, stretch_hop
        Slots from one block of the noise, and one stretch of the structure, to the next.
    start_std
        Standard deviation of the noise expected before any data, normalised.
    prior_mean, prior_std
        What is known of the slope before the window.
    nominal_slope
        0 where there is none.
    outlier
        Largest outlier by chance of Gaussian noise, in standard deviations.
    chunk_peaks
        As for `scan`.
    paper
        Whether to detect as the paper does.
    """

    speed_unit: float
    torque_unit: float
    dead_band: float
    angle_per_x: float
    block_hop: int
    stretch_hop: int
    start_std: float
    prior_mean: float
    prior_std: float
    nominal_slope: float
    outlier: float
    chunk_peaks: int
    paper: bool


@numba.njit(cache=True, error_model="numpy", nogil=True)
def gather(
    speed: FloatArray,
    torque: FloatArray,
    good: BoolArray,
    filled: int,
    done: int,
    last: bool,
    arrays: tuple[Any, ...],
    settings: tuple[Any, ...],
    peak_arrays: tuple[Any, ...],
) -> tuple[int, int, int, int]:
    """Take new slots into a window, and detect in all that are there.

    Parameters
    ----------
    speed, torque, good
        (n,), the new slots as they were measured.
    filled, done
        Slots that the window holds, and those in which it has detected.
    last
        Whether no slot will follow: else the last ones wait until a step of STEP is full, the first until a chunk is.
    arrays, settings, peak_arrays
        `WindowArrays`, `WindowSettings` and `PeakArrays`, as plain tuples.

    Returns
    -------
    tuple[int, int, int, int]
        How many of the new slots are good, where detection ended, how many jumps it told of (see `tell_confirmed`), and
        why it ended: ALL_DONE, NO_ROOM or HEAVY_TAILS. In the last two cases it is to be called again, without a slot.
    """
    window, by, peaks = WindowArrays(*arrays), WindowSettings(*settings), PeakArrays(*peak_arrays)
    count = _take(speed, torque, good, filled, window, by) if speed.size else 0
    filled, told = filled + speed.size, 0
    ready = filled if last else filled - filled % STEP
    if np.isnan(window.numbers[BAND]):
        if ready < CHUNK and not last:
            return count, done, told, ALL_DONE
        if _begin(min(ready, CHUNK), window, by, peaks):
            return count, done, told, HEAVY_TAILS
    learned, sums = _learned_of(window), _sums_of(window)
    if not np.isnan(window.numbers[OUTLIER]):
        set_bars(learned, window.scales, window.numbers[OUTLIER], by.paper)
        window.numbers[OUTLIER] = np.nan
    while done < ready:
        if done % CHUNK == 0 and peaks.counters[COUNT_PEAKS] + by.chunk_peaks > peaks.slots.shape[0]:
            return count, done, told, NO_ROOM
        change = CHUNK  # variances, floors and slope change after 1, 2, 4, 8 … chunks
        while change <= done:
            change *= 2
        done = _detect(done, min(ready, change), window, by, peaks)
        if peaks.counters[COUNT_CONFIRMED] > 0:
            told = tell_confirmed(peaks, learned, sums, window.scales, by.nominal_slope, by.paper, told)
        if done == change and done > CHUNK:
            heavy = _refresh(done, window, by)
            if not by.paper and window.running[0] >= CHUNK and _is_odd_power(done // CHUNK):
                learn_slope(done, peaks, learned, sums, window.scales, by.prior_mean, by.prior_std)
            if heavy:
                return count, done, told, HEAVY_TAILS
    return count, done, told, ALL_DONE


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _take(
    speed: FloatArray, torque: FloatArray, good: BoolArray, first: int, window: WindowArrays, by: WindowSettings
) -> int:
    """Take the slots from `first` on into x, z and good of a window, and their directions; return how many are good."""
    new = slice(first, first + speed.size)
    x, z, is_good = window.x[new], window.z[new], window.good[new]
    count = normalise(speed, torque, good, by.speed_unit, by.torque_unit, x, z, is_good)
    count_signs(first, speed, is_good, window.signs, window.counts)
    return count


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _begin(stop: int, window: WindowArrays, by: WindowSettings, peaks: PeakArrays) -> bool:
    """Learn dead band, weight of the prior and first variances from the slots [0, stop); return as `_refresh`."""
    x, z, good, used = window.x, window.z, window.good, window.used
    # The second difference of a smooth speed is noise, of √6 times its standard deviation.
    certain = SPEED_NOISES * _median_bend(x[:stop], good[:stop]) / (_NORMAL_MEDIAN * np.sqrt(6.0))
    band = certain if np.isnan(by.dead_band) else by.dead_band
    window.numbers[BAND], window.numbers[CERTAIN] = band, certain
    mark_used(x, good, band, 0, stop, used)
    std = by.start_std
    if np.isnan(std):
        step = _median_step(x[:stop], z[:stop], used[:stop], window.numbers[SLOPE])
        std = step / (_NORMAL_MEDIAN * np.sqrt(2.0))
    window.numbers[WEIGHT] = first_weight(std, by.prior_std, by.paper)
    # The first chunk is scanned twice: for the histogram alone, and when it is known what to look for.
    window.histogram[:] = 0
    state = ScanState(window.prefix, window.histogram)
    scan(x, z, used, 0, stop, True, _scanning(window, by), state, peaks, by.chunk_peaks)
    return _refresh(0, window, by)


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _detect(start: int, stop: int, window: WindowArrays, by: WindowSettings, peaks: PeakArrays) -> int:
    """Detect in the slots [start, stop) and add them to all sums, as far as there is room for peaks; return the end."""
    x, z, good, used = window.x, window.z, window.good, window.used
    if start >= CHUNK:
        mark_used(x, good, window.numbers[BAND], start, stop, used)
    state = ScanState(window.prefix, window.histogram)
    end = scan(x, z, used, start, stop, start >= CHUNK, _scanning(window, by), state, peaks, by.chunk_peaks)
    sums = _sums_of(window)
    find_centre(sums, window.running, start, end)
    extend_checkpoints(sums, window.running, start, end)
    structure = StructureArrays(window.signs, window.counts, window.near_zero, window.zeros, window.ripple)
    certain = window.numbers[CERTAIN]
    extend_structure(x, z, good, used, start, end, certain, by.angle_per_x, by.stretch_hop, structure)
    first, last = _blocks_before(start, window, by), _blocks_before(end, window, by)
    if last > first:
        slope, weight = window.numbers[SLOPE], window.numbers[WEIGHT]
        block_differences(x, z, used, first, last, by.block_hop, slope, weight, window.block_sums, window.block_pairs)
    return end


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _refresh(done: int, window: WindowArrays, by: WindowSettings) -> bool:
    """Bring the variance of each scale, and what is kept and sure, up to date.

    Returns whether the tails of the noise look heavy: then the bars, made for Gaussian ones, are to be set again.
    """
    blocks = _blocks_before(done, window, by)
    _, _, variances, quantiles = learn_noise(
        window.block_sums[:blocks],
        window.block_pairs[:blocks],
        window.histogram,
        window.scales,
        by.start_std**2,
    )
    window.bars[VARIANCE] = variances
    window.numbers[COUNTED], window.numbers[MIDDLE], window.numbers[END] = quantiles
    gaussian = np.isfinite(variances[0]) and not by.paper  # which takes no outlier into account
    outlier = by.outlier * np.sqrt(variances[0]) if gaussian else 0.0
    set_bars(_learned_of(window), window.scales, outlier, by.paper)
    return gaussian and are_heavy(quantiles, variances[0])


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _is_odd_power(chunks: int) -> bool:
    """Return whether a power of two is 2, 8, 32 …: after so many chunks the slope is learned."""
    while chunks > 2:
        chunks //= 4
    return chunks == 2


@numba.njit(cache=True, error_model="numpy", nogil=True, inline="always")
def _blocks_before(slot: int, window: WindowArrays, by: WindowSettings) -> int:
    """Count the blocks of the noise that end by `slot`."""
    return pieces_before(slot, BLOCK + LAGS, by.block_hop, window.block_sums.shape[0])


@numba.njit(cache=True, error_model="numpy", nogil=True, inline="always")
def _scanning(window: WindowArrays, by: WindowSettings) -> ScanSettings:
    """Return how to scan, by what is known now."""
    numbers = window.numbers
    floors, sure = window.bars[FLOOR], window.bars[SURE]
    return ScanSettings(window.scales, numbers[WEIGHT], numbers[SLOPE], floors, sure, by.paper)


@numba.njit(cache=True, error_model="numpy", nogil=True, inline="always")
def _sums_of(window: WindowArrays) -> SumArrays:
    """Return the arrays of the running sums."""
    return SumArrays(window.checkpoints, window.x, window.z, window.used, window.centre)


@numba.njit(cache=True, error_model="numpy", nogil=True, inline="always")
def _learned_of(window: WindowArrays) -> Learned:
    """Return the arrays of what was learned."""
    return Learned(window.bars, window.announced, window.numbers)


@numba.njit(cache=True, error_model="numpy", nogil=True)
def mark_used(x: FloatArray, good: BoolArray, band: float, start: int, stop: int, used: BoolArray) -> None:
    """Mark the slots of [start, stop) that are good and turn faster than the dead band."""
    speed, there, out = x[start:stop], good[start:stop], used[start:stop]
    for k in range(speed.size):  # without branches: several slots at once
        out[k] = there[k] & (speed[k] >= band) & (speed[k] > 0.0)


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _median_bend(x: FloatArray, good: BoolArray) -> float:
    """Return the median size of the second differences of the good samples; 0 with less than three."""
    there = x[good]
    if there.size < 3:
        return 0.0
    steps = there[1:] - there[:-1]
    return median(np.abs(steps[1:] - steps[:-1]))


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _median_step(x: FloatArray, z: FloatArray, used: BoolArray, slope: float) -> float:
    """Return the median size of the differences of neighbouring used z - slope x; 0 with less than two."""
    residual = z[used] - slope * x[used]
    if residual.size < 2:
        return 0.0
    return median(np.abs(residual[1:] - residual[:-1]))
