from typing import Final

from rwa_monitor.changepoints.running_sums import SumArrays
from rwa_monitor.samples import FloatArray, IntArray

STRIDE: Final[int]
CENTRE_BLOCK: Final[int]

def find_centre(arrays: SumArrays, running: FloatArray, start: int, stop: int) -> None:
    """Centre sums that hold nothing yet on the medians of the first used slots of [start, stop), about to be added."""

def extend_checkpoints(arrays: SumArrays, running: FloatArray, start: int, stop: int) -> None:
    """Add the slots [start, stop) to the running sums and keep them at every checkpoint passed, in place.

    `running`, float64 (6,), are the centred sums over [0, start); over [0, stop) afterwards.
    """

def range_moments(start: IntArray, stop: IntArray, slots: int, arrays: SumArrays, out: FloatArray) -> int:
    """Write the statistics of each range [start, stop), int64 (m,), not centred, to `out`, float64 (6, m).

    Returns the samples read, or -1 if a slot lies outside [0, slots].
    """
