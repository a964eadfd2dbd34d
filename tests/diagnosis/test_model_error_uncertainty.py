"""Where the model lacks an effect, a healthy wheel is not called failing, and a failing one is still found."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.adequacy.trials import hide_and_diagnose
from rwa_monitor.diagnosis.adequacy import ModelErrorUncertainty
from rwa_monitor.diagnosis.features import Features, SystemFeatures
from rwa_monitor.simulation.motion import ProfileKind
from rwa_monitor.simulation.scenario import Anomaly
from tests.diagnosis.test_window import named

UNCERTAINTIES = st.floats(0.0, 10.0)


@pytest.mark.parametrize(
    ("name", "motion", "taken_for"),
    [("quadratic_drag", "rich", "viscous"), ("quadratic_drag", "orbit", "viscous"), ("lubricant_lag", "orbit", "")],
)
def test_what_the_effect_moved_is_not_near_certain(name: str, motion: ProfileKind, taken_for: str) -> None:
    (diagnosis,) = hide_and_diagnose(name, motion, 500, windows=1).windows
    assert not diagnosis.model_adequate
    assert max(anomaly.probability for anomaly in diagnosis.anomalies) < 0.9
    if taken_for:
        assert diagnosis.verdict == "inconclusive"
        assert "while the friction model lacks something" in diagnosis.reason
        assert getattr(diagnosis, taken_for).std > 0.02 * getattr(diagnosis, taken_for).value  # else far below 1 %


def test_model_error_uncertainty_does_not_add_up_to_certainty() -> None:
    trial = hide_and_diagnose("quadratic_drag", "orbit", 500, windows=3)
    assert [named(window)["viscous"].probability < 0.9 for window in trial.windows] == [True] * 3


@pytest.mark.parametrize(("anomaly", "factor"), [("viscous", 1.15), ("fss_1", 1.6)])
def test_a_failing_wheel_is_found_where_the_missing_effect_does_not_touch_it(anomaly: str, factor: float) -> None:
    trial = hide_and_diagnose("torque_bias", "crossings", 600, windows=1, anomalies={anomaly: Anomaly(factor=factor)})
    (diagnosis,) = trial.windows
    assert not diagnosis.model_adequate
    assert diagnosis.verdict == "anomalous"
    assert [found.name for found in diagnosis.anomalies if found.active] == [anomaly]
    assert "extend the wheel file" in diagnosis.explanation


@given(base=UNCERTAINTIES, viscous=UNCERTAINTIES, systems=UNCERTAINTIES)
def test_model_error_uncertainty_only_adds(base: float, viscous: float, systems: float) -> None:
    stds = np.array([0.0, 0.02])
    system = SystemFeatures("fss_1", np.array([0, 1]), np.array([0.0, 0.5]), stds, rests=True)
    features = Features(1.0, 0.01, 1.0, 0.02, (system,))
    wide = ModelErrorUncertainty(base, viscous, systems).widen(features)
    assert (wide.base_dry, wide.viscous) == (1.0, 1.0)
    assert wide.base_dry_std >= max(0.01, base)
    assert wide.viscous_std >= max(0.02, viscous)
    assert wide.systems[0].friction_std[0] == 0.0  # at rest a system has no friction, whatever is missing
    assert wide.systems[0].friction_std[1] >= max(0.02, systems)


@pytest.mark.parametrize(("seed", "motion"), [(50_000, "crossings"), (50_000, "orbit"), (50_002, "rich")])
def test_a_drag_that_hardly_bends_may_be_most_of_the_viscous_slope(seed: int, motion: ProfileKind) -> None:
    # Two to four times the nominal slope, all of it a drag of a power below one that the model lacks.
    (diagnosis,) = hide_and_diagnose("sublinear_viscous", motion, seed, windows=1).windows
    viscous = named(diagnosis)["viscous"]
    assert not diagnosis.model_adequate
    assert viscous.estimate > 2.0 * viscous.nominal_high
    assert viscous.probability < 0.9
    assert diagnosis.verdict == "inconclusive"
