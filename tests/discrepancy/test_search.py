"""The traps of the search: what must not be explained, and what jumps must not swallow."""

from __future__ import annotations

import gc
from dataclasses import replace

import numpy as np
import pytest

from rwa_monitor.discrepancy.base_fit import make_problem, strong_level
from rwa_monitor.discrepancy.find import find_discrepancy
from rwa_monitor.discrepancy.jump_terms import JUMP_TERMS
from rwa_monitor.discrepancy.problem import ColumnCache
from rwa_monitor.discrepancy.record import make_record
from rwa_monitor.discrepancy.terms import make_term
from rwa_monitor.samples import Samples
from rwa_monitor.threads import on_threads
from rwa_monitor.wheel.effects.catalogue import CATALOGUE, MEAN_EFFECTS
from rwa_monitor.wheel.effects.presliding import Presliding
from tests.discrepancy.simple import DRY_NM, NOISE_NM, PERIOD_S, VISCOUS, WHEEL, record, swing


def one_way(count: int = 8000) -> np.ndarray:
    """A speed that never changes direction, with slews [rad/s]."""
    time = np.arange(count) * PERIOD_S
    return 200.0 + 40.0 * np.sin(2 * np.pi * time / 700) + 20.0 * np.tanh(np.sin(2 * np.pi * time / 240) / 0.1)


def with_current(samples: Samples) -> Samples:
    assert WHEEL.inertia_kg_m2 is not None
    assert WHEEL.torque_constant_Nm_A is not None
    assert samples.friction_torque_Nm is not None
    motor = samples.friction_torque_Nm + WHEEL.inertia_kg_m2 * np.gradient(one_way(len(samples)), PERIOD_S)
    return Samples(samples.time_ns, samples.speed_rad_s, samples.friction_torque_Nm, motor / WHEEL.torque_constant_Nm_A)


def test_a_current_that_holds_the_friction_does_not_explain_it() -> None:
    samples, level = record(one_way())
    problem = make_problem([make_record(with_current(samples), WHEEL, "current")], WHEEL)
    joined = level[problem.slot]
    column = make_term(problem, MEAN_EFFECTS["torque_constant_error"], {}, joined).columns[:, 0]
    # What is left of K_T·I is J·dω/dt and the slope: no jump of the level is in it.
    steps = [abs(column[k + 20 : k + 60].mean() - column[k - 60 : k - 20].mean()) for k in (1500, 4000, 6200)]
    moves = [abs(column[k + 20 : k + 60].mean() - column[k - 60 : k - 20].mean()) for k in (1000, 3000, 5000)]
    assert max(steps) < 0.1 * 0.4 * DRY_NM + max(moves)


def test_a_record_in_one_direction_with_current_is_adequate() -> None:
    samples, _ = record(one_way())
    result = find_discrepancy([("plain", with_current(samples))], WHEEL).result
    assert result.verdict == "adequate", [effect.name for effect in result.effects]


def _caches() -> set[int]:
    """Return which caches are there; other tests may keep theirs."""
    return {id(one) for one in gc.get_objects() if isinstance(one, ColumnCache)}


def test_what_a_search_kept_is_freed_with_it_and_waits_for_no_collector() -> None:
    samples, _ = record(one_way())
    gc.collect()
    of_others = _caches()
    gc.disable()  # it counts objects, not bytes: hundreds of megabytes in a circle would wait for it
    try:
        found = find_discrepancy([("plain", with_current(samples))], WHEEL)
        assert _caches() > of_others
        del found
        assert _caches() == of_others
    finally:
        gc.enable()


def test_an_offset_in_a_few_dwells_may_be_an_asymmetry() -> None:
    # Level and direction change together from dwell to dwell: without the offset, levels take its part.
    dwells = np.repeat([60.0, -60.0, 150.0, -150.0, 300.0, -300.0], 1000)
    samples, _ = record(np.convolve(dwells, np.ones(41) / 41, "same")[20:-20], (), lambda _, level: 0.05 * level)
    (effect,) = find_discrepancy([("dwells", samples)], WHEEL).result.effects
    assert {effect.name, *effect.equivalent} >= {"torque_bias", "coulomb_asymmetry"}


def test_the_bias_of_the_derivative_is_taken_out() -> None:
    assert WHEEL.inertia_kg_m2 is not None
    assert WHEEL.torque_constant_Nm_A is not None
    time = np.arange(4000) * PERIOD_S
    # Acceleration that swings within 100 slots (and a bit: no peak repeats to the last digit, as at an end stop): a
    # parabola over 17 slots misses 2.8 % of it.
    rate = 2 * np.pi / (100.37 * PERIOD_S)
    speed = 150.0 + 5.0 * np.sin(rate * time)
    acceleration = 5.0 * rate * np.cos(rate * time)
    friction = DRY_NM + VISCOUS * speed
    current = (friction + WHEEL.inertia_kg_m2 * acceleration) / WHEEL.torque_constant_Nm_A
    time_ns = (np.arange(4000) * round(PERIOD_S * 1e9)).astype(np.int64)
    made = make_record(Samples(time_ns, speed, None, current), WHEEL, "bent")
    inner = slice(60, -60)
    missed = 0.028 * WHEEL.inertia_kg_m2 * np.max(np.abs(acceleration))
    assert np.max(np.abs(made.friction_torque_Nm[inner] - friction[inner])) < 0.02 * missed


def test_an_effect_that_jumps_could_follow_is_named_and_gives_the_jumps_back() -> None:
    def stribeck(speed: np.ndarray, level: np.ndarray) -> np.ndarray:
        return 3e-4 * np.exp(-((np.abs(speed) / 12.0) ** 2)) * np.sign(speed)

    samples, _ = record(swing(), effect=stribeck)
    search = find_discrepancy([("stribeck", samples)], WHEEL)
    assert [effect.name for effect in search.result.effects] == ["stribeck"]
    assert search.extended.fit.jumps.size == 3
    found = search.result.effects[0].parameters["stribeck_speed_rad_s"].value
    assert found == pytest.approx(12.0, rel=0.15)


def test_the_answer_does_not_depend_on_threads() -> None:
    def hidden(speed: np.ndarray, level: np.ndarray) -> np.ndarray:
        return 2e-4 * np.exp(-np.abs(speed) / 10.0) * np.sign(speed) + 1e-4

    samples, _ = record(swing(4000), jumps=(1500,), effect=hidden)
    one = find_discrepancy([("hidden", samples)], WHEEL)
    other = find_discrepancy([("hidden", samples)], WHEEL, each=on_threads(4))
    assert one.result.effects
    assert one.result.to_json() == other.result.to_json()
    assert np.array_equal(one.extended.fit.residual, other.extended.fit.residual)


def test_columns_of_the_jumps_are_those_of_the_catalogue() -> None:
    assert {term.name for term in JUMP_TERMS} == {"decaying_jump", "viscous_jump"}
    for term in JUMP_TERMS:
        assert term.family == "switching"
        assert [p.name for p in term.parameters] == [p.name for p in CATALOGUE[term.name].parameters]


def test_only_strong_jumps_are_left_in_a_level() -> None:
    samples, level = record(swing())
    problem = make_problem([make_record(samples, WHEEL, "level")], WHEEL)
    joined = level[problem.slot].copy()
    joined[3000:3010] += 2 * NOISE_NM  # worth 40 at a price of 216 for a strong one
    strong = strong_level(problem, joined)
    assert np.flatnonzero(np.abs(np.diff(strong)) > 1e-9).size == 3


@pytest.mark.parametrize(("slots", "told"), [(1.5, False), (6.0, True)])
def test_a_breakaway_faster_than_the_samples_is_no_more_than_a_dead_zone(slots: float, told: bool) -> None:
    speed = swing(top=100.0, period_s=60.0)
    step = np.abs(np.diff(speed))[np.abs(speed[1:]) < 10.0].mean()
    angle = slots**2 * 0.5 * step * PERIOD_S  # what the wheel turns through in so many slots after a reversal
    bristle = Presliding(strength_Nm=3 * DRY_NM, breakaway_angle_rad=angle)
    channels = make_record(record(speed)[0], WHEEL, "motion").channels
    torque, _ = bristle.torque(replace(channels, speed_rad_s=speed, direction=np.sign(speed)))
    samples, _ = record(speed, effect=lambda speed, level: torque)
    found = [e for e in find_discrepancy([("record", samples)], WHEEL).result.effects if e.family == "mean"]
    names = {name for entry in found for name in (entry.name, *entry.equivalent)}
    assert "presliding" in names
    assert ("speed_dead_zone" not in names) is told


def test_a_threshold_of_speed_is_no_jump_at_each_of_its_crossings() -> None:
    def dead_zone(omega: np.ndarray, level: np.ndarray) -> np.ndarray:
        return -0.3 * DRY_NM * np.sign(omega) * (np.abs(omega) < 20.0)

    search = find_discrepancy([("dead zone", record(swing(), effect=dead_zone)[0])], WHEEL)
    assert [effect.name for effect in search.result.effects] == ["speed_dead_zone"]
    np.testing.assert_allclose(search.problem.slot[search.extended.fit.jumps], [1500, 4000, 6200], atol=2)


def test_a_step_at_half_the_speed_is_no_dead_zone() -> None:
    def step(omega: np.ndarray, level: np.ndarray) -> np.ndarray:
        return 0.3 * DRY_NM * np.sign(omega) * (np.abs(omega) > 120.0)

    result = find_discrepancy([("step", record(swing(), effect=step)[0])], WHEEL).result
    assert result.unexplained is not None or any(effect.formula for effect in result.effects)
    assert "speed_dead_zone" not in [effect.name for effect in result.effects]
