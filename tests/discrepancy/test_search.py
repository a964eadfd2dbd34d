"""The traps of the search: what must not be explained, and what jumps must not swallow."""

import gc
from dataclasses import replace

import numpy as np
import pytest
from scipy import signal
from scipy.integrate import cumulative_trapezoid

from rwa_monitor.discrepancy.find import find_discrepancy
from rwa_monitor.discrepancy.noise_effects import coloured_beyond_filter
from rwa_monitor.discrepancy.problem import ColumnCache
from rwa_monitor.discrepancy.record import make_record
from rwa_monitor.threads import on_threads
from rwa_monitor.wheel.effects.cage_instability import CageInstability
from rwa_monitor.wheel.effects.lags import Presliding
from rwa_monitor.wheel.torque_balance import averaging_taps, derivative_taps
from rwa_monitor.wheel.wheel import Wheel
from tests.discrepancy.simple import (
    DRY_NM,
    NOISE_NM,
    PERIOD_S,
    VISCOUS,
    WHEEL,
    current_of,
    names,
    record,
    sampled,
    search,
    swing,
)


def one_way(count: int = 8000) -> np.ndarray:
    """A speed that never changes direction, with slews [rad/s]."""
    time = np.arange(count) * PERIOD_S
    return 200.0 + 40.0 * np.sin(2 * np.pi * time / 700) + 20.0 * np.tanh(np.sin(2 * np.pi * time / 240) / 0.1)


def _caches() -> set[int]:
    """Return which caches are there; other tests may keep theirs."""
    return {id(one) for one in gc.get_objects() if isinstance(one, ColumnCache)}


def test_one_direction_with_current_is_adequate_and_what_a_search_kept_is_freed_with_it() -> None:
    samples, _ = record(one_way())
    samples = replace(samples, motor_current_A=current_of(samples.friction_torque_Nm, one_way()))
    gc.collect()
    of_others = _caches()
    gc.disable()  # it counts objects, not bytes: hundreds of megabytes in a circle would wait for it
    try:
        found = search(samples)
        assert found.result.verdict == "adequate", names(found)
        assert _caches() > of_others
        del found
        assert _caches() == of_others
    finally:
        gc.enable()


def test_an_offset_in_a_few_dwells_may_be_an_asymmetry() -> None:
    # Level and direction change together from dwell to dwell: without the offset, levels take its part.
    dwells = np.repeat([60.0, -60.0, 150.0, -150.0, 300.0, -300.0], 1000)
    samples, _ = record(np.convolve(dwells, np.ones(41) / 41, "same")[20:-20], (), lambda _, level: 0.05 * level)
    (effect,) = search(samples).result.effects
    assert {effect.name, *effect.equivalent} >= {"torque_bias", "coulomb_asymmetry"}


@pytest.mark.parametrize("seed", range(2))
def test_an_error_of_the_inertia_is_found_in_short_slews_between_long_dwells(seed: int) -> None:
    rng = np.random.default_rng(seed)
    speeds = rng.uniform(-60.0, 60.0, 24)
    slews_s = np.abs(np.diff(speeds, prepend=0.0)) / 3.0  # at 3 rad/s²
    ends_s = np.cumsum(slews_s + 25.0)
    corners_s = np.stack([ends_s - slews_s, ends_s], axis=1).ravel()
    speed = np.interp(np.arange(8000) * PERIOD_S, corners_s, np.repeat(np.append(0.0, speeds), 2)[1:-1])
    missed = 0.02 * WHEEL.inertia_kg_m2 * np.gradient(speed, PERIOD_S)
    found = search(record(speed, (1500,), lambda *_: missed, seed=seed)[0])
    assert names(found) == ["inertia_error"]
    error = found.result.effects[0].parameters["strength_kg_m2"]
    assert error.value == pytest.approx(0.02 * WHEEL.inertia_kg_m2, abs=5.0 * error.std)


def test_the_answer_does_not_depend_on_threads() -> None:
    samples, _ = record(swing(4000), (1500,), lambda w, _: 2e-4 * np.exp(-np.abs(w) / 10.0) * np.sign(w) + 1e-4)
    one = search(samples)
    other = find_discrepancy([("hidden", samples)], WHEEL, each=on_threads(4))
    assert one.result.effects
    assert one.result.to_json() == other.result.to_json()
    assert np.array_equal(one.extended.fit.residual, other.extended.fit.residual)


@pytest.mark.parametrize(("slots", "alone"), [(1.5, False), (6.0, True)])
def test_a_breakaway_faster_than_the_samples_is_no_more_than_a_dead_zone(slots: float, alone: bool) -> None:
    speed = swing(top=100.0, period_s=60.0)
    step = np.abs(np.diff(speed))[np.abs(speed[1:]) < 10.0].mean()
    angle = slots**2 * 0.5 * step * PERIOD_S  # what the wheel turns through in so many slots after a reversal
    bristle = Presliding(strength_Nm=3 * DRY_NM, breakaway_angle_rad=angle)
    channels = make_record(record(speed)[0], WHEEL, "motion").channels
    torque, _ = bristle.torque(replace(channels, speed_rad_s=speed, direction=np.sign(speed)))
    samples, _ = record(speed, effect=lambda speed, level: torque)
    found = [effect for effect in search(samples).result.effects if effect.family == "mean"]
    names = {name for entry in found for name in (entry.name, *entry.equivalent)}
    assert "presliding" in names
    assert ("speed_dead_zone" not in names) is alone


def test_a_threshold_of_speed_is_no_jump_at_each_of_its_crossings() -> None:
    found = search(record(swing(), effect=lambda w, _: -0.3 * DRY_NM * np.sign(w) * (np.abs(w) < 20.0))[0])
    assert names(found) == ["speed_dead_zone"]
    np.testing.assert_allclose(found.problem.slot[found.extended.fit.jumps], [1500, 4000, 6200], atol=2)


def test_a_step_at_half_the_speed_is_no_dead_zone() -> None:
    found = search(record(swing(), effect=lambda w, _: 0.3 * DRY_NM * np.sign(w) * (np.abs(w) > 120.0))[0])
    assert found.result.unexplained is not None or any(effect.formula for effect in found.result.effects)
    assert "speed_dead_zone" not in names(found)


def test_a_torque_constant_that_is_far_off_is_named_with_its_size_on_a_loaded_bench() -> None:
    # The motor drives a load and its torque is measured beyond the friction: what is read is too much by 1/(1 - δ).
    error, rng = 0.35, np.random.default_rng(8)
    time = np.arange(4000) * PERIOD_S
    speed = 40.0 * np.sin(2 * np.pi * time / 90.0) + 5.0
    load = 0.1 * np.sin(2 * np.pi * time / 131.0)
    true_friction = np.sign(speed) * DRY_NM + VISCOUS * speed + NOISE_NM * rng.normal(size=time.size)
    motor = (load + true_friction) / (1.0 - error)
    samples = sampled(speed + rng.normal(0.0, 0.01, time.size), motor - load, motor_torque_Nm=motor)
    (found,) = search(samples, Wheel(name="bench", sample_period_s=PERIOD_S)).result.effects
    assert found.name == "torque_constant_error"
    assert found.parameters["strength"].value == pytest.approx(error, rel=0.01)


# ---- noise effects in the whole search -------------------------------------------------------------------------------


SAMPLES = 20_000


def test_a_cage_is_named_alone_and_its_bursts_are_no_jumps() -> None:
    cage = CageInstability(
        strength_Nm=2.0 * NOISE_NM,
        noise_strength=2.0,
        band_speed_rad_s=120.0,
        band_half_width_rad_s=20.0,
        burst_s=15.0,
        quiet_s=15.0,
    )
    rng = np.random.default_rng(21)
    quiet, _ = record(swing())
    channels = make_record(quiet, WHEEL, "quiet").channels
    noise = cage.apply(NOISE_NM * rng.normal(size=len(quiet)), channels, rng)
    samples, _ = record(swing(), noise=noise)
    found = search(samples)
    assert names(found) == ["cage_instability"]
    assert found.result.effects[0].parameters["band_speed_rad_s"].value == pytest.approx(120.0, abs=8.0)
    assert found.result.unexplained is None
    assert found.result.gain.changepoints_base == pytest.approx(3, abs=2)  # of some twenty with the bursts in


def test_what_stands_out_only_where_the_direction_changes_is_no_noise() -> None:
    speed = swing(8000, period_s=60.0)
    turning = np.flatnonzero(np.diff(np.sign(speed)) != 0)
    near = np.abs(np.arange(speed.size)[:, None] - turning).min(axis=1) < 10
    scatter = np.where(near, 5.0 * NOISE_NM * np.random.default_rng(4).standard_t(3.0, speed.size), 0.0)
    assert names(search(record(speed, effect=lambda *_: scatter)[0])) == []


def test_a_simulation_without_noise_is_adequate() -> None:
    speed = np.linspace(10.0, 200.0, 4000)
    friction = np.round(DRY_NM + VISCOUS * speed, 9)  # as a table with few digits has it
    assert search(sampled(speed, friction)).result.verdict == "adequate"


@pytest.mark.parametrize(
    ("phi", "missing", "of_speed"),  # noise of the torque has a standard deviation of 0.26 in the mean
    [(0.0, 0.0, 0.1), (0.0, 0.1, 0.4), (0.0, 0.1, 1.5), (0.5, 0.1, 0.1), (0.9, 0.1, 0.4)],
)
def test_colour_is_distinguished_from_the_derivative_of_a_noisy_speed(
    phi: float, missing: float, of_speed: float
) -> None:
    rng = np.random.default_rng(3)
    taps, slope = averaging_taps(WHEEL), derivative_taps(WHEEL.friction.derivative, WHEEL.sample_period_s)
    own = signal.lfilter([np.sqrt(1 - phi**2)], [1.0, -phi], rng.normal(size=SAMPLES))
    derived = np.convolve(rng.normal(size=SAMPLES), slope / np.sqrt(np.sum(slope**2)), "same")
    walk = 0.1 * np.cumsum(rng.random(SAMPLES) < 5 / SAMPLES)  # jumps that were missed
    own, walk = (np.convolve(values, taps, "same") for values in (own, walk))
    good = np.repeat(rng.random(SAMPLES // 20) >= missing, 20)
    fit = coloured_beyond_filter(own + of_speed * derived + walk - walk.mean(), good, taps)
    if phi == 0.0:
        assert fit.penalised_gain < 10.0  # the search accepts from 25 on
    else:
        assert fit.penalised_gain > 25.0
        assert fit.values["ar_coefficient"] == pytest.approx(phi, abs=0.08)


def test_coarse_rounding_makes_no_mean_effect() -> None:
    speed = swing(6_000, period_s=700.0)
    rng = np.random.default_rng(2)
    friction = np.sign(speed) * DRY_NM + VISCOUS * speed + NOISE_NM * rng.normal(size=speed.size)
    coarse = sampled(5.0 * np.rint(speed / 5.0), motor_current_A=current_of(friction, speed))
    assert names(search(coarse)) == ["tachometer_quantisation"]


@pytest.mark.parametrize("phi", [pytest.param(0.0, marks=pytest.mark.slow), 0.7])
def test_torque_that_the_derivative_does_not_follow_is_no_noise(phi: float) -> None:
    """What a controller does from sample to sample stands in the current, and is no noise of the derived friction."""
    rng = np.random.default_rng(4)
    lively = 1e-4 * signal.lfilter([1.0], [1.0, -phi], rng.standard_t(4.0, size=SAMPLES))
    turned = cumulative_trapezoid(lively - lively.mean(), dx=PERIOD_S, initial=0.0) / WHEEL.inertia_kg_m2
    speed = swing(SAMPLES) + turned
    friction = np.sign(speed) * DRY_NM + VISCOUS * speed + NOISE_NM * rng.normal(size=SAMPLES)
    motor = friction + WHEEL.inertia_kg_m2 * np.gradient(swing(SAMPLES), PERIOD_S) + lively - lively.mean()
    samples = sampled(speed, motor_current_A=motor / WHEEL.torque_constant_Nm_A)
    assert names(search(samples)) == []
