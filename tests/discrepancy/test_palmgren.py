"""Palmgren's rolling drag, whose viscosity follows the recorded temperature, is one effect and not several."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rwa_monitor.discrepancy.extended import extend
from rwa_monitor.discrepancy.find import find_discrepancy
from rwa_monitor.discrepancy.finished_search import Search
from rwa_monitor.wheel.wheel import Wheel
from tests.discrepancy.simple import NOISE_NM, PERIOD_S, WHEEL, Array, record, swing

STRENGTH_NM, EXPONENT = 4e-5, 2.0 / 3.0


def search(seed: int, b_kelvin: float) -> Search:
    """Search a record with rolling drag over an orbit's worth of temperatures."""
    speed = swing(top=200.0, period_s=230.0)
    time = np.arange(speed.size) * PERIOD_S
    temperature = 20.0 + 5.0 * np.sin(2 * np.pi * time / 870.0 + seed)

    def drag(speed: Array, _: Array) -> Array:
        viscosity = np.exp(b_kelvin * (1.0 / (temperature + 273.15) - 1.0 / 293.15))
        return np.asarray(STRENGTH_NM * np.sign(speed) * (viscosity * np.abs(speed)) ** EXPONENT)

    samples, _ = record(speed, effect=drag, seed=seed)
    rng = np.random.default_rng([seed, 1])
    measured = temperature + rng.normal(0.0, 0.02, speed.size)
    return find_discrepancy([("warm", replace(samples, bearing_temperature_degC=measured))], WHEEL)


@pytest.mark.parametrize(("seed", "b_kelvin"), [(50300, 3500.0), (50301, 5500.0)])
def test_rolling_drag_that_follows_speed_and_viscosity_is_one_effect(seed: int, b_kelvin: float) -> None:
    found = search(seed, b_kelvin)
    (effect,) = found.result.effects
    assert effect.name == "sublinear_viscous"
    assert found.result.unexplained is None
    truth = {"strength_Nm": STRENGTH_NM, "exponent": EXPONENT, "activation_temperature_K": b_kelvin}
    assert set(effect.parameters) == set(truth)
    for name, value in effect.parameters.items():
        assert value.std is not None
        assert abs(value.value - truth[name]) < 4.0 * value.std
    extended = Wheel.from_toml(extend(found).to_toml(), "extended")
    assert extended.effect[0].parameters["activation_temperature_K"] > 0.0
    gain = found.result.gain
    assert gain is not None
    assert gain.rmse_extended_Nm < 1.05 * NOISE_NM
    assert gain.simulated is not None
    assert gain.simulated.rmse_extended_Nm < 0.2 * gain.simulated.rmse_base_Nm


def test_rolling_drag_that_does_not_follow_the_temperature_needs_no_viscosity() -> None:
    (effect,) = search(50302, 0.0).result.effects
    assert effect.name == "sublinear_viscous"
    assert set(effect.parameters) == {"strength_Nm", "exponent"}
