"""The ring buffer against a dictionary that keeps everything."""

from __future__ import annotations

import hypothesis.strategies as st
import numpy as np
from hypothesis import given

from rwa_monitor.live.core import WheelCore
from rwa_monitor.live.ring_buffer import RingBuffer
from rwa_monitor.physics.wheel import built_in_wheel
from tests.live.support import telemetry

CAPACITY = 13


@given(
    steps=st.lists(st.lists(st.booleans(), min_size=1, max_size=CAPACITY), max_size=12),
    begin=st.integers(0, 30),
)
def test_it_holds_the_last_slots(steps: list[list[bool]], begin: int) -> None:
    ring = RingBuffer(CAPACITY)
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


def test_memory_is_bounded() -> None:
    # 80,000 slots, two channels of 8 bytes and a flag, and room for the piece that is being written.
    core = WheelCore(built_in_wheel(), None)
    core.feed(telemetry(2_000, given=False))
    assert core.buffer_bytes <= 3_000_000
