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
# Rows of the table of pieces: parabola, left edge and envelope there, least cost within.
A, B, C, EDGE, AT_EDGE, LEAST = range(6)
ROWS: Final = 6
ROOM: Final = 64  # pieces: more are hardly ever alive


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
    running = np.zeros((1, z.size + 1))
    np.cumsum(z - z.mean(), out=running[0, 1:])  # less their mean, running sums lose fewer digits
    return segment_sums(running, np.ones(1), penalty)


def segment_sums(running: FloatArray, factors: FloatArray, penalty: float) -> IntArray:
    """Segment a sum of rows, each times its factor, as `segment` does, from the rows' running sums alone.

    What a model leaves of the data for ever other coefficients is such a sum: no sample is read again.

    Parameters
    ----------
    running
        float64 (rows, n + 1), running sums of each row from any value on.
    factors
        float64 (rows,).
    penalty
        Cost of one jump.
    """
    block = BLOCK if running.shape[1] > COARSE_FROM else 1
    jumps: IntArray = _fpop(*_block_means(running, factors, block), float(penalty)) * block
    return jumps if block == 1 else _refine(running, factors, jumps, float(penalty))


@njit(cache=True, nogil=True)
def _block_means(running: FloatArray, factors: FloatArray, block: int) -> tuple[FloatArray, FloatArray]:
    """Return the mean of each block of samples of the sum, and how many samples it has."""
    size = running.shape[1] - 1
    count = (size + block - 1) // block
    means, weights = np.zeros(count), np.full(count, float(block))
    weights[-1] = size - (count - 1) * block
    for row in range(factors.size):
        factor = factors[row]
        for i in range(count):
            rise = running[row, min((i + 1) * block, size)] - running[row, i * block]
            means[i] += factor * rise
    return means / weights, weights


@njit(cache=True, nogil=True)
def _sum_until(running: FloatArray, factors: FloatArray, index: int) -> float:
    """Return the running sum of the sum of rows before an index."""
    total = 0.0
    for row in range(factors.size):
        total += factors[row] * running[row, index]
    return total


@njit(cache=True, nogil=True)
def _refine(running: FloatArray, factors: FloatArray, jumps: IntArray, penalty: float) -> IntArray:
    """Move each coarse jump to its best sample, and drop the second of two that framed one block with a jump in it."""
    n = running.shape[1] - 1
    # Jumps between the ends, and the running sum at each of them.
    edges, sums = np.empty(jumps.size + 2, np.int64), np.empty(jumps.size + 2)
    edges[0], edges[1:-1], edges[-1] = 0, jumps, n
    for i in range(edges.size):
        sums[i] = _sum_until(running, factors, edges[i])
    count = jumps.size
    for _ in range(3):
        _move(running, factors, edges, sums, count)
        fewer = _drop(edges, sums, count, penalty)
        if fewer == count:
            break
        count = fewer
    return edges[1 : count + 1].copy()


@njit(cache=True, nogil=True)
def _move(running: FloatArray, factors: FloatArray, edges: IntArray, sums: FloatArray, count: int) -> None:
    """Move each of the `count` jumps between the first and the last edge, in place, to the best sample around it."""
    for i in range(1, count + 1):
        before, after = edges[i - 1], edges[i + 1]
        best, place, at_best = -np.inf, edges[i], sums[i]
        for k in range(max(edges[i] - REFINE, before + 1), min(edges[i] + REFINE, after - 1) + 1):
            until = _sum_until(running, factors, k)
            left, right = until - sums[i - 1], sums[i + 1] - until
            explained = left * left / (k - before) + right * right / (after - k)
            if explained > best:
                best, place, at_best = explained, k, until
        edges[i], sums[i] = place, at_best


@njit(cache=True, nogil=True)
def _drop(edges: IntArray, sums: FloatArray, count: int, penalty: float) -> int:
    """Drop, in place and weakest first, the jumps that are not worth the penalty; return how many are left."""
    while True:
        weakest, least = 0, penalty
        for i in range(1, count + 1):
            n1, n2 = edges[i] - edges[i - 1], edges[i + 1] - edges[i]
            step = (sums[i + 1] - sums[i]) / n2 - (sums[i] - sums[i - 1]) / n1
            worth = step * step * n1 * n2 / (n1 + n2)
            if worth < least:
                weakest, least = i, worth
        if weakest == 0:
            return count
        edges[weakest : count + 1] = edges[weakest + 1 : count + 2].copy()
        sums[weakest : count + 1] = sums[weakest + 1 : count + 2].copy()
        count -= 1


@njit(cache=True, nogil=True, error_model="numpy")
def _fpop(z: FloatArray, weight: FloatArray, penalty: float) -> IntArray:
    """Run FPOP on weighted values.

    The cost of all partitions of z[:t] as a function of the last level μ is a lower envelope of parabolas
    a μ² - 2 b μ + c, one for each surviving last jump τ, on a sorted list of pieces [edge_i, edge_{i+1}). Each step
    adds w_t (z_t - μ)² to all of them and gives the parts that lie above the least cost + penalty to a new jump.

    What lies below is nearly always one stretch in the middle: its pieces stay in place, in arrays with room on both
    sides, and all else is one new piece on the left and one on the right. Only around a hole all pieces are laid anew.
    """
    last = np.zeros(z.size + 1, np.int64)
    low, high = z.min(), z.max()
    if low == high:
        return last[:0]  # no level but one
    pieces, jump = np.zeros((ROWS, ROOM)), np.zeros(ROOM, np.int64)
    begin, end = ROOM // 2, ROOM // 2 + 1
    pieces[EDGE, begin], pieces[EDGE, end] = low, high
    # Rows are taken out only where the table is another: in each step that would take as long as the rest.
    a, b, c, edge, at_edge, least = _rows(pieces)
    for t in range(1, z.size + 1):
        if begin == 0 or end + 2 > jump.size - 1:
            pieces, jump, begin, end = _centred(pieces, jump, begin, end)
            a, b, c, edge, at_edge, least = _rows(pieces)
        value, w = z[t - 1], weight[t - 1]
        for i in range(begin, end):
            a[i] += w
            b[i] += w * value
            c[i] += w * value * value
            mu = min(max(b[i] / a[i], edge[i]), edge[i + 1])
            least[i] = c[i] + mu * (a[i] * mu - 2.0 * b[i])
            at_edge[i] += w * (value - edge[i]) ** 2
        at_edge[end] += w * (value - high) ** 2
        best = begin
        for i in range(begin + 1, end):
            if least[i] < least[best]:
                best = i
        last[t], ceiling = jump[best], least[best] + penalty
        first, final = begin, end - 1  # of the pieces that are below the ceiling somewhere
        while least[first] >= ceiling:
            first += 1
        while least[final] >= ceiling:
            final -= 1
        highest = ceiling
        for i in range(first + 1, final + 1):
            highest = max(highest, at_edge[i])
        if highest > ceiling:
            pieces, jump, begin, end = _laid_anew(pieces, jump, begin, end, ceiling, t)
            a, b, c, edge, at_edge, least = _rows(pieces)
            continue
        begin, end = first, final + 1
        if at_edge[end] > ceiling:
            half = np.sqrt(max(b[final] * b[final] - a[final] * (c[final] - ceiling), 0.0))
            right = (b[final] + half) / a[final]
            edge[end], at_edge[end] = max(min(right, edge[end]), edge[final]), ceiling
            a[end], b[end], c[end], jump[end] = 0.0, 0.0, ceiling, t
            end += 1
            edge[end], at_edge[end] = high, ceiling
        if at_edge[begin] > ceiling:
            half = np.sqrt(max(b[first] * b[first] - a[first] * (c[first] - ceiling), 0.0))
            left = (b[first] - half) / a[first]
            edge[begin], at_edge[begin] = min(max(left, edge[begin]), edge[begin + 1]), ceiling
            begin -= 1
            a[begin], b[begin], c[begin], jump[begin] = 0.0, 0.0, ceiling, t
            edge[begin], at_edge[begin] = low, ceiling
    return _trace_back(last)


@njit(cache=True, nogil=True)
def _rows(
    pieces: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the rows of the table of pieces."""
    return pieces[A], pieces[B], pieces[C], pieces[EDGE], pieces[AT_EDGE], pieces[LEAST]


@njit(cache=True, nogil=True)
def _centred(pieces: FloatArray, jump: IntArray, begin: int, end: int) -> tuple[FloatArray, IntArray, int, int]:
    """Return the pieces in the middle of arrays with as much room again on both sides."""
    count = end - begin
    room = max(ROOM, 4 * count)
    at = (room - count) // 2
    wider, of_wider = np.zeros((ROWS, room)), np.zeros(room, np.int64)
    wider[:, at : at + count + 1] = pieces[:, begin : end + 1]
    of_wider[at : at + count] = jump[begin:end]
    return wider, of_wider, at, at + count


@njit(cache=True, nogil=True, error_model="numpy")
def _laid_anew(
    old: FloatArray, old_jump: IntArray, begin: int, end: int, ceiling: float, t: int
) -> tuple[FloatArray, IntArray, int, int]:
    """Give every part of the pieces that lies above the ceiling to the new jump t, wherever it is."""
    room = max(ROOM, 6 * (end - begin))  # each piece may become three
    pieces, jump = np.zeros((ROWS, room)), np.full(room, -1, np.int64)
    start = room // 4
    count = 0
    for i in range(begin, end):
        a, b, c = old[A, i], old[B, i], old[C, i]
        left, right = old[EDGE, i], old[EDGE, i + 1]
        keep_left, keep_right = left, right
        if old[LEAST, i] >= ceiling:
            keep_right = left
        else:
            half = np.sqrt(max(ceiling - (c - b * b / a), 0.0) / a)
            if old[AT_EDGE, i] > ceiling:
                keep_left = min(max(b / a - half, left), right)
            if old[AT_EDGE, i + 1] > ceiling:
                keep_right = max(min(b / a + half, right), keep_left)
        for part in range(3):
            from_edge = left if part == 0 else (keep_left if part == 1 else keep_right)
            to_edge = keep_left if part == 0 else (keep_right if part == 1 else right)
            owner = old_jump[i] if part == 1 else t
            at = start + count
            if to_edge <= from_edge or jump[at - 1] == owner:
                continue
            count += 1
            jump[at] = owner
            pieces[A, at], pieces[B, at], pieces[C, at] = (a, b, c) if part == 1 else (0.0, 0.0, ceiling)
            pieces[EDGE, at] = from_edge
            pieces[AT_EDGE, at] = min(old[AT_EDGE, i], ceiling) if from_edge == left else ceiling
    pieces[EDGE, start + count] = old[EDGE, end]
    pieces[AT_EDGE, start + count] = min(old[AT_EDGE, end], ceiling)
    return pieces, jump, start, start + count


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
