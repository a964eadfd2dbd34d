"""Exact penalised segmentation of a sequence into constant levels: functional pruning optimal partitioning (FPOP).

Minimises  Σ (z_k - level_k)² + penalty · (number of jumps)  exactly. Source: Maidstone, Hocking, Rigaill, Fearnhead,
"On optimal multiple changepoint algorithms for large data", Statistics and Computing 27 (2017), algorithm FPOP.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit

from rwa_monitor.samples import FloatArray, IntArray

COARSE_FROM: Final = 2_000  # samples from which jumps are first looked for between blocks
BLOCK: Final = 4  # samples to a block
REFINE: Final = 6  # slots to each side of a coarse jump that are tried


def segment(z: FloatArray, penalty: float) -> IntArray:
    """Return the first index of each segment after the first, int64 (jumps,), increasing.

    Exact for short sequences. Long ones are segmented exactly with jumps between blocks of `BLOCK` samples, then each
    jump is moved to the best sample between its neighbours: the search segments thousands of times.

    Parameters
    ----------
    z
        float64 (n,), finite values, n ≥ 1.
    penalty
        Cost of one jump, in the unit of z² (a few log n times the noise variance).
    """
    if z.size < COARSE_FROM:
        exact: IntArray = _fpop(z - z.mean(), np.ones(z.size), float(penalty))
        return exact
    centred, means, weights = _blocks(z)
    refined: IntArray = _refine(centred, _fpop(means, weights, float(penalty)) * BLOCK, float(penalty))
    return refined


@njit(cache=True, nogil=True)
def _blocks(z: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the values less their mean, in which running sums lose fewer digits, and the blocks' means and sizes."""
    centred = z - z.mean()
    count = (z.size + BLOCK - 1) // BLOCK
    means, weights = np.empty(count), np.empty(count)
    for block in range(count):
        begin, end = block * BLOCK, min((block + 1) * BLOCK, z.size)
        total = 0.0
        for k in range(begin, end):
            total += centred[k]
        means[block], weights[block] = total / (end - begin), end - begin
    return centred, means, weights


@njit(cache=True, nogil=True)
def _refine(z: FloatArray, jumps: IntArray, penalty: float) -> IntArray:
    """Move each coarse jump to its best sample, and drop the second of two that framed one block with a jump in it."""
    sums = np.zeros(z.size + 1)
    sums[1:] = np.cumsum(z)
    moved = jumps.copy()
    count = moved.size
    for _ in range(3):
        _move(sums, moved, count)
        fewer = _drop(sums, moved, count, penalty)
        if fewer == count:
            break
        count = fewer
    return moved[:count].copy()


@njit(cache=True, nogil=True)
def _move(sums: FloatArray, jumps: IntArray, count: int) -> None:
    """Move each of the first `count` jumps, in place, to the best of the samples around it."""
    n = sums.size - 1
    for i in range(count):
        before = jumps[i - 1] if i > 0 else 0
        after = jumps[i + 1] if i + 1 < count else n
        best, place = -np.inf, jumps[i]
        for k in range(max(jumps[i] - REFINE, before + 1), min(jumps[i] + REFINE, after - 1) + 1):
            left, right = sums[k] - sums[before], sums[after] - sums[k]
            explained = left * left / (k - before) + right * right / (after - k)
            if explained > best:
                best, place = explained, k
        jumps[i] = place


@njit(cache=True, nogil=True)
def _drop(sums: FloatArray, jumps: IntArray, count: int, penalty: float) -> int:
    """Drop, in place and weakest first, the jumps that are not worth the penalty; return how many are left."""
    n = sums.size - 1
    while True:
        weakest, least = -1, penalty
        for i in range(count):
            before = jumps[i - 1] if i > 0 else 0
            after = jumps[i + 1] if i + 1 < count else n
            n1, n2 = jumps[i] - before, after - jumps[i]
            step = (sums[after] - sums[jumps[i]]) / n2 - (sums[jumps[i]] - sums[before]) / n1
            worth = step * step * n1 * n2 / (n1 + n2)
            if worth < least:
                weakest, least = i, worth
        if weakest < 0:
            return count
        for i in range(weakest, count - 1):
            jumps[i] = jumps[i + 1]
        count -= 1


@njit(cache=True, nogil=True)
def _fpop(z: FloatArray, weight: FloatArray, penalty: float) -> IntArray:
    """Run FPOP on weighted values.

    The cost of all partitions of z[:t] as a function of the last level μ is a lower envelope of parabolas
    a μ² - 2 b μ + c, one for each surviving last jump τ, on a sorted list of pieces [edge_i, edge_{i+1}). Each step
    adds w_t (z_t - μ)² to all of them and gives the parts that lie above the least cost + penalty to a new jump.

    All of a step stands in one function: a call would cost more than the few dozen operations in it.
    """
    last = np.zeros(z.size + 1, np.int64)
    capacity, pieces = 64, 1
    edge, new_edge = np.empty(capacity + 1), np.empty(capacity + 1)
    jump, new_jump = np.zeros(capacity, np.int64), np.zeros(capacity, np.int64)
    parabola, new_parabola = np.zeros((capacity, 3)), np.zeros((capacity, 3))  # a, b, c
    least = np.empty(capacity)  # cost within the piece
    edge[0], edge[1] = z.min(), z.max()
    if edge[0] == edge[1]:
        return last[:0]  # no level but one
    for t in range(1, z.size + 1):
        if 3 * pieces > capacity:
            capacity *= 2
            edge, new_edge = _longer(edge, capacity + 1), np.empty(capacity + 1)
            jump, new_jump = _longer(jump, capacity), np.zeros(capacity, np.int64)
            parabola, new_parabola = _longer(parabola, capacity), np.zeros((capacity, 3))
            least = np.empty(capacity)
        value, w = z[t - 1], weight[t - 1]
        best = 0
        for i in range(pieces):
            parabola[i, 0] += w
            parabola[i, 1] += w * value
            parabola[i, 2] += w * value * value
            a, b, c = parabola[i]
            mu = min(max(b / a, edge[i]), edge[i + 1])
            least[i] = c + mu * (a * mu - 2.0 * b)
            if least[i] < least[best]:
                best = i
        last[t], ceiling = jump[best], least[best] + penalty
        count = 0
        new_edge[0] = edge[0]
        for i in range(pieces):
            a, b, c = parabola[i]
            left, right = edge[i], edge[i + 1]
            keep_left, keep_right = left, right
            if least[i] >= ceiling:
                keep_right = left
            # A parabola below the ceiling at both ends is below it in between.
            elif c + left * (a * left - 2.0 * b) > ceiling or c + right * (a * right - 2.0 * b) > ceiling:
                half = np.sqrt(max(ceiling - (c - b * b / a), 0.0) / a)
                keep_left = min(max(b / a - half, left), right)
                keep_right = max(min(b / a + half, right), keep_left)
            for part in range(3):
                begin = left if part == 0 else (keep_left if part == 1 else keep_right)
                end = keep_left if part == 0 else (keep_right if part == 1 else right)
                owner = jump[i] if part == 1 else t
                if end <= begin:
                    continue
                if count == 0 or new_jump[count - 1] != owner:
                    new_jump[count] = owner
                    new_parabola[count, 0] = a if part == 1 else 0.0
                    new_parabola[count, 1] = b if part == 1 else 0.0
                    new_parabola[count, 2] = c if part == 1 else ceiling
                    count += 1
                new_edge[count] = end
        pieces = count
        edge, new_edge = new_edge, edge
        jump, new_jump = new_jump, jump
        parabola, new_parabola = new_parabola, parabola
    return _trace_back(last)


@njit(cache=True, nogil=True)
def _longer(values, size):  # type: ignore[no-untyped-def]
    """Return a copy of an array with room for `size` rows."""
    longer = np.zeros((size, *values.shape[1:]), values.dtype)
    longer[: values.shape[0]] = values
    return longer


@njit(cache=True, nogil=True)
def _trace_back(last: IntArray) -> IntArray:
    """Return the jumps from the end to the beginning, in increasing order."""
    found = np.empty(last.size, np.int64)
    count = 0
    t = last[-1]
    while t > 0:
        found[count] = t
        count += 1
        t = last[t]
    return found[:count][::-1].copy()
