"""The effect that the demo hides: the same for a seed, none of the monitor's wheel, as strong as it states."""

import numpy as np
import pytest

from benchmarks.adequacy.strength import level_columns, orthogonal_rms
from benchmarks.adequacy.trials import true_channels
from rwa_monitor.messages import SamplesMessage, key_of
from rwa_monitor.simulation.demo_satellite import (
    EFFECTS,
    FAILING,
    PAUSE_S,
    WINDOW_SECONDS,
    Satellite,
    demo_wheel,
    simulate_satellite,
)
from rwa_monitor.simulation.motion import SpeedProfile
from rwa_monitor.simulation.record import simulate
from rwa_monitor.simulation.scenario import Scenario
from rwa_monitor.wheel.effects.catalogue import build
from rwa_monitor.wheel.wheel import EffectBlock

DURATION_S = 2 * WINDOW_SECONDS


def _satellite(seed: int) -> Satellite:
    return simulate_satellite("test", DURATION_S, start_ns=10**18, seed=seed)


def test_a_longer_demo_hides_the_same_effect() -> None:
    short, long = _satellite(3), simulate_satellite("test", 2 * DURATION_S, start_ns=10**18, seed=3)
    assert (short.hiding, short.hidden.effect) == (long.hiding, long.hidden.effect)
    count = len(short.hidden.samples)
    np.testing.assert_array_equal(short.hidden.samples.speed_rad_s, long.hidden.samples.speed_rad_s[:count])


def test_seeds_hide_different_effects_which_the_monitor_does_not_get() -> None:
    satellites = [_satellite(seed) for seed in range(8)]
    for satellite in satellites:
        assert satellite.wheel.effect == ()
        assert satellite.hiding != FAILING
        assert satellite.hidden.effect in EFFECTS
    assert len({satellite.hidden.effect.name for satellite in satellites}) >= 3


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.name)
def test_each_effect_leaves_one_to_two_deviations_of_the_noise_in_a_pass(effect: EffectBlock) -> None:
    wheel = demo_wheel()
    scenario = Scenario(duration_s=wheel.window_s - PAUSE_S, speed=SpeedProfile(kind="rich"))
    truth = simulate(scenario, wheel, np.random.default_rng(5)).truth
    channels = true_channels(truth, wheel, truth.used)
    levels = level_columns(channels.direction, np.unique(truth.changepoints.index))
    left = orthogonal_rms(build(effect).torque(channels)[0], channels, levels) / truth.noise_std_Nm
    assert 1.0 < left < 2.0


def test_the_hidden_wheel_sends_in_passes_of_a_window() -> None:
    satellite = _satellite(0)
    samples = satellite.hidden.samples
    assert samples is satellite.telemetry[key_of(SamplesMessage, "test", satellite.hiding)]
    steps_s = np.diff(samples.time_ns) / 1e9
    pauses = steps_s[steps_s > 1.5 * satellite.wheel.sample_period_s]
    np.testing.assert_allclose(pauses, PAUSE_S + satellite.wheel.sample_period_s)
    assert pauses.size == 1  # between two passes
    assert samples.time_ns[-1] < satellite.start_ns + 2 * satellite.wheel.window_s * 1e9
