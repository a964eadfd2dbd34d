"""How viscous friction follows the temperature, learned by `identify` alone, and what is judged by it."""

from functools import cache

import numpy as np
import pytest

from rwa_monitor.diagnosis.model import built_in_model
from rwa_monitor.identification.identify import identify
from rwa_monitor.monitor.core import diagnose_samples
from rwa_monitor.samples import Samples
from rwa_monitor.simulation.record import simulate
from rwa_monitor.simulation.scenario import Anomaly, Scenario, Temperature
from rwa_monitor.wheel.wheel import EffectBlock, Wheel, built_in_wheel

ACTIVATION_K = 4300.0  # K, −5 % a kelvin at 20 °C


def true_wheel() -> Wheel:
    """The built-in wheel without switching systems, its viscosity falling by 5 % a kelvin."""
    parameters = {"strength_Nm_s_rad": 5.333e-6, "activation_temperature_K": ACTIVATION_K, "sensor_lag_s": 600.0}
    effect = (EffectBlock(name="viscosity_temperature", parameters=parameters),)
    return built_in_wheel().model_copy(update={"effect": effect, "fss": ()})


def record(at_degC: float, seed: int, viscous: float = 1.0, temperature: bool = True) -> Samples:
    anomalies = {"viscous": Anomaly(factor=viscous)} if viscous != 1.0 else {}
    channels = None if temperature else ("friction_torque_Nm", "motor_current_A")
    scenario = Scenario(temperature=Temperature(mean_degC=at_degC, swing_K=3.0), anomalies=anomalies, channels=channels)
    return simulate(scenario, true_wheel(), np.random.default_rng([9, seed])).samples


@cache
def learned(temperature: bool = True) -> Wheel:
    bare = Wheel(name="bare", sample_period_s=0.125)
    named = [(f"{at:g} °C", record(at, seed, temperature=temperature)) for seed, at in enumerate((8.0, 20.0, 32.0))]
    return identify(named, bare, systems=False).wheel


def test_the_law_comes_back_with_the_range_it_holds_over() -> None:
    wheel = learned()
    (law,) = wheel.effect
    assert law.name == "viscosity_temperature"
    assert law.parameters["activation_temperature_K"] == pytest.approx(ACTIVATION_K, rel=0.03)
    assert law.parameters["sensor_lag_s"] == pytest.approx(600.0, rel=0.1)
    assert wheel.nominal is not None
    assert wheel.nominal.viscous_Nm_s_rad == pytest.approx(5.333e-6, rel=0.01)
    assert wheel.temperature is not None
    assert 2.0 < wheel.temperature.low_degC < 8.0
    assert 32.0 < wheel.temperature.high_degC < 40.0


@pytest.mark.parametrize("at_degC", [8.0, 15.0, 26.0, 32.0])
@pytest.mark.parametrize(("viscous", "verdict"), [(1.0, "nominal"), (1.3, "anomalous")])
def test_healthy_and_failing_are_judged_right_at_any_temperature_within(
    at_degC: float, viscous: float, verdict: str
) -> None:
    (closed,) = diagnose_samples(record(at_degC, 50 + int(at_degC), viscous), learned(), built_in_model())
    active = [name for name, one in closed.diagnosis.anomalies.items() if one.active]
    assert (closed.diagnosis.verdict, active) == (verdict, ["viscous"] if viscous > 1.0 else [])


def test_without_the_channel_the_swing_is_learned_as_spread() -> None:
    wheel = learned(temperature=False)
    assert wheel.effect == ()
    assert wheel.nominal is not None
    assert wheel.nominal.viscous_spread is not None
    assert wheel.nominal.viscous_spread > 0.3  # ±12 K at 5 % a kelvin is a standard deviation of half
