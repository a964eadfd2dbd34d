"""The history on a database: takes diagnoses in, runs the alarms over them, and tells what it knows.

SQLite without set-up: one file, write-ahead log, so that readers and the one writer do not wait for each other. A
window is taken in once, whether it comes live, again after a restart, or from an imported recording; what it means for
the alarms is written in the same transaction.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Self

from sqlalchemy import Engine, create_engine, delete, event, func, select
from sqlalchemy.exc import SQLAlchemyError
from sqlalchemy.orm import Session

from rwa_monitor.errors import InputError, RwaMonitorError
from rwa_monitor.history.alarms import (
    MODEL_ALARM,
    Alarm,
    AlarmEvent,
    EventKind,
    Level,
    Observation,
    Phase,
    Policy,
    acknowledge,
    advance,
    observe,
)
from rwa_monitor.history.records import AlarmRecord, EstimateRecord
from rwa_monitor.history.tables import (
    AlarmEventRow,
    AlarmRow,
    AlarmStateRow,
    DiagnosisRow,
    DiscrepancyRow,
    EstimateRow,
    Table,
)
from rwa_monitor.messages import Diagnosis, Discrepancy
from rwa_monitor.samples import NANOSECONDS_PER_SECOND

BUSY_TIMEOUT_S: Final = 5.0
DAY_NS: Final = 86_400 * NANOSECONDS_PER_SECOND
MAX_NAME: Final = 100  # characters of a person's name
MAX_NOTE: Final = 2_000


class HistoryError(RwaMonitorError):
    """The database cannot be used just now."""


@dataclass(frozen=True, slots=True)
class Retention:
    """How long things are kept, in days before the latest window of the wheel.

    Attributes
    ----------
    diagnoses_days
        Whole diagnoses.
    estimates_days
        Estimates, for trends.
    alarms_days
        Closed alarms with their audit trail; open ones are kept always.
    """

    diagnoses_days: float = 180.0
    estimates_days: float = 3650.0
    alarms_days: float = 3650.0


class History:
    """Diagnoses, estimates and alarms in one database.

    Parameters
    ----------
    path
        SQLite file, made where it is missing; None keeps everything in memory.
    policy
        When windows make an alarm.
    wall_ns
        This machine's clock [ns], for the audit trail.

    Raises
    ------
    InputError
        If the file is no database or cannot be opened.
    """

    def __init__(
        self, path: Path | None, policy: Policy | None = None, wall_ns: Callable[[], int] = time.time_ns
    ) -> None:
        self.path = path
        self.policy = policy or Policy()
        self._wall_ns = wall_ns
        self._engine = _open_engine(path)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the database."""
        self._engine.dispose()

    # ---- in ------------------------------------------------------------------------------------------------------

    def add(self, diagnosis: Diagnosis) -> bool:
        """Take in one window; False, and nothing done, where the history has it already.

        Raises
        ------
        HistoryError
            If the database cannot be written; nothing of the window is in it then.
        """
        return self.add_all([diagnosis]) == 1

    def add_all(self, diagnoses: list[Diagnosis]) -> int:
        """Take in several windows in one transaction; returns how many were new. Raises HistoryError as `add`."""
        with self._session() as session:
            return sum(self._add(session, diagnosis) for diagnosis in diagnoses)

    def _add(self, session: Session, diagnosis: Diagnosis) -> bool:
        place = {"spacecraft": diagnosis.spacecraft, "wheel": diagnosis.wheel}
        known = select(DiagnosisRow.id).filter_by(**place, window_start_ns=diagnosis.window_start_ns)
        if session.scalar(known) is not None:
            return False
        session.add(
            DiagnosisRow(
                **place,
                window_start_ns=diagnosis.window_start_ns,
                window_end_ns=diagnosis.window_end_ns,
                verdict=diagnosis.verdict,
                message=diagnosis.to_json().decode(),
                stored_wall_ns=self._wall_ns(),
            )
        )
        for estimate in _estimates(diagnosis):
            session.merge(EstimateRow(**place, **estimate))
        for name, observation in observe(diagnosis, self.policy).items():
            self._observe(session, diagnosis, name, observation)
        session.flush()
        return True

    def add_discrepancy(self, found: Discrepancy) -> bool:
        """Take in a discrepancy report; False where a later one of the wheel is known. Raises HistoryError as `add`."""
        with self._session() as session:
            row = session.get(DiscrepancyRow, (found.spacecraft, found.wheel))
            if row is not None and row.end_ns >= found.end_ns:
                return False
            session.merge(
                DiscrepancyRow(
                    spacecraft=found.spacecraft,
                    wheel=found.wheel,
                    end_ns=found.end_ns,
                    message=found.to_json().decode(),
                    stored_wall_ns=self._wall_ns(),
                )
            )
            return True

    def _observe(self, session: Session, diagnosis: Diagnosis, name: str, observation: Observation) -> None:
        """Run one alarm over one window; a window older than the last one taken in changes no alarm."""
        key = (diagnosis.spacecraft, diagnosis.wheel, name)
        state = session.get(AlarmStateRow, key)
        if state is None:
            if observation.level == Level.NORMAL:
                return  # an alarm that never had cause to be needs no row
            state = AlarmStateRow(
                spacecraft=key[0], wheel=key[1], name=name, recent="", last_window_ns=-1, alarm_id=None
            )
            session.add(state)
        if observation.time_ns <= state.last_window_ns:
            return
        row = session.get(AlarmRow, state.alarm_id) if state.alarm_id is not None else None
        after, events = advance(_alarm(state, row), observation, self.policy)
        state.recent = "".join(str(int(level)) for level in after.recent)
        state.last_window_ns = observation.time_ns
        for happened in events:
            if happened.kind == EventKind.RAISED:
                row = self._raise(session, state, diagnosis, happened)
            assert row is not None  # every other event is of an alarm that was raised
            if happened.kind in {EventKind.ESCALATED, EventKind.RELAPSED}:
                row.reason = _reason(diagnosis, name)
            self._tell(session, row, happened)
        if row is not None:
            _write(row, state, after, observation.time_ns)

    def _raise(self, session: Session, state: AlarmStateRow, diagnosis: Diagnosis, happened: AlarmEvent) -> AlarmRow:
        row = AlarmRow(
            spacecraft=state.spacecraft,
            wheel=state.wheel,
            name=state.name,
            phase=Phase.ACTIVE.value,
            level=happened.level,
            peak=happened.level,
            acknowledged_level=0,
            reason=_reason(diagnosis, state.name),
            raised_ns=happened.time_ns,
            changed_ns=happened.time_ns,
            closed_ns=None,
        )
        session.add(row)
        session.flush()
        state.alarm_id = row.id
        return row

    def _tell(self, session: Session, row: AlarmRow, happened: AlarmEvent, person: str = "", note: str = "") -> None:
        session.add(
            AlarmEventRow(
                alarm_id=row.id,
                kind=happened.kind.value,
                level=happened.level,
                time_ns=happened.time_ns,
                wall_ns=self._wall_ns(),
                person=person,
                note=note,
            )
        )

    def acknowledge(self, alarm_id: int, person: str, note: str = "") -> AlarmRecord:
        """Note that somebody has seen an alarm; returns it as it stands then.

        Raises
        ------
        InputError
            If there is no such alarm, it needs no acknowledgement, or the name is missing or too long.
        HistoryError
            If the database cannot be written; nothing is acknowledged then.
        """
        person, note = person.strip(), note.strip()
        if not person or len(person) > MAX_NAME or len(note) > MAX_NOTE:
            raise InputError("name", f"is needed, of at most {MAX_NAME} characters, and a note of at most {MAX_NOTE}")
        with self._session() as session:
            row = session.get(AlarmRow, alarm_id)
            state = session.scalar(select(AlarmStateRow).filter_by(alarm_id=alarm_id))
            if row is None or state is None:
                raise InputError(f"alarm {alarm_id}", "is not open")
            after, events = acknowledge(_alarm(state, row), state.last_window_ns)
            if not events:
                raise InputError(f"alarm {alarm_id}", "is acknowledged already")
            for happened in events:
                by_person = (person, note) if happened.kind == EventKind.ACKNOWLEDGED else ("", "")
                self._tell(session, row, happened, *by_person)
            _write(row, state, after, state.last_window_ns)
            session.flush()
            return _record(session, row)

    def prune(self, retention: Retention) -> int:
        """Remove what is older than the policy says; returns the number of diagnoses removed."""
        removed = 0
        with self._session() as session:
            latest = session.execute(
                select(EstimateRow.spacecraft, EstimateRow.wheel, func.max(EstimateRow.window_end_ns)).group_by(
                    EstimateRow.spacecraft, EstimateRow.wheel
                )
            ).all()
            for spacecraft, wheel, end_ns in latest:
                old_diagnoses = delete(DiagnosisRow).where(
                    DiagnosisRow.spacecraft == spacecraft,
                    DiagnosisRow.wheel == wheel,
                    DiagnosisRow.window_end_ns < end_ns - retention.diagnoses_days * DAY_NS,
                )
                old_estimates = delete(EstimateRow).where(
                    EstimateRow.spacecraft == spacecraft,
                    EstimateRow.wheel == wheel,
                    EstimateRow.window_end_ns < end_ns - retention.estimates_days * DAY_NS,
                )
                old_alarms = delete(AlarmRow).where(
                    AlarmRow.spacecraft == spacecraft,
                    AlarmRow.wheel == wheel,
                    AlarmRow.closed_ns < end_ns - retention.alarms_days * DAY_NS,
                )
                removed += int(getattr(session.execute(old_diagnoses), "rowcount", 0))
                session.execute(old_estimates)
                session.execute(old_alarms)
        return removed

    # ---- out -----------------------------------------------------------------------------------------------------

    def wheels(self) -> list[tuple[str, str]]:
        """Return spacecraft and wheel of everything the history knows, sorted."""
        with self._session() as session:
            pairs = session.execute(select(DiagnosisRow.spacecraft, DiagnosisRow.wheel).distinct()).all()
            return sorted((spacecraft, wheel) for spacecraft, wheel in pairs)

    def latest(self) -> dict[tuple[str, str], bytes]:
        """Return the latest diagnosis of every wheel, as JSON, by spacecraft and wheel."""
        ends = (
            select(DiagnosisRow.spacecraft, DiagnosisRow.wheel, func.max(DiagnosisRow.window_end_ns).label("end_ns"))
            .group_by(DiagnosisRow.spacecraft, DiagnosisRow.wheel)
            .subquery()
        )
        same = (
            (DiagnosisRow.spacecraft == ends.c.spacecraft)
            & (DiagnosisRow.wheel == ends.c.wheel)
            & (DiagnosisRow.window_end_ns == ends.c.end_ns)
        )
        wanted = select(DiagnosisRow.spacecraft, DiagnosisRow.wheel, DiagnosisRow.message).join(ends, same)
        with self._session() as session:
            return {(spacecraft, wheel): text.encode() for spacecraft, wheel, text in session.execute(wanted)}

    def windows(self, spacecraft: str, wheel: str, limit: int = 200, before_ns: int | None = None) -> list[Diagnosis]:
        """Return the latest diagnoses of a wheel, the oldest first; only those that end before `before_ns`."""
        wanted = select(DiagnosisRow.message).filter_by(spacecraft=spacecraft, wheel=wheel)
        if before_ns is not None:
            wanted = wanted.where(DiagnosisRow.window_end_ns < before_ns)
        wanted = wanted.order_by(DiagnosisRow.window_end_ns.desc()).limit(limit)
        with self._session() as session:
            texts = session.scalars(wanted).all()
        return [Diagnosis.parse(text.encode(), "history") for text in reversed(texts)]

    def estimates(self, spacecraft: str, wheel: str, limit: int = 5_000) -> list[EstimateRecord]:
        """Return the latest estimates of a wheel, the oldest first."""
        wanted = (
            select(EstimateRow)
            .filter_by(spacecraft=spacecraft, wheel=wheel)
            .order_by(EstimateRow.window_end_ns.desc(), EstimateRow.name)
            .limit(limit)
        )
        with self._session() as session:
            rows = session.scalars(wanted).all()
            return [
                EstimateRecord(**{name: getattr(row, name) for name in EstimateRecord.model_fields})
                for row in reversed(rows)
            ]

    def discrepancy(self, spacecraft: str, wheel: str) -> bytes | None:
        """Return the latest discrepancy report of a wheel, as JSON; None where there is none."""
        with self._session() as session:
            row = session.get(DiscrepancyRow, (spacecraft, wheel))
            return None if row is None else row.message.encode()

    def alarms(self, *, closed: int = 50) -> list[AlarmRecord]:
        """Return all open alarms, the worst first, then the latest closed ones."""
        open_ones = select(AlarmRow).where(AlarmRow.closed_ns.is_(None)).order_by(AlarmRow.level.desc(), AlarmRow.id)
        ended = select(AlarmRow).where(AlarmRow.closed_ns.is_not(None)).order_by(AlarmRow.id.desc()).limit(closed)
        with self._session() as session:
            return [_record(session, row) for query in (open_ones, ended) for row in session.scalars(query)]

    @contextmanager
    def _session(self) -> Iterator[Session]:
        """Give a session in a transaction; what the database itself refuses becomes a HistoryError."""
        try:
            with Session(self._engine) as session, session.begin():
                yield session
        except SQLAlchemyError as error:
            reason = str(getattr(error, "orig", None) or error).splitlines()[0]
            raise HistoryError(f"the history ({self.path or 'in memory'}) cannot be used: {reason}") from error


def _open_engine(path: Path | None) -> Engine:
    """Open the database and make its tables where they are missing."""
    try:
        if path is None:
            from sqlalchemy.pool import StaticPool  # noqa: PLC0415 - only where nothing is kept

            engine = create_engine("sqlite://", poolclass=StaticPool, connect_args={"check_same_thread": False})
        else:
            path.parent.mkdir(parents=True, exist_ok=True)
            engine = create_engine(f"sqlite:///{path}", connect_args={"timeout": BUSY_TIMEOUT_S})
        event.listen(engine, "connect", _set_up_connection)
        Table.metadata.create_all(engine)
    except (OSError, SQLAlchemyError) as error:
        reason = str(getattr(error, "orig", None) or error).splitlines()[0]
        raise InputError(str(path), f"cannot be used as a history: {reason}") from error
    return engine


def _set_up_connection(connection: Any, record: object) -> None:
    del record
    cursor = connection.cursor()
    cursor.execute("PRAGMA journal_mode = WAL")
    cursor.execute("PRAGMA synchronous = FULL")  # an acknowledgement that was answered survives a loss of power
    cursor.execute("PRAGMA foreign_keys = ON")
    cursor.close()


def _alarm(state: AlarmStateRow, row: AlarmRow | None) -> Alarm:
    """Return an alarm as the state machine sees it."""
    recent = tuple(Level(int(digit)) for digit in state.recent)
    if row is None:
        return Alarm(recent=recent)
    return Alarm(
        recent=recent,
        phase=Phase(row.phase),
        level=Level(row.level),
        peak=Level(row.peak),
        acknowledged_level=Level(row.acknowledged_level),
        raised_ns=row.raised_ns,
        changed_ns=row.changed_ns,
    )


def _write(row: AlarmRow, state: AlarmStateRow, alarm: Alarm, time_ns: int) -> None:
    """Bring the alarm's row up to date; one that has cleared is closed."""
    row.phase = alarm.phase.value
    row.level = int(alarm.level)
    if alarm.phase == Phase.QUIET:
        row.closed_ns = row.changed_ns = time_ns
        state.alarm_id = None
        return
    row.peak = int(alarm.peak)
    row.acknowledged_level = int(alarm.acknowledged_level)
    row.changed_ns = alarm.changed_ns or row.changed_ns


def _record(session: Session, row: AlarmRow) -> AlarmRecord:
    trail = session.scalars(select(AlarmEventRow).filter_by(alarm_id=row.id).order_by(AlarmEventRow.id))
    lines = [
        {
            "event": line.kind,
            "level": Level(line.level).word,
            "time_ns": line.time_ns,
            "wall_ns": line.wall_ns,
            "person": line.person,
            "note": line.note,
        }
        for line in trail
    ]
    same = {name: getattr(row, name) for name in _SAME_IN_RECORD}
    words = {"level": Level(row.level).word, "peak": Level(row.peak).word}
    return AlarmRecord.model_validate({**same, **words, "trail": lines})


_SAME_IN_RECORD: Final = (
    "id", "spacecraft", "wheel", "name", "phase", "reason", "raised_ns", "changed_ns", "closed_ns"
)  # fmt: skip


def _reason(diagnosis: Diagnosis, name: str) -> str:
    if name != MODEL_ALARM:
        return diagnosis.reason
    suspected = f"; suspected: {diagnosis.suspected_effect}" if diagnosis.suspected_effect else ""
    return f"The friction model does not fit this wheel's telemetry{suspected}."


def _estimates(diagnosis: Diagnosis) -> Iterator[dict[str, Any]]:
    stds = {"dry": diagnosis.friction.base_dry.std, "viscous": diagnosis.friction.viscous.std}
    for name, anomaly in diagnosis.anomalies.items():
        yield {
            "name": name,
            "window_start_ns": diagnosis.window_start_ns,
            "window_end_ns": diagnosis.window_end_ns,
            "value": anomaly.estimate,
            "std": stds.get(name),
            "nominal_low": anomaly.nominal_low,
            "nominal_high": anomaly.nominal_high,
            "unit": anomaly.unit,
            "probability": anomaly.probability,
            "severity": anomaly.severity,
            "active": anomaly.active,
        }
