"""The features of the classifiers: the paper's histogram with errata 13, and sojourns."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from rwa_monitor.changepoints.estimation import SlopePrior
from rwa_monitor.diagnosis.features import (
    Features,
    SystemFeatures,
    histogram,
    normalised_nominal_viscous,
    without_prior,
)
from rwa_monitor.wheel.wheel import built_in_wheel


def test_bins_are_half_open_and_cover_the_range() -> None:
    edges = np.array([0.0, 0.25, 0.5, 0.75, 1.0])
    assert histogram(edges, 0.0, 1.0, 4).tolist() == [0.2, 0.2, 0.2, 0.4]  # the end belongs to the last bin


def test_values_outside_count_in_the_end_bins() -> None:
    assert histogram(np.array([-5.0, 5.0, 7.0]), 0.0, 1.0, 4).tolist() == pytest.approx([1 / 3, 0, 0, 2 / 3])


@given(hnp.arrays(np.float64, st.integers(1, 50), elements=st.floats(-3, 3)), st.integers(1, 60))
def test_histogram_is_normalised_and_ignores_order(values: np.ndarray, bins: int) -> None:
    counts = histogram(values, -1.0, 2.0, bins)
    assert counts.sum() == pytest.approx(1.0)
    assert np.allclose(counts, histogram(values[::-1], -1.0, 2.0, bins))


@given(hnp.arrays(np.float64, 20, elements=st.floats(0.01, 0.99)), st.integers(1, 40))
def test_histogram_agrees_with_numpy_inside_the_range(values: np.ndarray, bins: int) -> None:
    expected, edges = np.histogram(values, bins=bins, range=(0.0, 1.0))
    if np.abs(values[:, None] - edges).min() > 1e-9:  # on an edge rounding decides
        assert np.allclose(histogram(values, 0.0, 1.0, bins), expected / 20)


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
