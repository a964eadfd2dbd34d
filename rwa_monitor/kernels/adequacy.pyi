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
    """Return n, x, friction, residual, interval and usable of `estimation.Blocks`; `index` are the changepoints."""

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
