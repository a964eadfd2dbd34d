"""Noise effects in the whole search: what is there is named, what is not there is not, and nothing else suffers."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal
from scipy.integrate import cumulative_trapezoid

from rwa_monitor.discrepancy.noise_effects import coloured_beyond_filter
from rwa_monitor.discrepancy.record import make_record
from rwa_monitor.wheel.effects.cage_instability import CageInstability
from rwa_monitor.wheel.torque_balance import averaging_taps, derivative_taps
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
    result = found.result
    assert names(found) == ["cage_instability"]
    assert result.effects[0].parameters["band_speed_rad_s"].value == pytest.approx(120.0, abs=8.0)
    assert result.unexplained is None
    assert result.gain.changepoints_base == pytest.approx(3, abs=2)  # of some twenty with the bursts in


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
