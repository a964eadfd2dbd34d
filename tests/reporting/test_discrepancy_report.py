"""Views, plan, report and command on one record with a Stribeck effect hidden in it."""

import json
import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rwa_monitor.discrepancy.find import find_discrepancy
from rwa_monitor.discrepancy.fitting import Fitting
from rwa_monitor.discrepancy.p_values import with_bootstrap
from rwa_monitor.discrepancy.plan import plan, rank_manoeuvres
from rwa_monitor.discrepancy.result import Search, nested_models
from rwa_monitor.discrepancy.terms import make_term
from rwa_monitor.messages import Unexplained
from rwa_monitor.reporting import discrepancy_report as report
from rwa_monitor.reporting import figures
from rwa_monitor.reporting.residual_views import all_views
from rwa_monitor.samples import Samples
from rwa_monitor.simulation.motion import SpeedProfile
from rwa_monitor.simulation.record import simulate
from rwa_monitor.simulation.scenario import Scenario
from rwa_monitor.telemetry.table import table_writer
from rwa_monitor.wheel.effects.base import Effect
from rwa_monitor.wheel.effects.catalogue import CATALOGUE, MEAN_EFFECTS
from rwa_monitor.wheel.effects.formula import FORMULAS
from rwa_monitor.wheel.wheel import EffectBlock, Wheel, built_in_wheel
from tests.program import run

STRENGTH_NM, WIDTH_RAD_S = 6.0e-4, 10.0


def record(effect: EffectBlock | None, seed: int = 7) -> Samples:
    """Simulate 1500 s of rich motion, with or without the effect."""
    scenario = Scenario(duration_s=1500.0, speed=SpeedProfile(kind="rich"), effect=(effect,) if effect else ())
    return simulate(scenario, built_in_wheel(), np.random.default_rng(seed)).samples


STRIBECK = EffectBlock(
    name="stribeck", parameters={"strength_Nm": STRENGTH_NM, "stribeck_speed_rad_s": WIDTH_RAD_S, "exponent": 2.0}
)


@pytest.fixture(scope="module")
def found() -> Search:
    """Search one record with the effect."""
    return find_discrepancy([("hidden.csv", record(STRIBECK))], built_in_wheel())


@pytest.fixture(scope="module")
def nothing() -> Search:
    """Search one record without any effect."""
    return find_discrepancy([("plain.csv", record(None))], built_in_wheel())


def test_the_hidden_effect_is_found_with_its_parameters(found: Search) -> None:
    first = found.result.effects[0]
    assert (found.result.verdict, first.name, first.family) == ("inadequate", "stribeck", "mean")
    strength, width = first.parameters["strength_Nm"], first.parameters["stribeck_speed_rad_s"]
    assert abs(strength.value - STRENGTH_NM) < 5 * strength.std + 0.02 * STRENGTH_NM
    assert width.value == pytest.approx(WIDTH_RAD_S, rel=0.05)
    assert [nested.name for nested in nested_models(found)] == ["simulation as it is", "+ stribeck"]


def test_nothing_hidden_nothing_named(nothing: Search) -> None:
    assert nothing.result.verdict == "adequate"
    assert nothing.result.effects == ()
    assert nothing.result.unexplained is None
    gain = nothing.result.gain
    assert gain.rmse_base_Nm == gain.rmse_extended_Nm
    assert gain.log_score_base == gain.log_score_extended


def test_the_views_show_the_effect_before_and_nothing_after(found: Search) -> None:
    views = {view.name: view for view in all_views(found.problem, found.base, found.extended)}
    assert views["speed"].base.p_value < 1e-6
    assert views["speed"].extended.p_value > 1e-3
    near_zero = views["speed"].base.x < WIDTH_RAD_S
    assert np.all(views["speed"].base.y[near_zero] > 0)  # extra drag, both directions folded together
    assert {"temperature", "motor_torque", "angle", "time_since_slew", "slope_per_segment", "tails"} <= set(views)
    for view in views.values():
        assert view.base.x.shape == view.base.y.shape == view.base.error.shape
        assert np.broadcast_to(view.base.expected, view.base.x.shape).shape == view.extended.x.shape


def test_a_plan_ranks_by_separation_and_prefers_what_shows_the_effect(found: Search) -> None:
    planned = rank_manoeuvres(found, ["stribeck"])
    separations = [entry.separation for entry in planned]
    assert separations == sorted(separations, reverse=True)
    worth = {entry.name: entry.separation for entry in planned}
    assert worth["slow zero crossing"] > 25.0
    assert worth["constant speed for an orbit"] < 1.0  # far from zero speed nothing of the effect is left


def test_the_page_stands_alone_and_is_the_same_each_time(found: Search) -> None:
    text = report.html(found, ["hidden.csv"])
    assert re.findall(r"""(?:src|href)=["'][^#]""", text) == []
    assert text.count("<svg") >= 12
    for word in ("stribeck", "hidden.csv", "What to fly next", "extended_wheel.toml", "N m"):
        assert word in text
    seen_nothing_of = text[text.index("Tested and not seen") :]
    assert not any(f">{name}</code>" in seen_nothing_of for name, _ in found.result.untested)
    assert report.html(found, ["hidden.csv"]) == text
    other = report.html(found, ["<script>alert(1)</script>.csv"], "0.1.0+gabc")
    assert "rwa-monitor 0.1.0, build 0.1.0+gabc" in other
    assert "<script>alert" not in other


def test_without_matplotlib_the_page_has_no_pictures_and_names_what_is_missing(
    found: Search, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    monkeypatch.delitem(sys.modules, "rwa_monitor.reporting.figures")
    monkeypatch.delattr("rwa_monitor.reporting.figures")
    page = report.html(found, ["hidden.csv"])
    assert "<svg" not in page
    assert "pip install 'rwa-monitor[plot]'" in page
    assert CATALOGUE["stribeck"].formula[:4] in page


@pytest.mark.parametrize("effect", [*CATALOGUE.values(), *FORMULAS.values()], ids=lambda effect: effect.title)
def test_every_formula_can_be_drawn(effect: type[Effect]) -> None:
    drawn = figures.svg(figures.formula(effect.formula), tight=True)
    assert drawn.count("<use ") > 3


def test_friction_over_speed_shows_the_law_near_zero(found: Search) -> None:
    """The Stribeck rise is drawn: near zero the extended line lies above the straight one, on both sides."""
    axis = figures.friction_over_speed(found).axes[0]
    lines = {str(line.get_label()): line for line in axis.get_lines()}
    simple, extended = lines["simulation as it is"], lines["simulation extended"]
    slow = np.asarray(simple.get_xdata()) < 4.0
    assert slow.sum() >= 2
    assert (np.asarray(extended.get_ydata())[slow] > np.asarray(simple.get_ydata())[slow]).all()


def test_bootstrap_gives_the_smallest_p_value_it_can(found: Search) -> None:
    draws = 3
    effects = with_bootstrap(found, draws, lambda _: None).result.effects
    assert effects[0].p_value == pytest.approx(1 / (1 + draws))


def test_command_writes_report_and_json(tmp_path: Path) -> None:
    table = tmp_path / "hidden.csv"
    table_writer(table)(record(STRIBECK), table)
    result = run("discrepancy", table, "--json", "--plan", "--out", tmp_path / "out")
    assert result.exit_code == 0
    answer = json.loads(result.stdout)
    assert answer["effects"][0]["name"] == "stribeck"
    before, after = (answer["gain"]["diagnosis"][when] for when in ("before", "after"))
    assert after["detection"] > before["detection"]
    assert after["false_changepoints"] < 1.0 < before["false_changepoints"]
    assert answer["plan_question"] == "show what these data could not test"  # the effect itself is certain
    assert all(entry["separation_nats"] > 5.0 and entry["duration_s"] > 0 for entry in answer["plan"])
    written = {"report.html", "report.json", "extended_wheel.toml"}
    assert {path.name for path in (tmp_path / "out").iterdir()} == written
    assert json.loads((tmp_path / "out" / "report.json").read_text())["verdict"] == "inadequate"
    wheel = Wheel.from_toml((tmp_path / "out" / "extended_wheel.toml").read_text(), "extended")
    assert [block.name for block in wheel.effect] == ["stribeck"]
    assert find_discrepancy([("hidden.csv", record(STRIBECK))], wheel).result.verdict == "adequate"


def test_each_thing_is_stated_once_and_many_names_with_what_would_separate_them(found: Search) -> None:
    assert report.sentence(found.result) == "The simulation lacks stribeck (Stribeck effect)."
    dahl = replace(found.result.effects[0], name="presliding")
    assert report.sentence(replace(found.result, effects=(dahl,))) == "The simulation lacks presliding (Dahl)."
    assert report.p_in_words(found, found.result.effects[0]).startswith("≤ ")  # far beyond the largest null
    many = ("torque_bias", "coulomb_asymmetry", "viscous_asymmetry", "presliding")
    wide, three = (
        report.sentence(replace(found.result, effects=(replace(dahl, equivalent=some, separate_by="Fly slowly."),)))
        for some in (many, many[:3])
    )
    assert f"one of 5 effects alike in these data (presliding, {', '.join(many)}): fly slowly" in wide
    assert "or, indistinguishable by these data, torque_bias" in three


def test_the_plan_asks_what_is_open_and_not_what_is_known(found: Search) -> None:
    assert plan(found).manoeuvres == []  # the effect is certain, and the motion showed all others
    assert plan(found).advice == ["nothing is open that a manoeuvre would answer"]
    scenario = Scenario(duration_s=1500.0, speed=SpeedProfile(kind="one_direction"))
    samples = simulate(scenario, built_in_wheel(), np.random.default_rng(7)).samples
    planned = plan(find_discrepancy([("one_direction.csv", samples)], built_in_wheel()))
    assert planned.question == "show what these data could not test"
    best = planned.manoeuvres[0]
    assert {"presliding", "torque_bias"} <= set(best.shows)  # a direction is missing: it changes direction
    assert "zero crossing" in best.name or "direction" in best.name or "reversal" in best.name
    assert best.nats_per_hour == pytest.approx(best.separation * 3600 / best.duration_s)


def test_what_no_manoeuvre_shows_is_reported_with_what_would(found: Search) -> None:
    both = replace(found.result.effects[0], name="coulomb_asymmetry", equivalent=("torque_bias",))
    model = found.extended
    term = make_term(found.problem, MEAN_EFFECTS["coulomb_asymmetry"], {}, model.fit.level)
    asked = Fitting(found.problem, jumps=True).refitted([*model.terms, term], model, [model.fit.jumps])
    nested = (*found.mean.nested, asked)
    search = replace(found, mean=replace(found.mean, nested=nested), result=replace(found.result, effects=(both,)))
    planned = plan(search)
    assert planned.question == "separate coulomb_asymmetry from torque_bias"
    assert any("would separate" in line and "motor" in line for line in planned.advice)


def test_what_is_unexplained_asks_for_the_manoeuvre_that_shows_its_shape(nothing: Search) -> None:
    left = Unexplained(signature="a drag that is periodic in time, every 120 s", size_Nm=1e-5)
    search = replace(nothing, result=replace(nothing.result, verdict="inadequate", unexplained=left))
    assert any("dwell at one speed" in line for line in plan(search).advice)
