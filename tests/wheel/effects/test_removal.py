"""Known effects are taken out of the friction: the base law is left, also for effects that scale with the dry level."""

import numpy as np
import pytest

from rwa_monitor.diagnosis.model import built_in_model
from rwa_monitor.monitor.core import diagnose_samples
from rwa_monitor.simulation.motion import SpeedProfile
from rwa_monitor.simulation.record import simulate
from rwa_monitor.simulation.scenario import Scenario
from rwa_monitor.wheel.effects.asymmetry import CoulombAsymmetry, TorqueBias
from rwa_monitor.wheel.effects.catalogue import effect_torque
from rwa_monitor.wheel.wheel import EffectBlock, built_in_wheel
from tests.wheel.effects.records import channels_of

VISCOUS = 5.0e-6  # N m s/rad


def test_asymmetry_and_bias_are_removed_exactly_but_for_the_fifth_order() -> None:
    speed = np.linspace(-300.0, 300.0, 1000)
    level = np.where(np.arange(1000) < 600, 1.6e-3, 2.4e-3)
    base = level * np.sign(speed) + VISCOUS * speed
    friction = base + 0.1 * level + 2.0e-5
    channels = channels_of(speed)
    effects = [CoulombAsymmetry(strength=0.1), TorqueBias(strength_Nm=2.0e-5)]
    torque, viscous_speed, memories = effect_torque(effects, channels, friction, VISCOUS, [None, None])
    assert np.max(np.abs(friction - torque - base)) < 2 * 0.1**5 * level.max()
    assert memories == [None, None]
    assert viscous_speed is channels.speed_rad_s  # the same bits as without any effect


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
        (closed,) = diagnose_samples(samples, used, built_in_model())  # type: ignore[arg-type]
        return sum(change.fss != "rejected" for change in closed.diagnosis.changepoints)

    assert jumps(hidden, extended) == jumps(plain, wheel)
    assert jumps(hidden, wheel) > jumps(plain, wheel)
