"""The alarm's state machine: rules that hold for any sequence of windows and acknowledgements."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwa_monitor.errors import InputError
from rwa_monitor.history.alarms import (
    MODEL_ALARM,
    MONITOR_ALARM,
    Alarm,
    Level,
    Policy,
    acknowledge,
    advance,
    observe,
)
from rwa_monitor.history.database import MonitorState
from rwa_monitor.history.store import History
from tests.history.support import START_NS, diagnosis

LEVELS = st.sampled_from(list(Level))
DEEDS = st.lists(st.one_of(LEVELS, st.just("acknowledge")), max_size=60)
POLICIES = st.integers(1, 5).flatmap(lambda n: st.integers(1, n).map(lambda k: Policy(k=k, n=n)))


def play(actions: list[object], policy: Policy) -> list[tuple[Alarm, list[str], Alarm, object]]:
    """Return each step as (before, events, after, action)."""
    steps = []
    alarm = Alarm()
    for time_ns, action in enumerate(actions):
        before = alarm
        if isinstance(action, Level):
            alarm, events = advance(alarm, action, time_ns, policy)
        else:
            alarm, events = acknowledge(alarm, time_ns)
        steps.append((before, [one.event for one in events], alarm, action))
    return steps


@given(DEEDS, POLICIES)
def test_it_rises_only_when_k_of_the_last_n_windows_are_bad(actions: list[object], policy: Policy) -> None:
    windows: list[Level] = []
    for _, events, _, action in play(actions, policy):
        if isinstance(action, Level):
            windows.append(action)
        if {"raised", "relapsed", "escalated"} & set(events):
            assert sum(level > Level.NORMAL for level in windows[-policy.n :]) >= policy.k


@given(DEEDS, POLICIES)
def test_it_clears_only_when_normal_and_acknowledged(actions: list[object], policy: Policy) -> None:
    seen = False
    for before, events, after, _ in play(actions, policy):
        if "raised" in events:
            seen = False
        seen = seen or "acknowledged" in events
        if "cleared" in events:
            assert seen
            assert not any(after.recent[-policy.n :]) or before.phase == "returned"
            assert after.phase == "quiet"
        elif before.phase != "quiet":
            assert after.phase != "quiet"


@given(DEEDS, POLICIES)
def test_what_is_worse_than_what_was_acknowledged_is_not_acknowledged(actions: list[object], policy: Policy) -> None:
    for _, _, after, _ in play(actions, policy):
        if after.phase == "acknowledged":
            assert after.level <= after.acknowledged_level
        assert after.level <= after.peak or after.phase == "quiet"


def test_one_bad_window_does_not_shout_and_two_do() -> None:
    steps = play([Level.NORMAL, Level.CRITICAL, Level.NORMAL, Level.WATCH], Policy(k=2, n=3))
    assert [events for _, events, _, _ in steps] == [[], [], [], ["raised"]]
    assert steps[-1][2].level == Level.WATCH  # the level that two of three windows reach


def test_a_window_that_decides_nothing_because_its_model_does_not_fit_raises_the_models_alarm_only() -> None:
    window = diagnosis(0, severity=2.0).model_copy(update={"verdict": "inconclusive", "model_adequate": False})
    assert observe(window) == {MODEL_ALARM: Level.WATCH}
    assert observe(window.model_copy(update={"model_adequate": True})) == {}


def test_an_uncertain_severity_counts_as_far_as_it_is_certain() -> None:
    window = diagnosis(0, severity=2.0)
    assert observe(window)["viscous"] == Level.DISTRESS
    doubtful = window.anomalies["viscous"].model_copy(update={"severity_std": 1.7})
    window = window.model_copy(update={"model_adequate": False, "anomalies": {"viscous": doubtful}})
    assert observe(window)["viscous"] == Level.WATCH
    assert observe(window)[MODEL_ALARM] == Level.WATCH


def test_a_partial_window_counts_for_no_alarm() -> None:
    whole = diagnosis(1, severity=4.0)
    assert observe(whole)
    assert observe(whole.model_copy(update={"partial": True})) == {}


# ---- the alarm of a monitor that does not report, in the history -----------------------------------------------------


SILENT = MonitorState("sat", "wheel_1", silent=True, time_ns=START_NS, reason="Silent.")
REPORTING = MonitorState("sat", "wheel_1", silent=False, time_ns=START_NS)


def test_the_alarm_goes_the_way_of_every_other(place: Path | str) -> None:
    with History(place) as history:
        assert history.monitors() == {}
        assert history.take_monitors([REPORTING]) == []
        assert history.monitors() == {("sat", "wheel_1"): False}
        (alarm,) = history.take_monitors([SILENT])
        assert (alarm.name, alarm.level, alarm.phase, alarm.reason) == (MONITOR_ALARM, "warning", "active", "Silent.")
        assert "rwa-monitor run" in alarm.advice
        assert history.take_monitors([SILENT]) == [], "no second one"
    with History(place) as history:
        assert history.monitors() == {("sat", "wheel_1"): True}
        history.add(diagnosis(0))  # a window, taken in late, shows nothing of the monitor
        (alarm,) = history.open_alarms("sat", "wheel_1")
        history.acknowledge(alarm.id, "Ann")
        with pytest.raises(InputError, match="acknowledged already"):
            history.acknowledge(alarm.id, "Ann")
        (alarm,) = history.take_monitors([REPORTING])
        assert alarm.closed_ns == START_NS
        assert [line.event for line in alarm.trail] == ["raised", "acknowledged", "returned", "cleared"]
        assert history.monitors() == {("sat", "wheel_1"): False}


def test_one_that_is_not_acknowledged_stays_and_comes_again(history: History) -> None:
    history.add(diagnosis(0))
    history.take_monitors([REPORTING])
    history.take_monitors([SILENT])
    (alarm,) = history.take_monitors([REPORTING])
    assert (alarm.phase, alarm.level, alarm.closed_ns) == ("returned", "normal", None)
    later = MonitorState("sat", "wheel_1", silent=True, reason="Again.")  # its clock is not known: as it was
    (alarm,) = history.take_monitors([later])
    assert (alarm.phase, alarm.reason, alarm.changed_ns) == ("active", "Again.", START_NS)
    assert [line.event for line in alarm.trail] == ["raised", "returned", "relapsed"]
