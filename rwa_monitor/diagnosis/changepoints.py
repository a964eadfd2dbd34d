"""Stage 1, its last step: from the peaks of all scales to the candidates of a window.

A big jump shows at every scale, with side lobes at half the scale's distance (errata 4), and two near jumps blur each
other at scales wider than their distance (errata 5). So peaks are taken narrow scale first, and each is judged *given*
the candidates already accepted: its halves end at its neighbours, the slope is the window's own. Positions are refined
by likelihood, and at last the weakest candidates are taken away until all that stay are significant by themselves.
Everything comes from running sums; a few samples are read around each candidate.
"""

from __future__ import annotations

from typing import Final

import numba
import numpy as np
from scipy import special

from rwa_monitor.diagnosis.noise import Tails
from rwa_monitor.diagnosis.results import Candidates
from rwa_monitor.diagnosis.running_sums import STRIDE, RunningSums, prefix_moments
from rwa_monitor.diagnosis.wglr import MAX_SCALE
from rwa_monitor.samples import BoolArray, FloatArray, IntArray

LONGEST_HALF: Final = 1024  # slots on each side that a candidate is judged by: enough, and near enough for slow drifts
# Tests that a window amounts to, per slot. The peaks of all scales are about 1.5 independent tests a slot, but a
# candidate must also stand between its final neighbours: simulated windows without a jump show this many.
TESTS_PER_SLOT: Final = 0.25
MOST_CANDIDATES: Final = 1000  # a window with more holds something else than jumps; the strongest are kept


def threshold_for(false_alarms: float, tests: float) -> float:
    """Return the χ² (one degree of freedom) threshold that `tests` independent tests exceed `false_alarms` times."""
    return float(special.chdtri(1, min(false_alarms / max(tests, 1.0), 0.5)))


def variance_table(scales: IntArray, variances: FloatArray) -> FloatArray:
    """Return v for a shorter half of 0 … MAX_SCALE used samples: the scales' variances, interpolated in log n."""
    n = np.maximum(np.arange(MAX_SCALE + 1), 1)
    return np.exp(np.interp(np.log(n), np.log(scales), np.log(variances)))


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _ends(low: int, middle: int, high: int) -> int:
    """Return the samples that the prefix sums at three slots read beside the checkpoints."""
    return low % STRIDE + middle % STRIDE + high % STRIDE


@numba.njit(cache=True, error_model="numpy", nogil=True)
def judge(  # noqa: PLR0913, PLR0917 - a kernel takes its state array by array
    k: int,
    low: int,
    high: int,
    slope: float,
    checkpoints: FloatArray,
    x: FloatArray,
    z: FloatArray,
    used: BoolArray,
    centre: FloatArray,
    variances: FloatArray,
    threshold: float,
    outlier: float,
) -> tuple[float, float, float]:
    """Test for a jump at slot k between the levels of [low, k) and [k, high), the slope known.

    Returns
    -------
    statistic, jump, excess
        Normalised statistic, jump, and the statistic over the threshold that applies to it, which is higher where a
        single outlier of the noise could make the jump. All 0 where a half has no used sample.
    """
    n0, x0, z0, _, _, _ = prefix_moments(low, checkpoints, x, z, used, centre)
    n1, x1, z1, _, _, _ = prefix_moments(k, checkpoints, x, z, used, centre)
    n2, x2, z2, _, _, _ = prefix_moments(high, checkpoints, x, z, used, centre)
    left, right = n1 - n0, n2 - n1
    if left < 1.0 or right < 1.0:
        return 0.0, 0.0, 0.0
    jump = ((z2 - z1) - slope * (x2 - x1)) / right - ((z1 - z0) - slope * (x1 - x0)) / left
    shorter, longer = min(left, right), max(left, right)
    variance = variances[int(min(shorter, variances.size - 1))]
    information = left * right / (left + right)
    statistic = jump * jump * information / variance
    # An outlier o in the shorter half shifts its mean by o/n.
    by_chance = outlier * outlier * longer / (shorter * (left + right)) / variance
    return statistic, jump, statistic / max(threshold, by_chance)


@numba.njit(cache=True, error_model="numpy", nogil=True)
def refine(
    k: int,
    low: int,
    high: int,
    reach: int,
    slope: float,
    checkpoints: FloatArray,
    x: FloatArray,
    z: FloatArray,
    used: BoolArray,
    centre: FloatArray,
) -> tuple[int, int]:
    """Return the most likely slot of a single jump in [low, high) within `reach` of k, and the samples read."""
    first = max(low + 1, k - reach)
    last = min(high - 1, k + reach)
    n0, x0, z0, _, _, _ = prefix_moments(low, checkpoints, x, z, used, centre)
    n2, x2, z2, _, _, _ = prefix_moments(high, checkpoints, x, z, used, centre)
    n1, x1, z1, _, _, _ = prefix_moments(first, checkpoints, x, z, used, centre)
    e0 = z0 - slope * x0
    e1 = z1 - slope * x1
    e2 = z2 - slope * x2
    best, best_value = k, -1.0
    for at in range(first, last + 1):
        left, right = n1 - n0, n2 - n1
        # Among slots with the same samples on each side the last one: the first sample of the new level is used.
        if left > 0.0 and right > 0.0 and used[at]:
            difference = (e2 - e1) / right - (e1 - e0) / left
            value = difference * difference * left * right / (left + right)
            if value > best_value:
                best, best_value = at, value
        if used[at]:
            n1 += 1.0
            e1 += (z[at] - centre[1]) - slope * (x[at] - centre[0])
    return best, max(last - first + 1, 0) + _ends(low, max(first, 0), high)


@numba.njit(cache=True, error_model="numpy", nogil=True)
def refine_in_colour(  # noqa: PLR0913, PLR0917 - a kernel takes its state array by array
    k: int,
    low: int,
    high: int,
    reach: int,
    slope: float,
    correlation: float,
    checkpoints: FloatArray,
    x: FloatArray,
    z: FloatArray,
    used: BoolArray,
    centre: FloatArray,
) -> tuple[int, int]:
    """Return the most likely slot of a jump near k where the noise is AR(1), and the samples read.

    With the levels left and right of k, the likelihood of each slot follows from the innovations e_k - φ e_{k-1},
    in which a jump is a spike: coloured noise hides where a jump is less than it hides that there is one.
    """
    n0, x0, z0, _, _, _ = prefix_moments(low, checkpoints, x, z, used, centre)
    n1, x1, z1, _, _, _ = prefix_moments(k, checkpoints, x, z, used, centre)
    n2, x2, z2, _, _, _ = prefix_moments(high, checkpoints, x, z, used, centre)
    read = _ends(low, k, high)
    if n1 - n0 < 1.0 or n2 - n1 < 1.0:
        return k, read
    left = ((z1 - z0) - slope * (x1 - x0)) / (n1 - n0)
    right = ((z2 - z1) - slope * (x2 - x1)) / (n2 - n1)
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
        value = (z[at] - centre[1]) - slope * (x[at] - centre[0])
        old, new = value - right, value - left
        if used[at - 1]:
            before = correlation * ((z[at - 1] - centre[1]) - slope * (x[at - 1] - centre[0]) - left)
            cost += (new - before) ** 2 - (old - before) ** 2
        else:
            cost += alone * (new * new - old * old)
        if at + 1 < high and used[at + 1]:
            after = (z[at + 1] - centre[1]) - slope * (x[at + 1] - centre[0]) - right
            cost += (after - correlation * new) ** 2 - (after - correlation * old) ** 2
    return best, read + max(last - first + 1, 0)


@numba.njit(cache=True, error_model="numpy", nogil=True)
def select(  # noqa: PLR0913, PLR0917 - a kernel takes its state array by array
    peak_index: IntArray,
    peak_scale: IntArray,
    slots: int,
    slope: float,
    checkpoints: FloatArray,
    x: FloatArray,
    z: FloatArray,
    used: BoolArray,
    centre: FloatArray,
    variances: FloatArray,
    threshold: float,
    outlier: float,
    correlation: float,
    longest: int,
    index: IntArray,
    scale: IntArray,
    values: FloatArray,
) -> tuple[int, int]:
    """Choose the candidates among the peaks, narrow scales first, then drop what is not significant by itself.

    Parameters
    ----------
    peak_index, peak_scale
        int64 (P,), in the order in which they are tried.
    slots
        Length of the window.
    slope
        f_v of the window.
    checkpoints, x, z, used, centre
        The running sums.
    variances
        See `variance_table`.
    threshold, outlier
        The χ² threshold and the largest outlier by chance, see `judge`.
    correlation
        φ of AR(1) noise, 0 where it is not like that.
    longest
        Longest half that a candidate is judged by [slots].
    index, scale, values
        Outputs: int64 (C,), int64 (C,), float64 (C, 2): statistic and jump; C bounds the number of candidates.

    Returns
    -------
    count, read
        Candidates found and samples read.
    """
    count = 0
    read = 0
    for p in range(peak_index.size):
        k, w = peak_index[p], peak_scale[p]
        place = 0
        while place < count and index[place] < k:
            place += 1
        if (place < count and index[place] == k) or count == index.size:
            continue
        before = index[place - 1] if place > 0 else 0
        after = index[place] if place < count else slots
        low, high = max(k - w, before), min(k + w, after)
        _, _, excess = judge(k, low, high, slope, checkpoints, x, z, used, centre, variances, threshold, outlier)
        read += _ends(low, k, high)
        if excess < 1.0:
            continue
        low, high = max(k - 2 * w, before), min(k + 2 * w, after)
        k, reads = refine(k, low, high, w, slope, checkpoints, x, z, used, centre)
        read += reads
        for q in range(count, place, -1):
            index[q] = index[q - 1]
            scale[q] = scale[q - 1]
        index[place] = k
        scale[place] = w
        count += 1

    # Each candidate again, between its final neighbours. One that fails goes, weakest first, and frees its neighbours.
    fresh = True
    while count > 0:
        weakest, least = -1, 1.0
        for i in range(count):
            before = index[i - 1] if i > 0 else 0
            after = index[i + 1] if i + 1 < count else slots
            low, high = max(index[i] - longest, before), min(index[i] + longest, after)
            if fresh:
                near_low, near_high = max(index[i] - 2 * scale[i], before), min(index[i] + 2 * scale[i], after)
                index[i], reads = refine(
                    index[i], near_low, near_high, scale[i], slope, checkpoints, x, z, used, centre
                )
                read += reads
                if correlation > 0.0:
                    index[i], reads = refine_in_colour(
                        index[i],
                        near_low,
                        near_high,
                        scale[i],
                        slope,
                        correlation,
                        checkpoints,
                        x,
                        z,
                        used,
                        centre,
                    )
                    read += reads
            statistic, jump, excess = judge(
                index[i], low, high, slope, checkpoints, x, z, used, centre, variances, threshold, outlier
            )
            read += _ends(low, index[i], high)
            values[i, 0] = statistic
            values[i, 1] = jump
            if excess < least:
                weakest, least = i, excess
        fresh = False
        if weakest < 0:
            break
        for q in range(weakest, count - 1):
            index[q] = index[q + 1]
            scale[q] = scale[q + 1]
        count -= 1
    return count, read


def select_candidates(
    peaks: Candidates,
    sums: RunningSums,
    slope: float,
    variances: FloatArray,
    threshold: float,
    tails: Tails,
    correlation: float = 0.0,
) -> Candidates:
    """Choose the candidates of a window among the peaks of all scales.

    Parameters
    ----------
    peaks
        Peaks of all scales above their thresholds, in any order.
    sums
        Running sums of the window.
    slope
        f_v of the window, as well as it is known.
    variances
        float64 (MAX_SCALE + 1,), see `variance_table`.
    threshold
        χ² threshold of a candidate.
    tails
        Tails of the noise; outliers of this size by themselves are no candidates.
    correlation
        φ of AR(1) noise, see `ar_coefficient`; 0 where it is not like that.
    """
    order = np.lexsort((peaks.index, -peaks.statistic, peaks.scale))
    room = min(len(peaks), MOST_CANDIDATES)
    index = np.empty(room, dtype=np.int64)
    scale = np.empty(room, dtype=np.int64)
    values = np.empty((room, 2))
    count, read = select(
        peaks.index[order],
        peaks.scale[order],
        sums.slots,
        slope,
        sums.checkpoints,
        sums.x,
        sums.z,
        sums.used,
        sums.centre,
        variances,
        threshold,
        tails.largest_outlier,
        correlation,
        LONGEST_HALF,
        index,
        scale,
        values,
    )
    sums.samples_read += int(read)
    return Candidates(
        index=index[:count].copy(),
        scale=scale[:count].copy(),
        statistic=values[:count, 0].copy(),
        jump=values[:count, 1].copy(),
    )


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _suppress(index: IntArray, scale: IntArray, taken: IntArray) -> int:
    """Write the kept of `index`, in the order in which they are tried, to `taken`; return how many."""
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
    return count


def suppress(peaks: Candidates) -> IntArray:
    """Return the slots of the peaks, narrow scales and large statistics first, with no kept one within ±w; sorted."""
    order = np.lexsort((peaks.index, -peaks.statistic, peaks.scale))
    taken = np.empty(len(peaks), dtype=np.int64)
    count = _suppress(peaks.index[order], peaks.scale[order], taken)
    return np.sort(taken[:count])
