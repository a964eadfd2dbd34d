"""Stage 1, its last step: from the peaks of all scales to the candidates of a window.

A big jump shows at every scale, with side lobes at half the scale's distance (errata 4), and two near jumps blur each
other at scales wider than their distance (errata 5). So peaks are taken narrow scale first, and each is judged *given*
the candidates already accepted: its halves end at its neighbours, the slope is the window's own. Positions are refined
by likelihood, and at last the weakest candidates are taken away until all that stay are significant by themselves.
Everything comes from running sums; a few samples are read around each candidate.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numba
import numpy as np
from scipy import special

from rwa_monitor.diagnosis.results import Candidates
from rwa_monitor.diagnosis.running_sums import STRIDE, RunningSums, SumArrays, prefix_moments
from rwa_monitor.diagnosis.wglr import MAX_SCALE
from rwa_monitor.samples import BoolArray, FloatArray, IntArray

LONGEST_HALF: Final = 1024  # slots on each side that a candidate is judged by: enough, and near enough for slow drifts
# Tests that a window amounts to, per slot. The peaks of all scales are about 1.5 independent tests a slot, but a
# candidate must also stand between its final neighbours: simulated windows without a jump show this many.
TESTS_PER_SLOT: Final = 0.25
LONG_GAP: Final = MAX_SCALE // 2  # slots without a used sample that leave no contrast enough samples on either side
MOST_CANDIDATES: Final = 1000  # a window with more holds something else than jumps; the strongest are kept
_LOG_USED: Final[FloatArray] = np.log(np.maximum(np.arange(MAX_SCALE + 1), 1))  # of 0 … MAX_SCALE used samples


def threshold_for(false_alarms: float, tests: float) -> float:
    """Return the χ² (one degree of freedom) threshold that `tests` independent tests exceed `false_alarms` times."""
    return float(special.chdtri(1, min(false_alarms / max(tests, 1.0), 0.5)))


def variance_table(scales: IntArray, variances: FloatArray) -> FloatArray:
    """Return v for a shorter half of 0 … MAX_SCALE used samples: the scales' variances, interpolated in log n."""
    return np.exp(np.interp(_LOG_USED, np.log(scales), np.log(variances)))


def join(first: Candidates, second: Candidates) -> Candidates:
    """Return the peaks of both lists, in any order."""
    return Candidates(
        index=np.concatenate([first.index, second.index]),
        scale=np.concatenate([first.scale, second.scale]),
        statistic=np.concatenate([first.statistic, second.statistic]),
        jump=np.concatenate([first.jump, second.jump]),
    )


def in_turn(peaks: Candidates) -> Candidates:
    """Return the peaks in the order in which they are tried: narrow scales and large statistics first."""
    order = np.lexsort((peaks.index, -peaks.statistic, peaks.scale))
    return Candidates(peaks.index[order], peaks.scale[order], peaks.statistic[order], peaks.jump[order])


@numba.njit(cache=True, error_model="numpy", nogil=True)
def order_in_turn(scale: IntArray, statistic: FloatArray) -> IntArray:
    """Return the order of `in_turn`, for compiled code; of peaks in the order of their slots."""
    order = np.argsort(-statistic, kind="mergesort")
    return order[np.argsort(scale[order], kind="mergesort")]


def peaks_behind_gaps(sums: RunningSums) -> Candidates:
    """Return a peak behind each long stretch without a used sample: gaps of telemetry, the dead band around zero.

    No contrast of the fixed scales spans such a stretch, so that a jump in it would never be seen. Its scale reaches
    MAX_SCALE slots beyond the stretch; whether there is a jump is for `select` to say. The statistic is
    infinite, which only makes it the first of its scale to be tried.

    Parameters
    ----------
    sums
        Running sums of the window; their checkpoints alone tell where no sample is used.
    """
    index, scale = _ends_of_gaps(sums.arrays.checkpoints, sums.arrays.used, sums.slots)
    return Candidates(index, scale, statistic=np.full(index.size, np.inf), jump=np.zeros(index.size))


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _ends_of_gaps(checkpoints: FloatArray, used: BoolArray, slots: int) -> tuple[IntArray, IntArray]:
    """Return slot and scale of each peak of `peaks_behind_gaps`."""
    strides = slots // STRIDE
    index, scale = np.empty(strides, dtype=np.int64), np.empty(strides, dtype=np.int64)
    found, begin = 0, -1  # first slot of the present gap
    for j in range(strides + 1):
        end = j * STRIDE
        if j < strides and checkpoints[j + 1, 0] == checkpoints[j, 0]:
            begin = end if begin < 0 else begin
            continue
        if begin > 0 and end - begin >= LONG_GAP:
            for slot in range(end, min(end + STRIDE, used.size)):
                if used[slot]:
                    index[found], scale[found] = slot, end - begin + MAX_SCALE
                    found += 1
                    break
        begin = -1
    return index[:found], scale[:found]


class Bar(NamedTuple):
    """What a jump must clear to be a candidate.

    Attributes
    ----------
    variances
        float64 (MAX_SCALE + 1,), see `variance_table`.
    threshold
        χ² threshold of the normalised statistic.
    outlier
        Largest outlier of the noise by chance, normalised.
    """

    variances: FloatArray
    threshold: float
    outlier: float


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _ends(low: int, middle: int, high: int) -> int:
    """Return the samples that the prefix sums at three slots read beside the checkpoints."""
    return low % STRIDE + middle % STRIDE + high % STRIDE


@numba.njit(cache=True, error_model="numpy", nogil=True)
def judge(k: int, low: int, high: int, slope: float, sums: SumArrays, bar: Bar) -> tuple[float, float, float]:
    """Test for a jump at slot k between the levels of [low, k) and [k, high), the slope known.

    Returns
    -------
    statistic, jump, excess
        Normalised statistic, jump, and the statistic over the threshold that applies to it, which is higher where a
        single outlier of the noise could make the jump. All 0 where a half has no used sample.
    """
    n0, x0, z0, _, _, _ = prefix_moments(low, sums)
    n1, x1, z1, _, _, _ = prefix_moments(k, sums)
    n2, x2, z2, _, _, _ = prefix_moments(high, sums)
    left, right = n1 - n0, n2 - n1
    if left < 1.0 or right < 1.0:
        return 0.0, 0.0, 0.0
    jump = ((z2 - z1) - slope * (x2 - x1)) / right - ((z1 - z0) - slope * (x1 - x0)) / left
    shorter, longer = min(left, right), max(left, right)
    variance = bar.variances[int(min(shorter, bar.variances.size - 1))]
    information = left * right / (left + right)
    statistic = jump * jump * information / variance
    # An outlier o in the shorter half shifts its mean by o/n.
    by_chance = bar.outlier * bar.outlier * longer / (shorter * (left + right)) / variance
    return statistic, jump, statistic / max(bar.threshold, by_chance)


@numba.njit(cache=True, error_model="numpy", nogil=True)
def contrast(k: int, w: int, slope: float, weight: float, sums: SumArrays) -> tuple[float, float]:
    """Return the wGLR's statistic [torque²] and jump at slot k and scale w, with any centre and weight of the slope.

    See `wglr` for the formulas. Both 0 where a half has no used sample.
    """
    n0, x0, z0, xx0, xz0, _ = prefix_moments(k - w, sums)
    n1, x1, z1, _, _, _ = prefix_moments(k, sums)
    n2, x2, z2, xx2, xz2, _ = prefix_moments(k + w, sums)
    left, right = n1 - n0, n2 - n1
    if left < 1.0 or right < 1.0:
        return 0.0, 0.0
    xl, xr = (x1 - x0) / left, (x2 - x1) / right
    el, er = (z1 - z0) / left - slope * xl, (z2 - z1) / right - slope * xr
    spread = max(xx2 - xx0 - left * xl * xl - right * xr * xr, 0.0)
    tilt = xz2 - xz0 - slope * (xx2 - xx0) - left * xl * el - right * xr * er
    step = (xr - xl) / (spread + weight)
    jump = er - el - step * tilt
    return jump * jump / (1.0 / left + 1.0 / right + (xr - xl) * step), jump


@numba.njit(cache=True, error_model="numpy", nogil=True)
def refine(k: int, low: int, high: int, reach: int, slope: float, sums: SumArrays) -> tuple[int, int]:
    """Return the most likely slot of a single jump in [low, high) within `reach` of k, and the samples read."""
    first = max(low + 1, k - reach)
    last = min(high - 1, k + reach)
    n0, x0, z0, _, _, _ = prefix_moments(low, sums)
    n1, x1, z1, _, _, _ = prefix_moments(first, sums)
    n2, x2, z2, _, _, _ = prefix_moments(high, sums)
    e0, e1, e2 = z0 - slope * x0, z1 - slope * x1, z2 - slope * x2
    best, best_value = k, -1.0
    for at in range(first, last + 1):
        if not sums.used[at]:
            continue  # a masked slot is not the first sample of a level
        left, right = n1 - n0, n2 - n1
        if left > 0.0 and right > 0.0:
            difference = (e2 - e1) / right - (e1 - e0) / left
            value = difference * difference * left * right / (left + right)
            if value > best_value:
                best, best_value = at, value
        n1 += 1.0
        e1 += (sums.z[at] - sums.centre[1]) - slope * (sums.x[at] - sums.centre[0])
    return best, max(last - first + 1, 0) + _ends(low, first, high)


@numba.njit(cache=True, error_model="numpy", nogil=True)
def refine_in_colour(
    k: int, low: int, high: int, reach: int, slope: float, correlation: float, sums: SumArrays
) -> tuple[int, int]:
    """Return the most likely slot of a jump near k where the noise is AR(1), and the samples read.

    With the levels left and right of k, the likelihood of each slot follows from the innovations e_k - φ e_{k-1},
    in which a jump is a spike: coloured noise hides where a jump is less than it hides that there is one.
    """
    n0, x0, z0, _, _, _ = prefix_moments(low, sums)
    n1, x1, z1, _, _, _ = prefix_moments(k, sums)
    n2, x2, z2, _, _, _ = prefix_moments(high, sums)
    read = _ends(low, k, high)
    if n1 - n0 < 1.0 or n2 - n1 < 1.0:
        return k, read
    left = ((z1 - z0) - slope * (x1 - x0)) / (n1 - n0)
    right = ((z2 - z1) - slope * (x2 - x1)) / (n2 - n1)
    used, x, z, x_centre, z_centre = sums.used, sums.x, sums.z, sums.centre[0], sums.centre[1]
    alone = 1.0 - correlation * correlation  # weight of a sample whose neighbour is masked
    first, last = max(low + 1, k - reach), min(high - 1, k + reach)
    cost = 0.0
    best, best_cost = k, np.inf
    for at in range(first, last + 1):
        if not used[at]:
            continue
        if cost < best_cost:
            best, best_cost = at, cost
        # What changes when the slot `at` goes over to the left level: its innovation and the next one's.
        value = (z[at] - z_centre) - slope * (x[at] - x_centre)
        old, new = value - right, value - left
        if used[at - 1]:
            before = correlation * ((z[at - 1] - z_centre) - slope * (x[at - 1] - x_centre) - left)
            cost += (new - before) ** 2 - (old - before) ** 2
        else:
            cost += alone * (new * new - old * old)
        if at + 1 < high and used[at + 1]:
            after = (z[at + 1] - z_centre) - slope * (x[at + 1] - x_centre) - right
            cost += (after - correlation * new) ** 2 - (after - correlation * old) ** 2
    return best, read + max(last - first + 1, 0)


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _neighbours(i: int, count: int, index: IntArray, slots: int) -> tuple[int, int]:
    """Return the candidates before and after the i-th, or the window's ends."""
    return (index[i - 1] if i > 0 else 0), (index[i + 1] if i + 1 < count else slots)


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _accept(
    peak_index: IntArray,
    peak_scale: IntArray,
    slots: int,
    slope: float,
    sums: SumArrays,
    bar: Bar,
    index: IntArray,
    scale: IntArray,
) -> tuple[int, int]:
    """Accept the peaks, in their order, that are significant between those accepted before.

    Writes slot and scale of the accepted to `index` and `scale`, sorted by slot; returns their number, at most the
    room there, and the samples read.
    """
    count = 0
    read = 0
    for p in range(peak_index.size):
        k, w = int(peak_index[p]), int(peak_scale[p])
        place = int(np.searchsorted(index[:count], k))
        if count == index.size or (place < count and index[place] == k):
            continue
        before = index[place - 1] if place > 0 else 0
        after = index[place] if place < count else slots
        low, high = max(k - w, before), min(k + w, after)
        _, _, excess = judge(k, low, high, slope, sums, bar)
        read += _ends(low, k, high)
        if excess < 1.0:
            continue
        k, reads = refine(k, max(k - 2 * w, before), min(k + 2 * w, after), w, slope, sums)
        read += reads
        for q in range(count, place, -1):
            index[q] = index[q - 1]
            scale[q] = scale[q - 1]
        index[place] = k
        scale[place] = w
        count += 1
    return count, read


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _settle(
    count: int,
    slots: int,
    slope: float,
    correlation: float,
    sums: SumArrays,
    bar: Bar,
    index: IntArray,
    scale: IntArray,
    values: FloatArray,
) -> tuple[int, int]:
    """Refine the accepted between their final neighbours, then take away the weakest while it fails the bar.

    Writes statistic, jump and excess of each to `values`, float64 (C, 3); returns how many stay and the samples read.
    """
    read = 0
    for i in range(count):
        before, after = _neighbours(i, count, index, slots)
        reach = scale[i]
        low, high = max(index[i] - 2 * reach, before), min(index[i] + 2 * reach, after)
        index[i], reads = refine(index[i], low, high, reach, slope, sums)
        read += reads
        if correlation > 0.0:
            index[i], reads = refine_in_colour(index[i], low, high, reach, slope, correlation, sums)
            read += reads
    first, last = 0, count  # whose neighbours have changed
    while True:
        for i in range(first, last):
            before, after = _neighbours(i, count, index, slots)
            half = max(LONGEST_HALF, 2 * scale[i])
            low, high = max(index[i] - half, before), min(index[i] + half, after)
            values[i, 0], values[i, 1], values[i, 2] = judge(index[i], low, high, slope, sums, bar)
            read += _ends(low, index[i], high)
        if count == 0:
            return count, read
        weakest = int(np.argmin(values[:count, 2]))
        if values[weakest, 2] >= 1.0:
            return count, read
        for q in range(weakest, count - 1):
            index[q] = index[q + 1]
            scale[q] = scale[q + 1]
            values[q] = values[q + 1]
        count -= 1
        first, last = max(weakest - 1, 0), min(weakest + 1, count)


@numba.njit(cache=True, error_model="numpy", nogil=True)
def select(
    peak_index: IntArray,
    peak_scale: IntArray,
    slots: int,
    slope: float,
    correlation: float,
    sums: SumArrays,
    bar: Bar,
) -> tuple[IntArray, IntArray, FloatArray, FloatArray, int]:
    """Choose the candidates of a window among the peaks of all scales.

    Parameters
    ----------
    peak_index, peak_scale
        int64 (P,), slots and scales of the peaks above their thresholds, see `in_turn`.
    slots
        Of the window, all in the sums.
    slope
        f_v of the window, as well as it is known.
    correlation
        φ of AR(1) noise, see `ar_coefficient`; 0 where it is not like that.
    sums
        Running sums of the window.
    bar
        What a jump must clear.

    Returns
    -------
    index, scale, statistic, jump, read
        The fields of their `Candidates`, and how many samples were read.
    """
    room = min(peak_index.size, MOST_CANDIDATES)
    index, scale, values = np.empty(room, dtype=np.int64), np.empty(room, dtype=np.int64), np.empty((room, 3))
    accepted, read = _accept(peak_index, peak_scale, slots, slope, sums, bar, index, scale)
    count, more = _settle(accepted, slots, slope, correlation, sums, bar, index, scale, values)
    return index[:count].copy(), scale[:count].copy(), values[:count, 0].copy(), values[:count, 1].copy(), read + more


@numba.njit(cache=True, error_model="numpy", nogil=True)
def kept_apart(index: IntArray, scale: IntArray) -> IntArray:
    """Return the slots of peaks, taken `in_turn`, with no kept one within ±w; sorted."""
    taken = np.empty(index.size, dtype=np.int64)
    count = 0
    for i in range(index.size):
        free = True
        for j in range(count):
            if abs(taken[j] - index[i]) <= scale[i]:
                free = False
                break
        if free:
            taken[count] = index[i]
            count += 1
    return np.sort(taken[:count])
