"""The monitor core: its result is a function of the samples, not of how they arrive."""

from __future__ import annotations

import json
from base64 import b64encode
from dataclasses import replace
from functools import cache

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings

from rwa_monitor.errors import InputError
from rwa_monitor.monitor.core import WheelCore, diagnose_samples
from rwa_monitor.monitor.events import WindowDiagnosed
from rwa_monitor.monitor.ingest.sequencer import Trouble
from rwa_monitor.samples import Samples
from rwa_monitor.switching.carried_state import CarriedState
from rwa_monitor.wheel.wheel import Wheel
from tests.monitor.support import WINDOW, messages_of, model, pieces, resumed, run_core, spoiled, telemetry, wheel

ROWS = 3_400
# window, hop, effects, friction given: all ways in which a core works.
KINDS = {
    "given": (WINDOW, None, False, True),
    "derived": (WINDOW, None, False, False),
    "overlapping windows": (WINDOW, 300, False, True),
    "windows with gaps between": (WINDOW, 1_500, False, False),
    "effects, given": (WINDOW, None, True, True),
    "effects, derived": (WINDOW, 700, True, False),
    "broken sensors, given": (WINDOW, 700, False, True),
    "broken sensors, derived": (WINDOW, None, True, False),
}


def case(kind: str) -> tuple[Wheel, Samples]:
    samples, hop, effects, given_ = KINDS[kind]
    table = spoiled(telemetry(ROWS, 3, given_), 5)
    return wheel(samples, hop, effects), broken(table) if "broken" in kind else table


def broken(samples: Samples) -> Samples:
    """Return telemetry whose sensors hang and jump, most of all about the ends of windows."""
    rng = np.random.default_rng(6)
    channels = dict(samples.channels())
    name = "motor_current_A" if samples.friction_torque_Nm is None else "friction_torque_Nm"
    torque, speed = channels[name].copy(), channels["speed_rad_s"].copy()
    slots = samples.time_ns // 125_000_000
    for border in (WINDOW, WINDOW + 8, WINDOW + 700, 2 * WINDOW, 2 * WINDOW + 8, 3 * WINDOW):
        rows = np.searchsorted(slots, border) + rng.integers(-3, 3, 4)
        torque[rows] *= rng.choice([-30.0, 30.0], rows.size)
    for values, start in ((torque, WINDOW - 40), (speed, 2 * WINDOW - 15), (torque, 1_300), (speed, 1_800)):
        row = int(np.searchsorted(slots, start))
        values[row : row + 60] = values[row]
    torque[rng.integers(0, torque.size, 30)] *= 30.0
    speed[rng.integers(0, speed.size, 15)] += 40.0
    return replace(samples, **{name: torque, "speed_rad_s": speed})


def messages(core: WheelCore, parts: list[Samples]) -> list[tuple[str, bytes]]:
    return messages_of([*run_core(core, parts), *core.finish()])


@cache
def whole(kind: str) -> list[tuple[str, bytes]]:
    """Return the outputs of a core that gets everything at once."""
    of_wheel, samples = case(kind)
    return messages(WheelCore(of_wheel, model()), [samples])


@pytest.mark.parametrize("kind", KINDS)
def test_the_interesting_things_are_there(kind: str) -> None:
    kinds = {key.rsplit("/", 1)[1] for key, _ in whole(kind)}
    assert {"diagnosis", "changepoints", "health", "carried"} <= kinds


def test_broken_sensors_are_seen() -> None:
    for kind in KINDS:
        of_wheel, samples = case(kind)
        core = WheelCore(of_wheel, model())
        kinds = " ".join(event.kind for event in core.feed(samples) if isinstance(event, Trouble))
        assert ("hangs" in kinds and "stands out" in kinds) == ("broken" in kind)


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=12, deadline=None)
@given(cuts=st.lists(st.integers(0, ROWS), max_size=60))
def test_messages_cut_anyhow_give_the_same_bytes(kind: str, cuts: list[int]) -> None:
    of_wheel, samples = case(kind)
    parts = list(pieces(samples, [min(cut, len(samples)) for cut in cuts]))
    assert messages(WheelCore(of_wheel, model()), parts) == whole(kind)


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=6, deadline=None)
@given(cuts=st.lists(st.integers(1, 30), min_size=1, max_size=3))
def test_a_core_resumed_from_a_checkpoint_gives_the_same_bytes(kind: str, cuts: list[int]) -> None:
    of_wheel, samples = case(kind)
    parts = list(pieces(samples, list(range(100, len(samples), 100))))
    core = WheelCore(of_wheel, model())
    events = []
    for number, part in enumerate(parts):
        if number in cuts:
            data = core.checkpoint().to_json()
            core = resumed(data, of_wheel)
            assert core.checkpoint().to_json() == data
        events += core.feed(part, "p", number)
    assert messages_of([*events, *core.finish()]) == whole(kind)


def test_what_is_carried_after_any_window_is_what_its_file_holds() -> None:
    """Otherwise a core that was resumed diagnoses from other numbers: those of the file have 12 digits."""
    unseen = 0
    for seed in range(3):
        for event in WheelCore(wheel(), model()).feed(telemetry(12 * WINDOW, seed)):
            if isinstance(event, WindowDiagnosed):
                assert CarriedState.from_json(event.carried.to_json(), "test") == event.carried
                base = event.carried.base_dry
                unseen += base is not None and base.held < 1.0
    assert unseen > 3  # windows that did not show the base dry friction, whose value is carried with doubt


def test_a_damaged_checkpoint_is_refused() -> None:
    of_wheel, samples = case("given")
    core = WheelCore(of_wheel, model())
    run_core(core, list(pieces(samples, [1_500]))[:1])
    content = json.loads(core.checkpoint().to_json())
    ((start, window),) = content["open"]
    endless = b64encode(np.array([np.inf]).tobytes()).decode()
    for damaged in (window["x"][:-1], "AAAA", endless, "0.5", [0.1], {}, None):
        with pytest.raises(InputError, match=r"open.*x|does not fit"):
            resumed(json.dumps(content | {"open": [[start, window | {"x": damaged}]]}).encode(), of_wheel)
    for name in ("channels", "memories"):
        with pytest.raises(InputError, match="does not fit"):
            resumed(json.dumps(content | {name: [endless] * 3}).encode(), of_wheel)


def test_a_checkpoint_keeps_the_messages_that_wait() -> None:
    samples = telemetry(WINDOW)
    parts = list(pieces(samples, list(range(100, WINDOW, 100))))
    core = WheelCore(wheel(), model())
    for number in (0, 2, 3):
        core.feed(parts[number], "p", number)
    core.feed(parts[1], "other", 0)
    again = resumed(core.checkpoint().to_json(), wheel())
    assert again.counts == core.counts
    again.feed(parts[1], "p", 1)
    assert (again.counts.used, again.counts.rejected) == (400, 100)


def test_a_checkpoint_that_counts_beyond_all_bounds_is_refused() -> None:
    core = WheelCore(wheel(), model())
    core.feed(telemetry(WINDOW)[:200])
    whole = json.loads(core.checkpoint().to_json())
    for part, field, value in (
        ("sequencer", "counts", {"used": -1}),
        ("sequencer", "counts", {"used": 2**60}),
        ("sequencer", "expected", -(2**64)),
        ("slots", "begin", 2**64),
    ):
        with pytest.raises(InputError, match=field):
            resumed(json.dumps(whole | {part: whole[part] | {field: value}}).encode(), wheel())
    for field in ("done", "origin_ns", "frontier"):
        with pytest.raises(InputError, match=field):
            resumed(json.dumps(whole | {field: 2**64}).encode(), wheel())


def test_a_checkpoint_of_another_wheel_is_refused() -> None:
    core = WheelCore(wheel(effects=True), model())
    core.feed(telemetry(500))
    with pytest.raises(InputError, match="does not fit"):
        resumed(core.checkpoint().to_json(), wheel())
    with pytest.raises(InputError, match="said_missing"):
        resumed(b'{"version":2,"source":"","said_missing":false}', wheel())


# ---- when windows close ----------------------------------------------------------------------------------------------


def closed(events: list[object]) -> list[WindowDiagnosed]:
    return [event for event in events if isinstance(event, WindowDiagnosed)]


def test_a_window_closes_when_a_sample_beyond_it_comes() -> None:
    samples = telemetry(WINDOW + 1)
    core = WheelCore(wheel(), model())
    assert closed(core.feed(samples[:WINDOW])) == []
    (event,) = closed(core.feed(samples[WINDOW:]))
    assert (event.start_ns, event.end_ns, event.partial) == (0, WINDOW * 125_000_000, False)
    assert event.diagnosis.slots == WINDOW


def test_a_window_of_derived_friction_waits_for_the_stencil() -> None:
    # The Savitzky-Golay window of 2 s reaches 8 slots to either side at 8 Hz.
    samples = telemetry(WINDOW + 20, given=False)
    core = WheelCore(wheel(), model())
    assert closed(core.feed(samples[: WINDOW + 8])) == []
    (event,) = closed(core.feed(samples[WINDOW + 8 : WINDOW + 9]))
    # The first slots have too few samples before them: a parabola through two less than 17 is still enough.
    assert event.diagnosis.good == WINDOW - 6


def test_the_last_window_is_partial_unless_it_is_full() -> None:
    for rows, expected in ((WINDOW, [False]), (WINDOW + 7, [False, True]), (90, [True])):
        events = list(diagnose_samples(telemetry(rows), wheel(), model()))
        assert [event.partial for event in events] == expected
        assert sum(event.diagnosis.slots for event in events) == rows


def test_of_overlapping_windows_the_last_partial_one_holds_all_that_is_left() -> None:
    events = list(diagnose_samples(telemetry(2 * WINDOW + 100), wheel(WINDOW, WINDOW // 2), model()))
    starts = [event.start_ns // 125_000_000 for event in events]
    assert starts == [0, WINDOW // 2, WINDOW, 3 * WINDOW // 2]
    assert [event.partial for event in events] == [False, False, False, True]
    assert events[-1].diagnosis.slots == 2 * WINDOW + 100 - 3 * WINDOW // 2


def test_jitter_of_less_than_half_a_slot_does_not_matter() -> None:
    samples = telemetry(1_500)
    rng = np.random.default_rng(2)
    jitter = rng.integers(-50_000_000, 50_000_000, len(samples))
    jitter[0] = 0
    moved = Samples(samples.time_ns + jitter, samples.speed_rad_s, samples.friction_torque_Nm)
    plain = messages_of(list(diagnose_samples(samples, wheel(), model())))
    assert messages_of(list(diagnose_samples(moved, wheel(), model()))) == plain


# ---- what friction comes from ----------------------------------------------------------------------------------------


def test_without_friction_and_constants_there_is_one_clear_error() -> None:
    tables = wheel().to_tables()
    del tables["wheel"]["inertia_kg_m2"]
    bare = Wheel.from_tables(tables, "bare")
    core = WheelCore(bare, model())
    with pytest.raises(InputError, match="friction_torque_Nm is missing"):
        core.feed(telemetry(100, given=False))
    assert core.counts.received == 0
    core.feed(telemetry(100))
    assert core.counts.used == 100


def test_motor_torque_serves_as_well_as_current() -> None:
    samples = telemetry(1_500, given=False)
    constant = wheel().torque_constant_Nm_A
    torque = Samples(samples.time_ns, samples.speed_rad_s, motor_torque_Nm=constant * samples.motor_current_A)
    current = Samples(samples.time_ns, samples.speed_rad_s, motor_current_A=samples.motor_current_A)
    plain = messages_of(list(diagnose_samples(current, wheel(), model())))
    assert messages_of(list(diagnose_samples(torque, wheel(), model()))) == plain


def test_a_message_that_lacks_the_channel_is_masked_and_reported_once() -> None:
    samples = telemetry(300)
    bare = Samples(samples.time_ns, samples.speed_rad_s, motor_current_A=samples.motor_current_A)
    core = WheelCore(wheel(), model())
    events = [*core.feed(samples[:100]), *core.feed(bare[100:200]), *core.feed(bare[200:])]
    (trouble,) = [event for event in events if isinstance(event, Trouble)]
    assert trouble.text.startswith("samples without friction_torque_Nm")
    assert (core.counts.used, core.counts.masked) == (100, 200)
