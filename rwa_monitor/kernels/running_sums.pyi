from typing import Final

from rwa_monitor.changepoints.running_sums import StructureSums, SumArrays
from rwa_monitor.samples import BoolArray, FloatArray, IntArray

STRIDE: Final[int]
BLOCK: Final[int]
STRETCH: Final[int]

def extend_sums(arrays: SumArrays, running: FloatArray, start: int, stop: int) -> None:
    """Add the slots [start, stop) to the running sums and keep them at every checkpoint passed, in place.

    `running`, float64 (6,), are the centred sums over [0, start); over [0, stop) afterwards. Empty sums are centred on
    the medians of the first used slots.
    """

def range_moments(start: IntArray, stop: IntArray, slots: int, arrays: SumArrays, out: FloatArray) -> bool:
    """Write the statistics of each range [start, stop), int64 (m,), not centred, to `out`, float64 (6, m).

    Returns whether all slots lie in [0, slots].
    """

def slope_within(
    slots: int,
    index: IntArray,
    exclude: IntArray,
    sums: SumArrays,
    variance: float,
    prior_mean: float,
    prior_std: float,
) -> tuple[float, float]:
    """Return the shared slope and its standard deviation from the slots so far, see `estimation.estimate`.

    Parameters
    ----------
    slots, sums
        Length of the window so far, and its running sums.
    index
        int64 (m,), changepoints, ascending.
    exclude
        int64 (m,), slots left out on each side of each changepoint (Δk_error of the paper), at most a quarter of an
        interval at each end. Where the rest has no used slot, the whole interval is used.
    variance
        Long-run variance of the noise.
    prior_mean, prior_std
        Of the slope; NaN where nothing is known.
    """

def count_signs(first: int, speed: FloatArray, good: BoolArray, signs: IntArray, counts: IntArray) -> None:
    """Add the slots from `first` on that are good, and those forward less those backward, to their blocks."""

def extend_structure(
    motion: FloatArray,
    x: FloatArray,
    z: FloatArray,
    good: BoolArray,
    used: BoolArray,
    start: int,
    stop: int,
    certain: float,
    angle_per_x: float,
    hop: int,
    arrays: StructureSums,
) -> None:
    """Add the slots [start, stop), which follow those added before.

    Parameters
    ----------
    motion, x, z, good, used
        The whole window, (slots,) each, filled up to `stop`: |ω| first, then the speed of the viscous friction.
    start, stop
        The new slots.
    certain
        |ω|, normalised, above which its sign is certain.
    angle_per_x, hop
        As `angle_per_x` and `stretch_hop` of `WindowSettings`.
    arrays
        Updated, but for the signs and their counts.
    """
