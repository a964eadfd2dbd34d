"""The order guard: where each sample goes, and that every one of them is accounted for."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings

from rwa_monitor.monitor.checkpoint import Checkpoint
from rwa_monitor.monitor.core import Event, WheelCore, WindowDiagnosed
from rwa_monitor.monitor.ingest import (
    HOLD_BACK_MESSAGES,
    TAKEOVER_MESSAGES,
    UNCERTAIN_FACTOR,
    Trouble,
)
from rwa_monitor.samples import MAX_TIME_NS, MIN_TIME_NS, Samples
from rwa_monitor.wheel.wheel import Limits
from rwa_monitor.words import time_text
from tests.monitor.support import WINDOW, adds_up, messages_of, telemetry, wheel

PERIOD_NS = 125_000_000


def samples_at(slots: list[int], speed: float = 100.0) -> Samples:
    time_ns = np.array(slots, dtype=np.int64) * PERIOD_NS
    return Samples(time_ns, np.full(time_ns.size, speed), np.full(time_ns.size, 1.6e-3))


def new_core() -> WheelCore:
    return WheelCore(wheel(), None)


TOOK_OVER = "publisher 'after' took over from 'before', which had gone silent"


def troubles(events: list[Event], kind: str) -> list[str]:
    """Return what is reported of a kind."""
    return [event.text for event in events if isinstance(event, Trouble) and event.kind == kind]


def test_gaps_late_and_repeated_samples_are_distinguished() -> None:
    core = new_core()
    core.feed(samples_at([0, 1, 2, 5, 6]))
    core.feed(samples_at([3]))  # passed and empty: late
    core.feed(samples_at([5, 6, 7]))  # two of them again
    core.feed(samples_at([8, 8]))  # twice within one message
    counts = core.counts
    assert (counts.used, counts.late, counts.duplicate, counts.slots_missed) == (7, 1, 3, 2)
    assert adds_up(counts)


def test_values_that_are_not_finite_hold_their_slot_but_are_masked() -> None:
    core = new_core()
    samples = samples_at([0, 1, 2, 3])
    samples.speed_rad_s[1] = np.nan
    samples.friction_torque_Nm[2] = np.inf
    core.feed(samples)
    core.feed(samples_at([1]))
    assert (core.counts.used, core.counts.masked, core.counts.duplicate) == (2, 2, 1)


def test_samples_beyond_the_wheels_limits_are_rejected_and_leave_no_trace() -> None:
    core = new_core()
    core.feed(samples_at([0, 1]))
    core.feed(samples_at([2, 3], speed=651.0))
    core.feed(samples_at([2, 3]))
    assert (core.counts.used, core.counts.rejected, core.counts.slots_missed) == (4, 2, 0)


def test_values_that_no_wheel_has_are_rejected_also_without_limits() -> None:
    unlimited = wheel().model_copy(update={"limits": Limits()})
    samples = telemetry(3 * WINDOW)
    wild = samples[:]
    wild.friction_torque_Nm[[5, 100, 101, 2_000]] = (1e182, -1e7, 1.001e6, 1e300)
    wild.speed_rad_s[700] = -1e200
    core, clean = WheelCore(unlimited, None), WheelCore(unlimited, None)
    events = core.feed(wild)
    assert core.counts.rejected == 5
    assert messages_of(events) == messages_of(
        clean.feed(samples[np.setdiff1d(np.arange(len(samples)), [5, 100, 101, 700, 2_000])])
    )


@pytest.mark.parametrize("step", [WINDOW + 1, -WINDOW - 1, 50 * WINDOW, -3 * WINDOW])
def test_a_clock_step_of_more_than_a_window_begins_an_epoch(step: int) -> None:
    core = new_core()
    origin = 10 * WINDOW
    core.feed(samples_at([origin, origin + 1]))
    events = core.feed(samples_at([origin + 1 + step, origin + 2 + step]))
    (reported,) = troubles(events, "clock step")
    first_ns = (origin + 1 + step) * PERIOD_NS
    assert f"stepped by {step * PERIOD_NS / 1e9:.3f} s, to {time_text(first_ns)}" in reported
    assert core.assignment.grid.origin_ns == first_ns
    assert core.counts.used == 4


@pytest.mark.parametrize("size", [1, 3, 100])
@pytest.mark.parametrize("wild", [-(2**55), 2**40, 2**60])
def test_single_wild_times_are_rejected_and_reported_however_samples_are_cut(size: int, wild: int) -> None:
    samples = telemetry(2 * WINDOW + 50)
    spoilt = samples[:]
    places = [0, 7, 8, 500, 1_501]
    spoilt.time_ns[places] += wild + np.arange(len(places)) * 2**50  # no two of them agree
    core, clean = WheelCore(wheel(), None), WheelCore(wheel(), None)
    events = [event for start in range(0, len(spoilt), size) for event in core.feed(spoilt[start : start + size])]
    expected = clean.feed(samples[np.setdiff1d(np.arange(len(samples)), places)])
    reported = sum(int(text.split()[0]) for text in troubles(events, "stray samples"))
    assert core.counts.rejected == len(places)
    assert core.assignment.last_ns == samples.time_ns[-1]
    assert reported == sum(MIN_TIME_NS <= time_ns <= MAX_TIME_NS for time_ns in spoilt.time_ns[places])
    assert troubles(events, "clock step") == []
    assert messages_of(events) == messages_of(expected)
    assert adds_up(core.counts)


def test_a_sample_that_the_next_one_judges_waits_and_is_counted() -> None:
    core = new_core()
    core.feed(samples_at([0, 1]))
    assert core.feed(samples_at([5 * WINDOW])) == []
    assert (core.counts.used, core.counts.queued) == (2, 1)
    kept = Checkpoint.from_json(core.checkpoint(), "test")
    resumed = WheelCore.resume(kept, wheel(), None)
    for one in (core, resumed):
        events = one.feed(samples_at([5 * WINDOW + 1]))
        assert [type(event) for event in events] == [WindowDiagnosed, Trouble]
        assert (one.counts.used, one.counts.queued) == (4, 0)
    core.feed(samples_at([50 * WINDOW, 50 * WINDOW, 50 * WINDOW]))  # one sample three times is not two that agree
    assert (core.counts.queued, core.counts.duplicate) == (1, 2)
    core.finish()
    assert (core.counts.queued, core.counts.rejected) == (0, 1)


def batches(count: int) -> list[Samples]:
    samples = telemetry(count * 50)
    return [samples[i * 50 : (i + 1) * 50] for i in range(count)]


def fed(
    core: WheelCore, parts: Sequence[Samples], publisher: str, numbers: Iterable[int], first: int = 0
) -> list[Event]:
    """Feed parts of these numbers; `first` is that of the publisher's first one."""
    return [event for number in numbers for event in core.feed(parts[number], publisher, number - first)]


def test_a_lost_message_is_given_up_when_enough_others_wait() -> None:
    parts = batches(HOLD_BACK_MESSAGES + 4)
    core = new_core()
    core.feed(parts[0], "p", 0)
    assert fed(core, parts, "p", range(2, 2 + HOLD_BACK_MESSAGES)) == []
    assert core.counts.queued == 50 * HOLD_BACK_MESSAGES
    events = core.feed(parts[2 + HOLD_BACK_MESSAGES], "p", 2 + HOLD_BACK_MESSAGES)
    assert troubles(events, "messages missed") == ["missing: 1 message of 'p', from batch 1 on"]
    assert core.counts.queued == 0
    core.feed(parts[1], "p", 1)  # found again, too late
    core.feed(parts[1], "p", 1)  # and once more
    assert (core.counts.late, core.counts.duplicate, core.counts.messages_missed) == (50, 50, 1)
    assert adds_up(core.counts)


def test_a_history_that_comes_again_after_the_clock_stepped_back_is_no_new_count() -> None:
    after = [replace(part, time_ns=part.time_ns - 40 * WINDOW * PERIOD_NS) for part in batches(8)]
    core, parts = new_core(), [*batches(6), *after]
    fed(core, parts, "same", range(14))
    counts = (core.counts.used, core.counts.duplicate)
    fed(core, parts, "same", range(14))
    assert (core.counts.used, core.counts.duplicate) == (counts[0], counts[1] + 14 * 50)
    assert counts == (14 * 50, 0)


def test_a_publisher_that_counts_anew_leaves_no_message_behind() -> None:
    parts = batches(4)
    core = new_core()
    core.feed(parts[0], "same", 0)
    core.feed(parts[2], "same", 2)  # waits for 1, which never comes
    core.feed(parts[3], "same", 0)
    assert (core.counts.used, core.counts.queued, core.counts.messages_missed) == (150, 0, 1)
    assert adds_up(core.counts)


@pytest.mark.parametrize(("sizes", "run"), [((50, 50), 1), ((50, 50), 7), ((160, 10), 40), ((10, 160), 9)])
def test_two_publishers_that_send_in_bursts_are_not_mixed(sizes: tuple[int, int], run: int) -> None:
    """Both send the same times at one pace; the second never gets a word in, however its messages are cut."""
    samples = telemetry(1_600)
    one, other = ([samples[i : i + size] for i in range(0, 1_600, size)] for size in sizes)
    core = new_core()
    events = []
    numbers = [0, 0]
    while numbers[0] < len(one):
        burst = run * sizes[1] // sizes[0]
        for who, parts, count in (("one", one, burst), ("other", other, run)):
            for part in parts[numbers[who == "other"] :][:count]:
                events += core.feed(part, who, numbers[who == "other"])
                numbers[who == "other"] += 1
    assert not troubles(events, "publisher change")
    conflicts = troubles(events, "publisher conflict")
    assert conflicts
    assert all("of 'other' rejected, 'one' goes on" in text for text in conflicts)
    assert core.counts.used == 1_600
    assert adds_up(core.counts)


def test_a_publisher_that_was_replaced_does_not_take_turns() -> None:
    parts = batches(20 * TAKEOVER_MESSAGES)
    core = new_core()
    events = core.feed(parts[0], "one", 0)
    events += fed(core, parts, "other", range(1, TAKEOVER_MESSAGES + 1))
    for start in range(TAKEOVER_MESSAGES + 1, len(parts) - 8, 8):
        events += fed(core, parts, "one", range(start, start + 7))
        events += fed(core, parts, "other", [start + 7])
    assert len(troubles(events, "publisher change")) == 1
    assert all("of 'one' rejected" in text for text in troubles(events, "publisher conflict"))
    assert adds_up(core.counts)


def test_a_publisher_that_restarts_with_its_clock_set_back_is_taken_over_after_a_while() -> None:
    parts = batches(2 * UNCERTAIN_FACTOR * TAKEOVER_MESSAGES)
    core = new_core()
    fed(core, parts, "before", range(30, 60), first=30)
    events = fed(core, parts, "after", range(60))
    assert TOOK_OVER in troubles(events, "publisher change")
    assert core.counts.rejected == 0
    assert adds_up(core.counts)


CHUNKS = st.lists(
    st.tuples(
        st.sampled_from(["", "a", "b"]),
        st.none() | st.integers(0, 12),
        st.integers(0, 6 * WINDOW),  # first slot
        st.lists(st.integers(-20, 400), min_size=0, max_size=12),  # steps
        st.sampled_from([100.0, 100.0, 1e4, float("nan")]),
    ),
    max_size=25,
)


@settings(max_examples=150, deadline=None)
@given(history=CHUNKS)
def test_every_sample_is_accounted_for(history: list[tuple[str, int | None, int, list[int], float]]) -> None:
    core = new_core()
    for publisher, number, first, steps, speed in history:
        slots = (first + np.cumsum([0, *steps])).tolist()
        core.feed(samples_at(slots, speed), publisher, number)
        assert adds_up(core.counts)
    core.finish()
    assert adds_up(core.counts)
    assert core.counts.queued == 0
    assert core.counts.received == sum(len(steps) + 1 for _, _, _, steps, _ in history)


@settings(max_examples=60, deadline=None)
@given(keys=st.lists(st.floats(0, HOLD_BACK_MESSAGES), min_size=24, max_size=24))
def test_messages_that_overtake_within_reach_are_put_right(keys: list[float]) -> None:
    # Message n moves by less than the hold-back, so that never more than that many wait for one.
    order = sorted(range(24), key=lambda number: number + keys[number])
    parts = batches(24)
    straight, mixed = new_core(), new_core()
    expected, got = fed(straight, parts, "p", range(24)), fed(mixed, parts, "p", order)
    assert messages_of(got) == messages_of(expected)
    assert any(isinstance(event, WindowDiagnosed) for event in expected)
    assert mixed.counts == straight.counts
