"""Scenario files: round trip, and one clear sentence for each mistake."""

import re

import pytest

from rwa_monitor.errors import InputError
from rwa_monitor.simulation.motion import SpeedProfile
from rwa_monitor.simulation.scenario import Anomaly, Base, Fault, FrictionNoise, Scenario, Sensors
from rwa_monitor.wheel.wheel import EffectBlock, built_in_wheel

FULL = Scenario(
    duration_s=2500.0,
    start_ns=1000,
    friction_given=False,
    channels=("motor_current_A", "bearing_temperature_degC"),
    speed=SpeedProfile(kind="rich", direction=-1),
    base=Base(dry=1.02),
    anomalies={"dry": Anomaly(factor=1.3), "fss_2": Anomaly(factor=1.4, onset_s=1000.0, growth_s=500.0)},
    noise=FrictionNoise(law="ar1", ar_coefficient=0.5),
    sensors=Sensors(speed_noise_rad_s=0.02),
    effect=(EffectBlock(name="stribeck", parameters={"strength_Nm": 5.0e-4, "stribeck_speed_rad_s": 8.0}),),
    fault=(Fault(kind="gap", start_s=100.0, duration_s=12.0),),
)


@pytest.mark.parametrize("scenario", [Scenario(), FULL], ids=["empty", "full"])
def test_round_trip(scenario):
    assert Scenario.from_toml(scenario.to_toml(), "again") == scenario


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[scenario", "s.toml: is no valid TOML"),
        ("[scenarios]", "s.toml: scenarios: does not belong here"),
        ("[scenario.speed]", "s.toml: speed: does not belong here"),
        ("[scenario]\nduration_s = -1", "s.toml: duration_s: "),
        ("[scenario]\nlength = 5", "s.toml: length: "),
        ('[scenario]\nchannels = ["current"]', "s.toml: channels.0: "),
        ('[speed]\nkind = "loop"', "s.toml: speed.kind: "),
        ("[anomalies.dry]\nfactor = -1", "s.toml: anomalies.dry.factor: "),
        ('[[fault]]\nkind = "gap"', "s.toml: fault.0.start_s: "),
        ('[[fault]]\nkind = "stuck"\nstart_s = 0\nduration_s = 1\nchannel = "speed"', "s.toml: fault.0.channel: "),
        ('[noise]\nlaw = "ar1"\nar_coefficient = 1.0', "s.toml: noise.ar_coefficient: "),
    ],
)
def test_each_mistake_is_named_in_one_line(text, message):
    with pytest.raises(InputError, match=f"^{re.escape(message)}") as caught:
        Scenario.from_toml(text, "s.toml")
    assert "\n" not in str(caught.value)


def test_what_the_wheel_lacks_is_named():
    wheel = built_in_wheel()
    with pytest.raises(InputError, match=r"anomalies\.fss_9: this wheel has dry, viscous, fss_1, fss_2"):
        Scenario(anomalies={"fss_9": Anomaly(factor=2.0)}).check(wheel)
    with pytest.raises(InputError, match="nominal"):
        Scenario().check(wheel.model_copy(update={"nominal": None}))
    with pytest.raises(InputError, match="duration_s"):
        Scenario(duration_s=0.1).slots(wheel)
    with pytest.raises(InputError, match="duration_s"):
        Scenario(duration_s=1e12).slots(wheel)
