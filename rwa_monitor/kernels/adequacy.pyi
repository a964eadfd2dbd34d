from typing import Final

import numpy as np
from numpy.typing import NDArray

from rwa_monitor.changepoints.running_sums import SumArrays
from rwa_monitor.samples import BoolArray, FloatArray, IntArray

FEWEST_BLOCKS: Final[int]
LARGEST_BLOCK: Final[float]

def cut(
    size: int, blocks: int, index: IntArray, slope: float, sums: SumArrays
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, IntArray, NDArray[np.uint8]]:
    """Return n, x, friction, residual, interval and usable of `Blocks`; `index` are the changepoints."""

def deviations_of_slopes(moments: FloatArray, variance: float) -> tuple[FloatArray, FloatArray]:
    """Return each interval's slope less the common one in standard deviations, and its mean speed; (intervals,).

    `moments` are float64 (6, intervals), `variance` that of the noise of a long mean.
    """

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

def crossing_deviations(
    near_zero: FloatArray, direction: FloatArray, index: IntArray, level: FloatArray, viscous: float, block: int
) -> tuple[FloatArray, FloatArray]:
    """Return mean squared deviation and mean deviation of the dead band's friction at each crossing; (crossings,).

    A crossing with too few samples is left out.

    Parameters
    ----------
    near_zero, direction
        See `Structure`.
    index, level, viscous
        See `Estimate`.
    block
        Slots of a block.
    """

def lasting(
    residual: FloatArray,
    n: FloatArray,
    usable: BoolArray,
    interval: IntArray,
    intervals: int,
    expected: FloatArray,
    first: int,
) -> tuple[float, float]:
    """Return the significance of `adequacy.persistence`, and the largest mean product of residuals, per sample.

    Parameters
    ----------
    residual, n, usable, interval, intervals
        See `Blocks`.
    expected
        float64 (lags,), correlation of the means of two blocks at each lag by the noise's own memory.
    first
        The first lag.
    """
