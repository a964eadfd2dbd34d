"""Switching effects change simulated jumps as stated; those fitted to sojourns give their parameters back."""

from dataclasses import replace

import numpy as np
import pytest

from rwa_monitor.errors import InputError
from rwa_monitor.simulation.datasets import scaled_wheel
from rwa_monitor.wheel.effects.base import LikelihoodFit
from rwa_monitor.wheel.effects.catalogue import SWITCHING_EFFECTS
from rwa_monitor.wheel.effects.jumps import SpeedTriggeredJumps, WrongDurationLaw
from rwa_monitor.wheel.effects.switching_base import JumpClock, Jumps, Sojourns, SwitchingEvidence
from rwa_monitor.wheel.switching_systems import simulate_system
from rwa_monitor.wheel.wheel import built_in_wheel
from tests.wheel.effects.records import DRY_NM, rich_motion

SLOTS = 40_000
HURRY = 8  # the built-in wheel's systems, that much faster: some 60 jumps a record
CASES: dict[str, dict[str, float]] = {
    "wrong_duration_law": {"duration_factor": 0.3, "weibull_shape": 1.0},
    "speed_triggered_jumps": {"strength_s_rad": 0.03},
}  # those that are fitted to sojourns: the others are columns, or found by the attribution


def record(name: str, seed: int) -> SwitchingEvidence:
    """Return what an exact detection and attribution would find, with a named effect at its strength."""
    effect, rng = SWITCHING_EFFECTS[name](**CASES[name]), np.random.default_rng(seed)
    channels = rich_motion(SLOTS, seed=seed)
    systems = {system.name: system for system in scaled_wheel(built_in_wheel(), 1.0 / HURRY).fss}
    index, size = [], []
    sojourns: dict[str, Sojourns] = {}
    for of_system, system in systems.items():
        clock = effect.clock(channels) or JumpClock(np.arange(SLOTS))
        found = clock.read(simulate_system(effect.change_system(system), clock.slots, rng))
        index.append(found.jump_index)
        size.append(DRY_NM * found.jump)
        begins = found.jump_index[:-1]
        sojourns[of_system] = Sojourns(begins, found.configuration[begins], np.diff(found.jump_index))
    order = np.argsort(np.concatenate(index), kind="stable")
    jumps = Jumps(np.concatenate(index)[order].astype(np.int64), np.concatenate(size)[order])
    return SwitchingEvidence(channels, channels.good, jumps, systems, sojourns)


def fit(name: str, evidence: SwitchingEvidence) -> LikelihoodFit:
    """Fit a law that the search fits to sojourns; of a duration law the system that gains most."""
    if name == SpeedTriggeredJumps.name:
        return SpeedTriggeredJumps.fit(evidence)
    fits = [WrongDurationLaw.fit(evidence.systems[one], sojourns) for one, sojourns in evidence.sojourns.items()]
    return max(fits, key=lambda fit: fit.penalised_gain)


@pytest.mark.parametrize("name", CASES)
def test_simulate_then_fit_gives_the_parameters_back(name: str) -> None:
    """The mean over five records, within five of its standard deviations or 10 %."""
    fits = [fit(name, record(name, seed)) for seed in range(5)]
    for parameter, value in CASES[name].items():
        found = np.array([one.values[parameter] for one in fits])
        spread = found.std(ddof=1) / np.sqrt(found.size)
        assert abs(found.mean() - value) < max(5 * spread, 0.1 * value), (parameter, found)
    assert SWITCHING_EFFECTS[name](**fits[1].values).values == fits[1].values


def test_without_jumps_no_rate_is_found() -> None:
    channels, none = rich_motion(SLOTS), Jumps(np.zeros(0, dtype=np.int64), np.zeros(0))
    assert SpeedTriggeredJumps.fit(SwitchingEvidence(channels, channels.good, none)).log_likelihood_gain == 0.0


def test_a_fast_clock_brings_more_jumps() -> None:
    system = built_in_wheel().fss[0]
    rate = np.where(np.arange(SLOTS) < SLOTS // 2, 0.2, 1.8)
    counts = np.zeros(2)
    for seed in range(20):
        clock = JumpClock.from_rate(rate)
        read = clock.read(simulate_system(system, clock.slots, np.random.default_rng(seed)))
        counts += np.histogram(read.jump_index, bins=[0, SLOTS // 2, SLOTS])[0]
        assert np.array_equal(read.jump_index, np.unique(read.jump_index))
    # Expected 1 : 9; the first half sees few, so the bound is wide.
    assert 4 < counts[1] / counts[0] < 20


def test_in_one_sweep_a_rate_over_the_speed_is_one_over_time() -> None:
    once = np.linspace(80.0, 0.0, SLOTS)
    swinging = 0.6 * once + 22.0 * (1.0 + np.sin(np.linspace(0.0, 60.0, SLOTS)))
    for speed, found in ((once, False), (np.concatenate([once[::2], once[1::2]]), True), (swinging, True)):
        fast = np.flatnonzero(speed > 0.75 * speed.max())[::200].astype(np.int64)
        channels = replace(rich_motion(SLOTS), speed_rad_s=speed, bearing_temperature_degC=None)
        evidence = SwitchingEvidence(channels, channels.good, Jumps(fast, np.ones(fast.size)))
        assert (SpeedTriggeredJumps.fit(evidence).log_likelihood_gain > 0.0) == found


def test_temperature_triggered_jumps_need_the_temperature() -> None:
    effect = SWITCHING_EFFECTS["speed_triggered_jumps"](strength_s_rad=0.0, strength_1_K=0.1)
    with pytest.raises(InputError, match="temperature"):
        effect.clock(replace(rich_motion(256), bearing_temperature_degC=None))
