"""The features of the classifiers: coefficients and sojourns."""

from dataclasses import replace

import numpy as np
import pytest

from rwa_monitor.changepoints.estimation import SlopePrior
from rwa_monitor.diagnosis.features import (
    Features,
    SystemFeatures,
    normalised_nominal_viscous,
    without_prior,
)
from rwa_monitor.wheel.wheel import built_in_wheel


def test_highest_configuration_is_averaged() -> None:
    system = SystemFeatures(
        "fss_2", np.array([0, 1, 2, 1, 2]), np.array([0.0, 0.5, 0.9, 0.5, 1.1]), np.full(5, 0.02), rests=True
    )
    q, mean, std = system.highest()
    assert (q, mean) == (2, pytest.approx(1.0))
    assert std == pytest.approx(0.02 / np.sqrt(2))
    assert SystemFeatures("fss_1", np.array([0]), np.zeros(1), np.zeros(1), rests=True).highest() == (0, 0.0, 0.0)


def test_nominal_viscous_of_the_built_in_wheel_is_one() -> None:
    assert normalised_nominal_viscous(built_in_wheel()) == pytest.approx(1.0, abs=1e-3)


def test_what_a_window_alone_measures_is_what_the_prior_was_multiplied_by() -> None:
    """Oracle: the product of two Gaussians, of a prior and of a measurement, undone."""
    prior, value, std = SlopePrior(1.04, 0.05), 1.2, 0.08
    weights = np.array([prior.std**-2, std**-2])
    mean, spread = float(weights @ [prior.mean, value] / weights.sum()), float(weights.sum() ** -0.5)
    seen = Features(1.0, 0.01, mean, spread, ())
    alone = without_prior(seen, prior, 1.0)
    assert alone.viscous == pytest.approx(value)
    assert alone.viscous_std == pytest.approx(std)
    assert without_prior(replace(seen, viscous=1.04, viscous_std=0.05), prior, 1.0).viscous_std == np.inf
