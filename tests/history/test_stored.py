"""Stored telemetry in the history: windows that come late and again, and the alarms that they raise."""

from itertools import permutations

from rwa_monitor.history.store import History
from rwa_monitor.messages import Diagnosis
from tests.history.support import diagnosis


def stored(number: int, severity: float | None = None, **changes: object) -> Diagnosis:
    return diagnosis(number, severity=severity).model_copy(update={"data": "stored", **changes})


def test_a_stored_window_takes_the_place_of_the_one_before_it_and_a_live_one_never_does(history: History) -> None:
    live, complete = diagnosis(0).model_copy(update={"coverage": 0.2}), stored(0)
    again = stored(0, severity=1.0)
    assert history.add(live)[0] == 1
    assert history.add(complete)[0] == 0
    assert history.windows("sat", "wheel_1") == [complete]
    history.add(live)
    assert history.windows("sat", "wheel_1") == [complete]
    history.add(again)
    assert history.windows("sat", "wheel_1") == [again]
    (estimate,) = history.estimates("sat", "wheel_1")
    assert estimate.active


def test_stored_windows_raise_an_alarm_of_their_own_with_their_times_in_whatever_order_they_come(
    history: History,
) -> None:
    windows = [stored(n, severity=1.0 if n in (1, 2) else None) for n in range(4)]
    for number, order in enumerate(permutations(windows)):
        wheel = f"wheel_{number + 2}"
        for window in order:
            history.add(window.model_copy(update={"wheel": wheel}))
        (alarm,) = history.open_alarms("sat", wheel)
        assert (alarm.name, alarm.level) in {("viscous (stored)", "warning"), ("viscous (stored)", "watch")}
        assert alarm.peak == "warning"
        assert alarm.raised_ns in {windows[1].window_end_ns, windows[2].window_end_ns}


def test_one_bad_stored_window_among_good_ones_raises_none(history: History) -> None:
    windows = [stored(n, severity=1.0 if n == 1 else None) for n in range(4)]
    for number, order in enumerate(permutations(windows)):
        for window in order:
            history.add(window.model_copy(update={"wheel": f"wheel_{number}"}))
    assert history.alarms() == []


def test_stored_windows_change_no_live_alarm(history: History) -> None:
    history.add(*(diagnosis(n, severity=1.0) for n in (8, 9)))
    (before,) = history.alarms()
    history.add(*(stored(n) for n in range(6)), *(stored(n) for n in (10, 11, 12)))
    assert history.alarms() == [before]
    history.add(*(stored(n, severity=4.0) for n in range(13, 16)))
    live, early = sorted(history.alarms(), key=lambda alarm: alarm.name)
    assert live == before
    assert (early.name, early.level, early.phase) == ("viscous (stored)", "critical", "active")
    assert "of earlier" in early.advice


def test_an_alarm_of_stored_windows_is_closed_by_whoever_has_seen_it(history: History) -> None:
    history.add(*(stored(n, severity=1.0) for n in range(2)))
    (alarm,) = history.alarms()
    seen = history.acknowledge(alarm.id, "Ann")
    assert seen.closed_ns is not None
    assert [line.event for line in seen.trail] == ["raised", "acknowledged", "cleared"]
    history.add(*(stored(n, severity=1.0) for n in (2, 3)))
    assert len(history.open_alarms("sat", "wheel_1")) == 1  # one more
