"""Coloured noise does not swallow an effect that changes faster than the noise forgets, nor does it become one."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from rwa_monitor.discrepancy.base_fit import fit, make_problem
from rwa_monitor.discrepancy.coloured import ORDER, coloured_gain, is_coloured
from rwa_monitor.discrepancy.find import find_discrepancy
from rwa_monitor.discrepancy.models import Model
from rwa_monitor.discrepancy.noise_effects import squares_told_twice
from rwa_monitor.discrepancy.record import make_record
from rwa_monitor.discrepancy.search import ACCEPT_GAIN, refit
from rwa_monitor.discrepancy.terms import make_term
from rwa_monitor.physics.effects.catalogue import MEAN_EFFECTS
from tests.discrepancy.simple import DRY_NM, NOISE_NM, WHEEL, record, swing

COUNT = 3000
AUTOCORRELATION = 0.9  # long-run variance 19 times that of a sample


def coloured(seed: int) -> np.ndarray:
    white = np.sqrt(1 - AUTOCORRELATION**2) * np.random.default_rng(seed).normal(size=COUNT)
    noise: np.ndarray = 4 * NOISE_NM * signal.lfilter([1.0], [1.0, -AUTOCORRELATION], white)
    return noise


def quick_swing() -> np.ndarray:
    return swing(COUNT, top=200.0, period_s=20.0)  # 160 samples: zero every 80, where the noise forgets in ten


def concave(speed: np.ndarray, level: np.ndarray) -> np.ndarray:
    return 0.35 * DRY_NM * np.abs(speed / 200.0) ** 0.3 * np.sign(speed)


def test_an_effect_in_coloured_noise_is_named() -> None:
    samples, _ = record(quick_swing(), jumps=(), effect=concave, noise=coloured(0))
    found = find_discrepancy([("coloured", samples)], WHEEL)
    problem = make_problem([make_record(samples, WHEEL, "coloured")], WHEEL)
    assert is_coloured(problem)
    assert found.result.effects[0].name == "sublinear_viscous"
    assert {effect.name for effect in found.result.effects} == {"sublinear_viscous", "coloured_noise"}
    # By the criterion of the search with jumps, which takes the largest variance for all, nothing is there.
    none = np.zeros(0, dtype=np.int64)
    base = fit(problem, np.zeros((problem.size, 0)), start=[none])
    extended = refit(problem, found.extended.terms, [none]).fit
    assert base.criterion - extended.criterion < ACCEPT_GAIN < found.mean.found[0].gain


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_coloured_noise_alone_is_named_as_noise_alone(seed: int) -> None:
    samples, _ = record(quick_swing(), jumps=(), noise=coloured(seed))
    result = find_discrepancy([("coloured", samples)], WHEEL).result
    assert [effect.name for effect in result.effects] == ["coloured_noise"]
    assert result.unexplained is None


def test_the_gain_in_coloured_noise_is_that_of_generalised_least_squares() -> None:
    """An oracle: with noise that is known, the deviance is the squared estimate over its variance."""
    samples, _ = record(quick_swing(), jumps=(), effect=concave, noise=coloured(4))
    problem = make_problem([make_record(samples, WHEEL, "oracle")], WHEEL)
    none = np.zeros(0, dtype=np.int64)
    term = make_term(
        problem, MEAN_EFFECTS["sublinear_viscous"], {"exponent": 0.3, "activation_temperature_K": 0.0}, None
    )
    simpler, richer = Model((), fit(problem, np.zeros((problem.size, 0)), start=[none])), refit(problem, [term], [none])
    assert simpler.fit.jumps.size == richer.fit.jumps.size == 0
    gain = coloured_gain(problem, simpler, richer) + term.parameters * problem.log_size

    crossing = np.flatnonzero(np.diff(problem.sign) != 0) + 1
    near = (np.arange(1, problem.size)[:, None] - crossing[None, :]).clip(-1)  # slots since each change of direction
    whole = ~((near >= 0) & (near < ORDER)).any(axis=1)

    def innovations(values: np.ndarray) -> np.ndarray:
        return (values[1:] - AUTOCORRELATION * values[:-1])[whole]

    column = richer.terms[0].columns[:, 0]
    others = np.column_stack([innovations(values) for values in (np.ones(problem.size), problem.speed)])
    clean = innovations(column) - others @ np.linalg.lstsq(others, innovations(column), rcond=None)[0]
    std = 4 * NOISE_NM * np.sqrt(1 - AUTOCORRELATION**2)
    oracle = float(clean @ innovations(problem.z)) ** 2 / float(clean @ clean) / std**2
    # The logarithm bends it: N·log(1 + g/N). Samples after a change of direction are left out in both.
    assert gain == pytest.approx(problem.size * np.log1p(oracle / problem.size), rel=0.2)


def test_squares_of_filtered_noise_tell_less_of_its_variance() -> None:
    """As many times less as the variance of the mean square is larger: for noise through a filter of 17 slots, 5.9."""
    taps = np.arange(-8.0, 9.0)
    whole = [np.convolve(np.random.default_rng(seed).normal(size=2_016), taps, "valid") for seed in range(400)]
    expected = float(np.sum((np.correlate(taps, taps, "full") / float(taps @ taps)) ** 2))
    squares = np.array([np.mean(values**2) for values in whole]) / float(taps @ taps)
    # The variance of 400 mean squares is itself known to a factor 1 ± sqrt(2 / 400).
    assert np.var(squares) * 2_000 / 2.0 == pytest.approx(expected, rel=4.0 * np.sqrt(2.0 / 400))
    found = [squares_told_twice(values, np.ones(values.size, dtype=bool), 16) for values in whole]
    assert np.mean(found) == pytest.approx(expected, rel=0.05)
    assert squares_told_twice(whole[0], np.ones(whole[0].size, dtype=bool), 0) == 1.0
