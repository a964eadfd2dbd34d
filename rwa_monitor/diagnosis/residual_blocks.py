"""What levels and slope leave of short blocks of a window, from running sums: no sample is read again."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rwa_monitor.changepoints.stage_results import Estimate, Evidence
from rwa_monitor.kernels.adequacy import cut
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
    n, x, friction, residual, interval, usable = cut(
        size, blocks, estimate.index, estimate.viscous, evidence.sums.arrays
    )
    return Blocks(size, n, x, friction, residual, interval, usable.view(np.bool_), count)
