"""A coefficient over windows: what counts once, what wins, what is forgotten."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import integrate

from rwa_monitor.changepoints.estimation import SlopePrior
from rwa_monitor.diagnosis.classification import Coefficient, coefficient
from rwa_monitor.diagnosis.features import Features, without_prior
from rwa_monitor.diagnosis.model import built_in_model
from rwa_monitor.switching.carried_state import CHANGE_PER_WINDOW, Tracked

VISCOUS = built_in_model().anomaly("viscous")
LEVELS, RATE = VISCOUS.levels[0], VISCOUS.rate


def before(mean: float = 1.0, std: float = 0.004, held: float = 0.98) -> Coefficient:
    return Coefficient(LEVELS, RATE, Tracked(mean=mean, std=std, windows=5, held=held))


def probability(seen: Coefficient, value: float, std: float) -> float:
    rows = seen.log_evidence(np.array([value]), np.array([std]))[:, 0] + np.log([1.0 - seen.prior, seen.prior])
    return float(np.exp(rows[1] - np.logaddexp(*rows)))


def over_windows(values: list[tuple[float, float]]) -> list[float]:
    tracked, found = None, []
    for value, std in values:
        seen = coefficient(VISCOUS, tracked)
        found.append(probability(seen, value, std))
        tracked = seen.after(value, std)
    return found


@pytest.mark.parametrize(("mean", "std", "held"), [(1.0, 0.01, 0.98), (1.15, 0.02, 0.5), (1.05, 0.03, 0.9)])
def test_what_a_window_can_measure_has_total_probability_one(mean: float, std: float, held: float) -> None:
    """Oracle: the density of a measurement, over both classes and all values, integrates to 1, by quadrature."""
    seen = before(mean, std, held)
    grid = np.linspace(-60.0, 60.0, 600_001)
    # Strays reach far beyond any grid; with next to none of them the bands hold everything.
    seen = Coefficient(LEVELS.model_copy(update={"stray": 1e-12}), RATE, seen.before)
    held_part, changed = (np.exp(part).sum(axis=0) for part in seen.log_parts(grid, np.full(grid.size, 0.02)))
    # The tail of anomalies of other sizes (a Lomax law of shape 1) beyond the grid: OTHER_SIZE · reach/60 or so.
    assert integrate.trapezoid(changed, grid) == pytest.approx(1.0 - held, abs=1e-3)
    assert integrate.trapezoid(held_part, grid) == pytest.approx(held, abs=1e-3)


@pytest.mark.parametrize("viscous", [1.0, 1.04, 1.06, 1.08, 1.15])
def test_the_same_value_again_is_no_new_evidence(viscous: float) -> None:
    """A healthy wheel keeps its place in its band: twenty windows must not make certain what is uncertain."""
    found = over_windows([(viscous, 0.003)] * 20)
    assert found[-1] == pytest.approx(found[0], abs=0.1)


@given(st.floats(0.9, 1.4), st.integers(1, 30))
def test_a_window_that_shows_the_value_wins_whatever_went_before(value: float, windows: int) -> None:
    """The verdict of a sharp measurement is that of the window alone, at most the hazard away from it."""
    alone = over_windows([(value, 0.002)])[0]
    after_healthy = over_windows([(1.0, 0.002)] * windows + [(value, 0.002)])[-1]
    if alone > 0.9:
        assert after_healthy > 0.6
    if alone < 0.1:
        assert after_healthy < 0.4


@given(st.integers(1, 60))
def test_windows_that_do_not_show_the_value_leave_it_with_the_hazard(windows: int) -> None:
    vague = 10.0 * LEVELS.reach
    found = over_windows([(1.0, 0.002)] + [(1.0, vague)] * windows)
    hazard = RATE * (1.0 - (1.0 - CHANGE_PER_WINDOW) ** windows)
    assert found[-1] >= 0.8 * hazard
    assert found[-1] <= RATE + 0.02


def test_what_a_window_alone_measures_is_what_the_prior_was_multiplied_by() -> None:
    """Oracle: the product of two Gaussians, of a prior and of a measurement, undone."""
    prior, value, std = SlopePrior(1.04, 0.05), 1.2, 0.08
    weights = np.array([prior.std**-2, std**-2])
    mean, spread = float(weights @ [prior.mean, value] / weights.sum()), float(weights.sum() ** -0.5)
    seen = Features(1.0, 0.01, mean, spread, ())
    alone = without_prior(seen, prior)
    assert alone.viscous == pytest.approx(value)
    assert alone.viscous_std == pytest.approx(std)
    assert without_prior(replace(seen, viscous=1.04, viscous_std=0.05), prior).viscous_std == np.inf
