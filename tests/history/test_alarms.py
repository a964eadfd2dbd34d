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
def test_any_sequence_of_windows_and_acknowledgements_keeps_the_rules(actions: list[object], policy: Policy) -> None:
    windows: list[Level] = []
    seen = False
    for before, events, after, action in play(actions, policy):
        if isinstance(action, Level):
            windows.append(action)
        if {"raised", "relapsed", "escalated"} & set(events):  # only when k of the last n windows are bad
            assert sum(level > Level.NORMAL for level in windows[-policy.n :]) >= policy.k
        seen = (seen and "raised" not in events) or "acknowledged" in events
        if "cleared" in events:  # only when normal and acknowledged
            assert seen
            assert not any(after.recent[-policy.n :]) or before.phase == "returned"
            assert after.phase == "quiet"
        elif before.phase != "quiet":
            assert after.phase != "quiet"
        if after.phase == "acknowledged":  # not what is worse than what was acknowledged
            assert after.level <= after.acknowledged_level
        assert after.level <= after.peak or after.phase == "quiet"


def test_one_bad_window_does_not_shout_and_two_do() -> None:
    steps = play([Level.NORMAL, Level.CRITICAL, Level.NORMAL, Level.WATCH], Policy(k=2, n=3))
    assert [events for _, events, _, _ in steps] == [[], [], [], ["raised"]]
    assert steps[-1][2].level == Level.WATCH  # the level that two of three windows reach


UNCERTAIN = diagnosis(0).anomalies["viscous"].model_copy(update={"active": True, "severity": 2.0, "severity_std": 1.7})


@pytest.mark.parametrize(
    ("changes", "levels"),
    [
        ({}, {"viscous": Level.DISTRESS, MODEL_ALARM: Level.NORMAL}),
        # An uncertain severity counts as far as it is certain where the model does not fit.
        (
            {"model_adequate": False, "anomalies": {"viscous": UNCERTAIN}},
            {"viscous": Level.WATCH, MODEL_ALARM: Level.WATCH},
        ),
        ({"verdict": "inconclusive", "model_adequate": False}, {MODEL_ALARM: Level.WATCH}),
        ({"verdict": "inconclusive"}, {}),
        ({"partial": True}, {}),
    ],
)
def test_a_window_gives_levels_to_the_alarms_that_it_decides(
    changes: dict[str, object], levels: dict[str, Level]
) -> None:
    assert observe(diagnosis(0, severity=2.0).model_copy(update=changes)) == levels


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
