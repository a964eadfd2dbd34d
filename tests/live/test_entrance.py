"""The short way of a clean message: what it takes, what it leaves to the long way, and that both end alike."""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwa_monitor.live.entrance import enter
from rwa_monitor.live.order_guard import OrderGuard
from rwa_monitor.live.ring_buffer import RingBuffer
from rwa_monitor.live.screen import HANGING_SLOTS, Screen
from rwa_monitor.live.sequencer import Counts
from rwa_monitor.physics.wheel import Limits
from rwa_monitor.samples import FloatArray, Samples
from rwa_monitor.slots import MAX_TIME_NS, MIN_TIME_NS, SlotGrid

PERIOD_NS = 125_000_000
BEFORE = 300  # slots that are there already
LIMIT = 500.0  # [rad/s]
SPEED_STEP, TORQUE_STEP = 0.5, 1e-3  # what a wheel can do within a slot

Way = tuple[OrderGuard, RingBuffer, Screen]


def restless(count: int, seed: int) -> tuple[FloatArray, FloatArray]:
    """Return speed and friction as noisy sensors measure them."""
    rng = np.random.default_rng(seed)
    return 200.0 + 0.01 * rng.standard_normal(count), 2e-3 + 4e-5 * rng.standard_normal(count)


def message(first: int, count: int, seed: int = 2) -> Samples:
    speed, torque = restless(count, seed)
    return Samples(np.arange(first, first + count) * PERIOD_NS, speed, torque)


def way(capacity: int = 1_000, origin_ns: int = 0, period_ns: int = PERIOD_NS, before: int = BEFORE) -> Way:
    """Return guard, ring buffer and screen that have seen so many clean slots."""
    counts = Counts(queued=10_000)
    guard = OrderGuard(period_ns, 10**6, Limits(max_speed_rad_s=LIMIT), None, counts)
    guard.grid, guard.frontier = SlotGrid(origin_ns, period_ns), before
    ring, screen = RingBuffer(capacity), Screen(SPEED_STEP, TORQUE_STEP)
    speed, torque = restless(before, 1)
    for start in range(0, before, capacity):
        part = slice(start, min(start + capacity, before))
        ring.extend(
            part.stop, np.arange(part.start, part.stop), {"speed_rad_s": speed[part], "torque_Nm": torque[part]}
        )
    screen.run(ring, before - 1, lambda _: 0)
    return guard, ring, screen


def state(way: Way) -> dict[str, Any]:
    """Return all that the three know."""
    guard, ring, screen = way
    return {
        "counts": asdict(guard.counts),
        "guard": (guard.frontier, guard.last_ns),
        "ring": (ring.end, ring.filled.tobytes(), ring.speed_rad_s.tobytes(), ring.torque_Nm.tobytes()),
        "screen": (screen.done, screen.speed.state.tobytes(), screen.torque.state.tobytes()),
    }


def go_the_long_way(samples: Samples, way: Way) -> None:
    """Take clean samples step by step."""
    guard, ring, screen = way
    piece = guard.next_piece(samples.time_ns, np.ones(len(samples), dtype=np.bool_), 0, ring.is_filled)
    assert samples.friction_torque_Nm is not None
    values = {"speed_rad_s": samples.speed_rad_s, "torque_Nm": samples.friction_torque_Nm}
    ring.extend(guard.frontier, piece.slots, values)
    assert screen.run(ring, ring.end - 1, lambda _: 0) == (0, [])


@given(
    sizes=st.lists(st.integers(1, 400), min_size=1, max_size=8),
    capacity=st.integers(402, 700),  # a message, the slots around it; its end lies within one now and then
    seed=st.integers(0, 5),
)
def test_both_ways_end_alike(sizes: list[int], capacity: int, seed: int) -> None:
    short, long, first = way(capacity), way(capacity), BEFORE
    for number, size in enumerate(sizes):
        samples = message(first, size, seed + number)
        assert enter(samples, *short)
        go_the_long_way(samples, long)
        assert state(short) == state(long)
        first += size
    assert short[0].counts.used == sum(sizes)


def spoiled(samples: Samples, how: str) -> Samples:
    """Return a message that has to go the long way."""
    time_ns, speed = samples.time_ns.copy(), samples.speed_rad_s.copy()
    assert samples.friction_torque_Nm is not None
    torque = samples.friction_torque_Nm.copy()
    if how == "late":
        time_ns -= PERIOD_NS
    elif how == "a gap before":
        time_ns += PERIOD_NS
    elif how == "a gap within":
        time_ns[20:] += PERIOD_NS
    elif how == "out of order":
        time_ns[[5, 6]] = time_ns[[6, 5]]
    elif how == "a wild time":
        time_ns[5] = MAX_TIME_NS + 1
    elif how == "speed missing":
        speed[-1] = np.nan
    elif how == "friction missing":
        torque[0] = np.nan
    elif how == "too fast":
        speed[7] = LIMIT * 1.01
    elif how == "too much friction":
        torque[7] = np.inf
    elif how == "another channel missing":
        return replace(samples, bearing_temperature_degC=np.where(np.arange(len(samples)) == 3, np.nan, 20.0))
    elif how == "no friction":
        return replace(samples, friction_torque_Nm=None)
    elif how == "empty":
        return samples[:0]
    return Samples(time_ns, speed, torque)


@pytest.mark.parametrize(
    "how",
    [
        "late",
        "a gap before",
        "a gap within",
        "out of order",
        "a wild time",
        "speed missing",
        "friction missing",
        "too fast",
        "too much friction",
        "another channel missing",
        "no friction",
        "empty",
    ],
)
def test_any_other_message_is_left_alone(how: str) -> None:
    of_wheel = way()
    before = state(of_wheel)
    assert not enter(spoiled(message(BEFORE, 60), how), *of_wheel)
    assert state(of_wheel) == before


def test_another_channel_that_is_there_does_no_harm() -> None:
    of_wheel = way()
    assert enter(replace(message(BEFORE, 60), bearing_temperature_degC=np.full(60, 20.0)), *of_wheel)
    assert state(of_wheel)["guard"] == (BEFORE + 60, (BEFORE + 59) * PERIOD_NS)


@pytest.mark.parametrize("channel", ["speed_rad_s", "friction_torque_Nm"])
@pytest.mark.parametrize("how", ["stands out", "hangs"])
def test_what_the_screen_finds_is_taken_and_left_for_it_to_mask(channel: str, how: str) -> None:
    of_wheel = guard, ring, screen = way()
    samples = message(BEFORE, 60)
    values = getattr(samples, channel).copy()
    if how == "stands out":
        values[30] *= 2.0
    else:
        values[10 : 12 + HANGING_SLOTS] = values[10]
    screened = state(of_wheel)["screen"]
    assert enter(replace(samples, **{channel: values}), *of_wheel)
    assert (guard.frontier, ring.end) == (BEFORE + 60, BEFORE + 60)
    assert state(of_wheel)["screen"] == screened
    assert not enter(message(BEFORE + 60, 10), *of_wheel)  # what comes next waits for the screen
    masked, faults = screen.run(ring, ring.end - 1, lambda _: 0)
    assert masked == (1 if how == "stands out" else HANGING_SLOTS + 1)
    assert [fault.hangs for fault in faults] == [how == "hangs"]
    assert enter(message(BEFORE + 60, 10), *of_wheel)


@given(
    origin_ns=st.integers(MIN_TIME_NS, MAX_TIME_NS - 10**14),
    period_ns=st.integers(1_000, 10**12),
    first=st.integers(1, 50),
    jitter=st.lists(st.floats(-0.6, 0.6), min_size=1, max_size=20),
)
def test_samples_go_straight_on_where_the_grid_gives_them_the_next_slots(
    origin_ns: int, period_ns: int, first: int, jitter: list[float]
) -> None:
    """The short way without a division, against the grid's own arithmetic."""
    of_wheel = way(origin_ns=origin_ns, period_ns=period_ns, before=first)
    expected = np.arange(first, first + len(jitter))
    time_ns = origin_ns + expected * period_ns + (np.array(jitter) * period_ns).astype(np.int64)
    straight = SlotGrid(origin_ns, period_ns).slot_of(time_ns).tolist() == expected.tolist()
    assert enter(replace(message(first, len(jitter)), time_ns=time_ns), *of_wheel) is straight
