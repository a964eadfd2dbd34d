"""The drift of an integrated angle is found by the phase of a ripple, and only where there is a ripple."""

from __future__ import annotations

import numpy as np
import pytest

from rwa_monitor.discrepancy.angle import smooth_phase, track_drift
from rwa_monitor.discrepancy.record import Record
from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import Channels

PERIOD_S = 0.125
SPEED_NOISE_RAD_S = 0.02
SIZE = 20_000
HARMONIC = 11


def swept_speed() -> FloatArray:
    return 200.0 + 80.0 * np.sin(2 * np.pi * np.arange(SIZE) / 9_000)


def record_of(speed: FloatArray) -> Record:
    n = speed.size
    channels = Channels(
        time_s=np.arange(n) * PERIOD_S,
        speed_rad_s=speed,
        direction=np.sign(speed),
        acceleration_rad_s2=np.gradient(speed, PERIOD_S),
        angle_rad=np.zeros(n),
        motor_torque_Nm=None,
        bearing_temperature_degC=None,
        dry_level_Nm=None,
        sample_period_s=PERIOD_S,
        good=np.ones(n, dtype=bool),
        motor_torque_rate_Nm_s=None,
    )
    return Record("r", channels, np.zeros(n), np.ones(n, dtype=bool), 0, False, SPEED_NOISE_RAD_S, 0.0)


def test_the_drift_that_speed_noise_makes_is_found_by_the_ripple() -> None:
    rng = np.random.default_rng(5)
    speed = swept_speed()
    error = rng.normal(0, SPEED_NOISE_RAD_S, SIZE)
    angle = np.concatenate([[0.0], np.cumsum(0.5 * PERIOD_S * (speed[1:] + speed[:-1]))])
    residual = np.sin(HARMONIC * angle) + rng.standard_normal(SIZE)
    drift = track_drift(record_of(speed + error), residual, 1.0)
    assert drift is not None
    wandered = np.concatenate([[0.0], np.cumsum(0.5 * PERIOD_S * (error[1:] + error[:-1]))])
    # With the drift added to the integral of the measured speed, the phase stands still but for a constant.
    left = HARMONIC * (wandered + drift)
    assert np.std(HARMONIC * wandered) > 0.8  # rad: the ripple would be lost
    # A block is an eighth of the coherent length, over which the phase wanders by 1/√8 rad, and is known at its middle.
    assert np.std(left) < 1 / np.sqrt(8)


def test_no_drift_is_read_into_noise() -> None:
    rng = np.random.default_rng(6)
    speed = swept_speed() + rng.normal(0, SPEED_NOISE_RAD_S, SIZE)
    assert track_drift(record_of(speed), rng.standard_normal(SIZE), 1.0) is None


@pytest.mark.parametrize("turn", [0.0, 2.5, -3.0])
def test_sure_phases_are_kept_and_unwrapped(turn: float) -> None:
    phase = turn + np.linspace(0.0, 9.0, 40)
    smooth = smooth_phase(np.exp(1j * phase), np.full(40, 1e-12), 0.1)
    np.testing.assert_allclose(np.diff(smooth), np.diff(phase), atol=1e-2)
