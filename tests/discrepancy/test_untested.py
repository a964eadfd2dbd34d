"""What a record could not test is said, and the strength that it would have shown is the one that it shows."""

from __future__ import annotations

import numpy as np
import pytest

from rwa_monitor.discrepancy.find import CANDIDATES, Search, find_discrepancy
from rwa_monitor.discrepancy.untested import detectable_strengths
from tests.discrepancy.simple import PERIOD_S, WHEEL, record, swing

COUNT = 3000


def search(speed: np.ndarray, bias_Nm: float = 0.0) -> Search:
    samples, _ = record(speed, jumps=(1500,), effect=lambda speed, level: np.full(speed.size, bias_Nm))
    return find_discrepancy([("record", samples)], WHEEL)


@pytest.mark.parametrize(("times", "shows"), [(0.5, False), (3.0, True)])  # between them it depends on the noise
def test_the_strength_that_would_show_is_the_one_that_shows(times: float, shows: bool) -> None:
    plain = search(swing(COUNT, period_s=60.0))
    (bias,) = [e for e in detectable_strengths(plain.problem, plain.extended, CANDIDATES) if e.name == "torque_bias"]
    assert not bias.too_weak
    names = {
        name
        for effect in search(swing(COUNT, period_s=60.0), times * bias.strength).result.effects
        for name in (effect.name, *effect.equivalent)
    }
    assert ("torque_bias" in names) is shows


def test_an_effect_too_weak_to_show_is_listed_with_the_strength_that_would() -> None:
    # A speed that hardly changes: a bent law of speed is as good as a straight one.
    time = np.arange(COUNT) * PERIOD_S
    untested = dict(search(200.0 + 20.0 * np.sin(2 * np.pi * time / 90.0)).result.untested)
    assert "would show only from strength_Nm" in untested["sublinear_viscous"]
    assert "% of all friction" in untested["sublinear_viscous"]


def test_missing_channels_and_missing_jumps_are_listed() -> None:
    untested = dict(search(swing(COUNT)).result.untested)
    assert untested["viscosity_temperature"] == "bearing_temperature_degC"
    assert untested["load_dependence"] == "motor_torque_Nm"
    assert "1 jumps" in untested["wrong_duration_law"]
    assert "motor_current_A" in untested["tachometer_quantisation"]
