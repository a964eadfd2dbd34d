"""The trends of whole wheels of the recipe `fleet`: simulated, diagnosed window by window, and followed to a limit."""

from __future__ import annotations

from dataclasses import dataclass, replace

import pytest

from rwa_monitor.monitor.core import diagnose_samples
from rwa_monitor.reporting.diagnoses import EstimateRecord, coefficient_trend
from rwa_monitor.simulation.datasets import FLEET_SEVERITIES, RECIPES, LabelledWindow, generate

LIFE = 16  # windows of a wheel here


def estimate(*values: object) -> EstimateRecord:
    judged = ("dry", 0.5, None, False)
    return EstimateRecord.model_validate(dict(zip(EstimateRecord.model_fields, (*values, *judged), strict=True)))


@dataclass(frozen=True)
class Course:
    """What was estimated of one wheel, and what was true."""

    windows: list[LabelledWindow]
    estimates: dict[str, list[EstimateRecord]]


@pytest.fixture(scope="module")
def fleet() -> list[Course]:
    """Three wheels: a healthy one, one with growing dry, one with growing viscous friction."""
    windows = list(generate(replace(RECIPES["fleet"], windows=LIFE), 3 * LIFE, 4))
    courses = []
    for start in range(0, 3 * LIFE, LIFE):
        part = windows[start : start + LIFE]
        found = [next(iter(diagnose_samples(w.telemetry.samples, w.wheel, None))).diagnosis.friction for w in part]
        length_ns = part[0].wheel.window.samples * part[0].wheel.period_ns
        estimates = {
            name: [
                estimate(k * length_ns, (k + 1) * length_ns, v.value, v.std, None, None, v.unit)
                for k, v in enumerate(values)
            ]
            for name, values in (("dry", [d.base_dry for d in found]), ("viscous", [d.viscous for d in found]))
        }
        courses.append(Course(part, estimates))
    assert [list(course.windows[-1].scenario.anomalies) for course in courses] == [[], ["dry"], ["viscous"]]
    return courses


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
