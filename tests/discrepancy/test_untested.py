"""What a record could not test is reported, and the strength that it would have shown is the one that it shows."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.ndimage import uniform_filter1d

from rwa_monitor.discrepancy.hypotheses import CANDIDATES, detectable_strengths, not_testable
from rwa_monitor.discrepancy.plan import DECIDES, MANOEUVRES, UNINFORMATIVE, plan
from rwa_monitor.discrepancy.result import Search
from rwa_monitor.reporting.discrepancy_report import absent_effects, html, sentence
from tests.discrepancy.simple import DRY_NM, NOISE_NM, PERIOD_S, WHEEL, Array, record, sampled, search, swing

COUNT = 3000


def biased(speed: np.ndarray, bias_Nm: float = 0.0) -> Search:
    samples, _ = record(speed, jumps=(1500,), effect=lambda speed, level: np.full(speed.size, bias_Nm))
    return search(samples)


@pytest.mark.parametrize(("times", "shows"), [(0.5, False), (3.0, True)])  # between them it depends on the noise
def test_the_strength_that_would_show_is_the_one_that_shows(times: float, shows: bool) -> None:
    plain = biased(swing(COUNT, period_s=60.0))
    (bias,) = [e for e in detectable_strengths(plain.problem, plain.extended, CANDIDATES) if e.name == "torque_bias"]
    assert not bias.too_weak
    effects = biased(swing(COUNT, period_s=60.0), times * bias.strength).result.effects
    assert any("torque_bias" in {effect.name, *effect.equivalent} for effect in effects) is shows


def test_an_effect_too_weak_to_show_is_listed_with_the_strength_that_would() -> None:
    # A speed that hardly changes: a bent law of speed is as good as a straight one.
    time = np.arange(COUNT) * PERIOD_S
    untested = dict(biased(200.0 + 20.0 * np.sin(2 * np.pi * time / 90.0)).result.untested)
    assert "would show only from strength_Nm" in untested["sublinear_viscous"]
    assert "% of all friction" in untested["sublinear_viscous"]


def test_a_ripple_that_does_not_repeat_within_the_angle_is_not_tested() -> None:
    angle = 0.05 * np.sin(2.0 * np.pi * np.arange(COUNT) / 300.0)  # less than a period of the highest order
    speed = np.gradient(angle, PERIOD_S)
    friction = DRY_NM * np.sign(speed) + NOISE_NM * np.random.default_rng(1).normal(size=COUNT)
    wheel = WHEEL.model_copy(update={"window": WHEEL.window.model_copy(update={"dead_band_rad_s": 1e-4})})
    found = search(sampled(speed, friction), wheel)
    assert "the angle" in dict(found.result.untested)["torque_ripple"]


def test_what_was_tested_is_distinguished_from_what_was_not_excited_and_what_is_not_testable() -> None:
    # At one speed: time alone shows a drift, no motion shows a law of speed, no channel the temperature.
    found = biased(np.full(COUNT, 120.0))
    assert found.result.verdict == "untestable"
    assert "needs motion" in sentence(found.result)
    untested = found.result.untested
    beyond = not_testable(found.problem, untested)
    seen = {entry.name for entry in absent_effects(found)}
    assert "run_in_drift" in seen
    assert not seen & dict(untested).keys()
    assert {"viscosity_temperature", "load_dependence", "tachometer_quantisation"} <= beyond
    assert {"stribeck", "sublinear_viscous"} <= dict(untested).keys() - beyond
    page = html(found, ["constant.csv"])
    for words in ("not excited", "not testable", "Tested and not seen"):
        assert words in page


def test_a_plan_promises_nothing_that_needs_a_channel() -> None:
    planned = plan(biased(np.full(COUNT, 120.0)))
    shown = {name for entry in planned.manoeuvres for name in entry.shows}
    assert "stribeck" in shown
    assert "viscosity_temperature" not in shown
    assert any("viscosity_temperature without bearing_temperature_degC" in line for line in planned.advice)
    rates = [(len(entry.shows) / entry.duration_s, entry.nats_per_hour) for entry in planned.manoeuvres]
    assert rates == sorted(rates, reverse=True)
    assert min(entry.separation for entry in planned.manoeuvres) >= UNINFORMATIVE


def test_an_effect_of_few_samples_is_judged_where_it_acts() -> None:
    # Zero speed is hurried through: a drag near rest acts in a few samples, and must be huge there to show.
    speed = 250.0 * np.clip(4.0 * np.sin(2 * np.pi * np.arange(COUNT) * PERIOD_S / 60.0 + 0.3), -1.0, 1.0)
    noise = np.random.default_rng(53000).normal(0.0, 2.0 * DRY_NM, COUNT)
    found = search(record(speed, jumps=(), noise=noise)[0])
    assert "of what there is where it acts" in dict(found.result.untested)["stribeck"]
    assert "stribeck" not in {entry.name for entry in absent_effects(found)}
    assert any("stribeck" in entry.shows for entry in plan(found).manoeuvres)


# ---- three causes that a record confuses; the manoeuvre that the plan puts first, flown, leaves the true one alone ---


TOP_RAD_S, OFFSET_NM = 150.0, 1e-5  # a quarter of the noise
CONFUSED: dict[str, Callable[[Array, Array], Array]] = {
    "torque_bias": lambda speed, level: np.full(speed.size, OFFSET_NM),
    "coulomb_asymmetry": lambda speed, level: 2 * OFFSET_NM / DRY_NM * level,
    "viscous_asymmetry": lambda speed, level: OFFSET_NM / TOP_RAD_S * np.abs(speed),
}


def to_and_fro() -> Array:
    """One speed, forwards and backwards, 25 s each, without a jump: all three are one constant."""
    time = np.arange(8000) * PERIOD_S
    return np.asarray(uniform_filter1d(np.where((time // 25.0) % 2 == 0, TOP_RAD_S, -TOP_RAD_S), 8))


@pytest.mark.parametrize(
    "truth", [pytest.param("torque_bias", marks=pytest.mark.slow), "coulomb_asymmetry", "viscous_asymmetry"]
)
def test_the_planned_manoeuvre_leaves_one_of_three_confused_causes(truth: str) -> None:
    effect = CONFUSED[truth]
    before = search(record(to_and_fro(), (), effect)[0])
    named = before.result.effects[0]
    assert {named.name, *named.equivalent} == set(CONFUSED)

    first, *others = plan(before).manoeuvres
    assert first.name == "two speeds in both directions, across a jump"
    assert first.separation > DECIDES > max((entry.separation for entry in others), default=0.0)
    assert min(entry.separation for entry in (first, *others)) >= UNINFORMATIVE

    manoeuvre = next(entry for entry in MANOEUVRES if entry.name == first.name)
    time = np.arange(0.0, manoeuvre.duration_s, PERIOD_S)
    speed = np.asarray(uniform_filter1d(manoeuvre.speed(time, TOP_RAD_S), 160))
    flown, _ = record(speed, (int(manoeuvre.jump_at * speed.size),), effect, seed=5)
    after = search(flown).result.effects
    assert [(found.name, found.equivalent) for found in after] == [(truth, ())]
