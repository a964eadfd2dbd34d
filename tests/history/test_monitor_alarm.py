"""The alarm of a monitor that does not report, in the history: as every other, but by its reports, not by windows."""

from pathlib import Path

import pytest

from rwa_monitor.errors import InputError
from rwa_monitor.history.alarms import MONITOR_ALARM
from rwa_monitor.history.database import MonitorState
from rwa_monitor.history.store import History
from tests.history.support import START_NS, diagnosis

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
