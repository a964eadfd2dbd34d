from typing import Final

from rwa_monitor.changepoints.running_sums import StructureArrays
from rwa_monitor.samples import BoolArray, FloatArray, IntArray

BLOCK: Final[int]
STRETCH: Final[int]

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
    arrays: StructureArrays,
) -> None:
    """Add the slots [start, stop), which follow those added before.

    Parameters
    ----------
    motion, x, z, good, used
        The whole window, (slots,) each, filled up to `stop`: |ω|, and what viscous friction is in proportion to.
    start, stop
        The new slots.
    certain
        |ω|, normalised, from which its sign is certain.
    angle_per_x, hop
        See `StructureSums`.
    arrays
        What they are added to; not their directions.
    """
