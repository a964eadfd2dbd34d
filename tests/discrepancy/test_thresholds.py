"""A threshold of speed is read off the jumps that its crossings make."""

from __future__ import annotations

import numpy as np

from rwa_monitor.discrepancy.base_fit import fit, make_problem
from rwa_monitor.discrepancy.find import find_discrepancy
from rwa_monitor.discrepancy.record import make_record
from rwa_monitor.discrepancy.terms import make_term
from rwa_monitor.discrepancy.thresholds import best_threshold
from rwa_monitor.physics.effects.speed_dead_zone import SpeedDeadZone
from tests.discrepancy.simple import DRY_NM, WHEEL, record, swing

THRESHOLD_RAD_S = 40.0


def test_the_speed_is_found_and_only_true_jumps_are_left() -> None:
    speed = swing()

    def dead_zone(omega: np.ndarray, level: np.ndarray) -> np.ndarray:
        return -0.3 * DRY_NM * np.sign(omega) * (np.abs(omega) < THRESHOLD_RAD_S)

    samples, _ = record(speed, effect=dead_zone)
    problem = make_problem([make_record(samples, WHEEL, "dead zone")], WHEEL)
    base = fit(problem, np.zeros((problem.size, 0)))
    assert base.jumps.size > 3  # each crossing of the threshold passes for a jump
    found = best_threshold(
        problem, (), base, lambda at: make_term(problem, SpeedDeadZone, {"dead_zone_rad_s": at}, None)
    )
    assert found is not None
    term, left = found
    # To within what the speed changes in a slot there.
    slot = float(np.max(np.abs(np.diff(speed))))
    assert abs(term.shape["dead_zone_rad_s"] - THRESHOLD_RAD_S) < slot
    np.testing.assert_allclose(problem.slot[left], [1500, 4000, 6200], atol=2)


def test_a_step_at_half_the_speed_is_no_dead_zone() -> None:
    def step(omega: np.ndarray, level: np.ndarray) -> np.ndarray:
        return 0.3 * DRY_NM * np.sign(omega) * (np.abs(omega) > 120.0)

    result = find_discrepancy([("step", record(swing(), effect=step)[0])], WHEEL).result
    assert result.unexplained is not None
    assert "speed" in result.unexplained.signature
    assert "speed_dead_zone" not in [effect.name for effect in result.effects]


def test_jumps_at_any_speed_suggest_no_threshold() -> None:
    problem = make_problem([make_record(record(swing(), jumps=(1500, 4000))[0], WHEEL, "plain")], WHEEL)
    base = fit(problem, np.zeros((problem.size, 0)))
    found = best_threshold(
        problem, (), base, lambda at: make_term(problem, SpeedDeadZone, {"dead_zone_rad_s": at}, None)
    )
    assert found is None
