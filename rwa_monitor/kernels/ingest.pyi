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
    """Assign samples to slots, as `SlotGrid.slot_of`, and mark those later than all before.

    Parameters
    ----------
    time_ns, good
        int64 and bool (n,).
    origin_ns, period_ns
        Of the grid.
    frontier, window_slots, passed
        As in `OrderGuard`. The piece ends before a clock step.
    furthest
        The piece also ends before a slot beyond this one, but has at least one sample unless a clock step comes first.
    slots, ahead
        int64 and bool (n,), output for the samples of the piece.

    Returns
    -------
    tuple[int, int, int]
        Number of samples in the piece, how many of them are ahead, and how many of those are good.
    """

def judge(
    values: FloatArray,
    following: FloatArray,
    limit: float,
    state: FloatArray,
    kind: NDArray[np.int8],
    since: IntArray,
) -> bool:
    """Return whether `slots.Channel.judge` finds a fault; updates `state`; sets `kind` and `since`, zeros on entry."""
