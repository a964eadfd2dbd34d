"""Closed-form tuning of the wGLR against the paper's figures, simulation and brute force."""

from __future__ import annotations

import json

import numpy as np
import pytest
from click.testing import CliRunner
from scipy import stats

from rwa_monitor.cli.main import main
from rwa_monitor.diagnosis.tuning import check, information, tune
from rwa_monitor.errors import InputError


def test_the_paper_s_example_comes_out() -> None:
    # Errata, figures: Δf = 3σ, w = 20, f_v known: λ = 90, threshold 41 σ², run length 6e9 at 0.1 % missed.
    tuning = tune(0.001, 6e9, 3.0)
    assert tuning.half_width == 20
    assert tuning.information == pytest.approx(90.0)
    assert tuning.threshold == pytest.approx(41.0, abs=0.3)


@pytest.mark.parametrize("acceleration", [0.0, 1e-3, 0.1])
def test_information_is_that_of_the_two_hypotheses_solved_in_full(acceleration: float) -> None:
    w, prior, jump = 12, 0.01, 3.0
    x = acceleration * (np.arange(2 * w) - w + 0.5)
    y = jump * (np.arange(2 * w) >= w)

    def squares(levels: np.ndarray) -> float:
        design = np.vstack([np.column_stack([levels, x]), np.append(np.zeros(levels.shape[1]), np.sqrt(prior))])
        target = np.append(y, 0.0)
        return float(np.sum((target - design @ np.linalg.lstsq(design, target, rcond=None)[0]) ** 2))

    one = np.ones((2 * w, 1))
    two = np.column_stack([np.arange(2 * w) < w, np.arange(2 * w) >= w]).astype(float)
    assert information(jump, w, acceleration, prior) == pytest.approx(squares(one) - squares(two), rel=1e-9)


@pytest.mark.parametrize("acceleration", [0.0, 1e-3])
def test_simulation_agrees_with_the_prediction(acceleration: float) -> None:
    tuning = tune(0.02, 500.0, 2.0, acceleration=acceleration)
    counted = check(tuning, 2.0, acceleration, np.random.default_rng(8), trials=20_000)
    # Five standard errors of a binomial count.
    assert abs(counted.missed - tuning.missed) < 5 * np.sqrt(tuning.missed / counted.trials)
    expected = counted.samples / tuning.run_length
    assert abs(counted.false_alarms - expected) < 5 * np.sqrt(expected)


def test_a_smaller_window_would_miss_more() -> None:
    tuning = tune(0.001, 1e6, 3.0)
    smaller = information(3.0, tuning.half_width - 1, 0.0, tuning.prior_weight)
    assert tuning.missed <= 0.001 < stats.ncx2.cdf(tuning.threshold, 1, smaller)


@pytest.mark.parametrize(("missed", "run_length", "jump"), [(0.0, 1e6, 3.0), (0.6, 1e6, 3.0), (0.01, 1.0, 3.0)])
def test_wishes_out_of_range_are_refused(missed: float, run_length: float, jump: float) -> None:
    with pytest.raises(InputError, match="is not between"):
        tune(missed, run_length, jump)


def test_a_jump_too_small_for_any_window_is_refused() -> None:
    with pytest.raises(InputError, match="no window"):
        tune(0.001, 1e6, 1e-3)


def test_command_prints_settings_and_their_check() -> None:
    arguments = ["tune", "--missed", "0.001", "--run-length", "1e6", "--jump", "3", "--json"]
    result = CliRunner().invoke(main, arguments, catch_exceptions=False)
    answer = json.loads(result.stdout)
    assert answer["half_width"] == 15
    assert answer["check"]["missed"] < 0.002
