"""The last slots of one wheel in arrays of fixed size, allocated once.

Slot k lives at position k mod capacity. A slot that no sample came for is empty; a slot with a bad value (NaN) is
filled but not good. What was written stays readable until `capacity` later slots have been written.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rwa_monitor.samples import BoolArray, FloatArray, IntArray

REQUIRED: Final = ("speed_rad_s", "torque_Nm")
OPTIONAL: Final = ("motor_torque_Nm", "bearing_temperature_degC")


class RingBuffer:
    """The last `capacity` slots of a wheel.

    Parameters
    ----------
    capacity
        Slots to keep.
    optional
        Which of the `OPTIONAL` channels to keep besides speed and torque.

    Attributes
    ----------
    begin, end
        The slots held: [begin, end).
    """

    def __init__(self, capacity: int, optional: tuple[str, ...] = ()) -> None:
        self.capacity = capacity
        self.end = 0
        self._first = 0
        self._filled: NDArray[np.uint8] = np.zeros(capacity, dtype=np.uint8)
        self._values: dict[str, FloatArray] = {name: np.zeros(capacity) for name in (*REQUIRED, *optional)}

    @property
    def begin(self) -> int:
        """First slot that is still held."""
        return max(self._first, self.end - self.capacity)

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels kept."""
        return tuple(self._values)

    @property
    def nbytes(self) -> int:
        """Memory of the arrays [bytes]."""
        return self._filled.nbytes + sum(values.nbytes for values in self._values.values())

    def clear(self, begin: int = 0) -> None:
        """Forget all slots and begin again at slot `begin`."""
        self.end = self._first = begin
        self._filled[:] = 0

    def extend(self, end: int, slots: IntArray, values: Mapping[str, FloatArray]) -> None:
        """Append the slots [self.end, end): those in `slots` with their values, the others empty.

        Parameters
        ----------
        end
            New end; at most `capacity` beyond the old one.
        slots
            int64 (n,), strictly increasing, within the appended range.
        values
            float64 (n,) for every channel.
        """
        positions = np.arange(self.end, end) % self.capacity
        self._filled[positions] = 0
        for array in self._values.values():
            array[positions] = np.nan
        positions = slots % self.capacity
        self._filled[positions] = 1
        for name, array in self._values.items():
            array[positions] = values[name]
        self.end = end

    def is_filled(self, slots: IntArray) -> BoolArray:
        """Return which slots a sample came for, bool (n,); False for slots that are no longer, or not yet, held."""
        held = (slots >= self.begin) & (slots < self.end)
        return np.asarray(held & (self._filled[slots % self.capacity] == 1), dtype=np.bool_)

    def read(self, name: str, start: int, stop: int) -> FloatArray:
        """Return a copy of a channel's slots [start, stop), float64; NaN where empty, not held or not kept."""
        result = np.full(stop - start, np.nan)
        if name in self._values:
            low, high = max(start, self.begin), min(stop, self.end)
            if low < high:
                result[low - start : high - start] = self._values[name][np.arange(low, high) % self.capacity]
        return result

    def overwrite(self, name: str, start: int, values: FloatArray) -> None:
        """Replace a channel's slots [start, start + n), which must be held."""
        self._values[name][np.arange(start, start + values.size) % self.capacity] = values
