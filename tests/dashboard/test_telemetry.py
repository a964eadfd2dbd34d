"""What the dashboard makes of samples: friction from current, and when telemetry is stale."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwa_monitor.dashboard.fleet import ArrivalTimes, DerivedFriction, VerdictHistory
from rwa_monitor.samples import NANOSECONDS_PER_SECOND as SECOND
from rwa_monitor.samples import Samples
from rwa_monitor.wheel.torque_balance import corrected_friction
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
    expected = corrected_friction(whole.speed_rad_s, WHEEL.torque_constant_Nm_A * whole.motor_current_A, WHEEL)
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


@given(st.floats(0.5, 500.0), st.integers(4, 20))
def test_what_is_late_is_late_for_this_wheel(interval_s: float, messages: int) -> None:
    arrivals, at_ns = ArrivalTimes(), 10**18
    for _ in range(messages + 1):
        arrivals.take_samples(np.array([0, int(interval_s * SECOND)]), at_ns)
        at_ns += int(interval_s * SECOND)
    assert arrivals.stale_after_s == pytest.approx(max(10.0, 3 * interval_s))


def test_a_verdict_history_has_its_beginning() -> None:
    verdicts = VerdictHistory()
    verdicts.extend(diagnosis(n) for n in range(3))
    assert (verdicts.since_ns, verdicts.windows) == (START_NS, 3)
    verdicts.extend([diagnosis(3, severity=0.5)])
    verdicts.extend([diagnosis(3, severity=0.5)])  # received again
    assert (verdicts.since_ns, verdicts.windows) == (START_NS + 3 * WINDOW_NS, 1)
