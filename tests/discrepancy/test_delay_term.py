"""The column of a delayed current: pulses where friction jumps, on the side that the shape says."""

from __future__ import annotations

import numpy as np
import pytest

from rwa_monitor.discrepancy.jump_terms import LEAD, DelayTerm, without_pulses
from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import Channels

PERIOD_S = 0.125
SIZE, JUMP = 200, 120


def channels(level: FloatArray, rise_Nm_s: float = 0.0) -> Channels:
    time = np.arange(level.size) * PERIOD_S
    return Channels(
        time_s=time,
        speed_rad_s=np.full(level.size, 100.0),
        direction=np.ones(level.size),
        acceleration_rad_s2=np.zeros(level.size),
        angle_rad=100.0 * time,
        motor_torque_Nm=level + rise_Nm_s * time,
        bearing_temperature_degC=None,
        dry_level_Nm=level,
        sample_period_s=PERIOD_S,
        good=np.ones(level.size, dtype=bool),
    )


@pytest.mark.parametrize(
    ("lead", "slots"), [(0.5, {JUMP - 1: 1.0}), (-0.5, {JUMP: 1.0}), (0.0, {JUMP - 1: 0.5, JUMP: 0.5})]
)
def test_a_jump_is_a_pulse_on_the_side_that_the_shape_says(lead: float, slots: dict[int, float]) -> None:
    level = np.where(np.arange(SIZE) < JUMP, 1.0, 1.4)
    column = DelayTerm.columns(channels(level), {LEAD: lead})[0][:, 0]
    expected = np.zeros(SIZE)
    for slot, share in slots.items():
        expected[slot] = share * 0.4 / PERIOD_S
    np.testing.assert_allclose(column, expected, atol=1e-12)


def test_a_slow_rise_is_its_slope() -> None:
    column = DelayTerm.columns(channels(np.ones(SIZE), rise_Nm_s=0.03), {LEAD: 0.5})[0][:, 0]
    np.testing.assert_allclose(column[10:-10], 0.03, rtol=1e-9)


@pytest.mark.parametrize(("lead", "pulse"), [(0.5, JUMP - 1), (-0.5, JUMP)])
def test_a_pulse_that_passed_for_a_level_is_taken_out_and_the_jump_stays(lead: float, pulse: int) -> None:
    clean = np.where(np.arange(SIZE) < JUMP, 1.0, 1.4)
    level = clean.copy()
    level[pulse] = 3.0
    np.testing.assert_array_equal(without_pulses(level, lead), clean)
