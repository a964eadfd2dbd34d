"""The monitor core: checkpoints that are refused, when windows close, and what friction comes from."""

import json
from base64 import b64encode
from dataclasses import replace

import numpy as np
import pytest

from rwa_monitor.diagnosis.model import built_in_model
from rwa_monitor.errors import InputError
from rwa_monitor.monitor.core import WheelCore, WindowDiagnosed, diagnose_samples
from rwa_monitor.monitor.ingest import Trouble
from rwa_monitor.samples import Samples
from rwa_monitor.switching.carried_state import CarriedState
from rwa_monitor.wheel.wheel import built_in_wheel
from tests.monitor.support import WINDOW, messages_of, model, pieces, resumed, telemetry, wheel


def test_what_is_carried_after_any_window_is_what_its_file_holds() -> None:
    """Otherwise a core that was resumed diagnoses from other numbers: those of the file have 12 digits."""
    unseen = 0
    for seed in range(3):
        for event in WheelCore(wheel(), model()).feed(telemetry(12 * WINDOW, seed)):
            if isinstance(event, WindowDiagnosed):
                assert CarriedState.from_json(event.carried.to_json(), "test") == event.carried
                base = event.carried.base_dry
                unseen += base is not None and base.held < 1.0
    assert unseen > 3  # windows that did not show the base dry friction, whose value is carried with its uncertainty


ENDLESS = b64encode(np.array([np.inf]).tobytes()).decode()
GATHERED, STORED = r"open.*x|does not fit", r"does not fit|stored"
# Where a checkpoint is changed, to what, and why it is refused then.
DAMAGED = [
    *((("open", 0, 1, "x"), value, GATHERED) for value in ("AAAA", ENDLESS, "0.5", [0.1], {}, None)),
    *(((name,), [ENDLESS] * 3, "does not fit") for name in ("channels", "memories")),
    *((("sequencer", "counts"), {"used": used}, "counts") for used in (-1, 2**60)),
    (("sequencer", "expected"), -(2**64), "expected"),
    (("slots", "begin"), 2**64, "begin"),
    *(((name,), 2**64, name) for name in ("done", "origin_ns", "frontier")),
    (("stored", "windows"), {str(2**50): {"values": {}}}, STORED),
    (("stored", "windows"), {"0": {"values": {"speed_rad_s": ENDLESS, "torque_Nm": ENDLESS}}}, STORED),
    (("stored", "waiting"), {"time_ns": "AAAAAAAAAAA=", "values": {}}, STORED),
    (("stored", "newest"), 2**52, STORED),
    (("stored", "period_ns"), 1, STORED),
]


@pytest.mark.parametrize(("place", "value", "reason"), DAMAGED)
def test_a_damaged_checkpoint_is_refused(place: tuple[str | int, ...], value: object, reason: str) -> None:
    core = WheelCore(wheel(), model())
    core.feed(telemetry(1_500))
    core.feed(telemetry(3_000)[1_500:2_100], data="stored")
    content = within = json.loads(core.checkpoint())
    for step in place[:-1]:
        within = within[step]
    within[place[-1]] = value
    with pytest.raises(InputError, match=reason):
        resumed(json.dumps(content).encode(), wheel())


def test_a_checkpoint_keeps_the_messages_that_wait() -> None:
    samples = telemetry(WINDOW)
    parts = list(pieces(samples, list(range(100, WINDOW, 100))))
    core = WheelCore(wheel(), model())
    for number in (0, 2, 3):
        core.feed(parts[number], "p", number)
    core.feed(parts[1], "other", 0)
    again = resumed(core.checkpoint(), wheel())
    assert again.counts == core.counts
    again.feed(parts[1], "p", 1)
    assert (again.counts.used, again.counts.rejected) == (400, 100)


# ---- when windows close ----------------------------------------------------------------------------------------------


def closed(events: list[object]) -> list[WindowDiagnosed]:
    return [event for event in events if isinstance(event, WindowDiagnosed)]


# The Savitzky-Golay window of 2 s reaches 8 slots to either side at 8 Hz. The first slots have too few samples before
# them: a parabola through two less than 17 is still enough.
@pytest.mark.parametrize(("given", "stencil", "coverage"), [(True, 0, 1.0), (False, 8, (WINDOW - 6) / WINDOW)])
def test_a_window_closes_when_a_sample_beyond_it_and_the_stencil_comes(
    given: bool, stencil: int, coverage: float
) -> None:
    samples = telemetry(WINDOW + 20, given=given)
    core = WheelCore(wheel(), model())
    assert closed(core.feed(samples[: WINDOW + stencil])) == []
    (event,) = closed(core.feed(samples[WINDOW + stencil : WINDOW + stencil + 1]))
    window = event.diagnosis
    assert (window.window_start_ns, window.window_end_ns, window.partial) == (0, WINDOW * 125_000_000, False)
    assert (window.samples, window.coverage) == (WINDOW, coverage)


def test_the_last_window_is_partial_unless_it_is_full() -> None:
    for rows, expected in ((WINDOW, [False]), (WINDOW + 7, [False, True]), (90, [True])):
        events = list(diagnose_samples(telemetry(rows), wheel(), model()))
        assert [event.diagnosis.partial for event in events] == expected
        assert sum(event.diagnosis.samples for event in events) == rows


def test_of_overlapping_windows_the_last_partial_one_holds_all_that_is_left() -> None:
    events = list(diagnose_samples(telemetry(2 * WINDOW + 100), wheel(WINDOW, WINDOW // 2), model()))
    starts = [event.diagnosis.window_start_ns // 125_000_000 for event in events]
    assert starts == [0, WINDOW // 2, WINDOW, 3 * WINDOW // 2]
    assert [event.diagnosis.partial for event in events] == [False, False, False, True]
    assert events[-1].diagnosis.samples == 2 * WINDOW + 100 - 3 * WINDOW // 2


def diagnosed(samples: Samples) -> list[tuple[str, bytes]]:
    return messages_of(list(diagnose_samples(samples, wheel(), model())))


def test_jitter_of_less_than_half_a_slot_does_not_matter() -> None:
    samples = telemetry(1_500)
    rng = np.random.default_rng(2)
    jitter = rng.integers(-50_000_000, 50_000_000, len(samples))
    jitter[0] = 0
    moved = Samples(samples.time_ns + jitter, samples.speed_rad_s, samples.friction_torque_Nm)
    assert diagnosed(moved) == diagnosed(samples)


# ---- what friction comes from ----------------------------------------------------------------------------------------


def test_motor_torque_serves_as_well_as_current() -> None:
    samples = telemetry(1_500, given=False)
    constant = wheel().torque_constant_Nm_A
    torque = Samples(samples.time_ns, samples.speed_rad_s, motor_torque_Nm=constant * samples.motor_current_A)
    current = Samples(samples.time_ns, samples.speed_rad_s, motor_current_A=samples.motor_current_A)
    assert diagnosed(torque) == diagnosed(current)


def test_a_message_that_lacks_the_channel_is_masked_and_reported_once() -> None:
    samples = telemetry(300)
    bare = Samples(samples.time_ns, samples.speed_rad_s, motor_current_A=samples.motor_current_A)
    core = WheelCore(wheel(), model())
    events = [*core.feed(samples[:100]), *core.feed(bare[100:200]), *core.feed(bare[200:])]
    (trouble,) = [event for event in events if isinstance(event, Trouble)]
    assert trouble.text.startswith("samples without friction_torque_Nm")
    assert (core.counts.used, core.counts.masked) == (100, 200)


# ---- samples that do not fit the wheel file --------------------------------------------------------------------------


def ramp(count: int, period_s: float, seed: int = 1) -> Samples:
    """A wheel that spins up; times jitter by a tenth of the step."""
    rng = np.random.default_rng(seed)
    time_s = (np.arange(count) + rng.uniform(-0.05, 0.05, count)) * period_s
    speed = np.linspace(50.0, 300.0, count)
    return Samples(np.rint(time_s * 1e9).astype(np.int64), speed, 1.6e-3 + 5.3e-6 * speed)


def looked(samples: Samples, cut: int) -> list[str]:
    """Return what is reported of samples in messages of this size."""
    core = WheelCore(built_in_wheel(), built_in_model())
    events = [event for i in range(0, len(samples), cut) for event in core.feed(samples[i : i + cut])]
    return [e.text for e in events if isinstance(e, Trouble) and e.kind in {"sample period", "limits"}]


@pytest.mark.parametrize("cut", [1, 7, 1000])
@pytest.mark.parametrize("period_s", [0.05, 0.25])
def test_another_sample_period_is_reported_once(period_s: float, cut: int) -> None:
    (text,) = looked(ramp(1000, period_s), cut)
    assert "is sample_period_s = 0.125 of the wheel file right? The samples come every " in text
    assert float(text.split()[-2]) == pytest.approx(period_s, rel=0.1)


def test_gaps_and_repetition_are_no_other_period() -> None:
    samples = ramp(1000, 0.125)
    kept = np.flatnonzero(np.random.default_rng(2).random(1000) > 0.3)
    assert looked(samples[kept], 10) == []
    assert looked(samples[np.repeat(np.arange(1000), 2)], 10) == []


@pytest.mark.parametrize("cut", [10, 1000])
def test_speeds_in_rpm_are_asked_about(cut: int) -> None:
    samples = ramp(1000, 0.125)
    rpm = replace(samples, speed_rad_s=samples.speed_rad_s * 30.0 / np.pi)
    (text,) = looked(rpm, cut)
    assert "samples are beyond the wheel's limits and rejected: is the speed in rpm" in text
    wild = samples.speed_rad_s.copy()
    wild[::50] = 1e4
    assert looked(replace(samples, speed_rad_s=wild), cut) == []
