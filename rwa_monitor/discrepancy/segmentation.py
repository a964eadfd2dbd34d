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
    centred = z - z.mean()  # running sums lose fewer digits
    if z.size < COARSE_FROM:
        exact: IntArray = _fpop(centred, np.ones(z.size), float(penalty))
        return exact
    whole = z.size // BLOCK * BLOCK
    means = centred[:whole].reshape(-1, BLOCK).mean(axis=1)
    weights = np.full(means.size, float(BLOCK))
    if whole < z.size:
        means = np.append(means, centred[whole:].mean())
        weights = np.append(weights, float(z.size - whole))
    refined: IntArray = _refine(centred, _fpop(means, weights, float(penalty)) * BLOCK, float(penalty))
    return refined


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

    The cost of all partitions of z[:t] as a function of the last level μ is a lower envelope of parabolas, one for
    each surviving last jump τ, on a sorted list of pieces [edge_i, edge_{i+1}). Each step adds (z_t - μ)² to all of
    them and replaces the parts that lie above `best + penalty` by the constant of a new jump.
    """
    n = z.size
    sums = np.zeros((n + 1, 3))  # of weight, weight·z, weight·z²
    for k in range(n):
        sums[k + 1, 0] = sums[k, 0] + weight[k]
        sums[k + 1, 1] = sums[k, 1] + weight[k] * z[k]
        sums[k + 1, 2] = sums[k, 2] + weight[k] * z[k] * z[k]
    best = np.zeros(n + 1)  # optimal cost of z[:t], jumps counted
    best[0] = -penalty
    last = np.zeros(n + 1, np.int64)

    capacity = 64
    edge = np.empty(capacity + 1)
    jump = np.empty(capacity, np.int64)
    new_edge = np.empty(capacity + 1)
    new_jump = np.empty(capacity, np.int64)
    pieces = 1
    edge[0], edge[1], jump[0] = z.min(), z.max(), 0
    for t in range(1, n + 1):
        if 3 * pieces + 1 > capacity:
            capacity *= 2
            edge, jump = _grown(edge, capacity + 1), _grown(jump, capacity)
            new_edge, new_jump = np.empty(capacity + 1), np.empty(capacity, np.int64)
        best[t], last[t] = _best_last_jump(t, best, sums, penalty, edge, jump, pieces)
        pieces = _restrict(t, best, sums, penalty, edge, jump, pieces, new_edge, new_jump)
        edge, new_edge = new_edge, edge
        jump, new_jump = new_jump, jump
    return _trace_back(last)


@njit(cache=True, nogil=True)
def _grown(values, size):  # type: ignore[no-untyped-def]
    """Return a copy of an array with room for `size` values."""
    grown = np.empty(size, values.dtype)
    grown[: values.size] = values
    return grown


@njit(cache=True, nogil=True)
def _best_last_jump(
    t: int, best: FloatArray, sums: FloatArray, penalty: float, edge: FloatArray, jump: IntArray, pieces: int
) -> tuple[float, int]:
    """Return the least cost of z[:t] and its last jump: the minimum over all pieces, each parabola within its own."""
    minimum, argmin = np.inf, 0
    for i in range(pieces):
        tau = jump[i]
        length, s, square = sums[t, 0] - sums[tau, 0], sums[t, 1] - sums[tau, 1], sums[t, 2] - sums[tau, 2]
        mu = min(max(s / length, edge[i]), edge[i + 1])
        cost = best[tau] + penalty + square - 2.0 * mu * s + length * mu * mu
        if cost < minimum:
            minimum, argmin = cost, tau
    return minimum, argmin


@njit(cache=True, nogil=True)
def _restrict(
    t: int,
    best: FloatArray,
    sums: FloatArray,
    penalty: float,
    edge: FloatArray,
    jump: IntArray,
    pieces: int,
    new_edge: FloatArray,
    new_jump: IntArray,
) -> int:
    """Give the parts of the pieces that lie above best[t] + penalty to a jump at t; return the number of new pieces."""
    level = best[t] + penalty
    count = 0
    for i in range(pieces):
        tau = jump[i]
        length, s, square = sums[t, 0] - sums[tau, 0], sums[t, 1] - sums[tau, 1], sums[t, 2] - sums[tau, 2]
        centre = s / length
        floor = best[tau] + penalty + square - s * centre
        left, right = edge[i], edge[i + 1]
        if floor >= level:
            keep_left = keep_right = left
        else:
            half = np.sqrt((level - floor) / length)
            keep_left = min(max(centre - half, left), right)
            keep_right = max(min(centre + half, right), keep_left)
        for begin, end, owner in ((left, keep_left, t), (keep_left, keep_right, tau), (keep_right, right, t)):
            if end <= begin:
                continue
            if count > 0 and new_jump[count - 1] == owner:
                new_edge[count] = end
                continue
            if count == 0:
                new_edge[0] = begin
            new_jump[count] = owner
            new_edge[count + 1] = end
            count += 1
    if count == 0:  # all values equal: one degenerate piece
        new_edge[0], new_edge[1], new_jump[0] = edge[0], edge[pieces], jump[0]
        count = 1
    return count


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
