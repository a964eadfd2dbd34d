from typing import Final

import numpy as np
from numpy.typing import NDArray

from rwa_monitor.samples import BoolArray, FloatArray, IntArray

HANGING_SLOTS: Final[int]
OUTSTANDING_SLOTS: Final[int]
HANGS: Final[int]
STANDS_OUT: Final[int]

def assign_slots(
    time_ns: IntArray,
    good: BoolArray,
    origin_ns: int,
    period_ns: int,
    frontier: int,
    furthest: int,
    window_slots: int,
    passed: bool,
    slots: IntArray,
    ahead: BoolArray,
) -> tuple[int, int, int]:
    """Give samples their slots, as `SlotGrid.slot_of`, and mark which of them are ahead of all before.

    Parameters
    ----------
    time_ns, good
        int64 and bool (n,).
    origin_ns, period_ns
        Of the grid.
    frontier, window_slots, passed
        As `OrderGuard` has them. The piece ends before a clock step.
    furthest
        The piece ends before a slot beyond, too, but holds one sample at least.
    slots, ahead
        int64 and bool (n,), output in the piece's part.

    Returns
    -------
    tuple[int, int, int]
        How many samples belong to the piece, how many of them are ahead, and how many of those are good.
    """

def judge(
    values: FloatArray,
    following: FloatArray,
    limit: float,
    state: FloatArray,
    kind: NDArray[np.int8],
    since: IntArray,
) -> bool:
    """Return whether `slots.Channel.judge` finds anything; `state` goes on; sets `kind`, `since`, zeros."""
