"""What made the jumps: one system more, other laws of duration, a clock that follows the speed, or what is known."""

from collections.abc import Sequence

import numpy as np
import pytest

from rwa_monitor.discrepancy.base_fit import fit, make_problem
from rwa_monitor.discrepancy.noise_effects import noise_effects, with_even_noise
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.discrepancy.record import make_record
from rwa_monitor.discrepancy.score import scored
from rwa_monitor.discrepancy.switching_effects import switching_effects
from rwa_monitor.discrepancy.terms import Model
from rwa_monitor.samples import BoolArray, FloatArray
from rwa_monitor.simulation.datasets import scaled_wheel
from rwa_monitor.wheel.durations import Geometric
from rwa_monitor.wheel.switching_systems import simulate_system
from rwa_monitor.wheel.wheel import SwitchingSystem, Wheel
from tests.discrepancy.simple import DRY_NM, NOISE_NM, VISCOUS, WHEEL, sampled
from tests.switching.assignment_windows import system

COUNT = 16_000
HURRY = 0.1  # of the built-in wheel's durations: some 30 jumps of the known systems
KNOWN = scaled_wheel(WHEEL, HURRY)


def memoryless(name: str, rest: float, active: float, low: float, high: float) -> SwitchingSystem:
    return system(name, Geometric(mean_slots=rest), Geometric(mean_slots=active), low=low, high=high)


EXTRA = memoryless("extra", 700.0, 300.0, 0.7, 0.9)


def level_of(systems: tuple[SwitchingSystem, ...], clock: np.ndarray, seed: int) -> FloatArray:
    rng = np.random.default_rng(seed)
    friction = [simulate_system(system, int(clock[-1]) + 1, rng).friction[clock] for system in systems]
    return np.asarray(DRY_NM * (1.0 + np.sum(friction, axis=0)))


def base_model(level: FloatArray, speed: FloatArray, noise: FloatArray, wheel: Wheel) -> tuple[Problem, Model]:
    friction = np.sign(speed) * level + VISCOUS * speed + NOISE_NM * noise
    problem = make_problem([make_record(sampled(speed, friction), wheel, "jumps")], wheel)
    return problem, scored(problem, (), fit(problem).jumps)


def named(
    level: FloatArray, speed: FloatArray, seed: int, in_band: Sequence[BoolArray] = (), wheel: Wheel = KNOWN
) -> list[str]:
    problem, model = base_model(level, speed, np.random.default_rng(seed + 100).normal(size=COUNT), wheel)
    return [effect.name for effect in switching_effects(problem, model, wheel, in_band)]


def some_speed(seed: int) -> FloatArray:
    return 180.0 + 100.0 * np.sin(2 * np.pi * np.arange(COUNT) / 5_000 + seed)


@pytest.mark.parametrize("seed", [1, 2])
def test_known_systems_are_no_discrepancy(seed: int) -> None:
    assert named(level_of(KNOWN.fss, np.arange(COUNT), seed), some_speed(seed), seed) == []


@pytest.mark.parametrize("seed", [1, 2])
def test_what_stands_out_at_a_reversal_is_no_jump_of_a_system(seed: int) -> None:
    speed = 100.0 * np.sin(2 * np.pi * np.arange(COUNT) / 1_500 + seed)
    level = level_of(KNOWN.fss, np.arange(COUNT), seed)
    turning = np.flatnonzero(np.diff(np.sign(speed))) + 1
    level[turning] -= 0.4 * DRY_NM  # along the rotation, in a single sample
    assert named(level, speed, seed) == []


@pytest.mark.parametrize("seed", [1, 3, 4, 5])
def test_samples_of_a_noisy_band_are_no_jumps(seed: int) -> None:
    speed, rng = some_speed(seed), np.random.default_rng(seed)
    noise = (1.0 + 1.5 * np.exp(-0.5 * ((speed - 150.0) / 15.0) ** 2)) * rng.normal(size=COUNT)
    problem, model = base_model(level_of(KNOWN.fss, np.arange(COUNT), seed), speed, noise, KNOWN)
    found = noise_effects(problem, model)
    assert [effect.name for effect in found] == ["speed_dependent_noise"]
    assert switching_effects(problem, with_even_noise(problem, model, found), KNOWN) == []


@pytest.mark.parametrize("seed", [1, 2])
def test_one_system_more_is_distinguished_from_other_laws(seed: int) -> None:
    level = level_of((*KNOWN.fss, EXTRA), np.arange(COUNT), seed)
    assert named(level, some_speed(seed), seed) == ["extra_switching_system"]


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("size", [0.25, 0.3])
def test_a_system_whose_size_no_known_one_states_is_one_more(size: float, seed: int) -> None:
    """The known systems could take its jumps as anomalous ones of their own, with other laws of duration."""
    known = tuple(memoryless(name, 2_900.0, 1_200.0, 0.38, 0.5) for name in ("fss_1", "fss_2"))
    wheel = KNOWN.model_copy(update={"fss": known})
    level = level_of((*known, memoryless("extra", 500.0, 500.0, size, size)), np.arange(COUNT), seed)
    assert named(level, some_speed(seed), seed, wheel=wheel) == ["extra_switching_system"]


@pytest.mark.parametrize("seed", [1, 4, 5, 6])
def test_jumps_that_decay_are_no_system(seed: int) -> None:
    known = memoryless("fss_1", 2_100.0, 1_300.0, 0.38, 0.5)
    since = np.arange(COUNT) - np.random.default_rng(seed).integers(COUNT, size=12)[:, np.newaxis]
    decaying = 0.3 * DRY_NM * np.sum((since >= 0) * np.exp(-np.maximum(since, 0) / 150.0), axis=0)
    level = level_of((known,), np.arange(COUNT), seed) + decaying
    assert named(level, some_speed(seed), seed, wheel=KNOWN.model_copy(update={"fss": (known,)})) == []


@pytest.mark.parametrize(("seed", "factor"), [(1, 0.4), (2, 2.5)])
def test_other_laws_are_distinguished_from_one_system_more(seed: int, factor: float) -> None:
    level = level_of(scaled_wheel(WHEEL, factor * HURRY).fss, np.arange(COUNT), seed)
    assert named(level, some_speed(seed), seed) == ["wrong_duration_law"]


@pytest.mark.parametrize("seed", [50010, 50011, 50012])
def test_a_law_may_be_wrong_for_one_configuration_alone(seed: int) -> None:
    fast, slow = KNOWN.fss
    rests = scaled_wheel(WHEEL, 0.25 * HURRY).fss[0].durations[0]
    level = level_of((fast.model_copy(update={"durations": (rests, fast.durations[1])}), slow), np.arange(COUNT), seed)
    assert named(level, some_speed(seed), seed) == ["wrong_duration_law"]


@pytest.mark.parametrize("seed", [1, 2])
def test_jumps_that_the_speed_triggers_are_distinguished_from_other_laws(seed: int) -> None:
    speed = some_speed(seed)
    rate = np.exp(0.02 * (speed - speed.max()))  # four e-folds from the lowest to the highest speed
    clock = np.floor(np.cumsum(rate / rate.mean())).astype(np.int64)
    assert named(level_of(KNOWN.fss, clock, seed), speed, seed) == ["speed_triggered_jumps"]


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
@pytest.mark.parametrize("everywhere", [False, True])
def test_what_jumps_in_the_band_of_a_cage_alone_is_no_further_system(seed: int, everywhere: bool) -> None:
    speed = some_speed(seed)
    band = np.abs(speed - 180.0) < 40.0
    extra = simulate_system(EXTRA, COUNT, np.random.default_rng(seed)).friction
    level = level_of(KNOWN.fss, np.arange(COUNT), seed) + DRY_NM * np.where(everywhere | band, extra, 0.0)
    assert named(level, speed, seed) == ["extra_switching_system"]
    assert named(level, speed, seed, [band]) == (["extra_switching_system"] if everywhere else [])
