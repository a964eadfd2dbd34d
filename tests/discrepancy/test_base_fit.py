"""The base fit: slope, levels and jumps together, bounds, robust start."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rwa_monitor.discrepancy.base_fit import criterion, fit, make_problem, robust_coefficients, solve_bounded
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.discrepancy.record import make_record
from rwa_monitor.errors import InputError
from tests.discrepancy.simple import DRY_NM, NOISE_NM, VISCOUS, WHEEL, record, swing


def problem_of(seed: int = 0) -> Problem:
    return make_problem([make_record(record(swing(), seed=seed)[0], WHEEL, "simple")], WHEEL)


@pytest.mark.parametrize("seed", range(3))
def test_slope_levels_and_jumps_are_found(seed: int) -> None:
    problem = problem_of(seed)
    found = fit(problem)
    assert problem.slot[found.jumps].tolist() == pytest.approx([1500, 4000, 6200], abs=1)
    # The slope's error: σ over √n times the spread of |ω|, about 75 rad/s; the measured sign errs at few crossings.
    std = NOISE_NM / (np.sqrt(problem.size) * np.std(problem.speed))
    assert found.coefficients[0] == pytest.approx(VISCOUS, abs=5 * std)
    assert found.level[100] == pytest.approx(DRY_NM, abs=5 * NOISE_NM / np.sqrt(1500) + 5 * std * 150)
    assert problem.noise.std == pytest.approx(NOISE_NM, rel=0.05)


def test_the_robust_start_is_not_misled_by_jumps() -> None:
    problem = problem_of()
    slope = robust_coefficients(problem, problem.speed[:, None])[0]
    assert slope == pytest.approx(VISCOUS, rel=0.05)


def test_the_criterion_is_what_the_formula_says() -> None:
    problem = problem_of()
    found = fit(problem)
    expected = found.rss / problem.noise.long_run_variance + np.log(problem.size) * 3 * found.jumps.size
    assert criterion(problem, found) == pytest.approx(expected)
    assert found.rss == pytest.approx(float(np.sum(found.residual**2)))


def test_bounds_hold_and_the_rest_is_refitted() -> None:
    problem = problem_of()
    rng = np.random.default_rng(0)
    design = rng.normal(size=(500, 3))
    truth = np.array([1.0, -2.0, 3.0])
    z = design @ truth
    low, high = np.array([-np.inf, 0.0, -np.inf]), np.full(3, np.inf)
    unprior = replace(problem, nominal_viscous=None)
    solution = solve_bounded(unprior, design.T @ design, design.T @ z, low, high)
    expected, *_ = np.linalg.lstsq(design[:, [0, 2]], z, rcond=None)
    assert solution[1] == 0.0
    assert solution[[0, 2]] == pytest.approx(expected)


def test_a_level_never_reaches_from_one_record_to_the_next() -> None:
    first = make_record(record(swing(), jumps=())[0], WHEEL, "a")
    shifted, _ = record(swing(), jumps=(), effect=lambda w, level: 0.5 * level * np.sign(w), seed=1)
    problem = make_problem([first, make_record(shifted, WHEEL, "b")], WHEEL)
    found = fit(problem)
    assert found.jumps.size == 0
    assert found.level[-1] == pytest.approx(1.5 * DRY_NM, rel=0.02)


def test_too_few_moving_samples_are_refused() -> None:
    made = make_record(record(swing()[:20], jumps=())[0], WHEEL, "short")
    with pytest.raises(InputError, match="at least 30 are needed: add rows"):
        make_problem([made], WHEEL)
