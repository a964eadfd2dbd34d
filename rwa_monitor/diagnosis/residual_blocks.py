"""What levels and slope leave of short blocks of a window, from running sums: no sample is read again."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rwa_monitor.diagnosis.results import Estimate, Evidence
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
    start = np.arange(evidence.slots // size, dtype=np.int64) * size
    sums = evidence.sums.between(start, start + size)
    # The first block that begins at or after each changepoint begins its interval.
    border = np.minimum(-(-estimate.index // size), start.size)
    interval = np.repeat(np.arange(estimate.index.size + 1), np.diff(border, prepend=0, append=start.size))
    usable = sums.n >= size // 2
    inside = estimate.index[(estimate.index % size != 0) & (estimate.index < start.size * size)]
    usable[inside // size] = False
    n = np.maximum(sums.n, 1.0)
    friction = (sums.z - estimate.viscous * sums.x) / n
    # The level is the blocks' own: an estimate leaves out samples beside the jumps, and a difference would look alike
    # in all blocks.
    weight = np.where(usable, sums.n, 0.0)
    count = estimate.index.size + 1
    total = np.maximum(np.bincount(interval, weight, count), 1.0)
    level = np.bincount(interval, weight * friction, count) / total
    return Blocks(size, n, sums.x / n, friction, friction - level[interval], interval, usable, count)
