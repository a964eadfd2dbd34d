from typing import Final

from rwa_monitor.changepoints.candidates import PeakArrays, ScanState
from rwa_monitor.changepoints.evidence import Learned, WindowSettings
from rwa_monitor.changepoints.running_sums import StructureArrays, SumArrays
from rwa_monitor.samples import BoolArray, FloatArray, IntArray

KEPT_STATISTIC: Final[float]
SMALLEST_WEIGHT: Final[float]
ALL_DONE: Final[int]
FIRST_CHUNK: Final[int]
NO_ROOM: Final[int]
VARIANCE: Final[int]
WEIGHT: Final[int]
COUNTED: Final[int]
OUTLIER: Final[int]

# x, z, good, used, (slots,): the samples, normalised; which are good, and which of those are used. Running sums, see
# `RunningSums`, and what is in their classes: structure, scan, what was learned. Sums and pairs of blocks, float64
# (B, LAGS), see `block_differences`. int64 (S,): half-widths of the scales [slots].
_WindowArrays = tuple[
    FloatArray,
    FloatArray,
    BoolArray,
    BoolArray,
    SumArrays,
    FloatArray,
    StructureArrays,
    FloatArray,
    FloatArray,
    ScanState,
    IntArray,
    Learned,
]

class Window:
    """The arrays of a window, looked up once: they must not be replaced while it is in use."""

    def __init__(self, arrays: _WindowArrays, settings: WindowSettings, peaks: PeakArrays) -> None: ...

def gather(
    window: Window,
    speed: FloatArray,
    torque: FloatArray,
    good: BoolArray,
    filled: int,
    done: int,
    last: bool,
) -> tuple[int, int, int, int]:
    """Take new slots into a window, and detect in all that are there.

    Parameters
    ----------
    window
        The window, changed in place.
    speed, torque, good
        (n,), the new slots as they were measured.
    filled, done
        Slots that the window holds, and those in which it has detected.
    last
        Whether no slot will follow: else the last ones wait until a step of STEP is full, the first until a chunk is.

    Returns
    -------
    tuple[int, int, int, int]
        How many of the new slots are good, where detection ended, how many jumps it reports, see `PeakArrays`, and why
        it ended: ALL_DONE; FIRST_CHUNK, of which what counts as used is to be marked, and `Learned.numbers` is to hold
        WEIGHT, dead band and certain speed; NO_ROOM for the peaks of the next chunk; else the tails of the noise look
        heavy, and `Learned.numbers` is to hold the largest OUTLIER by chance. In all cases but the first it is to be
        called again, without a slot.
    """
