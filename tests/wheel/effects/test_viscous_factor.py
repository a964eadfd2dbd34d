"""Effects that scale with viscous friction multiply it: a fault of the viscous friction scales the whole."""

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings

from rwa_monitor.diagnosis.model import built_in_model
from rwa_monitor.monitor.core import diagnose_samples
from rwa_monitor.samples import FloatArray
from rwa_monitor.simulation.motion import SpeedProfile
from rwa_monitor.simulation.record import simulate
from rwa_monitor.simulation.scenario import Anomaly, FrictionNoise, Scenario
from rwa_monitor.wheel.effects.base import Channels
from rwa_monitor.wheel.effects.catalogue import effect_torque, mean_effects, viscous_effects, viscous_per_K
from rwa_monitor.wheel.wheel import EffectBlock, Wheel, built_in_wheel
from tests.wheel.effects.records import DRY_NM, VISCOUS_NM_S_RAD, channels_of, rich_motion

LAWS = ("viscosity_temperature", "viscous_asymmetry")


def warm_wheel(activation_K: float, lag_s: float, asymmetry: float) -> Wheel:
    """Return the built-in wheel, of which viscous friction follows the temperature and differs between directions."""
    wheel = built_in_wheel()
    nominal = wheel.nominal.viscous_Nm_s_rad
    parameters = (
        {"strength_Nm_s_rad": nominal, "activation_temperature_K": activation_K, "sensor_lag_s": lag_s},
        {"strength_Nm_s_rad": asymmetry * nominal},
    )
    blocks = tuple(EffectBlock(name=name, parameters=of_one) for name, of_one in zip(LAWS, parameters, strict=True))
    return wheel.model_copy(update={"fss": (), "effect": blocks})


def viscous_speed(wheel: Wheel, channels: Channels) -> FloatArray:
    """Return what viscous friction is in proportion to."""
    effects = mean_effects(wheel)
    friction = np.zeros(len(channels))
    torque, speed, _ = effect_torque(effects, channels, friction, wheel.nominal.viscous_Nm_s_rad, [None] * len(effects))
    assert not torque.any()  # nothing is left that adds
    return speed


@settings(max_examples=25, deadline=None)
@given(
    factor=st.floats(0.3, 5.0),
    activation_K=st.floats(1500.0, 8000.0),
    lag_s=st.sampled_from([0.0, 400.0]),
    asymmetry=st.floats(-0.5, 0.5),
)
def test_scaling_the_fault_scales_the_whole(factor: float, activation_K: float, lag_s: float, asymmetry: float) -> None:
    """Simulated friction is dry friction plus f_v times what the diagnosis takes it to be in proportion to."""
    wheel = warm_wheel(activation_K, lag_s, asymmetry)
    scenario = Scenario(
        duration_s=500.0, noise=FrictionNoise(std_Nm=0.0), anomalies={"viscous": Anomaly(factor=factor)}
    )
    record = simulate(scenario, wheel, np.random.default_rng(1))
    truth = record.truth
    channels = channels_of(truth.speed_rad_s, bearing_temperature_degC=truth.bearing_temperature_degC)
    speed = viscous_speed(wheel, channels)
    viscous = factor * wheel.nominal.viscous_Nm_s_rad
    dry = np.sign(truth.speed_rad_s) * wheel.nominal.dry_torque_Nm
    np.testing.assert_allclose(truth.friction_torque_Nm, dry + viscous * speed, rtol=1e-12, atol=1e-18)
    assert (np.sign(speed) == np.sign(truth.speed_rad_s)).all()


def test_the_level_of_a_coulomb_asymmetry_is_free_of_the_warm_viscous_friction() -> None:
    """It scales with the dry friction by itself; what it takes for that must not hold the heat."""
    channels = rich_motion(4000)
    wheel = warm_wheel(5000.0, 0.0, 0.0)
    asymmetry = EffectBlock(name="coulomb_asymmetry", parameters={"strength": 0.1})
    bias = EffectBlock(name="torque_bias", parameters={"strength_Nm": 2.0e-5})
    blocks = (*wheel.effect[:1], asymmetry, bias)
    wheel = wheel.model_copy(update={"effect": blocks})
    warm = viscous_speed(wheel.model_copy(update={"effect": blocks[:1]}), channels)
    level = channels.dry_level_Nm
    base = channels.direction * level + VISCOUS_NM_S_RAD * warm
    effects = mean_effects(wheel)
    friction = base + 0.1 * level * np.abs(channels.direction) + 2.0e-5
    torque, speed, _ = effect_torque(effects, channels, friction, VISCOUS_NM_S_RAD, [None] * 3)
    np.testing.assert_array_equal(speed, warm)
    moving = channels.direction != 0.0
    assert np.max(np.abs(friction - torque - base)[moving]) < 2 * 0.1**5 * 3.0 * DRY_NM


def test_without_nominal_viscous_friction_they_add() -> None:
    wheel = warm_wheel(4000.0, 0.0, 0.1)
    bare = wheel.model_copy(update={"nominal": None})
    assert viscous_effects(bare) == []
    effects, channels = mean_effects(bare), rich_motion(500)
    torque, speed, _ = effect_torque(effects, channels, np.zeros(500), 0.0, [None, None])
    assert speed is channels.speed_rad_s
    np.testing.assert_allclose(torque, sum(effect.torque(channels)[0] for effect in effects))


def test_the_change_by_a_kelvin_is_that_of_the_law() -> None:
    for at_degC in (5.0, 20.0, 40.0):
        expected = -4300.0 / (at_degC + 273.15) ** 2
        assert viscous_per_K(warm_wheel(4300.0, 600.0, 0.0), at_degC) == pytest.approx(expected, rel=1e-3)
    assert viscous_per_K(built_in_wheel(), 20.0) == 0.0


# ---- known effects are taken out of the friction ---------------------------------------------------------------------


@pytest.mark.parametrize("name", ["stribeck", "coulomb_asymmetry", "lubricant_lag"])
def test_an_extended_wheel_diagnoses_as_if_the_effect_were_not_there(name: str) -> None:
    parameters = {
        "stribeck": {"strength_Nm": 5.0e-4, "stribeck_speed_rad_s": 8.0, "exponent": 2.0},
        "coulomb_asymmetry": {"strength": 0.06},
        "lubricant_lag": {"strength_Nm_s_rad": 2.0e-6, "time_constant_s": 120.0},
    }[name]
    wheel = built_in_wheel()
    extended = wheel.model_copy(update={"effect": (EffectBlock(name=name, parameters=parameters),)})
    scenario = Scenario(duration_s=5000.0, speed=SpeedProfile(kind="rich"))
    plain = simulate(scenario, wheel, np.random.default_rng(5)).samples
    hidden = simulate(scenario, extended, np.random.default_rng(5)).samples

    def jumps(samples: object, used: object) -> int:
        (closed,) = diagnose_samples(samples, used, built_in_model())
        return sum(change.fss != "rejected" for change in closed.diagnosis.changepoints)

    assert jumps(hidden, extended) == jumps(plain, wheel)
    assert jumps(hidden, wheel) > jumps(plain, wheel)
