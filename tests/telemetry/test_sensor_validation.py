"""What broken sensors show is masked, counted and reported, and costs no more than the slots in which they show it."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from rwa_monitor.kernels.ingest import HANGING_SLOTS, OUTSTANDING_SLOTS
from rwa_monitor.monitor.core import Event, WheelCore, WindowDiagnosed
from rwa_monitor.monitor.ingest import Trouble
from rwa_monitor.samples import FloatArray, Samples
from rwa_monitor.simulation.record import simulate
from rwa_monitor.simulation.scenario import Scenario
from rwa_monitor.telemetry.slots import Channel, friction_limit, speed_limit
from rwa_monitor.wheel.wheel import built_in_wheel
from rwa_monitor.words import time_text
from tests.monitor.support import adds_up, diagnoses, messages_of, model

SLOTS = 80_000
FROM = 30_000  # where a fault begins
GIVEN = {"given": True, "derived": False}
UNLIKE, UNLIKE_WORDS = {"inconclusive"}, "unlike anything learned"
ANY_BAD = {"anomalous", "inconclusive"}
SOURCE = {"given": "friction_torque_Nm", "derived": "motor_current_A"}


@cache
def telemetry(kind: str) -> Samples:
    """Return telemetry of a nominal wheel, enough to close one window."""
    scenario = Scenario(duration_s=(SLOTS + 9) * 0.125, friction_given=GIVEN[kind])
    return simulate(scenario, built_in_wheel(), np.random.default_rng(11)).samples


def changed(samples: Samples, channel: str, rows: slice | list[int], values: Any) -> Samples:
    array = getattr(samples, channel).copy()
    array[rows] = values
    return replace(samples, **{channel: array})


def diagnosed(samples: Samples) -> tuple[WindowDiagnosed, WheelCore, list[Event]]:
    core = WheelCore(built_in_wheel(), model())
    events = [*core.feed(samples), *core.finish()]
    window = next(event for event in events if isinstance(event, WindowDiagnosed))
    assert adds_up(core.counts)
    return window, core, events


def message(window: WindowDiagnosed) -> bytes:
    """Return the diagnosis as it is published."""
    return diagnoses(messages_of([window]))[0]


def masked_as_if_absent(samples: Samples, channel: str, rows: list[int], values: FloatArray) -> list[Trouble]:
    """Check that values are masked, and the diagnosis as without them; return their faults."""
    window, core, events = diagnosed(changed(samples, channel, rows, values))
    without, _, _ = diagnosed(changed(samples, channel, rows, np.nan))
    assert core.counts.masked == len(rows)
    assert message(window) == message(without)
    return sensor_faults(events)


def sensor_faults(events: list[Event]) -> list[Trouble]:
    return [event for event in events if isinstance(event, Trouble) and event.text.endswith(": masked")]


@pytest.mark.parametrize("kind", GIVEN)
def test_healthy_sensors_are_believed(kind: str) -> None:
    window, core, events = diagnosed(telemetry(kind))
    assert sensor_faults(events) == []
    assert core.counts.masked == 0
    assert window.diagnosis.verdict == "nominal"


@pytest.mark.parametrize("kind", GIVEN)
@pytest.mark.parametrize("broken", ["speed", "torque"])
@pytest.mark.parametrize("slots", [100, 20_000])
def test_a_sensor_that_hangs_is_masked_from_its_first_repetition_on(kind: str, broken: str, slots: int) -> None:
    samples, channel = telemetry(kind), "speed_rad_s" if broken == "speed" else SOURCE[kind]
    value = getattr(samples, channel)[FROM]
    window, core, events = diagnosed(changed(samples, channel, slice(FROM, FROM + slots), value))
    whole, _, _ = diagnosed(samples)
    (fault,) = sensor_faults(events)
    at = time_text(int(samples.time_ns[FROM + 1]))
    assert fault.text == f"{channel} repeats one value, as a sensor that hangs, at {at}: masked"
    # A quantised sensor may have shown the value once more, before it hung or afterwards.
    assert slots - 1 <= core.counts.masked <= slots + 1
    assert window.diagnosis.coverage == pytest.approx(1 - slots / SLOTS, abs=20 / SLOTS)
    assert window.diagnosis.verdict == whole.diagnosis.verdict == "nominal"


@pytest.mark.parametrize("kind", GIVEN)
def test_a_window_of_which_less_than_half_is_left_is_inconclusive_and_reports_it(kind: str) -> None:
    samples = telemetry(kind)
    channel = SOURCE[kind]
    hung = changed(samples, channel, slice(FROM, FROM + 43_200), getattr(samples, channel)[FROM])
    window, _, _ = diagnosed(hung)
    assert window.diagnosis.verdict == "inconclusive"
    assert window.diagnosis.reason.startswith("Only 46 % of the window's slots hold a usable sample")


@pytest.mark.parametrize("kind", GIVEN)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_samples_that_stand_out_are_masked_and_the_diagnosis_is_as_without_them(kind: str, sign: float) -> None:
    samples, channel = telemetry(kind), SOURCE[kind]
    rng = np.random.default_rng(4)
    rows = [*(100 * rng.choice(np.arange(3, 799), 12, replace=False)).tolist(), 50_050, 50_051, SLOTS - 1]
    torque = sign * 5.0 * friction_limit(built_in_wheel())
    size = torque if kind == "given" else torque / 0.032  # the built-in wheel's torque constant [N m/A]
    events = masked_as_if_absent(samples, channel, rows, getattr(samples, channel)[rows] + size)
    assert not any("hangs" in fault.kind for fault in events)
    assert len(events) == len(rows) - 1  # two of them are neighbours


@pytest.mark.parametrize("kind", GIVEN)
def test_a_speed_that_no_motor_can_make_is_masked(kind: str) -> None:
    samples = telemetry(kind)
    rows = [700, 2_900, 2_901, 7_003]
    speed = samples.speed_rad_s[rows] + 8.0 * speed_limit(built_in_wheel())
    events = masked_as_if_absent(samples, "speed_rad_s", rows, speed)
    assert {fault.kind.split()[0] for fault in events} == {"speed_rad_s"}


def test_a_saturated_current_is_masked() -> None:
    samples = telemetry("derived")
    limit = float(np.quantile(np.abs(samples.motor_current_A), 0.9))
    clipped = replace(samples, motor_current_A=np.clip(samples.motor_current_A, -limit, limit))
    built_in = built_in_wheel()
    of_wheel = built_in.model_copy(update={"limits": built_in.limits.model_copy(update={"max_current_A": limit})})
    core = WheelCore(of_wheel, model())
    (window,) = [event for event in core.feed(clipped) if isinstance(event, WindowDiagnosed)]
    assert core.counts.masked == int(np.sum(np.abs(clipped.motor_current_A) >= limit)) > 0.09 * SLOTS
    assert window.diagnosis.verdict == "nominal"


@pytest.mark.parametrize("channel", ["speed_rad_s", "motor_current_A"])
def test_a_wrong_unit_beyond_the_limits_is_counted_and_leaves_an_inconclusive_window(channel: str) -> None:
    samples = telemetry("derived")
    factor = 60.0 / (2.0 * np.pi) if channel == "speed_rad_s" else 1_000.0  # rpm, mA
    window, core, _ = diagnosed(replace(samples, **{channel: getattr(samples, channel) * factor}))
    assert core.counts.rejected > SLOTS / 2
    assert window.diagnosis.verdict == "inconclusive"
    assert "usable sample" in window.diagnosis.reason


@pytest.mark.parametrize(
    ("factor", "verdicts", "words"), [(-1.0, UNLIKE, UNLIKE_WORDS), (1e-3, UNLIKE, UNLIKE_WORDS), (1e3, ANY_BAD, "")]
)
def test_friction_of_the_wrong_sign_or_unit_is_never_nominal(factor: float, verdicts: set[str], words: str) -> None:
    samples = telemetry("given")
    window, _, _ = diagnosed(replace(samples, friction_torque_Nm=factor * samples.friction_torque_Nm))
    assert window.diagnosis.verdict in verdicts
    assert words in window.diagnosis.reason


@pytest.mark.parametrize("kind", GIVEN)
def test_lost_samples_cost_their_own_slots_and_not_a_stencil_each(kind: str) -> None:
    samples = telemetry(kind)
    keep = np.random.default_rng(3).random(len(samples)) >= 0.05
    keep[[0, -1]] = True
    window, core, _ = diagnosed(samples[np.flatnonzero(keep)])
    assert core.counts.slots_missed == int(np.sum(~keep))
    assert window.diagnosis.coverage == pytest.approx(0.95, abs=0.01)
    assert window.diagnosis.verdict == "nominal"


# ---- what must not be taken for a fault ------------------------------------------------------------------------------


def judged(values: FloatArray, limit: float = np.inf) -> FloatArray:
    found = Channel().judge(values, np.append(values[1:], np.nan), limit)
    return np.zeros(values.size) if found is None else np.asarray(found[0])


def test_a_noiseless_record_that_stands_still_does_not_hang() -> None:
    slot = np.arange(4_000)
    for moving in (np.minimum(np.abs(np.sin(slot / 300.0)), 0.7), np.minimum(slot * 0.1, 150.0)):
        assert not judged(moving).any()


@pytest.mark.parametrize("step", [0.5, 1.0, 2.0, 4.0, 10.0])
def test_a_coarse_converter_does_not_hang(step: float) -> None:
    noise = np.random.default_rng(8).normal(size=100_000)
    # Repetitions as long are possible, once in ten records.
    assert np.count_nonzero(judged(np.round(noise / step) * step)) <= HANGING_SLOTS


def test_jumps_and_short_visits_of_a_switching_system_do_not_stand_out() -> None:
    rng = np.random.default_rng(9)
    level = np.zeros(5_000)
    level[1_000:] = 30.0
    for start in range(2_000, 4_000, 100):
        level[start : start + int(rng.integers(1, 6))] -= 8.0
    assert not judged(level + rng.normal(size=level.size), limit=10.0).any()


@pytest.mark.parametrize("count", [1, OUTSTANDING_SLOTS])
def test_what_stands_out_does_so_however_large(count: int) -> None:
    values = np.random.default_rng(10).normal(size=600)
    values[300 : 300 + count] = 1e300
    found = np.flatnonzero(judged(values, limit=10.0))
    assert found.tolist() == [300 + count - 1]
