"""The torque balance, its derivative filter and the noise that it leaves."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from rwa_monitor.errors import InputError
from rwa_monitor.wheel import torque_balance as tb
from rwa_monitor.wheel.wheel import Derivative, FrictionFilter, Wheel, built_in_wheel

PERIOD = 0.125
GOLAY = Derivative(method="savitzky_golay", window_s=2.0)
CENTRAL = Derivative(method="central")
SPEED_STD = 0.01
derivatives = pytest.mark.parametrize("derivative", [GOLAY, CENTRAL], ids=["savitzky_golay", "central"])


def filtered(derivative):
    return built_in_wheel().model_copy(update={"friction": FrictionFilter(derivative=derivative)})


def test_friction_resists_positive_rotation():
    """A wheel coasting down from positive speed has positive friction; the motor holding it up gives it."""
    assert tb.friction_torque(np.array([0.0]), np.array([-0.2]), 0.01) == pytest.approx([0.002])
    assert tb.friction_torque(np.array([0.002]), np.array([0.0]), 0.01) == pytest.approx([0.002])


@pytest.mark.parametrize("window_s", [0.01, 0.3, 1.0, 2.0, 2.1, 7.7])
def test_taps_are_those_of_savitzky_and_golay(window_s):
    taps = tb.derivative_taps(Derivative(window_s=window_s), PERIOD)
    assert taps.size % 2 == 1
    oracle = signal.savgol_coeffs(taps.size, 2, deriv=1, delta=PERIOD, use="dot")
    assert taps == pytest.approx(oracle, abs=1e-10)


@derivatives
def test_a_missing_sample_touches_its_stencil_and_nothing_else(derivative):
    speed = np.sin(np.arange(200) / 9.0)
    whole = tb.differentiate(speed, derivative, PERIOD)
    half = tb.half_width(derivative, PERIOD)
    speed[90] = np.nan
    found = tb.differentiate(speed, derivative, PERIOD)
    touched = np.abs(np.arange(200) - 90) <= half
    assert np.all(np.isnan(found[touched]))
    assert np.array_equal(found[~touched], whole[~touched], equal_nan=True)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.02, 0.5))
def test_over_gaps_it_is_the_slope_of_a_parabola_through_what_is_left(seed, share):
    rng = np.random.default_rng(seed)
    speed = 100.0 + rng.normal(size=120)
    speed[rng.random(size=120) < share] = np.nan
    found = tb.differentiate_over_gaps(speed, GOLAY, PERIOD)
    whole = tb.differentiate(speed, GOLAY, PERIOD)
    assert np.array_equal(found[np.isfinite(whole)], whole[np.isfinite(whole)])
    offsets = np.arange(-8, 9)
    for k in range(8, 112):
        around = speed[k + offsets]
        left = np.isfinite(around)
        if left.sum() < 4 or np.isnan(speed[k]):
            continue
        parabola, covariance = np.polyfit(offsets[left] * PERIOD, around[left], 2, cov="unscaled")
        ratio = covariance[1, 1] * PERIOD**2 * np.sum(offsets**2)
        if abs(ratio - tb.MAX_VARIANCE_RATIO) > 1e-6:
            assert np.isfinite(found[k]) == (ratio < tb.MAX_VARIANCE_RATIO)
        if np.isfinite(found[k]):
            assert found[k] == pytest.approx(parabola[1], rel=1e-6, abs=1e-8)


@given(st.integers(0, 2**32 - 1), st.integers(20, 180), st.sampled_from([GOLAY, CENTRAL]))
def test_the_cut_of_a_record_changes_no_bit(seed, cut, derivative):
    rng = np.random.default_rng(seed)
    speed, motor = rng.normal(size=200) * 100, rng.normal(size=200)
    wheel = filtered(derivative)
    half = tb.half_width(derivative, PERIOD)
    whole = tb.derive_friction(speed, motor, wheel)
    first = tb.derive_friction(speed[: cut + half], motor[: cut + half], wheel)[:cut]
    rest = tb.derive_friction(speed[cut - half :], motor[cut - half :], wheel)[half:]
    assert np.array_equal(np.concatenate([first, rest]), whole, equal_nan=True)


def test_records_shorter_than_the_stencil_have_no_derivative():
    for size in (0, 1, 16):
        assert np.all(np.isnan(tb.differentiate(np.zeros(size), GOLAY, PERIOD)))
    assert np.isfinite(tb.differentiate(np.zeros(17), GOLAY, PERIOD)).sum() == 1


@derivatives
def test_noise_variance_is_that_of_simulated_noise(derivative):
    wheel = filtered(derivative)
    rng = np.random.default_rng(8)
    speed_std, current_std, n = 0.01, 2e-4, 400_000
    noise = tb.derive_friction(
        speed_std * rng.standard_normal(n), wheel.torque_constant_Nm_A * current_std * rng.standard_normal(n), wheel
    )
    expected = tb.derived_noise_variance(wheel, speed_std, current_std)
    # Neighbours within a stencil of 17 slots are related: at most nine independent values in a hundred.
    assert np.nanmean(noise**2) == pytest.approx(expected, rel=5.0 * np.sqrt(2.0 / (0.09 * n)))


def test_what_the_wheel_lacks_is_named():
    wheel = built_in_wheel().model_copy(update={"inertia_kg_m2": None, "torque_constant_Nm_A": None})
    with pytest.raises(InputError, match="inertia_kg_m2"):
        tb.derive_friction(np.zeros(3), np.zeros(3), wheel)
    with pytest.raises(InputError, match="torque_constant_Nm_A"):
        tb.torque_constant_of(wheel)
    with pytest.raises(InputError, match=r"friction\.derivative\.window_s"):
        tb.half_width(Derivative(window_s=1e9), PERIOD)


# ---- where the speed bends -------------------------------------------------------------------------------------------

SLEWS = built_in_wheel()  # with the filter GOLAY


def slews(seed, torque_Nm):
    """Return speed, motor torque, friction and slots of the steps of a rotor under a torque that steps."""
    rng = np.random.default_rng(seed)
    slots = 12_000
    steps = np.arange(400, slots - 400, 400)
    command = np.zeros(slots)
    for number, at in enumerate(steps):
        command[at:] = (0.0, torque_Nm, 0.0, -torque_Nm)[(number + 1) % 4]
    friction = np.full(slots, 1.6e-3)
    friction[2_100:] += 6e-4  # the motor follows at once: the speed does not show it
    friction[7_700:7_760] += 8e-4
    inertia = tb.inertia_of(SLEWS)
    speed = 150.0 + np.concatenate(([0.0], np.cumsum(command[:-1] * PERIOD / inertia)))
    return speed + rng.normal(0.0, SPEED_STD, slots), command + friction, friction, steps


@pytest.mark.parametrize("torque_Nm", [2e-3, 0.02, 0.2])
def test_where_torque_steps_derived_friction_is_known_to_be_wrong(torque_Nm):
    """It is off by up to half of the step; what is left errs by its noise, and no jump of friction is taken away."""
    speed, motor, friction, steps = slews(1, torque_Nm)
    derived = tb.derive_friction(speed, motor, SLEWS)
    rounding = tb.rounding_error(speed, motor, SLEWS)
    std = np.sqrt(tb.derived_noise_variance(SLEWS, SPEED_STD))
    assert np.nanmax(np.abs(derived - friction)) > 0.3 * torque_Nm
    assert np.nanmax(np.abs(tb.corrected_friction(speed, motor, SLEWS) - friction)) < 6.0 * std
    reach = tb.half_width(GOLAY, PERIOD) + 1
    touched = np.abs(np.arange(rounding.size)[:, None] - steps).min(axis=1) <= reach
    assert np.isnan(rounding[np.concatenate((steps - 1, steps))]).all()
    assert np.all(rounding[~touched] == 0.0)


def test_a_motor_that_follows_friction_does_no_harm():
    """Jumps of the friction, its reversal, and the noise of the current."""
    speed, motor, _, _ = slews(2, 0.0)
    speed, motor = speed - 150.0 + np.linspace(-30.0, 30.0, speed.size), motor * np.sign(np.linspace(-1, 1, speed.size))
    assert np.diff(motor).max() > 3e-3
    assert not tb.rounding_error(speed, motor, SLEWS).any()
    noisy = motor + np.random.default_rng(3).normal(0.0, 2e-4, motor.size)
    assert np.mean(tb.rounding_error(speed, noisy, SLEWS) != 0.0) < 0.005


def test_the_noise_of_the_current_is_no_step_while_the_wheel_is_slewed_smoothly():
    time = np.arange(8_000) * PERIOD
    rate = 2 * np.pi / 60.0
    rng = np.random.default_rng(6)
    speed = 150.0 + 50.0 * np.sin(rate * time) + rng.normal(0.0, SPEED_STD, time.size)
    torque = 1.6e-3 + tb.inertia_of(SLEWS) * 50.0 * rate * np.cos(rate * time) + rng.normal(0.0, 6e-4, time.size)
    assert np.mean(tb.rounding_error(speed, torque, SLEWS) != 0.0) < 0.01


@pytest.mark.parametrize("period_s", [12.5, 60.0, 600.0])
def test_a_smooth_bend_is_taken_out(period_s):
    time = np.arange(8_000) * PERIOD
    rate = 2 * np.pi / period_s
    speed = 150.0 + 5.0 * np.sin(rate * time)
    torque = 1.6e-3 + tb.inertia_of(SLEWS) * 5.0 * rate * np.cos(rate * time)
    left = tb.corrected_friction(speed, torque, SLEWS) - 1.6e-3
    half = tb.half_width(GOLAY, PERIOD)
    assert np.nanmax(np.abs(left)) <= tb.LEAST_ERROR * 1.6e-3  # less is not looked at
    assert np.isfinite(left[half:-half]).all()


def test_a_bend_as_long_as_the_filter_is_taken_out_although_no_single_current_shows_it():
    """Slews that begin and end within 20 s: the error is two standard deviations of a current, for a hundred slots."""
    rng = np.random.default_rng(50_140)
    slots, corner, inertia = 40_000, 160, tb.inertia_of(SLEWS)
    sharp = np.repeat(rng.uniform(-4.0, 4.0, 50), 800)  # rad/s²
    blend = np.hanning(corner + 2) / np.hanning(corner + 2).sum()
    acceleration = np.convolve(sharp, blend, mode="same")
    speed = 150.0 + np.cumsum(np.concatenate(([0.0], 0.5 * (acceleration[1:] + acceleration[:-1])))) * PERIOD
    error = tb.derive_friction(speed, 1.6e-3 + inertia * acceleration, SLEWS) - 1.6e-3
    torque = 1.6e-3 + inertia * acceleration + rng.normal(0.0, 3.9e-5, slots)
    left = error - tb.rounding_error(speed + rng.normal(0.0, SPEED_STD, slots), torque, SLEWS)
    large = np.isfinite(left) & (np.abs(error) > 6e-5) & (np.abs(error) < 1.5e-4)
    assert large.sum() > 1_000
    # At most a quarter of these slots may be missed; what is taken out has a sixth of a current's noise.
    assert np.sqrt(np.mean(left[large] ** 2)) < 0.5 * np.sqrt(np.mean(error[large] ** 2))
    assert np.median(np.abs(left[large])) < 0.25 * 3.9e-5


@pytest.mark.parametrize("window_s", [0.25, 0.625, 1.25])
@pytest.mark.parametrize("ramp", [0.3, 2.0, 5.5])
def test_a_filter_of_few_slots_masks_bends_and_hardly_anything_else(window_s, ramp):
    """The torque of a slew begins and ends between samples, over some slots; the wheel passes zero in steady slews."""
    wheel = filtered(Derivative(window_s=window_s))
    rng, slots, fine = np.random.default_rng(3), 12_000, 20
    steps = np.arange(200, slots, 400) + rng.uniform(0.0, 1.0, 30)
    command = np.zeros(slots * fine)
    for number, at in enumerate(steps):
        share = np.clip((np.arange(slots * fine) / fine - at) / ramp, 0.0, 1.0)
        command += share * 0.04 * (1.0, -1.0, -1.0, 1.0)[number % 4]
    speed = -15.0 + np.cumsum(command) * PERIOD / fine / tb.inertia_of(SLEWS)
    speed, command = speed[::fine], command[::fine]
    friction = 1.6e-3 * np.sign(speed)
    friction[7_100:] *= 1.4
    found = tb.corrected_friction(
        speed + rng.normal(0.0, SPEED_STD, slots), command + friction + rng.normal(0.0, 2e-5, slots), wheel
    )
    std = np.hypot(np.sqrt(tb.derived_noise_variance(wheel, SPEED_STD)), 2e-5)
    half = tb.half_width(wheel.friction.derivative, PERIOD)
    known = np.isfinite(found)
    assert np.abs(found - friction)[known].max() < max(6.0 * std, 2.0 * tb.LEAST_ERROR * 1.6e-3)
    beyond = np.arange(slots)[:, None] - steps
    steady = ~((beyond > -2 * half - 2) & (beyond < ramp + 2 * half + 2)).any(axis=1)
    assert np.mean(known[half:-half][steady[half:-half]]) > 0.999


@pytest.mark.parametrize("window_s", [0.25, 1.25, 2.0])
@given(st.integers(1_000, 11_000))
@settings(max_examples=20, deadline=None)
def test_the_error_does_not_depend_on_where_a_record_is_cut(window_s, cut):
    wheel = filtered(Derivative(window_s=window_s))
    speed, motor, _, _ = slews(4, 5e-3)
    speed[3_000:3_003] = np.nan
    motor[np.random.default_rng(5).random(motor.size) < 0.01] = np.nan
    before, after = tb.slots_around(wheel)
    first = tb.rounding_error(speed[: cut + after], motor[: cut + after], wheel)[:cut]
    rest = tb.rounding_error(speed[cut - before :], motor[cut - before :], wheel)[before:]
    assert np.array_equal(np.concatenate([first, rest]), tb.rounding_error(speed, motor, wheel), equal_nan=True)


@given(
    st.floats(-10.0, 10.0), st.floats(-100.0, 100.0), st.floats(1e-3, 1.0), st.floats(0.1, 300.0), st.floats(0.05, 1.0)
)
def test_a_gear_hands_on_its_share_of_the_power(current, speed, constant, ratio, efficiency):
    bare = Wheel(name="w", sample_period_s=PERIOD, torque_constant_Nm_A=constant)
    geared = bare.model_copy(update={"gear_ratio": ratio})
    lossy = geared.model_copy(update={"gear_efficiency": efficiency})
    at = np.array([current]), np.array([speed])
    assert tb.torque_per_ampere(*at, geared) == pytest.approx(ratio * tb.torque_per_ampere(*at, bare))
    wheel_W = float(tb.torque_per_ampere(*at, lossy)[0]) * current * speed
    motor_W = constant * current * ratio * speed  # the motor turns `ratio` times as fast
    into, out_of = (motor_W, wheel_W) if motor_W > 0 else (-wheel_W, -motor_W)
    assert out_of == pytest.approx(efficiency * into)
