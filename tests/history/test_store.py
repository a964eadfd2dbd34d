"""The history on a real SQLite file."""

import sqlite3
from collections.abc import Iterator
from itertools import permutations
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sqlalchemy import create_engine, text

from rwa_monitor.errors import InputError
from rwa_monitor.history.alarms import MODEL_ALARM, Level, advice
from rwa_monitor.history.database import AlarmRecord, HistoryError
from rwa_monitor.history.store import History
from rwa_monitor.messages import Diagnosis
from rwa_monitor.samples import SECONDS_PER_DAY
from tests.history.support import WINDOW_NS, diagnosis, discrepancy


def test_what_was_acknowledged_is_kept_and_clears_when_normal(place: Path | str) -> None:
    with History(place) as history:
        history.add(*[diagnosis(n, severity=1.0) for n in range(2)])
        history.acknowledge(1, "Ann", "lubricant ordered")
        with pytest.raises(InputError, match="acknowledged already"):
            history.acknowledge(1, "Ben")
    with History(place) as history:
        (alarm,) = history.alarms()
        line = alarm.trail[-1]
        assert (alarm.phase, line.person, line.note) == ("acknowledged", "Ann", "lubricant ordered")
        history.add(*[diagnosis(n) for n in range(2, 5)])
        (alarm,) = history.alarms()
        assert alarm.closed_ns is not None
        assert [line.event for line in alarm.trail] == ["raised", "acknowledged", "eased", "returned", "cleared"]


def test_an_alarm_advises_what_to_do_at_its_level() -> None:
    advised = {advice(name, level) for name in ("dry", MODEL_ALARM) for level in Level}
    assert len(advised) == len(Level) + 1  # of the model, the same at each level but normal
    assert advice("dry", Level.CRITICAL).startswith("Now")
    assert "do not extend" in advice(MODEL_ALARM, Level.WATCH)


def test_a_locked_database_is_reported_and_nothing_is_half_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rwa_monitor.history.database.BUSY_TIMEOUT_S", 0.05)
    path = tmp_path / "h.sqlite3"
    with History(path) as history:
        other = sqlite3.connect(path, isolation_level=None)
        other.execute("BEGIN IMMEDIATE")
        with pytest.raises(HistoryError, match="locked"):
            history.add(diagnosis(0))
        other.execute("COMMIT")
        other.close()
        assert history.windows("sat", "wheel_1") == []
        assert history.add(diagnosis(0)) == (1, [])


def test_no_database_is_refused_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "h.sqlite3").write_text("this is no database, but a text that is long enough to be read as one")
    with pytest.raises(InputError, match="not a database"):
        History(tmp_path / "h.sqlite3")


def test_estimates_are_kept_longer_than_diagnoses(history: History, monkeypatch: pytest.MonkeyPatch) -> None:
    a_window = WINDOW_NS * 1e-9 / SECONDS_PER_DAY
    monkeypatch.setattr("rwa_monitor.history.store.DIAGNOSES_DAYS", 2.5 * a_window)
    monkeypatch.setattr("rwa_monitor.history.store.ESTIMATES_DAYS", 10.5 * a_window)
    windows = [diagnosis(n) for n in range(50)]
    for window in windows:
        history.add(window)
    history.prune()
    assert len(history.windows("sat", "wheel_1")) == 3
    kept = history.estimates("sat", "wheel_1")
    assert [one.window_end_ns for one in kept] == [window.window_end_ns for window in windows[-11:]]
    history.prune()
    assert history.estimates("sat", "wheel_1") == kept
    # An old recording that is imported again does not bring back what was let go.
    assert history.add(*windows) == (0, [])
    assert history.estimates("sat", "wheel_1") == kept


@settings(max_examples=30)
@given(st.lists(st.integers(0, 14), max_size=40))
def test_importing_in_any_order_and_again_and_again_makes_no_doubles_and_no_alarms(order: list[int]) -> None:
    windows = {number: diagnosis(number, severity=1.0 if number % 3 else None) for number in order}
    with TemporaryDirectory() as folder, History(Path(folder, "h.sqlite3")) as history:
        assert sum(history.add(windows[number])[0] for number in order) == len(windows)
        before = history.alarms()
        assert history.add(*windows.values()) == (0, [])
        assert history.alarms() == before
        assert history.windows("sat", "wheel_1") == [windows[number] for number in sorted(windows)]
        assert len(history.estimates("sat", "wheel_1")) == len(windows)


def test_a_database_that_is_removed_is_reported(tmp_path: Path) -> None:
    path = tmp_path / "h.sqlite3"
    with History(path) as history:
        history.add(diagnosis(0))
        path.rename(tmp_path / "aside")
        with pytest.raises(HistoryError, match="is gone"):
            history.add(diagnosis(1))
        (tmp_path / "aside").rename(path)
        assert history.add(diagnosis(1)) == (1, [])


def test_the_latest_discrepancy_report_of_a_wheel_is_kept(history: History) -> None:
    assert history.discrepancy("sat", "wheel_1") is None
    history.add_discrepancy(discrepancy(2))
    history.add_discrepancy(discrepancy(1))
    assert history.discrepancy("sat", "wheel_1") == discrepancy(2).to_json()


def test_an_alarm_is_shelved_for_a_while_and_comes_back_when_it_gets_worse(place: Path | str) -> None:
    with History(place, wall_ns=lambda: 1_000) as history:
        history.add(*[diagnosis(n, severity=0.6) for n in range(2)])
        alarm = history.shelve(1, "Ann", 2.0, "known")
        assert alarm.shelved_until_wall_ns == 1_000 + 2_000_000_000
        history.add(diagnosis(2, severity=0.6))
        assert history.alarms()[0].shelved_until_wall_ns is not None
        assert history.shelve(1, "Ann", 0.0).shelved_until_wall_ns is None
        history.shelve(1, "Ben", 2.0)
        history.add(*[diagnosis(n, severity=4.0) for n in range(3, 5)])
        (alarm,) = history.alarms()
        assert (alarm.level, alarm.shelved_until_wall_ns) == ("critical", None)
        events = [(line.event, line.person) for line in alarm.trail]
        assert events[:4] == [("raised", ""), ("shelved", "Ann"), ("unshelved", "Ann"), ("shelved", "Ben")]
        assert sorted(events[4:]) == [("escalated", ""), ("unshelved", "")]
        for unknown in (2, 2**70):
            with pytest.raises(InputError):
                history.shelve(unknown, "Ann", 1.0)


# ---- places that cannot hold the tables ------------------------------------------------------------------------------


def test_a_database_of_another_release_is_refused(place: Path | str) -> None:
    with History(place):
        pass
    url = f"sqlite:///{place}" if isinstance(place, Path) else place.replace("postgresql://", "postgresql+psycopg://")
    engine = create_engine(url)
    with engine.begin() as connection:
        connection.execute(text("UPDATE revision SET number = 9999"))
    engine.dispose()
    with pytest.raises(InputError, match="another release"):
        History(place)


@pytest.mark.parametrize("url", ["mysql://host/name", "nothing", "postgresql://rwa:secret@127.0.0.1:9/none"])
def test_a_place_that_is_none_is_refused_without_its_password(url: str) -> None:
    with pytest.raises(InputError) as refused:
        History(url)
    assert "secret" not in str(refused.value)


# ---- stored telemetry ------------------------------------------------------------------------------------------------


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


def in_any_order(history: History, *bad: int) -> Iterator[tuple[list[Diagnosis], list[AlarmRecord]]]:
    """Add four stored windows, some of them bad, in each order; yields them with the open alarms that they leave."""
    windows = [stored(number, severity=1.0 if number in bad else None) for number in range(4)]
    for number, order in enumerate(permutations(windows)):
        for window in order:
            history.add(window.model_copy(update={"wheel": f"wheel_{number}"}))
        yield windows, history.open_alarms("sat", f"wheel_{number}")


def test_stored_windows_raise_an_alarm_of_their_own_with_their_times_in_whatever_order_they_come(
    history: History,
) -> None:
    for windows, (alarm,) in in_any_order(history, 1, 2):
        assert (alarm.name, alarm.level) in {("viscous (stored)", "warning"), ("viscous (stored)", "watch")}
        assert alarm.peak == "warning"
        assert alarm.raised_ns in {windows[1].window_end_ns, windows[2].window_end_ns}


def test_one_bad_stored_window_among_good_ones_raises_none(history: History) -> None:
    assert all(alarms == [] for _, alarms in in_any_order(history, 1))


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
