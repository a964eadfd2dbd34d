"""What motor voltage, drive power and the body's momentum show of torque constant and inertia."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwa_monitor.discrepancy.plausible import GAIN_STD, combined, measured_constants
from rwa_monitor.samples import Samples
from rwa_monitor.simulation.motion import SpeedProfile
from rwa_monitor.simulation.record import simulate
from rwa_monitor.simulation.scenario import Scenario
from rwa_monitor.wheel.wheel import EffectBlock, Wheel, built_in_wheel
from tests.discrepancy.simple import sampled, search

SLOTS = 8_000


@cache
def measured(gain: float = 0.0) -> Samples:
    """A rich motion with all three channels, their gains off by a part, and no friction channel."""
    wheel = built_in_wheel()
    scenario = Scenario(
        speed=SpeedProfile(kind="rich"),
        duration_s=SLOTS * wheel.sample_period_s,
        friction_given=False,
        channels=("motor_current_A", *GAIN_STD),
    )
    samples, rng = simulate(scenario, wheel, np.random.default_rng(5)).samples, np.random.default_rng(6)
    external = 2e-6 + np.cumsum(rng.normal(0.0, 1e-8, SLOTS))  # N m, on the body
    momentum = samples.body_momentum_Nms + np.cumsum(external) * wheel.sample_period_s
    return replace(
        samples,
        motor_voltage_V=(1.0 + gain) * (samples.motor_voltage_V + 0.1),  # an offset of its own
        drive_power_W=(1.0 + gain) * samples.drive_power_W,
        body_momentum_Nms=(1.0 + gain) * momentum,
    )


def with_channels(samples: Samples, *names: str) -> Samples:
    return replace(samples, **{name: None for name in GAIN_STD if name not in names})


def stated(inertia: float = 1.0, torque_constant: float = 1.0) -> Wheel:
    """A wheel file whose constants are off by a factor."""
    wheel = built_in_wheel()
    inertia, torque_constant = inertia * wheel.inertia_kg_m2, torque_constant * wheel.torque_constant_Nm_A
    constants = {"inertia_kg_m2": inertia, "torque_constant_Nm_A": torque_constant, "back_emf_constant_V_s_rad": None}
    return wheel.model_copy(update=constants)


WRONG = {"inertia_error": stated(inertia=0.96), "torque_constant_error": stated(torque_constant=1.04)}


def sets_of(samples: Samples, wheel: Wheel) -> list[set[str]]:
    return [{effect.name, *effect.equivalent} for effect in search(samples, wheel).result.effects]


@pytest.mark.parametrize("channel", GAIN_STD)
@given(inertia=st.floats(0.8, 1.2), torque_constant=st.floats(0.8, 1.2))
def test_each_channel_shows_its_constant_whatever_the_wheel_file_states(
    channel: str, inertia: float, torque_constant: float
) -> None:
    wheel = stated(inertia, torque_constant)
    (shown,) = measured_constants(with_channels(measured(), channel), wheel)
    of_file = inertia if shown.quantity == "inertia" else torque_constant
    assert shown.is_used
    assert shown.measured / shown.stated * of_file == pytest.approx(1.0, abs=4e-3)  # 50 mW of noise on the power
    assert abs(shown.measured / shown.stated * of_file - 1.0) < 5.0 * shown.whole_std / shown.measured


@pytest.mark.parametrize(
    "channels",
    [(), ("motor_voltage_V",), pytest.param(("drive_power_W",), marks=pytest.mark.slow), ("body_momentum_Nms",)],
)
@pytest.mark.parametrize("cause", WRONG)
def test_any_of_the_channels_separates_them(cause: str, channels: tuple[str, ...]) -> None:
    assert sets_of(with_channels(measured(), *channels), WRONG[cause]) == [{cause} if channels else set(WRONG)]


def test_what_is_better_in_the_place_of_the_effect_found_first_takes_it() -> None:
    """The error of the torque constant is found first, at jumps that the one of the inertia makes needless."""
    wheel, rng = built_in_wheel(), np.random.default_rng(0)
    period_s, inertia = wheel.sample_period_s, 1.08 * wheel.inertia_kg_m2
    time_s = np.arange(SLOTS) * period_s
    speed = 200.0 * np.sin(2 * np.pi * time_s / 250.0) + 60.0 * np.sin(2 * np.pi * time_s / 91.0)
    friction = wheel.nominal.dry_torque_Nm * np.sign(speed) + wheel.nominal.viscous_Nm_s_rad * speed
    current = (inertia * np.gradient(speed, period_s) + friction) / wheel.torque_constant_Nm_A
    samples = sampled(
        speed + rng.normal(0.0, 0.01, SLOTS),
        motor_current_A=current + rng.normal(0.0, 5e-4, SLOTS),
        body_momentum_Nms=-inertia * speed + rng.normal(0.0, 1e-4, SLOTS),
    )
    assert sets_of(samples, wheel) == [{"inertia_error"}]


@pytest.mark.parametrize("gain", [-0.01, 0.01])
def test_a_gain_that_is_off_as_far_as_it_may_be_names_nothing(gain: float) -> None:
    assert sets_of(measured(gain), stated()) == []


def test_a_channel_without_a_value_is_none() -> None:
    nothing = np.full(SLOTS, np.nan)
    empty = replace(measured(), drive_power_W=nothing, motor_voltage_V=nothing, body_momentum_Nms=nothing)
    assert measured_constants(empty, stated()) == ()


def test_what_several_recordings_show_is_the_same_in_any_order_and_no_surer_than_the_gain() -> None:
    halves = [
        measured_constants(measured()[part], stated()) for part in (slice(0, SLOTS // 2), slice(SLOTS // 2, None))
    ]
    one, other = combined(halves), combined(reversed(halves))
    for a, b in zip(one, other, strict=True):
        assert a.channel == b.channel
        assert a.measured == pytest.approx(b.measured, rel=1e-12)
        assert a.std < min(c.std for half in halves for c in half if c.channel == a.channel)
        assert a.whole_std >= GAIN_STD[a.channel] * a.measured


def test_momentum_of_body_and_wheel_together_is_not_used_and_said() -> None:
    samples = measured()
    whole = samples.body_momentum_Nms + stated().inertia_kg_m2 * samples.speed_rad_s
    (shown,) = measured_constants(replace(with_channels(samples), body_momentum_Nms=whole), stated())
    assert not shown.is_used
    assert "not used; is it in another unit, or of body and wheel together?" in shown.in_words()
    assert combined([(shown,)]) == ()


def test_an_error_that_the_wheel_file_has_already_is_no_contradiction() -> None:
    wheel = stated(inertia=0.96)
    error = EffectBlock(name="inertia_error", parameters={"strength_kg_m2": wheel.inertia_kg_m2 * 0.04 / 0.96})
    extended = wheel.model_copy(update={"effect": (error,)})
    (shown,) = measured_constants(with_channels(measured(), "body_momentum_Nms"), extended)
    assert shown.measured / shown.stated == pytest.approx(1.0, abs=2e-3)


def test_a_current_sensor_that_follows_the_bus_voltage_is_reported() -> None:
    wheel = built_in_wheel()
    scenario = Scenario(speed=SpeedProfile(kind="rich"), duration_s=SLOTS * wheel.sample_period_s)
    run = simulate(scenario, wheel, np.random.default_rng(8))
    bus = 28.0 + 2.0 * np.sign(np.sin(np.arange(SLOTS) / 300.0)) * np.linspace(0.2, 1.0, SLOTS)
    friction = run.samples.friction_torque_Nm + 1.5 * run.truth.noise_std_Nm * (bus - 28.0)
    samples = replace(run.samples, friction_torque_Nm=friction, bus_voltage_V=bus)
    assert "bus voltage" in search(samples, wheel).result.unexplained.signature
