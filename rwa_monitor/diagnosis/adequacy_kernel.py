"""The compiled loops of `adequacy`: plain functions over the arrays of a window."""

from __future__ import annotations

from typing import Final

import numba
import numpy as np
from scipy import special

from rwa_monitor.diagnosis.medians import median
from rwa_monitor.samples import BoolArray, FloatArray, IntArray

MIN_INTERVAL: Final = 30  # samples: shorter intervals do not know their slope

SIDE_BLOCKS: Final = 4

FEWEST_NEAR_ZERO: Final = 4  # samples of a crossing

RIPPLE_CAP: Final = 40.0  # counts at most, of the power in one stretch: a jump in it looks like any frequency

PERSISTENCE_LAGS: Final = (2, 8)
FEWEST_INTERVALS: Final = 3  # from which one may be left out
FEWEST_BLOCKS: Final = 40  # with fewer, the value is not yet normal
LARGEST_BLOCK: Final = 4.0  # standard deviations that one block counts at most
_MEDIAN_TO_STD: Final = float(1.0 / special.ndtri(0.75))


@numba.njit(cache=True, error_model="numpy", nogil=True)
def deviations_of_slopes(moments: FloatArray, variance: float) -> tuple[FloatArray, FloatArray]:
    """Return each interval's slope less the common one in standard deviations, and its mean speed; (intervals,).

    `moments` are float64 (6, intervals), `variance` that of the noise of a long mean.
    """
    deviation, spread, speed = np.empty((3, moments.shape[1]))
    usable, information, pull = 0, 0.0, 0.0
    for i in range(moments.shape[1]):
        n, x, z, xx, xz = moments[0, i], moments[1, i], moments[2, i], moments[3, i], moments[4, i]
        own = xx - x * x / max(n, 1.0)
        # The slope must be known to a tenth of what speed spans: else rounding is read as a slope.
        if n >= MIN_INTERVAL and own > 1e-9 * max(xx, 1e-300):
            cross = xz - x * z / n
            deviation[usable], spread[usable], speed[usable] = cross / own, own, x / n
            usable, information, pull = usable + 1, information + own, pull + cross
    if usable < 2 or not variance > 0.0:
        usable = 0
    for i in range(usable):
        deviation[i] = (deviation[i] - pull / information) * np.sqrt(spread[i] / variance)
    return deviation[:usable], speed[:usable]


@numba.njit(cache=True, error_model="numpy", nogil=True)
def side_differences(
    direction: FloatArray,
    n: FloatArray,
    friction: FloatArray,
    interval: IntArray,
    usable: BoolArray,
    variance: float,
    smallest: float,
) -> FloatArray:
    """Return what `adequacy.half_differences` does, float64 (crossings,).

    Parameters
    ----------
    direction
        See `Structure`.
    n, friction, interval, usable
        See `Blocks`.
    variance, smallest
        Of the noise of a long mean; and the standard deviation that a difference has at least.
    """
    found, count = np.empty(n.size), 0
    left = -1  # the last block before that turns one way only
    for right in range(n.size):
        if not usable[right] or abs(direction[right]) != 1.0:
            continue
        if left >= 0 and direction[right] * direction[left] < 0.0:
            before, before_n = _mean_beside(
                max(left - SIDE_BLOCKS + 1, 0), left + 1, left, direction, n, friction, interval, usable
            )
            after, after_n = _mean_beside(
                right, min(right + SIDE_BLOCKS, n.size), right, direction, n, friction, interval, usable
            )
            std = 0.5 * np.sqrt(variance * (1.0 / before_n + 1.0 / after_n))
            found[count] = 0.5 * (after - before) * direction[right] / max(std, smallest)
            count += 1
        left = right
    return found[:count]


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _mean_beside(
    first: int,
    stop: int,
    own: int,
    direction: FloatArray,
    n: FloatArray,
    friction: FloatArray,
    interval: IntArray,
    usable: BoolArray,
) -> tuple[float, float]:
    """Return mean friction and samples of the blocks [first, stop) of the same interval and direction as `own`."""
    total, count = 0.0, 0.0
    for b in range(first, stop):
        if usable[b] and interval[b] == interval[own] and direction[b] == direction[own]:
            total += n[b] * friction[b]
            count += n[b]
    return total / count, count


@numba.njit(cache=True, error_model="numpy", nogil=True)
def crossing_deviations(
    near_zero: FloatArray, direction: FloatArray, index: IntArray, level: FloatArray, viscous: float, block: int
) -> tuple[FloatArray, FloatArray]:
    """Return mean squared deviation and mean deviation of the dead band's friction at each crossing; (crossings,).

    Each block is compared with the best of the levels beside it. Where a jump lies in or next to the crossing, the
    worst block holds the jump and is left out. A crossing with too few samples is left out.

    Parameters
    ----------
    near_zero, direction
        See `Structure`.
    index, level, viscous
        See `Estimate`.
    block
        Slots of a block.
    """
    blocks = direction.size
    squares, deviations, count = np.empty(blocks), np.empty(blocks), 0
    stop = 0
    for first in range(blocks):
        if first < stop or near_zero[0, first] == 0.0:
            continue
        stop = first
        while stop < blocks and near_zero[0, stop] != 0.0:
            stop += 1
        if first == 0 or stop == blocks or not direction[first - 1] * direction[stop] < 0.0:
            continue
        low = np.searchsorted(index, (first - 1) * block)  # with a block on either side
        high = np.searchsorted(index, (stop + 1) * block)
        total, square, deviation = 0.0, 0.0, 0.0
        worst_n, worst, worst_apart = 0.0, 0.0, 0.0  # held back so far
        for b in range(first, stop):
            n, x, z, zz = near_zero[0, b], near_zero[1, b], near_zero[2, b], near_zero[3, b]
            least, apart = np.inf, 0.0
            for interval in range(low, high + 1):
                expected = level[interval] + viscous * x / n
                error = max(zz - 2.0 * expected * z + n * expected**2, 0.0)
                if error < least:
                    least, apart = error, z - n * expected
            if least > worst or worst_n == 0.0:
                n, worst_n, least, worst, apart, worst_apart = worst_n, n, worst, least, worst_apart, apart
            total, square, deviation = total + n, square + least, deviation + apart
        if high == low:
            total, square, deviation = total + worst_n, square + worst, deviation + worst_apart
        if total >= FEWEST_NEAR_ZERO:
            squares[count], deviations[count] = square / total, deviation / total
            count += 1
    return squares[:count], deviations[:count]


@numba.njit(cache=True, error_model="numpy", nogil=True)
def ripple_power(ripple: FloatArray) -> tuple[FloatArray, IntArray]:
    """Return the power at each harmonic over all stretches that tell it, capped, and their number; (harmonics,)."""
    power, told = np.zeros(ripple.shape[1]), np.zeros(ripple.shape[1], dtype=np.int64)
    for stretch in range(ripple.shape[0]):
        for h in range(power.size):
            if np.isfinite(ripple[stretch, h]):
                power[h] += min(ripple[stretch, h], RIPPLE_CAP)
                told[h] += 1
    return power, told


@numba.njit(cache=True, error_model="numpy", nogil=True)
def lasting(
    residual: FloatArray, n: FloatArray, usable: BoolArray, interval: IntArray, intervals: int, expected: FloatArray
) -> tuple[float, float]:
    """Return the significance of `adequacy.persistence`, and the largest mean product of residuals, per sample.

    Parameters
    ----------
    residual, n, usable, interval, intervals
        See `Blocks`.
    expected
        float64 (lags,), correlation of the means of two blocks at each lag by the noise's own memory.
    """
    if np.count_nonzero(usable) < FEWEST_BLOCKS:
        return 0.0, 0.0
    value = residual * np.sqrt(n)
    scale = _MEDIAN_TO_STD * median(np.abs(value[usable]))
    if not scale > 0.0:
        return 0.0, 0.0
    for b in range(value.size):
        value[b] = min(max(value[b] / scale, -LARGEST_BLOCK), LARGEST_BLOCK) if usable[b] else 0.0
    lags, first = expected.size, PERSISTENCE_LAGS[0]
    products, pairs = np.zeros((intervals, lags)), np.zeros((intervals, lags))
    end = value.size
    for i in range(intervals - 1, -1, -1):  # blocks are in the order of their intervals
        begin = end
        while begin > 0 and interval[begin - 1] == i:
            begin -= 1
        there = max(_both(usable[begin:end], usable[begin:end]), 1)
        for row in range(lags):
            stop = max(end - first - row, begin)
            products[i, row] = _product(value[begin:stop], value[begin + first + row : stop + first + row])
            pairs[i, row] = _both(usable[begin:stop], usable[begin + first + row : stop + first + row])
            # Taking out the level of an interval of m blocks correlates any two of them by -1/m.
            products[i, row] -= pairs[i, row] * (expected[row] - 1.0 / there)
        end = begin
    if np.count_nonzero(pairs[:, 0]) >= FEWEST_INTERVALS:
        worst = np.argmax(np.square(products).sum(axis=1))
        products[worst], pairs[worst] = 0.0, 0.0
    total, count = products.sum(axis=0), np.maximum(pairs.sum(axis=0), 1.0)
    return np.sum(total**2 / count), scale * scale * np.max(np.abs(total / count))


@numba.njit(cache=True, error_model="numpy", nogil=True, inline="always")
def _product(first: FloatArray, second: FloatArray) -> float:
    """Return the inner product, as four sums side by side: none of its additions waits for the one before it."""
    a, b, c, d = 0.0, 0.0, 0.0, 0.0
    fours = first.size - first.size % 4
    for i in range(0, fours, 4):
        a += first[i] * second[i]
        b += first[i + 1] * second[i + 1]
        c += first[i + 2] * second[i + 2]
        d += first[i + 3] * second[i + 3]
    for i in range(fours, first.size):
        a += first[i] * second[i]
    return (a + b) + (c + d)


@numba.njit(cache=True, error_model="numpy", nogil=True, inline="always")
def _both(first: BoolArray, second: BoolArray) -> int:
    """Return in how many places both are true."""
    count = 0
    for i in range(first.size):
        count += first[i] & second[i]
    return count
