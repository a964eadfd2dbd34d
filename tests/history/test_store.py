"""The history on a real SQLite file."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import pytest

from rwa_monitor.errors import InputError
from rwa_monitor.history.store import DAY_NS, History, HistoryError, Retention
from tests.history.support import WINDOW_NS, diagnosis


def test_a_window_taken_in_again_makes_no_double_and_no_alarm(tmp_path: Path) -> None:
    windows = [diagnosis(0), diagnosis(1, severity=1.0), diagnosis(2, severity=1.0)]
    with History(tmp_path / "h.sqlite3") as history:
        assert history.add_all(windows) == 3
        before = history.alarms()
        assert history.add_all(windows) == 0
        assert history.windows("sat", "wheel_1") == windows
        assert history.alarms() == before
        assert [line.event for line in before[0].trail] == ["raised"]
        assert len(history.estimates("sat", "wheel_1")) == 3


def test_what_was_acknowledged_is_kept_and_clears_when_normal(tmp_path: Path) -> None:
    path = tmp_path / "h.sqlite3"
    with History(path) as history:
        history.add_all([diagnosis(n, severity=1.0) for n in range(2)])
        history.acknowledge(1, "Ann", "lubricant ordered")
        with pytest.raises(InputError, match="acknowledged already"):
            history.acknowledge(1, "Ben")
    with History(path) as history:
        (alarm,) = history.alarms()
        assert (alarm.phase, alarm.trail[-1].person, alarm.trail[-1].note) == (
            "acknowledged",
            "Ann",
            "lubricant ordered",
        )
        history.add_all([diagnosis(n) for n in range(2, 5)])
        (alarm,) = history.alarms()
        assert alarm.closed_ns is not None
        assert [line.event for line in alarm.trail] == ["raised", "acknowledged", "eased", "returned", "cleared"]


def test_a_locked_database_is_said_and_nothing_is_half_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rwa_monitor.history.store.BUSY_TIMEOUT_S", 0.05)
    path = tmp_path / "h.sqlite3"
    with History(path) as history:
        other = sqlite3.connect(path, isolation_level=None)
        other.execute("BEGIN IMMEDIATE")
        with pytest.raises(HistoryError, match="locked"):
            history.add(diagnosis(0))
        other.execute("COMMIT")
        other.close()
        assert history.windows("sat", "wheel_1") == []
        assert history.add(diagnosis(0))


def test_no_database_is_refused_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "h.sqlite3").write_text("this is no database, but a text that is long enough to be read as one")
    with pytest.raises(InputError, match="not a database"):
        History(tmp_path / "h.sqlite3")


def test_retention_keeps_estimates_longer_than_diagnoses(tmp_path: Path) -> None:
    with History(tmp_path / "h.sqlite3") as history:
        history.add_all([diagnosis(n) for n in range(10)])
        removed = history.prune(Retention(diagnoses_days=2.5 * WINDOW_NS / DAY_NS))
        assert removed == 7
        assert len(history.windows("sat", "wheel_1")) == 3
        assert len(history.estimates("sat", "wheel_1")) == 10
