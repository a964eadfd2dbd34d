"""What the dashboard makes of samples: friction from current, the wGLR of windows, and when telemetry is stale."""

from __future__ import annotations

import itertools
import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwa_monitor.dashboard import fleet
from rwa_monitor.dashboard.fleet import Fleet, Received, VerdictHistory
from rwa_monitor.dashboard.telemetry import FIRST_STALE_S, DerivedFriction, OpenWindow, Rhythm, thinned_json
from rwa_monitor.messages import SamplesMessage
from rwa_monitor.monitor.setup import WheelSet
from rwa_monitor.samples import NANOSECONDS_PER_SECOND as SECOND
from rwa_monitor.samples import Samples
from rwa_monitor.wheel.torque_balance import mended_friction
from rwa_monitor.wheel.wheel import built_in_wheel
from tests.history.support import START_NS, WINDOW_NS, diagnosis

WHEEL = built_in_wheel()
PERIOD_NS = WHEEL.period_ns


def current(n: int) -> Samples:
    """Return samples with motor current and no friction."""
    rng = np.random.default_rng(5)
    speed = 100.0 + 20.0 * np.sin(np.arange(n) / 50.0)
    return Samples(START_NS + PERIOD_NS * np.arange(n), speed, motor_current_A=0.1 + 0.01 * rng.standard_normal(n))


@given(st.lists(st.integers(1, 199), max_size=12, unique=True))
def test_friction_from_current_does_not_depend_on_the_messages(cuts: list[int]) -> None:
    whole = current(200)
    expected = mended_friction(whole.speed_rad_s, WHEEL.torque_constant_Nm_A * whole.motor_current_A, WHEEL)
    derived = DerivedFriction(WHEEL)
    bounds = [0, *sorted(cuts), 200]
    parts = [derived.add(whole[a:b]) for a, b in itertools.pairwise(bounds)]
    time_ns = np.concatenate([part.time_ns for part in parts])
    friction = np.concatenate([part.friction_torque_Nm for part in parts])
    known = time_ns.size
    assert known >= 200 - 10  # all but the half stencil that waits for what comes
    np.testing.assert_array_equal(time_ns, whole.time_ns[:known])
    np.testing.assert_array_equal(friction, expected[:known])


def test_a_gap_leaves_a_hole_and_what_cannot_be_derived_passes() -> None:
    whole = current(300)
    derived = DerivedFriction(WHEEL)
    derived.add(whole[:100])
    after = derived.add(whole[200:])
    assert np.isnan(after.friction_torque_Nm[0])
    assert np.isfinite(after.friction_torque_Nm[20])
    bare = Samples(whole.time_ns, whole.speed_rad_s)
    assert DerivedFriction(WHEEL).add(bare) is bare
    far = Samples(np.array([START_NS, START_NS + 10**15]), np.ones(2), motor_current_A=np.ones(2))
    assert len(DerivedFriction(WHEEL).add(far)) == 2  # a record of two samples makes no array of a million slots


def with_friction(n: int) -> Samples:
    rng, period_ns = np.random.default_rng(9), WINDOW_NS // 16_000
    speed = np.full(n, 100.0)
    friction = 1.6e-3 + 5.3e-6 * speed + 3.9e-5 * rng.standard_normal(n)
    friction[n // 2 :] += 8e-4
    return Samples(START_NS + period_ns * np.arange(n), speed, friction)


def test_a_closed_window_has_its_curve_and_its_samples_are_let_go() -> None:
    known = Fleet(WheelSet(WHEEL))
    wheel = known.begin("sat", "wheel_1", [])
    samples = with_friction(20_000)
    for begin in range(0, 20_000, 256):
        known.take_samples(wheel, samples[begin : begin + 256], 1, watched=False)
    window = diagnosis(0)
    _, curve = known.take(wheel, window, Received("rwa/sat/wheel_1/diagnosis", window.to_json(), 1))
    assert curve.key == "rwa/sat/wheel_1/evidence"
    assert wheel.open_window.count <= 4_000 + 256
    so_far = wheel.open_window.evidence_so_far(window, WHEEL)
    assert so_far.open
    assert so_far.window_start_ns == window.window_end_ns
    # The jump, of 20 standard deviations, lies in the window before: here noise alone is left.
    assert max(so_far.statistic) < 2 * so_far.threshold < max(json.loads(curve.payload)["statistic"])


def test_open_windows_have_room_for_so_many_samples_and_a_page_goes_first(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fleet, "MAX_OPEN_SAMPLES", 1_000)
    known = Fleet(WheelSet(WHEEL))
    wheels = [known.begin("sat", f"wheel_{n}", []) for n in range(3)]
    samples = with_friction(600)
    for wheel, watched in zip(wheels, (False, False, True), strict=True):
        known.take_samples(wheel, samples, 1, watched=watched)
    assert [wheel.open_window.count for wheel in wheels if wheel] == [600, 0, 600]


def test_a_window_whose_samples_are_not_all_at_hand_has_no_curve() -> None:
    window = OpenWindow()
    window.add(with_friction(16_000)[:8_000])
    assert window.evidence(diagnosis(0), WHEEL) is None


def test_samples_without_friction_are_thinned_as_not_measured() -> None:
    message = SamplesMessage.parse(thinned_json(Samples(np.array([1]), np.ones(1))), "test")
    assert message.friction_torque_Nm == [None]


@given(st.floats(0.5, 500.0), st.integers(4, 20))
def test_what_is_late_is_late_for_this_wheel(interval_s: float, messages: int) -> None:
    rhythm, at_ns = Rhythm(), 10**18
    for _ in range(messages + 1):
        rhythm.take_samples(np.array([0, int(interval_s * SECOND)]), at_ns)
        at_ns += int(interval_s * SECOND)
    assert rhythm.stale_after_s == pytest.approx(max(10.0, 3 * interval_s))


def test_what_is_read_out_of_a_memory_is_no_rhythm() -> None:
    rhythm, at_ns = Rhythm(), 10**18
    for _ in range(20):
        rhythm.take_samples(np.array([0, 32 * SECOND]), at_ns)
        at_ns += 1_000_000  # a message of 32 s each millisecond
    assert rhythm.stale_after_s == pytest.approx(96.0)


def test_a_monitors_progress_stands_for_samples_that_are_not_received() -> None:
    rhythm = Rhythm()
    assert rhythm.wall_ns is None
    rhythm.take_status(5, 100)
    assert (rhythm.wall_ns, rhythm.stale_after_s) == (100, FIRST_STALE_S)
    rhythm.take_status(5, 200)
    assert rhythm.wall_ns == 100  # it stands still
    rhythm.take_status(6, 300)
    assert rhythm.wall_ns == 300


def test_a_verdict_history_has_its_beginning_and_its_change() -> None:
    verdicts = VerdictHistory()
    verdicts.extend(diagnosis(n) for n in range(3))
    assert (verdicts.since_ns, verdicts.windows, verdicts.change) == (START_NS, 3, None)
    verdicts.extend([diagnosis(3, severity=0.5)])
    assert (verdicts.since_ns, verdicts.windows, verdicts.change) == (START_NS + 3 * WINDOW_NS, 1, None)
    changes = []
    for number, severity in enumerate((0.9, 0.95, 0.2), start=4):
        verdicts.extend([diagnosis(number, severity=severity)])
        changes.append(verdicts.change)
    assert changes == ["worse", "steady", "better"]
    verdicts.extend([diagnosis(4, severity=3.0)])  # received again
    assert (verdicts.windows, verdicts.change) == (4, "better")


def test_a_course_takes_no_scatter_for_a_change() -> None:
    # Severities of 0.1 standard deviation: a change of two windows has 0.14.
    verdicts = VerdictHistory()
    changes = []
    for number, severity in enumerate((2.5, 2.25, 2.3, 2.7)):
        verdicts.extend([diagnosis(number, severity=severity)])
        changes.append(verdicts.change)
    assert changes == [None, "steady", "steady", "worse"]
