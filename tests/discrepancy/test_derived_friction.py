"""Friction derived from torque and speed: the window of dω/dt where a wheel file states none, and bends everywhere."""

import numpy as np
import pytest

from rwa_monitor.discrepancy.derived_friction import Motion, derived_friction, with_fitting_window
from rwa_monitor.wheel.torque_balance import differentiate, half_width, inertia_of, with_window
from rwa_monitor.wheel.wheel import Wheel

PERIOD_S, INERTIA, COUNT = 0.01, 1e-3, 4000
DRY_NM, TORQUE_NOISE_NM = 2e-3, 5e-5
WHEEL = Wheel(name="fast", sample_period_s=PERIOD_S, inertia_kg_m2=INERTIA)


def motion(turn_s: float, speed_noise_rad_s: float, seed: int, ripple_rad_s: float = 0.0) -> Motion:
    """Return a swing, its torque, and a speed whose reading ripples, too."""
    rng, at = np.random.default_rng(seed), np.arange(COUNT) * PERIOD_S
    speed = 100.0 + 5.0 * np.sin(2.0 * np.pi * at / turn_s)
    torque = DRY_NM + INERTIA * np.gradient(speed, PERIOD_S) + rng.normal(0.0, TORQUE_NOISE_NM, COUNT)
    read = speed + ripple_rad_s * np.sin(2.0 * np.pi * at / (5.0 * PERIOD_S)) + rng.normal(0, speed_noise_rad_s, COUNT)
    return Motion(read, torque, None)


def error_Nm(seen: Motion, wheel: Wheel, turn_s: float) -> float:
    at = np.arange(COUNT) * PERIOD_S
    true = 5.0 * (2.0 * np.pi / turn_s) * np.cos(2.0 * np.pi * at / turn_s)
    slope = differentiate(seen.speed_rad_s, wheel.friction.derivative, PERIOD_S)
    return inertia_of(wheel) * float(np.sqrt(np.nanmean((slope - true) ** 2)))


def half(wheel: Wheel) -> int:
    return half_width(wheel.friction.derivative, PERIOD_S)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("turn_s", "speed_noise_rad_s"), [(1.5, 2e-3), (2.0, 5e-3), (5.0, 1e-2)])
def test_a_fast_swing_is_not_averaged_away(turn_s: float, speed_noise_rad_s: float, seed: int) -> None:
    seen = motion(turn_s, speed_noise_rad_s, seed)
    fitting = with_fitting_window([seen], WHEEL)
    assert half(fitting) < half(WHEEL) / 2
    assert error_Nm(seen, fitting, turn_s) < 3.0 * TORQUE_NOISE_NM < error_Nm(seen, WHEEL, turn_s)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("ripple_rad_s", [0.0, 0.05])
def test_a_slow_swing_keeps_the_usual_window_however_the_reading_of_the_speed_ripples(
    ripple_rad_s: float, seed: int
) -> None:
    assert with_fitting_window([motion(60.0, 0.02, seed, ripple_rad_s)], WHEEL) == WHEEL


def test_given_friction_and_a_motor_that_is_off_leave_the_window() -> None:
    seen = motion(0.5, 1e-3, 0)
    off = Motion(seen.speed_rad_s, np.zeros(COUNT), None)
    given = Motion(seen.speed_rad_s, seen.torque_Nm, np.full(COUNT, DRY_NM))
    assert with_fitting_window([off], WHEEL) == WHEEL
    assert with_fitting_window([given], WHEEL) == WHEEL


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_units_of_the_torque_do_not_matter(scale: float) -> None:
    seen = motion(2.0, 5e-3, 0)
    scaled = WHEEL.model_copy(update={"inertia_kg_m2": INERTIA * scale})
    one = with_fitting_window([Motion(seen.speed_rad_s, scale * seen.torque_Nm, None)], scaled)
    assert half(one) == half(with_fitting_window([seen], WHEEL))


def test_a_torque_that_ripples_throughout_is_not_masked_as_bends_of_the_speed() -> None:
    rng, at = np.random.default_rng(0), np.arange(COUNT) * 2.0 * np.pi / 20.0  # a cogging period of 20 samples
    friction, driven = DRY_NM + 2e-3 * np.cos(at), DRY_NM + 2e-3 * np.cos(at - 1.0)
    speed = 10.0 + np.cumsum(driven - friction) * PERIOD_S / INERTIA
    torque = driven + rng.normal(0.0, 2e-5, COUNT)
    found = derived_friction(speed, torque, with_window(WHEEL, 6.0 * PERIOD_S), 0.0).friction_Nm
    assert np.mean(np.isfinite(found)) > 0.9
    assert np.nanstd(found - friction) < 0.2 * np.std(friction)


@pytest.mark.parametrize("seed", range(3))
def test_a_fast_swing_is_neither_masked_nor_taken_for_an_error_of_the_inertia(seed: int) -> None:
    seen = motion(1.5, 2e-3, seed)
    found = derived_friction(seen.speed_rad_s, seen.torque_Nm, with_fitting_window([seen], WHEEL), 0.0).friction_Nm
    known = np.isfinite(found)
    assert np.mean(known) > 0.8
    slope = np.gradient(5.0 * np.sin(2.0 * np.pi * np.arange(COUNT) * PERIOD_S / 1.5), PERIOD_S)[known]
    assert abs(np.polyfit(slope, found[known], 1)[0]) < 2e-3 * INERTIA
