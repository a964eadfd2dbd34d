from typing import Final

import numpy as np
from numpy.typing import NDArray

from rwa_monitor.samples import FloatArray, IntArray

HANGING_SLOTS: Final[int]
OUTSTANDING_SLOTS: Final[int]
HANGS: Final[int]
STANDS_OUT: Final[int]

def judge(
    values: FloatArray,
    following: FloatArray,
    limit: float,
    state: FloatArray,
    kind: NDArray[np.int8],
    since: IntArray,
) -> bool:
    """Return whether `slots.Channel.judge` finds a fault; updates `state`; sets `kind` and `since`, zeros on entry."""
