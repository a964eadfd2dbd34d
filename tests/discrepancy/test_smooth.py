"""The search where friction does not jump: it names what is hidden, nothing where nothing is, and the same in any form.

Friction as a law of the speed and noise that remembers, of some 600 samples: see `fitting`.
"""

from dataclasses import replace
from functools import cache
from typing import Final

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.nulls import best_gain
from rwa_monitor.discrepancy.extended import extend
from rwa_monitor.discrepancy.find import find_discrepancy
from rwa_monitor.discrepancy.fitting import Fitting
from rwa_monitor.discrepancy.found_effects import spread
from rwa_monitor.discrepancy.hypotheses import FOLLOWS_THE_SPEED, candidates, speed_curve
from rwa_monitor.discrepancy.likelihood import ACCEPT_GAIN, Series
from rwa_monitor.discrepancy.result import FoundEffect, Search
from rwa_monitor.discrepancy.search import search
from rwa_monitor.samples import Samples
from rwa_monitor.wheel.wheel import Limits, Nominal, Wheel
from tests.discrepancy.simple import DRY_NM, NOISE_NM, PERIOD_S, VISCOUS, WHEEL, Array, record, sampled, swing
from tests.discrepancy.smooth import (
    CORRELATIONS,
    COUNT,
    MOTIONS,
    coast_down,
    null_record,
    problem_of,
    reversals,
    smooth_record,
    two_sines,
)

QUADRATIC: Final = 2.0e-8  # N m s²/rad²: a third of all friction at the top
ASYMMETRY: Final = 2.0e-6  # N m s/rad
# A name asks for 25. In noise that forgets, 108 records gain 1.5 at most; of 108 in noise that remembers so long
# that the record holds an offset and a drift, three gain more than 25, by an offset.
LARGEST_NULL_GAIN: Final = 6.0
SHORT_MEMORY: Final = 0.95
OFFSETS_SHARE: Final = 0.05


def answer(*recordings: Samples) -> Search:
    """Search recordings of one wheel."""
    return find_discrepancy([(f"recording {i}", one) for i, one in enumerate(recordings)], WHEEL)


def mean_effects(found: Search) -> list[FoundEffect]:
    return [effect for effect in found.result.effects if effect.family == "mean"]


def assert_strength(found: Search, truths: dict[str, float]) -> None:
    """Ask for one mean effect, its strength within 10 % and three standard deviations, which are no excuse.

    `truths`: the strength by effect, any of which may be the one that is named; the others are its equivalents.
    """
    (effect,) = mean_effects(found)
    truth, value = truths[effect.name], next(iter(effect.parameters.values()))
    assert {effect.name, *effect.equivalent} >= truths.keys()
    assert 0.0 < value.std < 0.1 * abs(truth)
    assert abs(value.value - truth) < min(3.0 * value.std, 0.1 * abs(truth))


# ---- what is hidden is named -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("correlation", [0.0, 0.9])
def test_windage_in_a_single_coast_down(correlation: float) -> None:
    speed = coast_down()
    found = answer(smooth_record(speed, QUADRATIC * speed * np.abs(speed), correlation, seed=1))
    assert_strength(found, {"quadratic_drag": QUADRATIC})
    untested = dict(found.result.untested)
    assert {"inertia_error", "run_in_drift", "lubricant_lag", "load_dependence"} <= untested.keys()
    for name in ("inertia_error", "run_in_drift", "lubricant_lag"):
        assert untested[name] == FOLLOWS_THE_SPEED


def test_a_ripple_of_a_second_order_is_a_ripple_too() -> None:
    """A name stands once in an answer: the second order is a formula, which the name of the first goes with."""
    turns = np.cumsum(np.full(COUNT, 0.013))
    angle, speed = 2 * np.pi * turns, np.full(COUNT, 2 * np.pi * 0.013 / PERIOD_S)
    ripple = 20 * NOISE_NM * np.sin(14 * angle) + 10 * NOISE_NM * np.sin(12 * angle + 1.0)
    found = answer(replace(smooth_record(speed, ripple, seed=3), angle_rad=angle))
    first, second = sorted(mean_effects(found), key=lambda effect: effect.formula)
    assert first.name == "torque_ripple"
    assert second.formula
    assert "torque_ripple" in second.equivalent
    extended = extend(found)  # a formula is an effect of the wheel file, too
    assert Wheel.from_toml(extended.to_toml(), "extended_wheel.toml") == extended.wheel


@pytest.mark.parametrize("direction", [1.0, pytest.param(-1.0, marks=pytest.mark.slow)])
def test_what_drives_the_wheel_is_named_where_dry_friction_seems_negative(direction: float) -> None:
    speed, wind = direction * coast_down(), -direction * 3.0 * DRY_NM  # two dry frictions more than there is
    found = answer(smooth_record(speed, QUADRATIC * speed * np.abs(speed) + wind, seed=4))
    parameters = {effect.name: effect.parameters for effect in mean_effects(found)}
    assert parameters.keys() == {"quadratic_drag", "torque_bias"}
    bias = parameters["torque_bias"]["strength_Nm"]
    assert bias.value == pytest.approx(wind + direction * DRY_NM, rel=0.1)  # what dry friction holds of it is not seen


def test_a_drive_that_lags_the_torque_asked_of_it_is_named() -> None:
    """Friction is that torque less J dω/dt, as a test bench without a current sensor derives it."""
    inertia, lag_s, time_s = 2.0e-3, 0.05, np.arange(COUNT) * PERIOD_S

    def motion(time_s: Array, derivative: int) -> Array:
        """Return two sines about zero [rad/s], or their derivative."""
        turns = np.array([[0.05], [0.11]]) * 2 * np.pi
        return np.asarray(
            np.sum([[90.0], [60.0]] * turns**derivative * np.sin(turns * time_s + derivative * np.pi / 2), 0)
        )

    speed, later = motion(time_s, 0), motion(time_s + lag_s, 0)
    ahead = inertia * (motion(time_s + lag_s, 1) - motion(time_s, 1))
    friction = np.sign(later) * DRY_NM + VISCOUS * later
    found = answer(smooth_record(speed, friction - np.sign(speed) * DRY_NM - VISCOUS * speed + ahead, seed=6))
    assert_strength(found, {"drive_lag": inertia * lag_s, "current_delay": lag_s})


@pytest.mark.parametrize("late", [1, 2])
def test_noise_of_the_speed_that_a_controller_feeds_back_is_no_lag(late: int) -> None:
    rng = np.random.default_rng(7)
    noise, speed = rng.normal(0.0, 0.05, 2000), reversals(2000)
    friction = np.sign(speed) * DRY_NM + VISCOUS * speed - NOISE_NM * np.roll(noise, late) / 0.05
    assert not mean_effects(answer(sampled(speed + noise, friction + rng.normal(0.0, 0.2 * NOISE_NM, 2000))))


def test_rows_that_a_user_left_out_are_no_reason_to_refuse_given_friction() -> None:
    speed, kept = two_sines(8 * COUNT), np.random.default_rng(8).random(8 * COUNT) < 0.1
    found = answer(smooth_record(speed, QUADRATIC * speed * np.abs(speed), seed=9)[kept])
    assert_strength(found, {"quadratic_drag": QUADRATIC})


@pytest.mark.parametrize("breakaway", [5.0, 10.0])
def test_what_only_a_longer_lag_shows_is_tried(breakaway: float) -> None:
    """Strokes with rests between, read nearly without noise: the smallest steps of the speed say nothing of a lag."""
    place, count, rng = np.arange(1000) % 100 / 100.0, 1000, np.random.default_rng(5)
    speed = np.where(place < 0.5, 12.0, -12.0) * np.clip(
        40.0 * np.minimum(place % 0.5, 0.5 - place % 0.5) - 3.0, 0.0, 1.0
    )
    bristle = np.zeros(count)
    for k in range(1, count):
        left = np.exp(-np.abs(speed[k]) * PERIOD_S / breakaway)
        bristle[k] = left * bristle[k - 1] + (1.0 - left) * np.sign(speed[k])
    friction = DRY_NM * bristle + VISCOUS * speed + NOISE_NM * rng.normal(size=count)
    found = answer(sampled(speed + 1e-8 * rng.normal(size=count), friction))
    (effect,) = mean_effects(found)
    assert effect.name == "presliding"
    assert effect.parameters["breakaway_angle_rad"].value == pytest.approx(breakaway, rel=0.1)


def test_sublinear_drag_of_a_flywheel() -> None:
    speed = coast_down()
    drag = 1.5e-3 * np.sqrt(speed)
    found = answer(smooth_record(speed, drag, 0.9, seed=2))
    (effect,) = mean_effects(found)
    assert effect.name == "sublinear_viscous"
    for name, truth in {"strength_Nm": 1.5e-3, "exponent": 0.5}.items():
        assert abs(effect.parameters[name].value - truth) < 3.0 * effect.parameters[name].std
    # Strength and exponent trade with each other and with the base law: what they give together is known.
    fit = found.extended.fit
    viscous, strength = fit.coefficients
    law = fit.level[0] + viscous * speed + strength * speed ** effect.parameters["exponent"].value
    truth_Nm = DRY_NM + VISCOUS * speed + drag
    assert np.std(law - truth_Nm) < 0.01 * np.std(truth_Nm)


def test_viscous_asymmetry_on_a_reversing_axis() -> None:
    speed = reversals()
    found = answer(smooth_record(speed, ASYMMETRY * np.abs(speed), 0.9, seed=1))
    assert_strength(found, {"viscous_asymmetry": ASYMMETRY})


@pytest.mark.parametrize("seed", [1, 2])
def test_an_offset_between_two_recordings_of_opposite_direction(seed: int) -> None:
    offset, speed = 3e-4, coast_down()
    found = answer(*(smooth_record(one, offset, 0.9, seed + 10 * i) for i, one in enumerate((speed, -speed))))
    assert_strength(found, {"torque_bias": offset, "coulomb_asymmetry": offset / DRY_NM})


@pytest.mark.parametrize("seed", [1, 2])
def test_a_knee_in_a_short_table_is_no_level_that_wanders(seed: int) -> None:
    speed = np.linspace(0.5, 60.0, 80)
    found = answer(smooth_record(speed, 1e-3 * np.exp(-speed / 8.0), seed=seed))
    assert [effect.name for effect in mean_effects(found)] == ["stribeck"]


@pytest.mark.parametrize("seed", [1, 6])
@pytest.mark.parametrize("share", [0.1, 0.2])
def test_an_offset_under_a_commanded_torque_is_no_level_that_wanders(share: float, seed: int) -> None:
    """All noise is in the speed: over short times the friction, which is smoother, does not follow it."""
    rng, up = np.random.default_rng(seed), np.linspace(20.0, 200.0, 150)
    speed = np.concatenate([up, -up])
    friction = np.sign(speed) * DRY_NM + VISCOUS * speed + share * DRY_NM + 1e-3 * NOISE_NM * rng.normal(size=300)
    found = answer(sampled(speed + rng.normal(0.0, 3.0, 300), friction))
    assert_strength(found, {"torque_bias": share * DRY_NM})


@pytest.mark.parametrize("seed", [1, 2])
def test_two_effects_of_which_neither_alone_explains_what_wanders(seed: int) -> None:
    speed = np.linspace(0.5, 60.0, 80)
    knee = 5e-4 * np.exp(-speed / 8.0)
    pair = [smooth_record(sign * speed, sign * knee + 3e-4, seed=seed + 10 * i) for i, sign in enumerate((1.0, -1.0))]
    names = [{effect.name, *effect.equivalent} for effect in mean_effects(answer(*pair))]
    assert len(names) == 2
    assert any("stribeck" in one for one in names)
    assert any("torque_bias" in one for one in names)


# ---- what is not there is not ----------------------------------------------------------------------------------------


def null_gain(motion: str, correlation: float, seed: int) -> float:
    """Return by how much the best effect lowers the score where nothing is missing."""
    problem = problem_of(null_record(motion, correlation, seed))
    return best_gain(Fitting(problem, jumps=False), candidates(WHEEL, problem))[1]


@pytest.mark.parametrize("seed", [pytest.param(seed, marks=pytest.mark.slow) if seed else 0 for seed in range(9)])
@pytest.mark.parametrize("motion", MOTIONS)
def test_nothing_gains_what_a_name_asks_for_where_nothing_is_missing(motion: str, seed: int) -> None:
    gains = [null_gain(motion, one, seed) for one in CORRELATIONS if one < SHORT_MEMORY]
    assert max(gains) < LARGEST_NULL_GAIN


@pytest.mark.parametrize("seeds", [range(1), pytest.param(range(9), marks=pytest.mark.slow)])
def test_a_level_that_wanders_hardly_ever_gains_what_a_further_name_asks_for(seeds: range) -> None:
    long = [one for one in CORRELATIONS if one > SHORT_MEMORY]
    gains = np.array([null_gain(motion, one, seed) for motion in MOTIONS for one in long for seed in seeds])
    assert np.mean(gains > ACCEPT_GAIN) < OFFSETS_SHARE


def test_real_jumps_are_left_to_the_search_with_jumps() -> None:
    samples, _ = record(swing(3000, period_s=120.0), jumps=(700, 1600, 2400))
    problem = problem_of(samples)
    models = [search(Fitting(problem, jumps=jumps), candidates(WHEEL, problem)).nested[-1] for jumps in (True, False)]
    assert models[0].fit.jumps.size == 3
    assert models[0].score < models[1].score - ACCEPT_GAIN


# ---- the same in any form --------------------------------------------------------------------------------------------

Named = dict[str, tuple[float, float]]
seeds = st.integers(0, 99)
laws = st.sampled_from(["quadratic_drag", "viscous_asymmetry"])
few = settings(max_examples=3)


def strengths(*recordings: Samples, wheel: Wheel = WHEEL) -> Named:
    """Return the first strength of each effect that is named, with its standard deviation."""
    problem = problem_of(*recordings, wheel=wheel)
    found = search(Fitting(problem, jumps=False), candidates(wheel, problem))
    model = found.nested[-1]
    _, errors = spread(problem, model)
    return {
        term.effect.name: (float(model.strengths(i)[0]), errors[i][term.effect.strength_parameters()[0].name])
        for i, term in enumerate(model.terms)
    }


@cache
def hidden(law: str, seed: int) -> Samples:
    """Return a record that lacks a law."""
    speed = coast_down() if law == "quadratic_drag" else reversals()
    drag = QUADRATIC * speed * np.abs(speed) if law == "quadratic_drag" else ASYMMETRY * np.abs(speed)
    return smooth_record(speed, drag, 0.8, seed)


@cache
def strengths_of(law: str, seed: int) -> Named:
    """Return what is found in a record as it is."""
    found = strengths(hidden(law, seed))
    assert list(found) == [law]
    return found


def assert_same(one: Named, other: Named, scale: dict[str, float] | None = None, share: float = 1.0) -> None:
    """Ask for the same names, and strengths that differ by less than a share of their errors."""
    assert one.keys() == other.keys()
    for name, (value, std) in one.items():
        assert abs(other[name][0] / (scale or {}).get(name, 1.0) - value) < share * std


@few
@pytest.mark.parametrize(("torque", "turn"), [(-1.0, -1.0), (1000.0, 30.0 / np.pi)], ids=["mirror image", "units"])
@given(law=laws, seed=seeds)
def test_the_mirror_image_and_other_units_give_the_same(torque: float, turn: float, law: str, seed: int) -> None:
    samples, known = hidden(law, seed), WHEEL.nominal
    nominal = Nominal(
        dry_torque_Nm=abs(torque) * known.dry_torque_Nm,
        viscous_Nm_s_rad=torque / turn * known.viscous_Nm_s_rad,
        nominal_speed_rad_s=abs(turn) * known.nominal_speed_rad_s,
    )
    wheel = WHEEL.model_copy(update={"nominal": nominal, "limits": Limits()})
    changed = strengths(sampled(turn * samples.speed_rad_s, torque * samples.friction_torque_Nm), wheel=wheel)
    scale = {"quadratic_drag": torque / (turn * abs(turn)), "viscous_asymmetry": torque / abs(turn)}
    assert_same(strengths_of(law, seed), changed, scale, 0.05)


@few
@given(laws, seeds, st.floats(0.3, 0.7))
def test_a_recording_in_two_pieces_gives_the_same(law: str, seed: int, where: float) -> None:
    samples = hidden(law, seed)
    at = round(where * len(samples))
    pieces = samples[:at], samples[at:]
    there = strengths(*pieces)
    assert_same(strengths_of(law, seed), there)
    assert_same(there, strengths(*pieces[::-1]), share=0.05)  # in any order


@few
@pytest.mark.parametrize("step", [2.0, 0.5])
@given(law=laws, seed=seeds)
def test_every_second_sample_and_samples_put_between_give_the_same(step: float, law: str, seed: int) -> None:
    samples, known = hidden(law, seed), strengths_of(law, seed)
    place = np.arange(len(samples))
    at = np.arange(0.0, len(samples) - 0.5, step)
    channels = (np.interp(at, place, values) for values in (samples.speed_rad_s, samples.friction_torque_Nm))
    wheel = WHEEL.model_copy(update={"sample_period_s": step * PERIOD_S})
    there = strengths(sampled(*channels, step * PERIOD_S), wheel=wheel)
    assert_same(*((there, known) if step > 1.0 else (known, there)))  # within the errors of the rarer samples


def test_a_free_curve_follows_what_spans_decades_of_the_speed() -> None:
    """A start from rest, a twelfth of it slow: what friction does there is not taken for jumps, see `explain`."""
    along = np.linspace(0.0, 1.0, 4000)
    speed = np.where(along < 0.08, 0.03 + 4.5 * (along / 0.08) ** 0.7, 4.53 + 200.0 * np.maximum(along - 0.08, 0.0))
    samples, _ = record(speed, jumps=())
    series = Series.of(problem_of(samples))
    curve = speed_curve(series)
    for scale in (0.3, 1.0, 3.0, 30.0):
        law = np.exp(-((series.speed / scale) ** 2)) * series.sign
        left = law - curve.T @ np.linalg.lstsq(curve.T, law)[0]
        assert float(left @ left) < 0.02 * float(law @ law)
