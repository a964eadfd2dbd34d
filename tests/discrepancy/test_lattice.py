"""Torque that is read in coarse steps, or averaged over a reversal: neither is an effect of the wheel."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from rwa_monitor.discrepancy.quantisation import without_steps
from rwa_monitor.discrepancy.record import make_record
from rwa_monitor.reporting.discrepancy_report import steps_in_words
from rwa_monitor.samples import Samples
from tests.discrepancy.simple import DRY_NM, NOISE_NM, VISCOUS, WHEEL, Array, current_of, record, search, swing

SEED = 52_200
STRIBECK_NM, STRIBECK_RAD_S = 5e-4, 8.0
FINE_STEPS = 8  # of the time within a sample


def motion(count: int = 8000) -> Array:
    """Return a swing with dwells in it, on which a rounding error rests [rad/s]."""
    speed = swing(count)
    for k in range(500, count - 700, 2000):
        speed[k : k + 600] = speed[k]
        speed[k + 600 : k + 700] = np.linspace(speed[k], speed[k + 700], 100)
    return speed


def read_in_steps(samples: Samples, step: float) -> Samples:
    """Return samples whose friction is rounded [N m]."""
    return replace(samples, friction_torque_Nm=step * np.rint(samples.friction_torque_Nm / step))


def with_current(samples: Samples, speed: Array, step_A: float) -> Samples:
    """Return samples with a rounded current in place of the friction."""
    current = step_A * np.rint(current_of(samples.friction_torque_Nm, speed) / step_A)
    return replace(samples, friction_torque_Nm=None, motor_current_A=current)


@pytest.mark.parametrize("step", [1.5, 2.0, 4.0])
def test_steps_of_friction_make_no_effect_and_no_other_noise(step: float) -> None:
    samples, _ = record(motion(), seed=SEED)
    found = search(read_in_steps(samples, step * NOISE_NM))
    assert found.result.verdict == "adequate"
    # The standard error of a standard deviation from 8000 samples is 0.8 %; coarse steps show less of it.
    assert found.problem.noise.std == pytest.approx(NOISE_NM, rel=0.05)
    assert f"friction is quantised in steps of {step * NOISE_NM * 1e6:.4g} µN m" in steps_in_words(found.problem)


def test_steps_of_the_current_are_reported_and_make_no_effect() -> None:
    speed = swing(6_000, period_s=900.0)
    samples, _ = record(speed, seed=SEED + 1)
    found = search(with_current(samples, speed, 2.4e-3))
    assert found.result.verdict == "adequate"
    assert "current is quantised in steps of 2.4 mA" in steps_in_words(found.problem)


def test_an_effect_is_found_behind_the_steps() -> None:
    def stribeck(speed: Array, _: Array) -> Array:
        return STRIBECK_NM * np.exp(-((speed / STRIBECK_RAD_S) ** 2)) * np.sign(speed)

    samples, _ = record(swing(top=60.0), effect=stribeck, seed=SEED + 2)
    (effect,) = search(read_in_steps(samples, 4.0 * NOISE_NM)).result.effects
    assert effect.name == "stribeck"
    strength = effect.parameters["strength_Nm"]
    assert abs(strength.value - STRIBECK_NM) < 4.0 * strength.std


def test_what_is_drawn_within_the_steps_is_the_law_of_the_noise() -> None:
    samples, level = record(motion(), jumps=(), seed=SEED + 3)
    read = make_record(read_in_steps(samples, 3.0 * NOISE_NM), WHEEL, "read")
    (drawn,) = without_steps([read], WHEEL)
    apart = np.abs(drawn.friction_torque_Nm - read.friction_torque_Nm)[read.used]
    assert apart.max() <= 1.5 * NOISE_NM * (1 + 1e-9)
    speed = samples.speed_rad_s
    noise = ((drawn.friction_torque_Nm - np.sign(speed) * level - VISCOUS * speed) / NOISE_NM)[read.used]
    # Level, slope and spread are fitted, which only brings the laws nearer.
    assert stats.kstest(noise, "norm").pvalue > 1e-3


def test_no_number_changes_where_steps_are_fine_or_none() -> None:
    samples, _ = record(motion(), seed=SEED + 4)
    for table in (samples, read_in_steps(samples, 0.05 * NOISE_NM)):
        before = make_record(table, WHEEL, "table")
        (after,) = without_steps([before], WHEEL)
        assert after.steps is None
        assert after.friction_torque_Nm is before.friction_torque_Nm


def averaged(seed: int, shift: float) -> tuple[Samples, Array]:
    """Return samples that are means over their slot, whose middle is `shift` slots off, and where they straddle."""
    speed = swing(8000, period_s=250.0)
    at = np.arange(speed.size)[:, None] + shift + (np.arange(FINE_STEPS) + 0.5) / FINE_STEPS - 0.5
    inside = np.interp(at, np.arange(speed.size), speed)
    samples, _ = record(speed, jumps=(), seed=seed)
    mean_sign = np.sign(inside).mean(axis=1)
    friction = samples.friction_torque_Nm + DRY_NM * (mean_sign - np.sign(speed))
    return replace(samples, friction_torque_Nm=friction), np.flatnonzero(np.abs(mean_sign) < 1)


@pytest.mark.parametrize(("shift", "noise_rad_s"), [(0.0, 0.0), (-0.5, 0.0), (0.0, 0.1)])
def test_means_over_a_reversal_make_no_effect(shift: float, noise_rad_s: float) -> None:
    samples, straddling = averaged(SEED + 5, shift)
    assert straddling.size >= 3
    noise = noise_rad_s * np.random.default_rng(SEED).standard_normal(len(samples))
    samples = replace(samples, speed_rad_s=samples.speed_rad_s + noise)
    found = search(samples)
    assert found.result.verdict == "adequate"
    (read,) = found.problem.records
    assert not read.used[straddling].any()
    assert read.left_out.get("averaged over a reversal of the speed", 0) <= 2 * straddling.size


def test_a_rest_does_not_hide_that_samples_are_means() -> None:
    samples, straddling = averaged(SEED + 5, 0.0)
    rng, at, count = np.random.default_rng(SEED + 6), int(straddling[1]), 100
    friction = np.insert(samples.friction_torque_Nm, at, DRY_NM * rng.uniform(-1.0, 1.0, count))
    speed = np.insert(samples.speed_rad_s, at, 0.02 * rng.standard_normal(count))
    time_ns = samples.time_ns[0] + np.arange(speed.size) * int(samples.time_ns[1] - samples.time_ns[0])
    read = make_record(replace(samples, time_ns=time_ns, speed_rad_s=speed, friction_torque_Nm=friction), WHEEL, "rest")
    elsewhere = straddling[np.abs(straddling - at) > 1]
    assert not read.used[elsewhere + count * (elsewhere > at)].any()


def test_the_end_of_a_dead_zone_is_stated_as_well_as_samples_lie_around_it() -> None:
    zone = 12.0

    def dead_zone(speed: Array, level: Array) -> Array:
        return -level * np.sign(speed) * (np.abs(speed) < zone)

    samples, _ = record(swing(4000), jumps=(), effect=dead_zone, seed=SEED + 7)
    found = {effect.name: effect for effect in search(samples).result.effects}
    end = found["speed_dead_zone"].parameters["dead_zone_rad_s"]
    assert end.std > 0.0
    speeds = np.sort(np.abs(samples.speed_rad_s))
    above = int(np.searchsorted(speeds, end.value))
    assert 4.0 * end.std >= speeds[above] - speeds[above - 1]  # two deviations to either side hold the gap
    assert abs(end.value - zone) < 3.0 * end.std + 0.05  # speed noise of 0.01 rad/s on each sample
