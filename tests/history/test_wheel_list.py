"""Wheels that are put aside: who did it, what hinders it, and that a wheel that speaks is back once."""

from __future__ import annotations

from pathlib import Path

import pytest

from rwa_monitor.errors import InputError
from rwa_monitor.history.store import History
from tests.history.support import diagnosis


def test_a_wheel_is_put_aside_and_back_and_every_deed_is_kept(place: Path | str) -> None:
    clock = iter(range(1_000))
    with History(place, wall_ns=lambda: next(clock)) as history:
        history.add_all([diagnosis(0), diagnosis(1)])
        line = history.wheel_list.put_aside("sat", "wheel_1", " Ann ", "retired")
        assert (line.aside, line.person, line.time_ns) == (True, "Ann", diagnosis(1).window_end_ns)
        assert history.wheel_list.latest() == [line]
        with pytest.raises(InputError, match="put aside already, by Ann"):
            history.wheel_list.put_aside("sat", "wheel_1", "Ben")
        assert not history.wheel_list.bring_back("sat", "wheel_1", "Ben").aside
        with pytest.raises(InputError, match="is not put aside"):
            history.wheel_list.bring_back("sat", "wheel_1", "Ben")
        again = history.wheel_list.put_aside("sat", "wheel_1", "Ann")
        back = again.model_copy(update={"event": "spoke_again", "person": ""})
        history.wheel_list.spoke_again([back])
        history.wheel_list.spoke_again([back])  # a second dashboard on the same database heard it too
    with History(place) as history:
        deeds = [(line.event, line.person) for line in history.wheel_list.lines("sat", "wheel_1")]
        assert deeds == [("put_aside", "Ann"), ("brought_back", "Ben"), ("put_aside", "Ann"), ("spoke_again", "")]
        assert [line.event for line in history.wheel_list.latest()] == ["spoke_again"]
        assert history.windows("sat", "wheel_1") == [diagnosis(0), diagnosis(1)]  # nothing of the wheel is removed


def test_a_wheel_whose_alarm_nobody_has_seen_is_not_put_aside(place: Path | str) -> None:
    with History(place) as history:
        history.add_all([diagnosis(n, severity=1.0) for n in range(2)])
        with pytest.raises(InputError, match="alarms to acknowledge first: viscous"):
            history.wheel_list.put_aside("sat", "wheel_1", "Ann")
        history.acknowledge(1, "Ann")
        history.wheel_list.put_aside("sat", "wheel_1", "Ann")
        assert len(history.open_alarms("sat", "wheel_1")) == 1  # it stays as it is


@pytest.mark.parametrize("person", ["", "  ", "n" * 101])
def test_nobody_puts_a_wheel_aside_without_a_name(person: str) -> None:
    with History(None) as history, pytest.raises(InputError, match="name"):
        history.wheel_list.put_aside("sat", "wheel_1", person)
