"""Motions: smooth, within limits, and each kind what its name means."""

import numpy as np
import pytest

from rwa_monitor.errors import InputError
from rwa_monitor.simulation.motion import SpeedProfile, largest_acceleration, simulate_motion
from rwa_monitor.wheel.wheel import Limits, built_in_wheel

WHEEL = built_in_wheel()
KINDS = ("orbit", "one_direction", "crossings", "rich", "constant", "from_rest")
kinds = pytest.mark.parametrize("kind", KINDS)


def motion(kind, seed=0, slots=80_000, wheel=WHEEL, **settings):
    return simulate_motion(SpeedProfile(kind=kind, **settings), wheel, slots, np.random.default_rng(seed))


def crossings(speed):
    sign = np.sign(speed[speed != 0.0])
    return np.diff(sign)[np.diff(sign) != 0]


@kinds
def test_acceleration_is_the_derivative_of_the_speed(kind):
    """Against the central difference, whose error is Δt²/6·|d³ω/dt³|; the sharpest corner is that of a fast move."""
    for seed in range(5):
        found = motion(kind, seed)
        numeric = (found.speed_rad_s[2:] - found.speed_rad_s[:-2]) / (2 * WHEEL.sample_period_s)
        third = np.max(np.abs(np.diff(found.acceleration_rad_s2, 2))) / WHEEL.sample_period_s**2
        bound = third * WHEEL.sample_period_s**2 / 6 * 1.5 + 1e-9
        assert np.max(np.abs(numeric - found.acceleration_rad_s2[1:-1])) < bound


@kinds
@pytest.mark.parametrize("slots", [2, 50, 5_000])
def test_limits_hold_also_in_short_records_and_for_slow_wheels(kind, slots):
    slow = WHEEL.model_copy(update={"limits": Limits(max_speed_rad_s=120.0, max_current_A=0.5)})
    for wheel in (WHEEL, slow):
        for seed in range(5):
            found = motion(kind, seed, slots, wheel)
            assert np.all(np.isfinite(found.speed_rad_s))
            assert np.max(np.abs(found.speed_rad_s)) <= wheel.limits.max_speed_rad_s
            assert np.max(np.abs(found.acceleration_rad_s2)) <= largest_acceleration(wheel) * (1 + 1e-12)


def test_orbit_crosses_zero_in_both_directions_and_simple_crossings_are_few():
    for seed in range(20):
        assert {-2.0, 2.0} <= set(crossings(motion("orbit", seed).speed_rad_s))
        assert 2 <= crossings(motion("crossings", seed).speed_rad_s).size <= 5


def test_one_direction_stays_far_from_zero_and_takes_both_signs():
    speeds = [motion("one_direction", seed).speed_rad_s for seed in range(20)]
    assert np.min(np.abs(speeds)) > 10 * WHEEL.window.dead_band_rad_s
    assert not any(crossings(speed).size for speed in speeds)
    assert {float(np.sign(speed[0])) for speed in speeds} == {-1.0, 1.0}


def test_rich_has_ladder_and_crossings_at_several_rates_and_all_four_quadrants():
    for seed in range(10):
        found = motion("rich", seed, activity=0.0)
        speed, acceleration = found.speed_rad_s, found.acceleration_rad_s2
        at = np.nonzero(speed[1:] * speed[:-1] < 0)[0]
        assert at.size >= 4
        rates = np.abs(acceleration[at])
        assert rates.max() > 3 * rates.min()
        dwelling = np.abs(speed[acceleration == 0.0])
        assert np.unique(np.round(dwelling)).size >= 8
        for way in (-1, 1):
            for push in (-1, 1):
                assert np.mean((np.sign(speed) == way) & (np.sign(acceleration) == push)) > 0.05


def test_from_rest_begins_and_ends_at_rest():
    speed = motion("from_rest").speed_rad_s
    assert np.all(speed[:3_000] == 0.0)
    assert speed[-1] == 0.0
    assert np.max(np.abs(speed)) == pytest.approx(WHEEL.nominal.nominal_speed_rad_s)


def test_constant_is_constant_but_for_the_control_activity():
    speed = motion("constant", direction=-1, activity=0.002).speed_rad_s
    assert speed.mean() == pytest.approx(-300.0, abs=0.6)
    assert speed.std() == pytest.approx(0.6, rel=0.2)
    assert np.ptp(motion("constant", activity=0.0).speed_rad_s) == 0.0


@pytest.mark.parametrize("kind", ["one_direction", "constant", "from_rest"])
def test_directions_are_mirror_images(kind):
    """The direction turns the motion round; the wobble on top is the generator's and stays."""
    up, down = motion(kind, 3, direction=1, activity=0.0), motion(kind, 3, direction=-1, activity=0.0)
    assert np.all(up.speed_rad_s >= 0.0)
    assert np.all(down.speed_rad_s <= 0.0)


def test_what_the_wheel_lacks_is_named():
    with pytest.raises(InputError, match="nominal"):
        motion("orbit", wheel=WHEEL.model_copy(update={"nominal": None}))
    with pytest.raises(InputError, match=r"limits\.max_current_A"):
        motion("orbit", wheel=WHEEL.model_copy(update={"limits": Limits(max_current_A=0.01)}))
