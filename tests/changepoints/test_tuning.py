"""Closed-form tuning of the wGLR against the paper's figures, simulation and brute force."""

import json
from dataclasses import astuple, replace

import numpy as np
import pytest

from benchmarks.false_alarms import NOISES, WITHIN, run_length
from rwa_monitor.changepoints.evidence import SCALES, threshold_of_run_length
from rwa_monitor.changepoints.tuning import Measured, check, tune
from rwa_monitor.errors import InputError
from rwa_monitor.kernels.wglr import wglr
from tests.program import run


def test_the_paper_s_example_comes_out() -> None:
    # Errata, figures: Δf = 3σ, w = 20, f_v known: λ = 90, threshold 41 σ², run length 6e9 at 0.1 % missed.
    tuning = tune(0.001, 6e9, 3.0)
    assert tuning.half_width == 20
    assert tuning.information == pytest.approx(90.0)
    assert tuning.threshold == pytest.approx(41.0, abs=0.3)


@pytest.mark.parametrize(("missed", "run_length", "jump"), [(0.02, 500.0, 2.0), (1e-6, 1e10, 4.0)])
def test_simulation_agrees_with_the_prediction(missed: float, run_length: float, jump: float) -> None:
    tuning = tune(missed, run_length, jump)
    counted = check(tuning, jump, 0.0, np.random.default_rng(8), trials=5_000)
    agrees(counted.missed, tuning.missed)
    agrees(Measured(*(1.0 / x for x in astuple(counted.run_length))), 1.0 / tuning.run_length)
    assert counted.keeps(missed, run_length)


def agrees(found: Measured, expected: float) -> None:
    """Check that a simulated figure lies within five of its standard errors, and that these show something."""
    error = abs(found.high - found.low) / 2 / 1.96
    assert error < 0.1 * expected
    assert abs(found.value - expected) < 5 * error


def test_plain_counting_agrees_with_the_weighted_one() -> None:
    # A long record of noise, the statistic from the monitor's own kernel: samples and alarms above the threshold.
    tuning = tune(0.02, 200.0, 2.0)
    samples, w = 400_000, tuning.half_width
    noise = np.random.default_rng(9).standard_normal(samples)
    speed = 1e-3 * np.arange(samples)
    statistic, _ = wglr(speed, noise, np.ones(samples, dtype=bool), w, tuning.prior_weight, 0.0)
    above = statistic[w : samples - w] > tuning.threshold
    alarms = np.count_nonzero(np.diff(above.astype(int)) == 1)
    counted = check(tuning, 2.0, 1e-3, np.random.default_rng(10), trials=5_000)
    for found, count in ((counted.run_length, np.count_nonzero(above)), (counted.alarm_run_length, alarms)):
        expected = above.size / found.value
        # Alarms come about as a Poisson process, samples above in runs of the mean length of an alarm.
        error = np.sqrt(expected * max(count / alarms, 1.0)) + expected * (found.high / found.value - 1)
        assert abs(count - expected) < 5 * error


def test_a_tuning_that_breaks_its_promise_is_caught() -> None:
    tuning = tune(0.001, 1e6, 3.0)
    loose, narrow = replace(tuning, threshold=0.8 * tuning.threshold), replace(tuning, half_width=10)
    rng = np.random.default_rng(11)
    assert check(tuning, 3.0, 0.0, rng, trials=5_000).keeps(0.001, 1e6)
    assert not check(loose, 3.0, 0.0, rng, trials=5_000).keeps(0.001, 1e6)
    assert not check(narrow, 3.0, 0.0, rng, trials=5_000).keeps(0.001, 1e6)


@pytest.mark.parametrize(
    ("missed", "run_length", "jump", "reason"),
    [
        (0.0, 1e6, 3.0, "is not between"),
        (0.6, 1e6, 3.0, "is not between"),
        (0.01, 1.0, 3.0, "is not between"),
        (0.001, 1e6, 1e-3, "no window"),
    ],
)
def test_wishes_that_no_window_keeps_are_refused(missed: float, run_length: float, jump: float, reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        tune(missed, run_length, jump)


def test_command_prints_settings_and_their_check() -> None:
    arguments = ["tune", "--missed", "0.001", "--run-length", "1e6", "--jump", "3", "--json"]
    result = run(*arguments)
    answer = json.loads(result.stdout)
    assert answer["half_width"] == 15
    assert answer["check"]["kept"]
    assert answer["check"]["missed"]["low"] <= answer["missed"] <= answer["check"]["missed"]["high"]
    assert answer["check"]["run_length"]["low"] <= 1e6 <= answer["check"]["run_length"]["high"]


# ---- false reports while a window is open come as often as the wheel file asks for, whatever th ----------------------


@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize("asked", [1e4, 1e5])
def test_run_length_is_what_is_asked_for(noise: str, asked: float) -> None:
    measured = run_length(noise, asked, np.random.default_rng(3), events=150).measured
    assert asked / WITHIN <= measured <= asked * WITHIN


def test_threshold_rises_with_the_run_length() -> None:
    thresholds = [threshold_of_run_length(asked, SCALES) for asked in (1e4, 1e6, 1e12)]
    assert np.all(np.diff(thresholds) > 0)
    # As many tests a slot as there are scales, each at every slot, would need at most this.
    assert thresholds[1] < 2.0 * np.log(1e6 * len(SCALES))
