"""The drift of an integrated angle is found by the phase of a ripple, and only where there is a ripple."""

from __future__ import annotations

import numpy as np

from rwa_monitor.discrepancy.angle import track_drift
from rwa_monitor.discrepancy.record import Record
from rwa_monitor.samples import FloatArray
from rwa_monitor.simulation.motion import wheel_angle
from tests.wheel.effects.records import PERIOD_S, channels_of

SPEED_NOISE_RAD_S = 0.02
SIZE = 20_000
HARMONIC = 11


SWEPT_RAD_S = 200.0 + 80.0 * np.sin(2 * np.pi * np.arange(SIZE) / 9_000)


def record_of(speed: FloatArray) -> Record:
    channels = channels_of(speed, acceleration_rad_s2=np.gradient(speed, PERIOD_S))
    return Record("r", channels, np.zeros(SIZE), np.ones(SIZE, dtype=bool), False, SPEED_NOISE_RAD_S)


def test_the_drift_that_speed_noise_makes_is_found_by_the_ripple() -> None:
    rng = np.random.default_rng(5)
    error = rng.normal(0, SPEED_NOISE_RAD_S, SIZE)
    angle, wandered = wheel_angle(SWEPT_RAD_S, PERIOD_S), wheel_angle(error, PERIOD_S)
    residual = np.sin(HARMONIC * angle) + rng.standard_normal(SIZE)
    drift = track_drift(record_of(SWEPT_RAD_S + error), residual, 1.0)
    # With the drift added to the integral of the measured speed, the phase stands still but for a constant.
    left = HARMONIC * (wandered + drift)
    assert np.std(HARMONIC * wandered) > 0.8  # rad: the ripple would be lost
    # A block is an eighth of the coherent length, over which the phase wanders by 1/√8 rad, and is known at its middle.
    assert np.std(left) < 1 / np.sqrt(8)


def test_no_drift_is_read_into_noise() -> None:
    rng = np.random.default_rng(6)
    speed = SWEPT_RAD_S + rng.normal(0, SPEED_NOISE_RAD_S, SIZE)
    assert track_drift(record_of(speed), rng.standard_normal(SIZE), 1.0) is None
