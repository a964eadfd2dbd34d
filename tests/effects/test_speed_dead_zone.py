"""A dead zone of the tachometer, seen in the speed readings alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rwa_monitor.physics.effects.speed_dead_zone import SpeedDeadZone, plateau_speed
from tests.effects.records import rich_motion

SLOTS = 8192


@pytest.mark.parametrize("noise", [0.0, 0.01], ids=["quiet", "noisy"])
@pytest.mark.parametrize("zone", [1.0, 4.0])
def test_zeros_around_a_reversal_show_the_zone(zone: float, noise: float) -> None:
    motion = rich_motion(SLOTS, top_speed_rad_s=30.0)
    effect = SpeedDeadZone(strength_Nm=0.0, dead_zone_rad_s=zone)
    read = effect.read_speed(motion.speed_rad_s + noise * np.random.default_rng(0).normal(size=SLOTS))
    found = plateau_speed(replace(motion, speed_rad_s=read))
    assert found == pytest.approx(zone, rel=0.15)


def test_a_held_reading_shows_the_zone() -> None:
    motion = rich_motion(SLOTS, top_speed_rad_s=30.0)
    held, last = [], motion.speed_rad_s[0]
    for speed in motion.speed_rad_s:
        last = speed if abs(speed) >= 2.0 else last
        held.append(last)
    assert plateau_speed(replace(motion, speed_rad_s=np.array(held))) == pytest.approx(2.0, rel=0.15)


def test_an_honest_tachometer_shows_none() -> None:
    motion = rich_motion(SLOTS, top_speed_rad_s=30.0)
    assert plateau_speed(motion) is None
    noisy = motion.speed_rad_s + 0.01 * np.random.default_rng(1).normal(size=SLOTS)
    assert plateau_speed(replace(motion, speed_rad_s=noisy)) is None


def test_a_lattice_is_no_dead_zone() -> None:
    motion = rich_motion(SLOTS, top_speed_rad_s=30.0)
    assert plateau_speed(replace(motion, speed_rad_s=0.5 * np.rint(motion.speed_rad_s / 0.5))) is None


def test_rest_is_no_dead_zone() -> None:
    """A wheel that rests and then starts up leaves zero in steps of its acceleration."""
    time = np.arange(SLOTS) * 0.125
    speed = 0.05 * np.maximum(time - 200.0, 0.0)
    motion = replace(rich_motion(SLOTS), speed_rad_s=speed, direction=np.sign(speed))
    assert plateau_speed(motion) is None


def test_no_readings_show_nothing() -> None:
    motion = rich_motion(64)
    assert plateau_speed(replace(motion, good=np.zeros(64, dtype=bool))) is None
    assert plateau_speed(replace(motion, speed_rad_s=np.zeros(64))) is None
