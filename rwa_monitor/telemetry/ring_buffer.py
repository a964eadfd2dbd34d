"""The last slots of one wheel in arrays of fixed size, allocated once.

Slot k lives at position k modulo the array's size. A slot that no sample came for is empty; a slot with a bad value
(NaN) is filled but not good. That a slot was filled is known for `capacity` slots; values, of which only the newest are
worked on, are kept for `values_capacity`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from rwa_monitor.samples import BoolArray, FloatArray, IntArray

REQUIRED: Final = ("speed_rad_s", "torque_Nm")
OPTIONAL: Final = ("motor_torque_Nm", "bearing_temperature_degC")


class RingBuffer:
    """The last slots of a wheel.

    Parameters
    ----------
    capacity
        Slots of which to know whether they were filled.
    optional
        Which of the `OPTIONAL` channels to keep besides speed and torque.
    values_capacity
        Slots whose values to keep.

    Attributes
    ----------
    begin, end
        The slots held: [begin, end).
    channels
        Names of the channels kept.
    """

    def __init__(self, capacity: int, optional: tuple[str, ...], values_capacity: int) -> None:
        self.capacity = capacity
        self.values_capacity = min(values_capacity, capacity)
        self.end = 0
        self._first = 0
        self._filled: NDArray[np.uint8] = np.zeros(capacity, dtype=np.uint8)
        self.channels = (*REQUIRED, *optional)
        self._values: dict[str, FloatArray] = {name: np.zeros(self.values_capacity) for name in self.channels}

    @property
    def begin(self) -> int:
        """First slot that is still held."""
        return max(self._first, self.end - self.capacity)

    @property
    def values_begin(self) -> int:
        """First slot whose values are still held."""
        return max(self._first, self.end - self.values_capacity)

    def clear(self, begin: int = 0) -> None:
        """Drop all slots and begin again at slot `begin`."""
        if self.end > self._first:
            self._filled[:] = 0
        self.end = self._first = begin

    def extend(self, end: int, slots: IntArray, values: Mapping[str, FloatArray]) -> None:
        """Append the slots [self.end, end): those in `slots` with their values, the others empty.

        Parameters
        ----------
        end
            New end; at most `values_capacity` beyond the old one.
        slots
            int64 (n,), strictly increasing, within the appended range.
        values
            float64 (n,) for every channel.
        """
        start, count = self.end, end - self.end
        rows = slots - start
        filled = np.zeros(count, dtype=np.uint8)
        filled[rows] = 1
        _put(self._filled, start, filled)
        for name, array in self._values.items():
            spread = values[name]
            if slots.size < count:
                spread = np.full(count, np.nan)
                spread[rows] = values[name]
            _put(array, start, spread)
        self.end = end

    def restore(self, begin: int, filled: BoolArray, values: Mapping[str, FloatArray]) -> None:
        """Hold the slots [begin, begin + n) and nothing else.

        Parameters
        ----------
        begin
            First slot.
        filled
            bool (n,), at most `capacity`: which slots a sample came for.
        values
            float64 (m,) for every channel, m ≤ n: values of the last m slots, NaN where empty.
        """
        self.clear(begin)
        self.end = begin + filled.size
        _put(self._filled, begin, filled.astype(np.uint8))
        for name, array in self._values.items():
            last = values[name][-self.values_capacity :]
            _put(array, self.end - last.size, last)

    def is_filled(self, slots: IntArray) -> BoolArray:
        """Return which slots a sample came for, bool (n,); False for slots that are no longer, or not yet, held."""
        held = (slots >= self.begin) & (slots < self.end)
        return np.asarray(held & (self._filled[slots % self.capacity] == 1), dtype=np.bool_)

    def read(self, name: str, start: int, stop: int) -> FloatArray:
        """Return a channel's slots [start, stop), float64, to be read only; NaN where empty, not held or not kept.

        They are those of the buffer itself where they lie there side by side: `extend` and `overwrite` change them.
        """
        array = self._values.get(name)
        if array is not None and self._first <= start < stop <= self.end and start >= self.end - array.size:
            at = start % array.size
            if at + stop - start <= array.size:
                return array[at : at + stop - start]
        result = np.full(stop - start, np.nan)
        if array is not None:
            kept = np.arange(max(start, self.values_begin), min(stop, self.end))
            result[kept - start] = array[kept % array.size]
        return result

    def read_required(self, start: int, stop: int) -> tuple[FloatArray, FloatArray]:
        """Return speed and torque of the slots [start, stop), as `read` does."""
        return self.read("speed_rad_s", start, stop), self.read("torque_Nm", start, stop)

    def overwrite(self, name: str, start: int, values: FloatArray) -> None:
        """Replace a channel's slots [start, start + n), whose values must be held."""
        _put(self._values[name], start, values)


def _put(array: NDArray[Any], start: int, values: NDArray[Any]) -> None:
    """Write the values of the slots from `start` on, over the array's end and on from its begin."""
    at = start % array.size
    if at + values.size <= array.size:
        array[at : at + values.size] = values
    else:
        array[np.arange(at, at + values.size) % array.size] = values
