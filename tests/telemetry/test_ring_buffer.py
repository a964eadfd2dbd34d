"""The ring buffer against a dictionary that keeps everything."""

from __future__ import annotations

import hypothesis.strategies as st
import numpy as np
from hypothesis import given

from rwa_monitor.telemetry.slots import RingBuffer

CAPACITY = 13


@given(
    steps=st.lists(st.lists(st.booleans(), min_size=1, max_size=CAPACITY), max_size=12),
    begin=st.integers(0, 30),
)
def test_it_holds_the_last_slots(steps: list[list[bool]], begin: int) -> None:
    ring = RingBuffer(CAPACITY, (), CAPACITY)
    ring.clear(begin)
    reference: dict[int, float] = {}
    value = 0.0
    for filled in steps:
        slots = ring.end + np.flatnonzero(filled)
        values = value + np.arange(slots.size, dtype=np.float64)
        value += slots.size
        reference.update(zip(slots.tolist(), values.tolist(), strict=True))
        ring.extend(ring.end + len(filled), slots, {"speed_rad_s": values, "torque_Nm": -values})
    low, high = ring.begin - 5, ring.end + 5
    asked = np.arange(low, high)
    held = (asked >= ring.begin) & (asked < ring.end)
    assert ring.begin == max(begin, ring.end - CAPACITY)
    expected = np.array([reference.get(slot, np.nan) if ok else np.nan for slot, ok in zip(asked, held, strict=True)])
    np.testing.assert_array_equal(ring.read("speed_rad_s", low, high), expected)
    np.testing.assert_array_equal(ring.read("torque_Nm", low, high), -expected)
    np.testing.assert_array_equal(ring.is_filled(asked), ~np.isnan(expected))


def test_values_are_kept_for_fewer_slots_than_the_fact_that_they_came() -> None:
    ring = RingBuffer(CAPACITY, (), 4)
    for start in range(0, 18, 3):
        slots = np.arange(start, start + 3)
        ring.extend(start + 3, slots[1:], dict.fromkeys(ring.channels, slots[1:] + 0.5))
    asked = np.arange(18)
    np.testing.assert_array_equal(ring.is_filled(asked), (asked >= 18 - CAPACITY) & (asked % 3 > 0))
    values = ring.read("torque_Nm", 0, 18)
    np.testing.assert_array_equal(values, np.where((asked >= 14) & (asked % 3 > 0), asked + 0.5, np.nan))
    again = RingBuffer(CAPACITY, (), 4)
    again.restore(ring.begin, ring.is_filled(np.arange(ring.begin, 18)), dict.fromkeys(ring.channels, values[8:]))
    np.testing.assert_array_equal(again.read("torque_Nm", 0, 18), values)
    np.testing.assert_array_equal(again.is_filled(asked), ring.is_filled(asked))
