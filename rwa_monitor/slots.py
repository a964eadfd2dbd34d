"""The slot grid: which slot of a wheel's regular grid a sample belongs to, and which slots make a window.

slot = round((t - t0) / sample_period), with t0 the time of a wheel's first sample (of its epoch). A window is
`samples` consecutive slots; the next one begins `hop` slots later. All in integer arithmetic, so that live and batch
agree to the last bit.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, overload

import numpy as np

from rwa_monitor.samples import NANOSECONDS_PER_SECOND, IntArray

# Times that the arithmetic below holds in 64 bits for any two of them: 1954 to 2096, if the clock counts from 1970.
MIN_TIME_NS: Final = -500_000_000_000_000_000
MAX_TIME_NS: Final = 4_000_000_000_000_000_000
MIN_PERIOD_NS: Final = 1_000  # 1 MHz: faster sampling than any wheel's electronics gives is a wrong unit


@dataclass(frozen=True, slots=True)
class SlotGrid:
    """A regular grid of slots that begins at `origin_ns`.

    Attributes
    ----------
    origin_ns
        Time of slot 0 [ns], the time of the epoch's first sample.
    period_ns
        Length of a slot [ns].
    """

    origin_ns: int
    period_ns: int

    @overload
    def slot_of(self, time_ns: int) -> int: ...
    @overload
    def slot_of(self, time_ns: IntArray) -> IntArray: ...
    def slot_of(self, time_ns: int | IntArray) -> int | IntArray:
        """Return the slot of each time, int64 (n,), or of one; the nearest, the later when exactly between two."""
        return (2 * (time_ns - self.origin_ns) + self.period_ns) // (2 * self.period_ns)

    def time_of(self, slot: int) -> int:
        """Return the time of a slot [ns]."""
        return self.origin_ns + slot * self.period_ns


def period_ns(sample_period_s: float) -> int:
    """Return a sample period in whole nanoseconds."""
    return int(np.rint(sample_period_s * NANOSECONDS_PER_SECOND))
