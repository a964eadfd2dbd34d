"""Measured friction of six joints: honest sets, and nothing explained away. See docs/measured.md."""

import os
from functools import cache
from pathlib import Path

import pytest

from benchmarks.measured import PUBLISHED, basic_law, bias_beside, load
from rwa_monitor.discrepancy.find import find_discrepancy
from rwa_monitor.discrepancy.result import Search
from rwa_monitor.monitor.setup import read_wheel
from rwa_monitor.samples import Samples
from rwa_monitor.telemetry.table import read_table

MEASURED = os.environ.get("RWA_MEASURED_DATA")
pytestmark = pytest.mark.skipif(MEASURED is None, reason="RWA_MEASURED_DATA does not say where the measured tables are")


@cache
def joint(number: int) -> tuple[Search, Samples]:
    folder = Path(MEASURED) / "tx40"
    samples = read_table(folder / f"joint{number}.csv").samples
    return find_discrepancy([(f"joint {number}", samples)], read_wheel(folder / "wheel.toml")), samples


def names(number: int) -> set[str]:
    effects = joint(number)[0].result.effects
    return {name for effect in effects for name in (effect.name, *effect.equivalent)}


@pytest.mark.parametrize("number", [2, 3, 4, 6])
def test_the_basic_law_is_the_published_one(number: int) -> None:
    law = basic_law(joint(number)[0])
    # Published: all parameters of the robot fitted at once; here one joint by itself, rest left out.
    for value, std, known in zip(law.values, law.independent_std, PUBLISHED[number], strict=True):
        assert value == pytest.approx(known, abs=4 * std)


def test_an_offset_within_what_the_noise_remembers_is_not_named() -> None:
    search, _ = joint(4)
    law = basic_law(search)
    # Six errors of independent samples, but no more than three of noise that remembers.
    assert abs(law.values[2]) > 6 * law.independent_std[2]
    assert abs(law.values[2]) < 3 * law.std[2]
    gain, _ = bias_beside(search, search.extended)
    assert gain < 0


def test_over_less_than_a_turn_the_order_of_a_ripple_is_fitted() -> None:
    # The best of whole orders is 31; of any, 30.67, with residuals a sixth smaller.
    (ripple,) = (effect for effect in joint(4)[0].result.effects if effect.name == "torque_ripple")
    order = ripple.parameters["harmonic"]
    assert order.std < 0.05
    assert abs(order.value - 30.67) < 0.1


@pytest.mark.parametrize("number", [2, 3])
def test_drag_that_grows_less_than_with_the_speed_is_named(number: int) -> None:
    search, _ = joint(number)
    assert "sublinear_viscous" in names(number)
    # Near zero the drag is less than the basic law gives: Stribeck friction would be more.
    assert basic_law(search).near_zero_Nm < 0
    assert "stribeck" not in names(number)


def test_noise_of_a_long_memory_does_not_swallow_an_effect() -> None:
    search, _ = joint(3)
    assert search.problem.noise.long_run_variance > 8 * search.problem.noise.std**2
    assert search.result.effects[0].family == "mean"
    gain = search.result.gain
    assert gain.rmse_extended_Nm < 0.9 * gain.rmse_base_Nm


def test_motor_torque_that_is_friction_does_not_explain_friction() -> None:
    search, samples = joint(4)
    figures = load(search, samples)
    assert figures.correlation > 0.95
    assert figures.raw_ratio < 0.9  # the trap: friction explained by itself
    assert figures.clean_ratio > 0.99
    assert "sublinear_viscous" in names(4)


def test_a_joint_whose_cause_is_not_in_its_table_is_not_explained_away() -> None:
    # Its friction depends on the speed of joint 5: what is named leaves nearly all of that, and that it remembers.
    result = joint(6)[0].result
    assert result.verdict == "inadequate"
    assert "coloured_noise" in {effect.name for effect in result.effects}
    assert result.gain.rmse_extended_Nm > 0.9 * result.gain.rmse_base_Nm
