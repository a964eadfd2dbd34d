"""How viscous friction follows the temperature, learned by `identify` alone."""

import numpy as np
import pytest

from rwa_monitor.identification.identify import identify
from rwa_monitor.samples import Samples
from rwa_monitor.simulation.record import simulate
from rwa_monitor.simulation.scenario import Scenario, Temperature
from rwa_monitor.wheel.wheel import EffectBlock, Wheel, built_in_wheel

ACTIVATION_K = 4300.0  # K, −5 % a kelvin at 20 °C


def true_wheel() -> Wheel:
    """The built-in wheel without switching systems, its viscosity falling by 5 % a kelvin."""
    parameters = {"strength_Nm_s_rad": 5.333e-6, "activation_temperature_K": ACTIVATION_K, "sensor_lag_s": 600.0}
    effect = (EffectBlock(name="viscosity_temperature", parameters=parameters),)
    return built_in_wheel().model_copy(update={"effect": effect, "fss": ()})


def record(at_degC: float, seed: int, temperature: bool) -> Samples:
    channels = None if temperature else ("friction_torque_Nm", "motor_current_A")
    scenario = Scenario(temperature=Temperature(mean_degC=at_degC, swing_K=3.0), channels=channels)
    return simulate(scenario, true_wheel(), np.random.default_rng([9, seed])).samples


def learned(temperature: bool = True) -> Wheel:
    bare = Wheel(name="bare", sample_period_s=0.125)
    named = [(f"{at:g} °C", record(at, seed, temperature)) for seed, at in enumerate((8.0, 20.0, 32.0))]
    return identify(named, bare, systems=False).wheel


def test_the_law_comes_back_with_the_range_it_holds_over() -> None:
    wheel = learned()
    (law,) = wheel.effect
    assert law.name == "viscosity_temperature"
    assert law.parameters["activation_temperature_K"] == pytest.approx(ACTIVATION_K, rel=0.03)
    assert law.parameters["sensor_lag_s"] == pytest.approx(600.0, rel=0.1)
    assert wheel.nominal.viscous_Nm_s_rad == pytest.approx(5.333e-6, rel=0.01)
    assert 2.0 < wheel.temperature.low_degC < 8.0
    assert 32.0 < wheel.temperature.high_degC < 40.0


def test_without_the_channel_the_swing_is_learned_as_spread() -> None:
    wheel = learned(temperature=False)
    assert wheel.effect == ()
    assert wheel.nominal.viscous_spread > 0.3  # ±12 K at 5 % a kelvin is a standard deviation of half
