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
        return _fpop(centred, np.ones(z.size), float(penalty))
    whole = z.size // BLOCK * BLOCK
    means = centred[:whole].reshape(-1, BLOCK).mean(axis=1)
    weights = np.full(means.size, float(BLOCK))
    if whole < z.size:
        means = np.append(means, centred[whole:].mean())
        weights = np.append(weights, float(z.size - whole))
    return _refine(centred, _fpop(means, weights, float(penalty)) * BLOCK, float(penalty))


@njit(cache=True)
def _refine(z, jumps, penalty):  # type: ignore[no-untyped-def]
    """Move each coarse jump to its best sample, and drop the second of two that framed one block with a jump in it."""
    n = z.size
    sums = np.zeros(n + 1)
    for k in range(n):
        sums[k + 1] = sums[k] + z[k]
    moved = jumps.copy()
    count = moved.size
    for _ in range(3):
        for i in range(count):
            before = moved[i - 1] if i > 0 else 0
            after = moved[i + 1] if i + 1 < count else n
            best, place = -np.inf, moved[i]
            for k in range(max(moved[i] - REFINE, before + 1), min(moved[i] + REFINE, after - 1) + 1):
                left, right = sums[k] - sums[before], sums[after] - sums[k]
                explained = left * left / (k - before) + right * right / (after - k)
                if explained > best:
                    best, place = explained, k
            moved[i] = place
        dropped = False
        while True:
            weakest, least = -1, penalty
            for i in range(count):
                before = moved[i - 1] if i > 0 else 0
                after = moved[i + 1] if i + 1 < count else n
                n1, n2 = moved[i] - before, after - moved[i]
                step = (sums[after] - sums[moved[i]]) / n2 - (sums[moved[i]] - sums[before]) / n1
                worth = step * step * n1 * n2 / (n1 + n2)
                if worth < least:
                    weakest, least = i, worth
            if weakest < 0:
                break
            for i in range(weakest, count - 1):
                moved[i] = moved[i + 1]
            count -= 1
            dropped = True
        if not dropped:
            break
    return moved[:count].copy()


@njit(cache=True)
def _fpop(z, weight, penalty):  # type: ignore[no-untyped-def]
    """Run FPOP; plain function over arrays.

    The cost of all partitions of z[:t] as a function of the last level μ is a lower envelope of parabolas, one for
    each surviving last jump τ, on a sorted list of pieces [edge_i, edge_{i+1}). Each step adds (z_t - μ)² to all of
    them and replaces the parts that lie above `best + penalty` by the constant of a new jump.
    """
    n = z.size
    sum_w = np.zeros(n + 1)
    sum_z = np.zeros(n + 1)
    sum_zz = np.zeros(n + 1)
    for k in range(n):
        sum_w[k + 1] = sum_w[k] + weight[k]
        sum_z[k + 1] = sum_z[k] + weight[k] * z[k]
        sum_zz[k + 1] = sum_zz[k] + weight[k] * z[k] * z[k]

    best = np.zeros(n + 1)  # optimal cost of z[:t], jumps counted
    best[0] = -penalty
    last = np.zeros(n + 1, np.int64)

    low, high = z.min(), z.max()
    capacity = 64
    edge = np.empty(capacity + 1)
    jump = np.empty(capacity, np.int64)
    new_edge = np.empty(capacity + 1)
    new_jump = np.empty(capacity, np.int64)
    pieces = 1
    edge[0], edge[1], jump[0] = low, high, 0

    for t in range(1, n + 1):
        # The minimum over all pieces, each parabola restricted to its piece.
        minimum = np.inf
        argmin = 0
        for i in range(pieces):
            tau = jump[i]
            length = sum_w[t] - sum_w[tau]
            s = sum_z[t] - sum_z[tau]
            mu = min(max(s / length, edge[i]), edge[i + 1])
            cost = best[tau] + penalty + (sum_zz[t] - sum_zz[tau]) - 2.0 * mu * s + length * mu * mu
            if cost < minimum:
                minimum = cost
                argmin = tau
        best[t] = minimum
        last[t] = argmin

        # Replace what lies above minimum + penalty by the constant of a jump at t.
        if 3 * pieces + 1 > capacity:
            capacity *= 2
            grown_edge = np.empty(capacity + 1)
            grown_jump = np.empty(capacity, np.int64)
            grown_edge[: pieces + 1] = edge[: pieces + 1]
            grown_jump[:pieces] = jump[:pieces]
            edge, jump = grown_edge, grown_jump
            new_edge = np.empty(capacity + 1)
            new_jump = np.empty(capacity, np.int64)
        level = minimum + penalty
        count = 0
        for i in range(pieces):
            tau = jump[i]
            length = sum_w[t] - sum_w[tau]
            s = sum_z[t] - sum_z[tau]
            centre = s / length
            floor = best[tau] + penalty + (sum_zz[t] - sum_zz[tau]) - s * centre
            left, right = edge[i], edge[i + 1]
            if floor >= level:
                keep_left = keep_right = left
            else:
                half = np.sqrt((level - floor) / length)
                keep_left = min(max(centre - half, left), right)
                keep_right = max(min(centre + half, right), keep_left)
            for part in range(3):
                if part == 0:
                    begin, end, owner = left, keep_left, t
                elif part == 1:
                    begin, end, owner = keep_left, keep_right, tau
                else:
                    begin, end, owner = keep_right, right, t
                if end > begin:
                    if count > 0 and new_jump[count - 1] == owner:
                        new_edge[count] = end
                    else:
                        if count == 0:
                            new_edge[0] = begin
                        new_jump[count] = owner
                        new_edge[count + 1] = end
                        count += 1
        if count == 0:  # all values equal: one degenerate piece
            new_edge[0], new_edge[1], new_jump[0] = low, high, jump[0]
            count = 1
        edge, new_edge = new_edge, edge
        jump, new_jump = new_jump, jump
        pieces = count

    jumps = 0
    t = n
    while t > 0:
        t = last[t]
        if t > 0:
            jumps += 1
    found = np.empty(jumps, np.int64)
    t = n
    i = jumps - 1
    while t > 0:
        t = last[t]
        if t > 0:
            found[i] = t
            i -= 1
    return found
