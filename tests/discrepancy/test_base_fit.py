"""The base fit: slope, levels and jumps together, bounds, robust start; the noise beside jumps and tails."""

import numpy as np
import pytest
from scipy import signal

from rwa_monitor.discrepancy.base_fit import fit, make_problem
from rwa_monitor.discrepancy.problem import clip_outliers, estimate_noise
from rwa_monitor.discrepancy.record import make_record
from rwa_monitor.errors import InputError
from tests.discrepancy.simple import DRY_NM, NOISE_NM, VISCOUS, WHEEL, record, swing


@pytest.mark.parametrize("seed", range(3))
def test_slope_levels_and_jumps_are_found(seed: int) -> None:
    problem = make_problem([make_record(record(swing(), seed=seed)[0], WHEEL, "simple")], WHEEL)
    found = fit(problem)
    assert problem.slot[found.jumps].tolist() == pytest.approx([1500, 4000, 6200], abs=1)
    # The slope's error: σ over √n times the spread of |ω|, about 75 rad/s; the measured sign errs at few crossings.
    std = NOISE_NM / (np.sqrt(problem.size) * np.std(problem.speed))
    assert found.coefficients[0] == pytest.approx(VISCOUS, abs=5 * std)
    assert found.level[100] == pytest.approx(DRY_NM, abs=5 * NOISE_NM / np.sqrt(1500) + 5 * std * 150)
    assert problem.noise.std == pytest.approx(NOISE_NM, rel=0.05)


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


# ---- the noise -------------------------------------------------------------------------------------------------------

COUNT = 20_000


@pytest.mark.parametrize("phi", [0.0, 0.5, 0.9])
def test_noise_has_its_long_run_variance(phi: float) -> None:
    z = signal.lfilter([np.sqrt(1 - phi**2)], [1, -phi], np.random.default_rng(1).normal(size=COUNT))
    # The sum of 96 estimated autocovariances errs by some √(2·2·96/n)·(1+φ)/(1-φ).
    expected = (1 + phi) / (1 - phi)
    assert estimate_noise([z]).long_run_variance == pytest.approx(expected, rel=3 * np.sqrt(4 * 96 / COUNT))


def test_student_noise_has_the_variance_that_means_scatter_by() -> None:
    z = np.random.default_rng(3).standard_t(4, COUNT) / np.sqrt(2)  # variance 1
    # Winsorised at four of the median's standard deviations, t(4) keeps 87–100 % of its variance.
    assert 0.8 < estimate_noise([z]).std ** 2 < 1.1


def test_outliers_are_pulled_in_and_levels_are_not() -> None:
    z = np.random.default_rng(4).normal(size=1000)
    z[300] += 40.0
    z[500:520] += 40.0
    clipped, outliers = clip_outliers(z, 1.0)
    assert outliers[300]
    assert abs(clipped[300]) < 8
    assert clipped[505:515].mean() > 30
