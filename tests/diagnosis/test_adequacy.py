"""The cheap adequacy check: silent on healthy and failing wheels, awake where the model lacks an effect."""

import numpy as np
import pytest

from benchmarks.adequacy.trials import MEAN_EFFECTS, MOTIONS, diagnose_recipe, hide_and_diagnose
from rwa_monitor.diagnosis.model import built_in_model
from rwa_monitor.monitor.core import diagnose_samples
from rwa_monitor.simulation.motion import ProfileKind, SpeedProfile
from rwa_monitor.simulation.record import simulate
from rwa_monitor.simulation.scenario import Anomaly, FrictionNoise, Scenario, Sensors
from rwa_monitor.wheel.wheel import built_in_wheel

# Each effect on one motion that shows it, in turn; benchmarks/adequacy runs all of them on many seeds.
EITHER_WAY = ("crossings", "rich", "orbit")
CASES = [(name, EITHER_WAY[i % len(EITHER_WAY)]) for i, name in enumerate(MEAN_EFFECTS)]
SHOWN_ONE_WAY = ("current_delay", "inertia_error", "stribeck", "torque_ripple")


@pytest.mark.parametrize("recipe", ["paper", "mild", "hard", "derived"])
@pytest.mark.parametrize("nominal", [True, False])
def test_windows_that_lack_nothing_are_adequate(recipe: str, nominal: bool) -> None:
    """In 400 nominal windows of the benchmark at most one is not: 5 in a row of each recipe have that chance, too."""
    diagnoses = [diagnose_recipe(recipe, number, seed=77, nominal=nominal)[0] for number in range(5)]
    assert [diagnosis.explanation for diagnosis in diagnoses if not diagnosis.model_adequate] == []


UNUSUAL = {
    "heavy tails": Scenario(noise=FrictionNoise(law="student_t", degrees_of_freedom=3.0)),
    "long memory": Scenario(noise=FrictionNoise(law="ar1", ar_coefficient=0.9)),
    "coarse speed": Scenario(speed=SpeedProfile(kind="rich"), sensors=Sensors(speed_quantum_rad_s=1.0)),
    "noisy speed": Scenario(speed=SpeedProfile(kind="crossings"), sensors=Sensors(speed_noise_rad_s=0.3)),
    "constant speed": Scenario(speed=SpeedProfile(kind="constant")),
    "from rest, friction derived": Scenario(speed=SpeedProfile(kind="from_rest"), friction_given=False),
}


@pytest.mark.parametrize("case", UNUSUAL)
def test_unusual_noise_and_motion_are_no_missing_effect(case: str) -> None:
    wheel = built_in_wheel()
    for seed in (1, 2):
        samples = simulate(UNUSUAL[case], wheel, np.random.default_rng(seed)).samples
        (closed,) = diagnose_samples(samples, wheel, built_in_model())
        assert closed.diagnosis.model_adequate, closed.diagnosis.explanation


@pytest.mark.parametrize(("name", "motion"), [*CASES, *((name, "one_direction") for name in SHOWN_ONE_WAY)])
def test_a_missing_effect_of_half_a_sigma_is_seen_in_the_first_window(name: str, motion: str) -> None:
    (kind,) = (kind for kind in MOTIONS if kind == motion)
    trial = hide_and_diagnose(name, kind, seed=55, windows=1)
    assert trial.windows, "the motion must be able to show the effect"
    assert trial.seen_within(1)
    (diagnosis,) = trial.windows
    assert "The friction model lacks something" in diagnosis.explanation
    assert "rwa-monitor discrepancy" in diagnosis.explanation


@pytest.mark.parametrize("name", ["speed_dead_zone", "presliding", "torque_ripple", "torque_bias"])
def test_what_only_one_effect_does_is_called_by_its_name(name: str) -> None:
    (diagnosis,) = hide_and_diagnose(name, "rich", seed=56, windows=1).windows
    assert diagnosis.suspected_effect == name


# ---- where the model lacks an effect, a healthy wheel is not called failing, and a failing one  ----------------------


@pytest.mark.parametrize(
    ("name", "motion", "taken_for"),
    [("quadratic_drag", "rich", "viscous"), ("quadratic_drag", "orbit", "viscous"), ("lubricant_lag", "orbit", "")],
)
def test_what_the_effect_moved_is_not_near_certain(name: str, motion: ProfileKind, taken_for: str) -> None:
    (diagnosis,) = hide_and_diagnose(name, motion, 500, windows=1).windows
    assert not diagnosis.model_adequate
    assert max(anomaly.probability for anomaly in diagnosis.anomalies.values()) < 0.9
    if taken_for:
        assert diagnosis.verdict == "inconclusive"
        assert "while the friction model lacks something" in diagnosis.reason
        moved = getattr(diagnosis.friction, taken_for)
        assert moved.std > 0.02 * moved.value  # else far below 1 %


def test_model_error_uncertainty_does_not_add_up_to_certainty() -> None:
    trial = hide_and_diagnose("quadratic_drag", "orbit", 500, windows=3)
    assert [window.anomalies["viscous"].probability < 0.9 for window in trial.windows] == [True] * 3


@pytest.mark.parametrize(("anomaly", "factor"), [("viscous", 1.15), ("fss_1", 1.6)])
def test_a_failing_wheel_is_found_where_the_missing_effect_does_not_touch_it(anomaly: str, factor: float) -> None:
    trial = hide_and_diagnose("torque_bias", "crossings", 600, windows=1, anomalies={anomaly: Anomaly(factor=factor)})
    (diagnosis,) = trial.windows
    assert not diagnosis.model_adequate
    assert diagnosis.verdict == "anomalous"
    assert [name for name, found in diagnosis.anomalies.items() if found.active] == [anomaly]
    assert "extend the wheel file" in diagnosis.explanation


@pytest.mark.parametrize(("seed", "motion"), [(50_000, "crossings"), (50_000, "orbit"), (50_002, "rich")])
def test_a_drag_that_hardly_bends_may_be_most_of_the_viscous_slope(seed: int, motion: ProfileKind) -> None:
    # Two to four times the nominal slope, all of it a drag of a power below one that the model lacks.
    (diagnosis,) = hide_and_diagnose("sublinear_viscous", motion, seed, windows=1).windows
    viscous = diagnosis.anomalies["viscous"]
    assert not diagnosis.model_adequate
    assert viscous.estimate > 2.0 * viscous.nominal_high
    assert viscous.probability < 0.9
    assert diagnosis.verdict == "inconclusive"
