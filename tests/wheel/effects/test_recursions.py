"""The recursions against plain formulas, and the rule for gaps."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwa_monitor.kernels.effects import dahl_bristle, first_order_lag
from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.torque_balance_errors import CurrentDelay
from rwa_monitor.wheel.effects.torque_ripple import angle_turned
from tests.wheel.effects.records import channels_of


def start() -> FloatArray:
    return np.full(2, np.nan)


SPEEDS = np.concatenate([np.linspace(3.0, -3.0, 200), np.zeros(5), np.linspace(0.0, 2.0, 60)])


def test_the_state_is_held_through_a_gap() -> None:
    """A gap of any length leaves the state as it was: the slots after it are those of the record without the gap."""
    usable = np.ones(SPEEDS.size, dtype=bool)
    usable[50:90] = False
    holed = np.where(usable, SPEEDS, np.nan)
    for kernel, arguments in ((first_order_lag, (0.125, 4.0)), (dahl_bristle, (0.125, 0.02))):
        with_gap = kernel(holed, usable, *arguments, start())
        joined = kernel(SPEEDS[usable], np.ones(usable.sum(), dtype=bool), *arguments, start())
        assert np.array_equal(with_gap[usable], joined)
        assert (with_gap[50:90] == with_gap[49]).all()


def test_a_rate_across_a_gap_is_over_the_time_since() -> None:
    torque = np.array([0.0, 1.0, np.nan, np.nan, 7.0])
    rate = CurrentDelay.columns(channels_of(np.ones(5), 0.5, motor_torque_Nm=torque), {})[0][:, 0]
    assert rate[[0, 1, 4]].tolist() == [0.0, 2.0, 4.0]
    assert np.isnan(rate[2:4]).all()


def test_the_wheel_turns_on_through_a_gap() -> None:
    """Where the speed changes evenly, the angle after a gap is that without it."""
    speed = np.linspace(10.0, 40.0, 64)
    usable = np.ones(64, dtype=bool)
    usable[20:31] = False
    whole, _ = angle_turned(channels_of(speed))
    holed, _ = angle_turned(channels_of(np.where(usable, speed, np.nan)))
    assert whole[-1] == pytest.approx(25.0 * 63 * 0.125, rel=1e-12)
    np.testing.assert_allclose(holed[usable], whole[usable], rtol=1e-12)


@given(
    st.lists(st.floats(-700, 700), min_size=2, max_size=60),
    st.floats(1e-5, 1.0),
    st.floats(1e-3, 1.0),
)
def test_the_bristle_never_leaves_its_range(speeds: list[float], scale_rad: float, period_s: float) -> None:
    """Explicit integration would blow up at speed; the exact step cannot."""
    values = np.array(speeds)
    bristle = dahl_bristle(values, np.ones(values.size, dtype=bool), period_s, scale_rad, start())
    assert np.isfinite(bristle).all()
    assert (np.abs(bristle) <= 1.0).all()
