"""The drift of an integrated angle is found by the phase of a ripple, and only where there is a ripple."""

import numpy as np
import pytest

from rwa_monitor.discrepancy.angle import time_between, track_drift
from rwa_monitor.discrepancy.record import Record
from rwa_monitor.samples import FloatArray
from rwa_monitor.simulation.motion import wheel_angle
from tests.wheel.effects.records import PERIOD_S, channels_of

SPEED_NOISE_RAD_S = 0.02
SIZE = 20_000
HARMONIC = 11


SWEPT_RAD_S = 200.0 + 80.0 * np.sin(2 * np.pi * np.arange(SIZE) / 9_000)


def record_of(speed: FloatArray, noise_rad_s: float = SPEED_NOISE_RAD_S) -> Record:
    angle = wheel_angle(speed, PERIOD_S)
    channels = channels_of(speed, acceleration_rad_s2=np.gradient(speed, PERIOD_S), angle_rad=angle)
    return Record("r", channels, np.zeros(SIZE), np.ones(SIZE, dtype=bool), False, noise_rad_s)


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


@pytest.mark.parametrize("later_s", [-0.04, 0.0123, 0.1])
def test_friction_that_is_read_later_than_the_speed_turns_a_ripple_with_the_speed(later_s: float) -> None:
    rng = np.random.default_rng(7)
    angle = wheel_angle(SWEPT_RAD_S, PERIOD_S)
    residual = 0.3 * np.sin(HARMONIC * (angle + later_s * SWEPT_RAD_S)) + rng.standard_normal(SIZE)
    found = time_between(record_of(SWEPT_RAD_S, 1e-4), residual)
    # By as much as turns the harmonic by less than half a radian over the range of the speed.
    assert abs(found - later_s) < 0.5 / (HARMONIC * np.ptp(SWEPT_RAD_S))


@pytest.mark.parametrize("seed", range(20))
def test_neither_noise_nor_a_ripple_read_with_the_speed_is_later(seed: int) -> None:
    rng = np.random.default_rng(seed)
    noise, angle = rng.standard_normal(SIZE), wheel_angle(SWEPT_RAD_S, PERIOD_S)
    assert time_between(record_of(SWEPT_RAD_S, 1e-4), noise) == 0.0
    assert time_between(record_of(SWEPT_RAD_S, 1e-4), np.sin(HARMONIC * angle) + noise) == 0.0
