"""The noise, estimated from records with jumps and tails in them."""

import numpy as np
import pytest
from scipy import signal

from rwa_monitor.discrepancy.problem import clip_outliers, estimate_noise

N = 20_000


@pytest.mark.parametrize("phi", [0.0, 0.5, 0.9])
def test_noise_has_its_long_run_variance(phi: float) -> None:
    z = signal.lfilter([np.sqrt(1 - phi**2)], [1, -phi], np.random.default_rng(1).normal(size=N))
    # The sum of 96 estimated autocovariances errs by some √(2·2·96/N)·(1+φ)/(1-φ).
    expected = (1 + phi) / (1 - phi)
    assert estimate_noise([z]).long_run_variance == pytest.approx(expected, rel=3 * np.sqrt(4 * 96 / N))


def test_student_noise_has_the_variance_that_means_scatter_by() -> None:
    z = np.random.default_rng(3).standard_t(4, N) / np.sqrt(2)  # variance 1
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
