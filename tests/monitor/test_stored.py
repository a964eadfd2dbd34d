"""Stored telemetry in the core: dumps late by hours and in any order, beside live samples."""

import json
from collections.abc import Iterable
from functools import cache
from typing import Any, Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rwa_monitor.monitor.core import Event, WheelCore, WindowDiagnosed
from rwa_monitor.monitor.ingest import Trouble
from rwa_monitor.monitor.stored import MAX_WINDOWS
from rwa_monitor.samples import Samples
from tests.monitor.support import (
    WINDOW,
    adds_up,
    batch_diagnoses,
    diagnoses,
    messages_of,
    model,
    telemetry,
    wheel,
)

PERIOD_NS = 125_000_000
WINDOWS = 6
DAY = telemetry(WINDOWS * WINDOW)  # of windows of two minutes
PIECE = 300  # samples of a dump's message: no part of a window

Message = tuple[Literal["live", "stored"], Samples]


def feed(core: WheelCore, messages: Iterable[Message]) -> list[Event]:
    """Feed messages, the live ones numbered, as a publisher of each kind does."""
    events: list[Event] = []
    numbers = {"live": 0, "stored": 0}
    for data, samples in messages:
        events += core.feed(samples, f"{data} publisher", numbers[data], data)
        numbers[data] += 1
    return events


def dumps(samples: Samples = DAY) -> list[Message]:
    return [("stored", samples[start : start + PIECE]) for start in range(0, len(samples), PIECE)]


def latest(events: list[Event], data: str | None = "stored") -> dict[int, dict[str, Any]]:
    """Return the last diagnosis of each window of live or stored data, by its start."""
    found = (json.loads(payload) for payload in diagnoses(messages_of(events)))
    return {one["window_start_ns"]: one for one in found if one.get("data") == data}


def run(messages: Iterable[Message]) -> tuple[WheelCore, list[Event]]:
    core = WheelCore(wheel(), model())
    return core, [*feed(core, messages), *core.finish()]


@cache
def in_order() -> dict[int, dict[str, Any]]:
    return latest(run(dumps())[1])


def test_stored_samples_in_order_give_the_windows_of_the_live_ones() -> None:
    core, events = run(dumps())
    stored = [payload.replace(b'"data":"stored",', b"") for payload in diagnoses(messages_of(events))]
    assert stored == batch_diagnoses(DAY, wheel(), whole=False)
    assert len(stored) == WINDOWS
    assert (core.counts.used, core.counts.queued) == (len(DAY), 0)
    assert adds_up(core.counts)


@settings(max_examples=10, deadline=None)
@given(st.permutations(range(len(dumps()))), st.integers(0, 3))
def test_dumps_in_any_order_give_the_windows_of_those_in_order(order: list[int], repeats: int) -> None:
    parts = [dumps()[number] for number in order]
    core, events = run([*parts, *parts[:repeats]])
    assert latest(events) == in_order()
    assert core.counts.late == 0
    assert core.counts.used == len(DAY)
    assert core.counts.duplicate == sum(len(samples) for _, samples in parts[:repeats])
    assert adds_up(core.counts)


@pytest.mark.parametrize("dump_first", [False, True])
def test_a_dump_completes_the_windows_of_a_contact_and_leaves_the_live_ones_as_they_are(dump_first: bool) -> None:
    # Two contacts of half a window, and what lay between them, dumped in the second one and backwards.
    first, second = slice(0, WINDOW // 2), slice(4 * WINDOW + WINDOW // 2, 6 * WINDOW)
    between = list(reversed(dumps(DAY[WINDOW // 2 : 4 * WINDOW + WINDOW // 2])))
    contacts: list[Message] = [("live", DAY[first]), ("live", DAY[second][:100]), ("live", DAY[second][100:])]
    core, events = run([*contacts[:2], *between, contacts[2]] if dump_first else [*contacts, *between])
    live_alone, without = run(contacts)
    found, expected = latest(events), in_order()
    assert [start for start in expected if start not in found] in ([], [5 * WINDOW * PERIOD_NS])  # of live data alone
    assert all(one == expected[start] for start, one in found.items())
    assert latest(without, "stored") == {}
    windows = [{**one, "provenance": None} for one in latest(events, None).values()]
    assert [one["window_start_ns"] for one in windows] == list(latest(without, None))
    assert core.counts.used == live_alone.counts.used + sum(len(samples) for _, samples in between)
    assert adds_up(core.counts)


@pytest.mark.parametrize("declared", [True, False])
def test_the_windows_that_a_dump_completes_are_those_of_the_live_samples(declared: bool) -> None:
    first, gap = 100, slice(WINDOW // 2, WINDOW // 2 + 600)
    live = [DAY[first : gap.start], DAY[gap.stop : 2 * WINDOW + 200]]
    core = WheelCore(wheel(), model())
    events = [event for part in live for event in core.feed(part, data="live" if declared else None)]
    events += core.feed(DAY[gap], data="stored")
    events += core.finish()
    start = min(latest(events, None))
    assert start == first * PERIOD_NS
    assert set(latest(events)) >= {start}
    assert latest(events)[start]["coverage"] == (1.0 if declared else 600 / WINDOW)


def test_live_windows_with_gaps_that_had_closed_are_diagnosed_again_with_the_state_after_a_dump() -> None:
    gap, lost = slice(200, 700), slice(WINDOW + 300, WINDOW + 340)
    live = [DAY[: gap.start], DAY[gap.stop : lost.start], DAY[lost.stop : 3 * WINDOW]]
    core = WheelCore(wheel(), model())
    before = latest(feed(core, [("live", part) for part in live]), None)
    assert list(before) == [0, WINDOW * PERIOD_NS]
    events = [event for event in core.feed(DAY[gap], data="stored") if isinstance(event, WindowDiagnosed)]
    assert [event.diagnosis.window_start_ns for event in events] == [start * WINDOW * PERIOD_NS for start in range(3)]
    again = latest(events)
    assert again[WINDOW * PERIOD_NS]["coverage"] == 1 - 40 / WINDOW
    priors = [one[WINDOW * PERIOD_NS]["provenance"]["prior_sha256"] for one in (before, again)]
    assert priors[0] != priors[1]
    whole = feed(WheelCore(wheel(), model()), [("live", DAY[: lost.start]), ("live", DAY[lost.stop : 3 * WINDOW])])
    assert again[WINDOW * PERIOD_NS]["anomalies"] == latest(whole, None)[WINDOW * PERIOD_NS]["anomalies"]


@pytest.mark.parametrize("live_first", [10, 0])
def test_the_live_window_goes_on_from_the_state_of_a_dump(live_first: int) -> None:
    dump, live = DAY[: 3 * WINDOW], DAY[3 * WINDOW : 4 * WINDOW + 1]
    core = WheelCore(wheel(), model())
    feed(core, [("live", live[:live_first]), *dumps(dump)])
    events = core.feed(live[live_first:], "live publisher", 1, "live")
    (window,) = (one for one in events if isinstance(one, WindowDiagnosed))
    assert window.diagnosis.data is None
    assert window.carried.windows == 4


def test_what_is_older_than_all_that_is_kept_is_late_and_reported() -> None:
    long = telemetry((MAX_WINDOWS + 3) * 128)
    core = WheelCore(wheel(128), model())
    events = feed(core, [("stored", long[256:]), ("stored", long[:256])])
    assert core.counts.late == 256
    assert [one.kind for one in events if isinstance(one, Trouble)] == ["stored samples late"]
    assert adds_up(core.counts)


def test_wild_times_of_stored_samples_change_nothing() -> None:
    wild = Samples(DAY.time_ns + 10**18, DAY.speed_rad_s, DAY.friction_torque_Nm)[:PIECE]
    parts = dumps()
    core, events = run([*parts[:5], ("stored", wild), *parts[5:]])
    assert latest(events) == in_order()
    assert (core.counts.rejected, core.counts.used) == (PIECE, len(DAY))
    assert adds_up(core.counts)
    days_later = Samples(DAY.time_ns + 10**15, DAY.speed_rad_s, DAY.friction_torque_Nm)
    core, events = run([*parts, *dumps(days_later)])
    assert len(latest(events)) in (2 * WINDOWS, 2 * WINDOWS + 1)
    assert core.counts.used == 2 * len(DAY)


def test_a_window_is_diagnosed_when_the_dump_has_left_it_and_again_when_its_hole_is_filled() -> None:
    hole = slice(200, 260)
    with_hole = DAY[: 2 * WINDOW][np.r_[: hole.start, hole.stop : 2 * WINDOW]]
    core = WheelCore(wheel(), model())
    first = latest(feed(core, dumps(with_hole)))[0]
    assert first["coverage"] == 1 - 60 / WINDOW
    again = latest(core.feed(DAY[hole], "stored publisher", 99, "stored"))
    assert again == {start: one for start, one in in_order().items() if start < 2 * WINDOW * PERIOD_NS}
