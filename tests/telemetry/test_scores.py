"""Event-wise scores: those of ESA-ADB's own code on fixed cases, hand-made ones, and what holds for all cases.

The figures of `esa_adb.json` were printed once by the code of github.com/kplabs-pl/ESA-ADB, commit 489cb61 (MIT
licence), with `ESAScores(betas=0.5)` and `ADTQC()` on one channel, hours from 1970-01-01, numpy 2.4, pandas 3.1,
portion 2.6; it is not in this repository. On 899 random cases its scores and ours agreed to 3e-14, and
`affiliation_recall_nearest` with the authors' own code, github.com/ahstat/affiliation-metrics-py. Without an alarm, or
a time free of events, ESA-ADB's code raises an exception.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rwa_monitor.telemetry.scores import Interval, Timeline, score

HOUR_NS = 3600 * 10**9
EQUAL = {"rel": 0.0, "abs": 1e-12}

# By the name of the case: end, events and alarms in hours, and what ESA-ADB's code gives.
ESA: dict[str, dict[str, Any]] = json.loads((Path(__file__).parent / "esa_adb.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("case", ESA.values(), ids=ESA)
def test_equal_to_the_code_of_esa_adb(case: dict[str, Any]) -> None:
    timeline = Timeline(0, case["end"] * HOUR_NS, _hours(case["events"]), _hours(case["alarms"]))
    found = asdict(score([timeline]))
    assert {name: found[name] for name in case["scores"]} == pytest.approx(case["scores"], **EQUAL)


def _hours(intervals: list[Interval]) -> list[Interval]:
    return [(start * HOUR_NS, end * HOUR_NS) for start, end in intervals]


# ---- by hand ---------------------------------------------------------------------------------------------------------


def test_counts_and_times_of_timelines_are_summed() -> None:
    # 1 of 2 events found, 1 false alarm of two alarms; 10 of 70 without an event are alarmed.
    found = score([Timeline(0, 50, [(10, 20)], [(10, 20), (30, 40)]), Timeline(0, 40, [(0, 10)])])
    assert (found.events, found.detected, found.false_alarms, found.redundant_alarms) == (2, 1, 1, 0)
    assert found.precision == pytest.approx(1 / 2 * (1 - 10 / 70))
    assert found.recall == 0.5


def test_the_nearest_alarm_gives_the_recall_of_the_definition() -> None:
    # Event (70, 90), alarm (75, 80): times up to 5 before it and 10 after it, at d from it 2 d of 100 are nearer.
    found = score([Timeline(0, 100, [(70, 90)], [(5, 10), (20, 30), (75, 80)])])
    assert found.affiliation_recall_nearest == pytest.approx(1 - (5**2 + 10**2) / 100 / 20, **EQUAL)


def test_without_events_only_alarms_count() -> None:
    found = score([Timeline(0, 100, [], [(10, 20)])])
    assert (found.events, found.false_alarms, found.precision) == (0, 1, 0.0)
    assert {found.recall, found.f_0_5, found.timing, found.affiliation_precision} == {None}


# ---- for all cases ---------------------------------------------------------------------------------------------------

END = 1000
INTERVALS = st.lists(
    st.tuples(st.integers(0, END - 1), st.integers(1, 100)).map(lambda one: (one[0], min(one[0] + one[1], END))),
    max_size=8,
)
TIMELINES = st.builds(Timeline, st.just(0), st.just(END), INTERVALS, INTERVALS)


@given(TIMELINES)
@settings(max_examples=200, deadline=None)
def test_scores_lie_between_0_and_1(timeline: Timeline) -> None:
    shares = [value for value in asdict(score([timeline])).values() if isinstance(value, float)]
    assert all(-1e-12 <= share <= 1.0 + 1e-12 for share in shares)


@given(st.sets(st.integers(0, 99), min_size=2).filter(lambda ends: len(ends) % 2 == 0))
@settings(max_examples=100, deadline=None)
def test_perfect_detection_is_1(ends: set[int]) -> None:
    edges = sorted(ends)
    events = list(zip(edges[::2], edges[1::2], strict=True))
    found = score([Timeline(0, 100, events, events)])
    scores = {name: value for name, value in asdict(found).items() if isinstance(value, float)}
    assert scores == pytest.approx(dict.fromkeys(scores, 1.0), **EQUAL)
    assert (found.detected, found.false_alarms, found.redundant_alarms) == (len(events), 0, 0)


@given(TIMELINES)
@settings(max_examples=50, deadline=None)
def test_dummies_show_what_a_score_is_worth(timeline: Timeline) -> None:
    always, never = score([timeline.always]), score([timeline.never])
    assert (never.precision, never.recall) == (0.0, 0.0 if timeline.events else None)
    assert always.recall == (1.0 if timeline.events else None)
    if timeline.events:
        assert (always.precision, always.f_0_5) == (0.0, 0.0)  # some of the time is free of events
        assert never.affiliation_precision == 0.5


@given(TIMELINES, st.integers(-(2**61), 2**61))
@settings(max_examples=100, deadline=None)
def test_the_origin_of_time_changes_nothing(timeline: Timeline, by: int) -> None:
    events, alarms = ([(a + by, b + by) for a, b in given] for given in (timeline.events, timeline.alarms))
    assert score([Timeline(by, END + by, events, alarms)]) == score([timeline])


@given(st.lists(TIMELINES, max_size=4), st.randoms(use_true_random=False))
@settings(max_examples=100, deadline=None)
def test_order_changes_nothing(timelines: list[Timeline], random: Any) -> None:
    def mixed(given: Sequence[Any]) -> list[Any]:
        return random.sample(given, len(given))

    shuffled = [one._replace(events=mixed(one.events), alarms=mixed(one.alarms)) for one in mixed(timelines)]
    assert score(shuffled) == score(timelines)
