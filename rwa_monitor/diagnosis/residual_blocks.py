"""What levels and slope leave of short blocks of a window, from running sums: no sample is read again."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from rwa_monitor.diagnosis.results import Estimate, Evidence
from rwa_monitor.diagnosis.running_sums import SumArrays, moments_between, prefix_moments
from rwa_monitor.samples import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class Blocks:
    """Blocks of equal length, in order; arrays (blocks,).

    Attributes
    ----------
    size
        Slots of a block.
    n
        Used samples of each.
    x
        Their mean speed, normalised.
    friction
        Their mean friction less the viscous part, normalised.
    residual
        The same less the level of their interval.
    interval
        Number of the interval between changepoints that the block lies in.
    usable
        Whether it lies in one interval and at least half of its slots are used.
    intervals
        Number of intervals.
    """

    size: int
    n: FloatArray
    x: FloatArray
    friction: FloatArray
    residual: FloatArray
    interval: IntArray
    usable: BoolArray
    intervals: int


def residual_blocks(evidence: Evidence, estimate: Estimate, size: int) -> Blocks:
    """Cut a window into blocks and return what the friction model leaves of them.

    Parameters
    ----------
    evidence, estimate
        The window, and its levels and slope between the accepted changepoints.
    size
        Slots of a block; with a multiple of the running sums' stride no sample is read. The rest of the window that
        fills no block is left out.
    """
    blocks, count = evidence.slots // size, estimate.index.size + 1
    n, x, friction, residual, interval, usable = _cut(
        size, blocks, estimate.index, estimate.viscous, evidence.sums.arrays
    )
    return Blocks(size, n, x, friction, residual, interval, usable, count)


@njit(cache=True, error_model="numpy", nogil=True)
def _cut(
    size: int, blocks: int, index: IntArray, slope: float, sums: SumArrays
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, IntArray, BoolArray]:
    """Return the arrays of `Blocks` from the running sums; `index` are the changepoints."""
    n, x, friction, residual = np.empty(blocks), np.empty(blocks), np.empty(blocks), np.empty(blocks)
    interval, usable = np.empty(blocks, dtype=np.int64), np.empty(blocks, dtype=np.bool_)
    weight, total = np.zeros(index.size + 1), np.zeros(index.size + 1)
    own = 0
    begin = prefix_moments(0, sums)
    for b in range(blocks):
        # The first block that begins at or after each changepoint begins its interval.
        while own < index.size and index[own] <= b * size:
            own += 1
        interval[b] = own
        end = prefix_moments((b + 1) * size, sums)
        count, sum_x, sum_z, _, _, _ = moments_between(begin, end, sums.centre)
        begin = end
        n[b] = max(count, 1.0)
        x[b] = sum_x / n[b]
        friction[b] = (sum_z - slope * sum_x) / n[b]
        usable[b] = count >= size // 2 and (own == index.size or index[own] >= (b + 1) * size)
        if usable[b]:
            weight[own] += count
            total[own] += count * friction[b]
    # The level is the blocks' own: an estimate leaves out samples beside the jumps, and a difference would look alike
    # in all blocks.
    level = total / np.maximum(weight, 1.0)
    for b in range(blocks):
        residual[b] = friction[b] - level[interval[b]]
    return n, x, friction, residual, interval, usable
