"""The trends of whole wheels of the recipe `fleet`: simulated, diagnosed window by window, and followed to a limit."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass

import pytest

import rwa_monitor as rwa
from rwa_monitor.monitor.core import diagnose_samples
from rwa_monitor.monitor.trends import FrictionEstimate, coefficient_trend
from rwa_monitor.simulation.datasets import FLEET_SEVERITIES, LabelledWindow, generate

LIFE = 16  # windows of a wheel here


def estimate(*values: object) -> FrictionEstimate:
    return FrictionEstimate.model_validate(dict(zip(FrictionEstimate.model_fields, values, strict=True)))


@dataclass(frozen=True)
class Course:
    """What was estimated of one wheel, and what was true."""

    windows: list[LabelledWindow]
    estimates: dict[str, list[FrictionEstimate]]


@pytest.fixture(scope="module")
def fleet() -> list[Course]:
    """Three wheels: a healthy one, one with growing dry, one with growing viscous friction."""
    windows = list(generate("fleet", 3 * LIFE, 4, windows=LIFE))
    courses = []
    for start in range(0, 3 * LIFE, LIFE):
        part = windows[start : start + LIFE]
        found = [next(iter(diagnose_samples(w.telemetry.samples, w.wheel, None))).diagnosis for w in part]
        length_ns = part[0].wheel.window.samples * part[0].wheel.period_ns
        estimates = {
            name: [
                estimate(k * length_ns, (k + 1) * length_ns, v.value, v.std, None, None, v.unit)
                for k, v in enumerate(values)
            ]
            for name, values in (("dry", [d.base_dry for d in found]), ("viscous", [d.viscous for d in found]))
        }
        courses.append(Course(part, estimates))
    return courses


def test_the_fleet_is_what_the_test_needs(fleet: list[Course]) -> None:
    assert [list(course.windows[-1].scenario.anomalies) for course in fleet] == [[], ["dry"], ["viscous"]]


@pytest.mark.parametrize("name", ["dry", "viscous"])
def test_nothing_grows_on_wheels_that_lack_it(fleet: list[Course], name: str) -> None:
    for course in fleet:
        if name in course.windows[0].scenario.anomalies:
            continue
        trend = coefficient_trend(name, course.estimates[name], 1e9)
        assert not trend.trend.present, trend.sentence()
        assert trend.reach is None
        assert trend.sentence().startswith("No trend of ")


@pytest.mark.parametrize(("wheel", "name"), [(1, "dry"), (2, "viscous")])
def test_a_growth_is_found_and_its_limit_predicted(fleet: list[Course], wheel: int, name: str) -> None:
    course, seen = fleet[wheel], 12
    truth = course.windows[0].telemetry.truth
    healthy = float((truth.base_dry_Nm if name == "dry" else truth.viscous_Nm_s_rad)[0])
    share = 0.95  # of the growth at the end of the life
    limit = healthy * (1.0 + share * (FLEET_SEVERITIES[name] - 1.0))
    anomaly = course.windows[0].scenario.anomalies[name]
    trend = coefficient_trend(name, course.estimates[name][:seen], limit)
    assert trend.trend.present, trend.sentence()
    assert trend.reach.low_s <= anomaly.onset_s + share * anomaly.growth_s <= trend.reach.high_s
    assert "grows by" in trend.sentence()
    document = json.loads(json.dumps(trend.document()))
    assert document["present"]
    assert document["reach_ns"][0] <= document["reach_ns"][1]
    assert len(document["line"]["time_ns"]) == len(document["line"]["value"]) == len(document["line"]["std"])


def test_times_since_1970_lose_nothing(fleet: list[Course]) -> None:
    plain = fleet[1].estimates["dry"]
    epoch_ns = 1_800_000_000_123_456_789
    late = [
        e.model_copy(
            update={"window_start_ns": epoch_ns + e.window_start_ns, "window_end_ns": epoch_ns + e.window_end_ns}
        )
        for e in plain
    ]
    limit = 10.0 * plain[0].value
    one, other = coefficient_trend("dry", plain, limit), coefficient_trend("dry", late, limit)
    assert one.reach == other.reach
    assert other.at_ns(1.5) == epoch_ns + 1_500_000_000
    assert other.at_ns(float("inf")) is None


def test_diagnoses_in_any_order_give_the_same(fleet: list[Course]) -> None:
    wheel = (
        fleet[1]
        .windows[0]
        .wheel.model_copy(
            update={"window": fleet[1].windows[0].wheel.window.model_copy(update={"samples": 10_000, "hop": 10_000})}
        )
    )
    diagnoses = rwa.diagnose(fleet[1].windows[0].telemetry.samples, wheel)
    assert len(diagnoses) == 8
    forth, back = rwa.wheel_trends(diagnoses), rwa.wheel_trends(diagnoses[::-1])
    assert forth.keys() == back.keys()
    assert [t.document() for t in forth.values()] == [t.document() for t in back.values()]
    assert rwa.wheel_trends([]) == {}


HOUR_NS = 3_600_000_000_000


def growing(step: float) -> list[FrictionEstimate]:
    """Return twelve windows of an hour in which a coefficient grows by `step` a window."""
    return [estimate(k * HOUR_NS, (k + 1) * HOUR_NS, 1e-3 + k * step, 1e-6, 0.9e-3, 2e-3, "N m") for k in range(12)]


@pytest.mark.parametrize(
    ("step", "limit", "end"),
    [
        (1e-5, None, r"reaches its limit of 2 mN m in 3\.\d days \(95 %: 3\.\d to (3|4)(\.\d)?\)\."),
        (1e-5, 1.2e-3, r"reaches its limit of 1\.2 mN m in (8\.\d|9)(\.\d)? hours \(95 %: \d\S* to \d\S*\)\."),
        (1e-5, 1.05e-3, r"is beyond its limit of 1\.05 mN m\."),
        (1e-5, 1e9, r"is far from its limit of 1e\+09 N m\."),
        (-1e-5, None, r"is beyond its limit of 0\.9 mN m\."),
    ],
)
def test_the_sentence_names_the_limit_and_its_time(step: float, limit: float | None, end: str) -> None:
    trend = coefficient_trend("dry", growing(step), limit)
    course = "grows" if step > 0 else "falls"
    expected = rf"Base dry friction {course} by 0\.24\d mN m a day \(± \S+ µN m, p < 1e-09\) and {end}"
    assert re.fullmatch(expected, trend.sentence()), trend.sentence()
