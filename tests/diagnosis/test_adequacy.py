"""The cheap adequacy check: silent on healthy and failing wheels, awake where the model lacks an effect."""

from __future__ import annotations

import numpy as np
import pytest

from rwa_monitor.diagnosis.adequacy import expected_jumps
from rwa_monitor.diagnosis.model import built_in_model
from rwa_monitor.live.core import diagnose_samples
from rwa_monitor.physics.datasets import generate
from rwa_monitor.physics.scenario import Scenario
from rwa_monitor.physics.speed import SpeedProfile
from rwa_monitor.physics.telemetry import simulate
from rwa_monitor.physics.wheel import EffectBlock, Wheel, built_in_wheel
from rwa_monitor.samples import Samples

# Each has an RMS of about half a standard deviation of the noise in what levels and slope leave of it.
EFFECTS = {
    "stribeck": {"strength_Nm": 2.4e-4, "stribeck_speed_rad_s": 8.0, "exponent": 2.0},
    "quadratic_drag": {"strength_Nm_s2_rad2": 1.0e-8},
    "inertia_error": {"strength_kg_m2": 1.5e-4},
    "torque_bias": {"strength_Nm": 4.0e-5},
}


def adequate(samples: Samples, wheel: Wheel) -> bool:
    """Diagnose one window and return what the check says."""
    (closed,) = diagnose_samples(samples, wheel, built_in_model())
    return closed.diagnosis.model_adequate


@pytest.mark.parametrize("recipe", ["paper", "derived"])
def test_windows_that_lack_nothing_are_adequate(recipe: str) -> None:
    windows = list(generate(recipe, 10, seed=77))
    assert all(adequate(window.telemetry.samples, window.wheel) for window in windows)


@pytest.mark.parametrize("name", EFFECTS)
def test_a_missing_effect_is_noticed_within_three_windows(name: str) -> None:
    effect = EffectBlock(name=name, parameters=EFFECTS[name])
    scenario = Scenario(speed=SpeedProfile(kind="rich"), effect=(effect,))
    wheel = built_in_wheel()
    windows = [simulate(scenario, wheel, np.random.default_rng(seed)).samples for seed in (1, 2, 3)]
    assert not all(adequate(samples, wheel) for samples in windows)


def test_expected_jumps_are_those_of_the_law() -> None:
    # Per cycle of Example 1: two jumps in 15,000 + 100.5 slots. Example 2: one jump each 20,000 slots.
    expected = 2 * 80_000 / (15_000 + 100.5) + 80_000 / 20_000
    assert expected_jumps(built_in_wheel().fss, 80_000) == pytest.approx(expected, rel=1e-3)
    assert expected_jumps((), 80_000) == 0.0
