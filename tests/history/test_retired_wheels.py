"""Retired wheels: who did it, what hinders it, and that a wheel whose telemetry arrives is back once."""

from __future__ import annotations

from pathlib import Path

import pytest

from rwa_monitor.errors import InputError
from rwa_monitor.history.store import History
from tests.history.support import diagnosis


def test_a_wheel_is_retired_and_back_and_every_event_is_kept(place: Path | str) -> None:
    clock = iter(range(1_000))
    with History(place, wall_ns=lambda: next(clock)) as history:
        history.add(*[diagnosis(0), diagnosis(1)])
        line = history.retired.change("sat", "wheel_1", "Ann", "retired", retire=True)
        assert (line.retired, line.person, line.time_ns) == (True, "Ann", diagnosis(1).window_end_ns)
        assert history.retired.latest() == [line]
        with pytest.raises(InputError, match="is retired already, by Ann"):
            history.retired.change("sat", "wheel_1", "Ben", retire=True)
        assert not history.retired.change("sat", "wheel_1", "Ben", retire=False).retired
        with pytest.raises(InputError, match="is not retired"):
            history.retired.change("sat", "wheel_1", "Ben", retire=False)
        again = history.retired.change("sat", "wheel_1", "Ann", retire=True)
        back = again.model_copy(update={"event": "telemetry_arrived", "person": ""})
        history.retired.record([back])
        history.retired.record([back])  # a second dashboard on the same database had its telemetry too
    with History(place) as history:
        events = [(line.event, line.person) for line in history.retired.events("sat", "wheel_1")]
        assert events == [("retired", "Ann"), ("brought_back", "Ben"), ("retired", "Ann"), ("telemetry_arrived", "")]
        assert [line.event for line in history.retired.latest()] == ["telemetry_arrived"]
        assert history.windows("sat", "wheel_1") == [diagnosis(0), diagnosis(1)]  # nothing of the wheel is removed


def test_a_wheel_with_an_alarm_to_acknowledge_is_not_retired(history: History) -> None:
    history.add(*[diagnosis(n, severity=1.0) for n in range(2)])
    with pytest.raises(InputError, match="alarms to acknowledge first: viscous"):
        history.retired.change("sat", "wheel_1", "Ann", retire=True)
    history.acknowledge(1, "Ann")
    history.retired.change("sat", "wheel_1", "Ann", retire=True)
    assert len(history.open_alarms("sat", "wheel_1")) == 1  # it stays as it is
