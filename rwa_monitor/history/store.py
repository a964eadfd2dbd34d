"""The history on a database: takes diagnoses in, runs the alarms over them, and gives records of both.

A window is taken in once, whether it comes live, again after a restart, or from an imported recording; what it means
for the alarms is written in the same transaction.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Self

from sqlalchemy import Delete, delete, func, select
from sqlalchemy.orm import Session, selectinload

from rwa_monitor.errors import InputError
from rwa_monitor.history.alarms import (
    MODEL_ALARM,
    MONITOR_ALARM,
    MONITOR_POLICY,
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
from rwa_monitor.history.database import (
    AlarmEventRow,
    AlarmRow,
    AlarmStateRow,
    Database,
    DiagnosisRow,
    DiscrepancyRow,
    EstimateRow,
)
from rwa_monitor.history.records import AlarmRecord, EstimateRecord, MonitorState, signed
from rwa_monitor.history.retired_wheels import RetiredWheels
from rwa_monitor.messages import Diagnosis, Discrepancy
from rwa_monitor.samples import NANOSECONDS_PER_SECOND

MAX_SHELVED_S: Final = 7 * 86_400.0
MAX_ID: Final = 2**63 - 1  # that a database can hold
CHANGED: Final = "changed"  # alarms that a session has changed
_ALARMS: Final = select(AlarmRow).options(selectinload(AlarmRow.trail))


class History:
    """Diagnoses, estimates and alarms in one database.

    Parameters
    ----------
    place
        SQLite file, made where it is missing; URL of a PostgreSQL database; None keeps everything in memory.
    policy
        When windows make an alarm.
    retention
        How long what is kept.
    wall_ns
        This machine's clock [ns], for the audit trail.

    Attributes
    ----------
    retired
        Which wheels are retired.

    Raises
    ------
    InputError
        If the database cannot be opened.
    """

    def __init__(
        self,
        place: Path | str | None,
        policy: Policy | None = None,
        retention: Retention | None = None,
        wall_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self.policy = policy or Policy()
        self.retention = retention or Retention()
        self._wall_ns = wall_ns
        self._database = Database(place)
        self.retired = RetiredWheels(self._database, wall_ns)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the database."""
        self._database.close()

    # ---- in ------------------------------------------------------------------------------------------------------

    def add(self, *diagnoses: Diagnosis) -> int:
        """Take in windows in one transaction; returns how many the history did not have yet.

        Raises
        ------
        HistoryError
            If the database cannot be written; nothing of the windows is in it then.
        """
        with self._database.session() as session:
            return sum(self._add(session, diagnosis) for diagnosis in diagnoses)

    def take(self, diagnoses: Iterable[Diagnosis]) -> list[AlarmRecord]:
        """Take in windows in one transaction; returns the alarms that they changed. Raises HistoryError as `add`."""
        with self._database.session() as session:
            for diagnosis in diagnoses:
                self._add(session, diagnosis)
            return _changed(session)

    def _add(self, session: Session, diagnosis: Diagnosis) -> bool:
        place = {"spacecraft": diagnosis.spacecraft, "wheel": diagnosis.wheel}
        known = select(DiagnosisRow.id).filter_by(**place, window_start_ns=diagnosis.window_start_ns)
        if session.scalar(known) is not None or self._is_past_keeping(session, diagnosis):
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
            key = (diagnosis.spacecraft, diagnosis.wheel, name)
            self._observe(session, key, observation, _reason(diagnosis, name))
        session.flush()
        return True

    def take_monitors(self, reports: Iterable[MonitorState]) -> list[AlarmRecord]:
        """Take in of which wheels the monitor reports, and of which not any more; returns the alarms that this changed.

        From its first status on a monitor is expected, by every dashboard on this history, until its wheel is retired.

        Raises
        ------
        HistoryError
            If the database cannot be written; nothing is noted then.
        """
        with self._database.session() as session:
            for report in reports:
                state = _state_of(session, (report.spacecraft, report.wheel, MONITOR_ALARM))
                time_ns = max(state.last_window_ns, 0) if report.time_ns is None else report.time_ns
                observation = Observation(Level.WARNING if report.silent else Level.NORMAL, time_ns)
                self._advance(session, state, observation, MONITOR_POLICY, report.reason)
            return _changed(session)

    def _is_past_keeping(self, session: Session, diagnosis: Diagnosis) -> bool:
        """Return whether a window is older than the policy keeps any: of an old recording that is imported again."""
        newest = select(func.max(EstimateRow.window_end_ns)).filter_by(
            spacecraft=diagnosis.spacecraft, wheel=diagnosis.wheel
        )
        end_ns = session.scalar(newest)
        return end_ns is not None and diagnosis.window_end_ns < oldest_ns(end_ns, self.retention.diagnoses_days)

    def add_discrepancy(self, found: Discrepancy) -> bool:
        """Take in a discrepancy report; False where a later one of the wheel is known. Raises HistoryError as `add`."""
        with self._database.session() as session:
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

    def _observe(self, session: Session, key: tuple[str, str, str], observation: Observation, reason: str) -> None:
        """Run one alarm over one window; a window older than the last one taken in changes no alarm."""
        if observation.level == Level.NORMAL and session.get(AlarmStateRow, key) is None:
            return  # an alarm that never had cause to be needs no row
        state = _state_of(session, key)
        if observation.time_ns > state.last_window_ns:
            self._advance(session, state, observation, self.policy, reason)

    def _advance(
        self, session: Session, state: AlarmStateRow, observation: Observation, policy: Policy, reason: str
    ) -> None:
        """Take an observation into an alarm, and write down what it means."""
        row = session.get(AlarmRow, state.alarm_id) if state.alarm_id is not None else None
        after, events = advance(_alarm(state, row), observation, policy)
        state.recent = "".join(str(int(level)) for level in after.recent)
        state.last_window_ns = observation.time_ns
        for happened in events:
            if happened.kind == EventKind.RAISED:
                row = _raise(session, state, happened, reason)
            assert row is not None  # every other event is of an alarm that was raised
            if happened.kind in {EventKind.ESCALATED, EventKind.RELAPSED}:
                row.reason = reason
                if row.shelved_until_wall_ns is not None:
                    row.shelved_until_wall_ns = None
                    self._log(session, row, AlarmEvent(EventKind.UNSHELVED, happened.level, happened.time_ns))
            self._log(session, row, happened)
        if row is not None:
            _write(row, state, after, observation.time_ns)

    def _log(self, session: Session, row: AlarmRow, happened: AlarmEvent, person: str = "", note: str = "") -> None:
        session.info.setdefault(CHANGED, set()).add(row.id)
        row.trail.append(
            AlarmEventRow(
                event=happened.kind.value,
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
        person, note = signed(person, note)
        with self._database.session() as session:
            row, state = self._open_alarm(session, alarm_id)
            after, events = acknowledge(_alarm(state, row), state.last_window_ns)
            if not events:
                raise InputError(f"alarm {alarm_id}", "is acknowledged already")
            for happened in events:
                by_person = (person, note) if happened.kind == EventKind.ACKNOWLEDGED else ("", "")
                self._log(session, row, happened, *by_person)
            _write(row, state, after, state.last_window_ns)
            return _records([row])[0]

    def shelve(self, alarm_id: int, person: str, seconds: float, note: str = "") -> AlarmRecord:
        """Shelve an open alarm for a while; 0 s ends it, and so does an alarm that gets worse.

        Raises
        ------
        InputError
            If there is no such alarm, the name is missing or too long, or the time too long.
        HistoryError
            If the database cannot be written; nothing is shelved then.
        """
        person, note = signed(person, note)
        if not 0 <= seconds <= MAX_SHELVED_S:
            raise InputError("seconds", f"must be from 0 to {MAX_SHELVED_S}")
        with self._database.session() as session:
            row, state = self._open_alarm(session, alarm_id)
            kind = EventKind.SHELVED if seconds else EventKind.UNSHELVED
            until_ns = self._wall_ns() + int(seconds * NANOSECONDS_PER_SECOND)
            row.shelved_until_wall_ns = until_ns if seconds else None
            self._log(session, row, AlarmEvent(kind, Level(row.level), state.last_window_ns), person, note)
            return _records([row])[0]

    def _open_alarm(self, session: Session, alarm_id: int) -> tuple[AlarmRow, AlarmStateRow]:
        row = session.get(AlarmRow, alarm_id) if alarm_id <= MAX_ID else None
        state = session.scalar(select(AlarmStateRow).filter_by(alarm_id=alarm_id)) if row else None
        if row is None or state is None:
            raise InputError(f"alarm {alarm_id}", "is not open")
        return row, state

    def prune(self) -> int:
        """Remove what is older than the policy keeps; returns the number of diagnoses removed."""
        with self._database.session() as session:
            return prune(session, self.retention)

    def check(self) -> None:
        """Put the database back in its place if it was removed; raises HistoryError where that cannot be done."""
        self._database.check()

    # ---- out -----------------------------------------------------------------------------------------------------

    def wheels(self) -> list[tuple[str, str]]:
        """Return spacecraft and wheel of everything in the history, sorted."""
        with self._database.session() as session:
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
        with self._database.session() as session:
            return {(spacecraft, wheel): text.encode() for spacecraft, wheel, text in session.execute(wanted)}

    def windows(self, spacecraft: str, wheel: str, limit: int = 200, before_ns: int | None = None) -> list[Diagnosis]:
        """Return the latest diagnoses of a wheel, the oldest first; only those that end before `before_ns`."""
        wanted = select(DiagnosisRow.message).filter_by(spacecraft=spacecraft, wheel=wheel)
        if before_ns is not None:
            wanted = wanted.where(DiagnosisRow.window_end_ns < before_ns)
        wanted = wanted.order_by(DiagnosisRow.window_end_ns.desc()).limit(limit)
        with self._database.session() as session:
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
        with self._database.session() as session:
            rows = session.scalars(wanted).all()
            return [EstimateRecord.model_validate(row, from_attributes=True) for row in reversed(rows)]

    def discrepancy(self, spacecraft: str, wheel: str) -> bytes | None:
        """Return the latest discrepancy report of a wheel, as JSON; None where there is none."""
        with self._database.session() as session:
            row = session.get(DiscrepancyRow, (spacecraft, wheel))
            return None if row is None else row.message.encode()

    def monitors(self) -> dict[tuple[str, str], bool]:
        """Return spacecraft and name of wheels that ever had a monitor; True where it is known to be silent."""
        states = select(AlarmStateRow.spacecraft, AlarmStateRow.wheel, AlarmRow.level).outerjoin(
            AlarmRow, AlarmRow.id == AlarmStateRow.alarm_id
        )
        with self._database.session() as session:
            found = session.execute(states.where(AlarmStateRow.name == MONITOR_ALARM)).all()
            return {(spacecraft, wheel): bool(level) for spacecraft, wheel, level in found}

    def open_alarms(self, spacecraft: str, wheel: str) -> list[AlarmRecord]:
        """Return the open alarms of one wheel."""
        wanted = _ALARMS.filter_by(spacecraft=spacecraft, wheel=wheel, closed_ns=None).order_by(AlarmRow.id)
        with self._database.session() as session:
            return _records(session.scalars(wanted))

    def alarms(self, *, closed: int = 50) -> list[AlarmRecord]:
        """Return all open alarms, the worst first, then the latest closed ones."""
        open_ones = _ALARMS.where(AlarmRow.closed_ns.is_(None)).order_by(AlarmRow.level.desc(), AlarmRow.id)
        ended = _ALARMS.where(AlarmRow.closed_ns.is_not(None)).order_by(AlarmRow.id.desc()).limit(closed)
        with self._database.session() as session:
            return _records(row for query in (open_ones, ended) for row in session.scalars(query))


def _state_of(session: Session, key: tuple[str, str, str]) -> AlarmStateRow:
    """Return the state of an alarm by spacecraft, wheel and name; a new one where there is none."""
    state = session.get(AlarmStateRow, key)
    if state is None:
        spacecraft, wheel, name = key
        state = AlarmStateRow(
            spacecraft=spacecraft, wheel=wheel, name=name, recent="", last_window_ns=-1, alarm_id=None
        )
        session.add(state)
    return state


def _raise(session: Session, state: AlarmStateRow, happened: AlarmEvent, reason: str) -> AlarmRow:
    """Open the row of an alarm that rises."""
    row = AlarmRow(
        spacecraft=state.spacecraft,
        wheel=state.wheel,
        name=state.name,
        phase=Phase.ACTIVE.value,
        level=happened.level,
        peak=happened.level,
        acknowledged_level=0,
        reason=reason,
        raised_ns=happened.time_ns,
        changed_ns=happened.time_ns,
        closed_ns=None,
        shelved_until_wall_ns=None,
    )
    session.add(row)
    session.flush()
    state.alarm_id = row.id
    return row


def _alarm(state: AlarmStateRow, row: AlarmRow | None) -> Alarm:
    """Return an alarm as the state machine has it."""
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


def _changed(session: Session) -> list[AlarmRecord]:
    """Return the alarms that a session has changed."""
    return _records(session.get_one(AlarmRow, alarm) for alarm in sorted(session.info.get(CHANGED, ())))


def _records(rows: Iterable[AlarmRow]) -> list[AlarmRecord]:
    """Return alarms with their audit trails, in the order given."""
    return [AlarmRecord.model_validate(row, from_attributes=True) for row in rows]


def _reason(diagnosis: Diagnosis, name: str) -> str:
    if name != MODEL_ALARM:
        return diagnosis.reason
    suspected = f"; suspected: {diagnosis.suspected_effect}" if diagnosis.suspected_effect else ""
    return f"The friction model does not fit this wheel's telemetry{suspected}."


def _estimates(diagnosis: Diagnosis) -> Iterator[dict[str, Any]]:
    stds = {"dry": diagnosis.friction.base_dry.std, "viscous": diagnosis.friction.viscous.std}
    for name, anomaly in diagnosis.anomalies.items():
        yield anomaly.model_dump(exclude={"estimate", "severity_std"}) | {
            "name": name,
            "window_start_ns": diagnosis.window_start_ns,
            "window_end_ns": diagnosis.window_end_ns,
            "value": anomaly.estimate,
            "std": stds.get(name),
        }


# ---- how long what is kept -------------------------------------------------------------------------------------------


DAY_NS: Final = 86_400 * NANOSECONDS_PER_SECOND


@dataclass(frozen=True, slots=True)
class Retention:
    """How long things are kept, in days before the latest window of the wheel.

    Attributes
    ----------
    diagnoses_days
        Whole diagnoses. What is older is not taken in again either.
    fine_days
        Estimates of every window; older ones are thinned to the worst of each day.
    estimates_days
        Estimates at all.
    alarms_days
        Closed alarms with their audit trail; open ones are kept always.
    """

    diagnoses_days: float = 180.0
    fine_days: float = 365.0
    estimates_days: float = 3650.0
    alarms_days: float = 3650.0

    def __post_init__(self) -> None:
        """Check that estimates last as long as the diagnoses that they are of."""
        if not 0 < self.diagnoses_days <= self.fine_days <= self.estimates_days:
            raise ValueError("diagnoses_days, fine_days and estimates_days must be positive and in this order")


def oldest_ns(end_ns: int, days: float) -> int:
    """Return the time some days before the latest window's end."""
    return end_ns - int(days * DAY_NS)


def prune(session: Session, retention: Retention) -> int:
    """Remove what is older than the policy keeps; returns the number of diagnoses removed."""
    latest = select(EstimateRow.spacecraft, EstimateRow.wheel, func.max(EstimateRow.window_end_ns)).group_by(
        EstimateRow.spacecraft, EstimateRow.wheel
    )
    removed = 0
    for spacecraft, wheel, end_ns in session.execute(latest).all():
        alarms_end = oldest_ns(end_ns, retention.alarms_days)
        removed += _run(session, _older(DiagnosisRow, spacecraft, wheel, oldest_ns(end_ns, retention.diagnoses_days)))
        _run(session, _older(EstimateRow, spacecraft, wheel, oldest_ns(end_ns, retention.estimates_days)))
        _run(session, _thin(spacecraft, wheel, oldest_ns(end_ns, retention.fine_days)))
        _run(
            session,
            delete(AlarmRow).filter_by(spacecraft=spacecraft, wheel=wheel).where(AlarmRow.closed_ns < alarms_end),
        )
    return removed


def _older(table: type[DiagnosisRow | EstimateRow], spacecraft: str, wheel: str, before_ns: int) -> Delete:
    return delete(table).filter_by(spacecraft=spacecraft, wheel=wheel).where(table.window_end_ns < before_ns)


def _thin(spacecraft: str, wheel: str, before_ns: int) -> Delete:
    """Return what removes old estimates but the worst of each part and day; of equals, the latest."""
    own = (EstimateRow.spacecraft == spacecraft) & (EstimateRow.wheel == wheel)
    day = EstimateRow.window_end_ns - EstimateRow.window_end_ns % DAY_NS
    rank = func.row_number().over(
        partition_by=(EstimateRow.name, day),
        order_by=(func.coalesce(EstimateRow.severity, -1.0).desc(), EstimateRow.window_end_ns.desc()),
    )
    old = (
        select(EstimateRow.name, EstimateRow.window_start_ns, rank.label("rank"))
        .where(own, EstimateRow.window_end_ns < before_ns)
        .subquery()
    )
    superfluous = (
        select(old.c.name)
        .where(old.c.rank > 1, old.c.name == EstimateRow.name, old.c.window_start_ns == EstimateRow.window_start_ns)
        .exists()
    )
    return delete(EstimateRow).where(own, superfluous)


def _run(session: Session, statement: Delete) -> int:
    result: Any = session.execute(statement, execution_options={"synchronize_session": False})
    return int(result.rowcount)
