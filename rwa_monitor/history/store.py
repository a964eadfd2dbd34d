"""The history on a database: stores diagnoses, updates the alarms with them, and returns records of both.

A window is added once, whether it arrives live, again after a restart, or from an imported recording; the alarms are
updated in the same transaction. Stored telemetry may complete a window later, or change the state before it: then the
later diagnosis replaces the earlier one. It has alarms of its own, with the times of its windows.
"""

import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from threading import RLock
from typing import Final

import numpy as np
from sqlalchemy import delete, func, select, tuple_
from sqlalchemy.orm import Session, joinedload, selectinload

from rwa_monitor.errors import InputError
from rwa_monitor.history import alarms
from rwa_monitor.history.alarms import Alarm, AlarmEvent, Level, Policy
from rwa_monitor.history.database import (
    AlarmEventRow,
    AlarmRecord,
    AlarmRow,
    AlarmStateRow,
    Database,
    DiagnosisRow,
    DiscrepancyRow,
    EstimateRow,
    MonitorState,
    RetirementEvent,
    WheelEventRow,
)
from rwa_monitor.messages import Diagnosis, Discrepancy
from rwa_monitor.reporting.diagnoses import EstimateRecord, estimates_of
from rwa_monitor.samples import NANOSECONDS_PER_SECOND, SECONDS_PER_DAY

MAX_ID: Final = np.iinfo(np.int64).max  # the largest that a database can hold
CHANGED: Final = "changed"  # key in `Session.info` of the alarms that the session has changed
_ALARMS: Final = select(AlarmRow).options(selectinload(AlarmRow.trail))


class History(Database):
    """Diagnoses, estimates and alarms in one database; use it with `with`.

    Parameters
    ----------
    place
        SQLite file, made where it is missing; or the URL of a PostgreSQL database.
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

    def __init__(self, place: Path | str, wall_ns: Callable[[], int] = time.time_ns) -> None:
        self._wall_ns = wall_ns
        super().__init__(place)
        self._wheels: dict[str, set[str]] = {}  # known wheels by spacecraft
        self.retired = RetiredWheels(self, wall_ns)

    # ---- in ------------------------------------------------------------------------------------------------------

    def add(self, *diagnoses: Diagnosis) -> tuple[int, list[AlarmRecord]]:
        """Add windows in one transaction; returns how many of them were new, and the alarms that they changed.

        Raises
        ------
        HistoryError
            If the database cannot be written; none of the windows is added then.
        """
        with self.session() as session:
            new = sum(self._add(session, diagnosis) for diagnosis in diagnoses)
            return new, _changed(session)

    def _add(self, session: Session, diagnosis: Diagnosis) -> bool:
        place = {"spacecraft": diagnosis.spacecraft, "wheel": diagnosis.wheel}
        wanted = select(DiagnosisRow).filter_by(**place, window_start_ns=diagnosis.window_start_ns)
        known, message = session.scalar(wanted), diagnosis.to_json().decode()
        newest_ns = session.scalar(select(func.max(EstimateRow.window_end_ns)).filter_by(**place))
        # A window of an old recording that is imported again: older than any window that is kept.
        is_past = newest_ns is not None and diagnosis.window_end_ns < oldest_ns(newest_ns, DIAGNOSES_DAYS)
        if is_past or (known is not None and (diagnosis.data is None or known.message == message)):
            return False
        row = known or DiagnosisRow(**place, window_start_ns=diagnosis.window_start_ns)
        row.window_end_ns, row.message = diagnosis.window_end_ns, message
        session.add(row)
        for estimate in estimates_of(diagnosis):
            session.merge(EstimateRow(**place, **estimate.model_dump()))
        session.flush()
        end_ns = diagnosis.window_end_ns
        for wheel, name, level, reason in self._observed(session, diagnosis):
            key = (diagnosis.spacecraft, wheel, name + (alarms.STORED_ALARM if diagnosis.data else ""))
            if level == Level.NORMAL and session.get(AlarmStateRow, key) is None:
                continue  # an alarm that was never raised needs no row
            state = _state_of(session, key)
            if end_ns > state.last_window_ns:  # an older window changes no live alarm
                self._advance(session, state, level, end_ns, alarms.WINDOW_POLICY, reason)
            elif diagnosis.data and level > Level.NORMAL:
                self._raise_earlier(session, state, diagnosis, name)
        session.flush()
        return known is None

    def _raise_earlier(self, session: Session, state: AlarmStateRow, diagnosis: Diagnosis, name: str) -> None:
        """Raise an alarm of stored telemetry for a window added after later ones, from the windows around it."""
        policy, end = alarms.WINDOW_POLICY, DiagnosisRow.window_end_ns
        of_wheel = select(DiagnosisRow.message).filter_by(spacecraft=state.spacecraft, wheel=state.wheel)
        before = of_wheel.where(end < diagnosis.window_end_ns).order_by(end.desc()).limit(policy.n - 1)
        after = of_wheel.where(end > diagnosis.window_end_ns).order_by(end).limit(policy.n - 1)
        around = [*reversed(session.scalars(before).all()), diagnosis.to_json().decode(), *session.scalars(after)]
        then = Alarm()
        for text in around:
            level = alarms.observe(Diagnosis.parse(text.encode(), "history")).get(name)
            if level is not None:
                then, _ = alarms.advance(then, level, diagnosis.window_end_ns, policy)
        if then.peak > (state.alarm.level if state.alarm else Level.NORMAL):
            recent, last_ns = state.recent, state.last_window_ns
            state.recent = str(int(then.peak)) * (policy.n - 1)
            self._advance(session, state, then.peak, diagnosis.window_end_ns, policy, _reason(diagnosis, name))
            state.recent, state.last_window_ns = recent, last_ns

    def _observed(self, session: Session, diagnosis: Diagnosis) -> Iterator[tuple[str, str, Level, str]]:
        """Yield wheel, name, level and reason for each alarm, of the wheel or of all wheels, that a window changes.

        An inconclusive window gives its wheel a level only where the comparison with its siblings does.
        """
        siblings, levels = self._wheels_of(session, diagnosis), alarms.observe(diagnosis)
        # Dumps arrive in any order, perhaps before those of the siblings: they are not compared.
        several = alarms.FEWEST_WHEELS <= len(siblings) <= alarms.MOST_WHEELS
        alike = several and not diagnosis.data and not diagnosis.partial
        for name in [*levels, *(name for name in alarms.COMPARED if alike and name not in levels)]:
            level = levels.get(name)
            moved = _moved(session, diagnosis, name) if alike and name in alarms.COMPARED else None
            if moved and moved.common is not None:
                yield diagnosis.wheel, name, Level.NORMAL, ""
                yield alarms.ALL_WHEELS, name, max(level or Level.NORMAL, moved.common), moved.in_words
                continue
            if moved and moved.is_alone and not level:
                yield diagnosis.wheel, name, Level.WATCH, moved.in_words
            elif level is not None:
                yield diagnosis.wheel, name, level, _reason(diagnosis, name)
            if moved and (moved.is_alone or level is not None):
                yield alarms.ALL_WHEELS, name, Level.NORMAL, ""

    def _wheels_of(self, session: Session, diagnosis: Diagnosis) -> set[str]:
        """Return the wheels of a window's spacecraft, including its own."""
        known, wanted = self._wheels, select(DiagnosisRow.wheel).filter_by(spacecraft=diagnosis.spacecraft).distinct()
        if diagnosis.spacecraft not in known:
            known[diagnosis.spacecraft] = set(session.scalars(wanted))
        known[diagnosis.spacecraft].add(diagnosis.wheel)
        return known[diagnosis.spacecraft]

    def take_monitors(self, reports: Iterable[MonitorState]) -> list[AlarmRecord]:
        """Store which wheels' monitors report and which are silent; returns the alarms that this changed.

        From its first report on a monitor is expected, by every dashboard on this history, until its wheel is retired.

        Raises
        ------
        HistoryError
            If the database cannot be written; nothing is stored then.
        """
        with self.session() as session:
            for report in reports:
                state = _state_of(session, (report.spacecraft, report.wheel, alarms.MONITOR_ALARM))
                time_ns = max(state.last_window_ns, 0) if report.time_ns is None else report.time_ns
                level = Level.WARNING if report.silent else Level.NORMAL
                self._advance(session, state, level, time_ns, alarms.MONITOR_POLICY, report.reason)
            return _changed(session)

    def add_discrepancy(self, found: Discrepancy) -> None:
        """Store a discrepancy report unless a later one of the wheel is known; raises HistoryError as `add`."""
        name, text = {"spacecraft": found.spacecraft, "wheel": found.wheel}, found.to_json().decode()
        with self.session() as session:
            row = session.get(DiscrepancyRow, name)
            if row is None or row.end_ns < found.end_ns:
                session.merge(DiscrepancyRow(**name, end_ns=found.end_ns, message=text))

    def _advance(
        self, session: Session, state: AlarmStateRow, level: Level, time_ns: int, policy: Policy, reason: str
    ) -> None:
        """Update an alarm with a level, and write its state and events."""
        row = state.alarm
        after, events = alarms.advance(_alarm(state, row), level, time_ns, policy)
        state.recent = "".join(str(int(level)) for level in after.recent)
        state.last_window_ns = time_ns
        if row is None:
            if not events:
                return
            row = AlarmRow(spacecraft=state.spacecraft, wheel=state.wheel, name=state.name, reason=reason)
            session.add(row)
        for happened in events:
            if happened.event in {"escalated", "relapsed"}:
                row.reason = reason
                if row.shelved_until_wall_ns is not None:
                    row.shelved_until_wall_ns = None
                    self._log(session, row, happened._replace(event="unshelved"))
            self._log(session, row, happened)
        _write(row, after, time_ns)
        state.alarm = row if row.closed_ns is None else None

    def _log(self, session: Session, row: AlarmRow, happened: AlarmEvent, person: str = "", note: str = "") -> None:
        session.info.setdefault(CHANGED, set()).add(row)
        line = AlarmEventRow(**happened._asdict(), wall_ns=self._wall_ns(), person=person, note=note)
        row.trail.append(line)

    def acknowledge(self, alarm_id: int, person: str, note: str = "") -> AlarmRecord:
        """Acknowledge an alarm; returns its new state.

        Raises
        ------
        InputError
            If there is no such alarm, or it needs no acknowledgement.
        HistoryError
            If the database cannot be written; nothing is acknowledged then.
        """
        with self.session() as session:
            row, state = self._open_alarm(session, alarm_id)
            alarm = _alarm(state, row)
            if row.name.endswith(alarms.STORED_ALARM):  # an alarm of the past needs no normal window to close
                alarm = alarm._replace(phase="returned")
            after, events = alarms.acknowledge(alarm, state.last_window_ns)
            if not events:
                raise InputError(f"alarm {alarm_id}", "is acknowledged already")
            for happened in events:
                self._log(session, row, happened, *((person, note) if happened.event == "acknowledged" else ()))
            _write(row, after, state.last_window_ns)
            if row.closed_ns is not None:
                state.alarm = None
            return _records([row])[0]

    def shelve(self, alarm_id: int, person: str, seconds: float, note: str = "") -> AlarmRecord:
        """Shelve an open alarm for a while; 0 s unshelves it, as does an escalation or a relapse.

        Raises
        ------
        InputError
            If there is no such alarm.
        HistoryError
            If the database cannot be written; nothing is shelved then.
        """
        with self.session() as session:
            row, state = self._open_alarm(session, alarm_id)
            kind: alarms.EventKind = "shelved" if seconds else "unshelved"
            until_ns = self._wall_ns() + int(seconds * NANOSECONDS_PER_SECOND)
            row.shelved_until_wall_ns = until_ns if seconds else None
            self._log(session, row, AlarmEvent(kind, Level(row.level), state.last_window_ns), person, note)
            return _records([row])[0]

    def _open_alarm(self, session: Session, alarm_id: int) -> tuple[AlarmRow, AlarmStateRow]:
        state = session.scalar(select(AlarmStateRow).filter_by(alarm_id=alarm_id)) if alarm_id <= MAX_ID else None
        if state is None or state.alarm is None:
            raise InputError(f"alarm {alarm_id}", "is not open")
        return state.alarm, state

    def prune(self) -> None:
        """Remove records that are older than their retention time."""
        row = EstimateRow
        latest = select(row.spacecraft, row.wheel, func.max(row.window_end_ns)).group_by(row.spacecraft, row.wheel)
        with self.session() as session:
            for spacecraft, wheel, end_ns in session.execute(latest).all():
                for table, end, days in (
                    (DiagnosisRow, DiagnosisRow.window_end_ns, DIAGNOSES_DAYS),
                    (EstimateRow, EstimateRow.window_end_ns, ESTIMATES_DAYS),
                    (AlarmRow, AlarmRow.closed_ns, ALARMS_DAYS),
                ):
                    old = (
                        delete(table).filter_by(spacecraft=spacecraft, wheel=wheel).where(end < oldest_ns(end_ns, days))
                    )
                    session.execute(old, execution_options={"synchronize_session": False})

    # ---- out -----------------------------------------------------------------------------------------------------

    def latest(self) -> dict[tuple[str, str], bytes]:
        """Return the latest diagnosis of every wheel, as JSON, by spacecraft and wheel."""
        row = DiagnosisRow
        ends = select(row.spacecraft, row.wheel, func.max(row.window_end_ns)).group_by(row.spacecraft, row.wheel)
        wanted = select(row).where(tuple_(row.spacecraft, row.wheel, row.window_end_ns).in_(ends))
        with self.session() as session:
            return {(found.spacecraft, found.wheel): found.message.encode() for found in session.scalars(wanted)}

    def windows(self, spacecraft: str, wheel: str, limit: int = 200) -> list[Diagnosis]:
        """Return the latest diagnoses of a wheel, the oldest first."""
        wanted = select(DiagnosisRow.message).filter_by(spacecraft=spacecraft, wheel=wheel)
        wanted = wanted.order_by(DiagnosisRow.window_end_ns.desc()).limit(limit)
        with self.session() as session:
            texts = session.scalars(wanted).all()
        return [Diagnosis.parse(text.encode(), "history") for text in reversed(texts)]

    def estimates(self, spacecraft: str, wheel: str, limit: int = 5_000) -> list[EstimateRecord]:
        """Return the latest estimates of a wheel, the oldest first."""
        wanted = select(EstimateRow).filter_by(spacecraft=spacecraft, wheel=wheel)
        wanted = wanted.order_by(EstimateRow.window_end_ns.desc(), EstimateRow.name).limit(limit)
        with self.session() as session:
            rows = session.scalars(wanted).all()
            return [EstimateRecord.model_validate(row, from_attributes=True) for row in reversed(rows)]

    def discrepancy(self, spacecraft: str, wheel: str) -> bytes | None:
        """Return the latest discrepancy report of a wheel, as JSON; None where there is none."""
        with self.session() as session:
            row = session.get(DiscrepancyRow, (spacecraft, wheel))
            return None if row is None else row.message.encode()

    def monitors(self) -> dict[tuple[str, str], bool]:
        """Return, by spacecraft and name of wheels that ever had a monitor, whether its alarm is raised."""
        wanted = select(AlarmStateRow).filter_by(name=alarms.MONITOR_ALARM).options(joinedload(AlarmStateRow.alarm))
        with self.session() as session:
            return {(one.spacecraft, one.wheel): bool(one.alarm and one.alarm.level) for one in session.scalars(wanted)}

    def open_alarms(self, spacecraft: str, wheel: str) -> list[AlarmRecord]:
        """Return the open alarms of one wheel."""
        wanted = _ALARMS.filter_by(spacecraft=spacecraft, wheel=wheel, closed_ns=None).order_by(AlarmRow.id)
        with self.session() as session:
            return _records(session.scalars(wanted))

    def alarms(self, *, closed: int = 50) -> list[AlarmRecord]:
        """Return all open alarms, the highest level first, then the latest closed ones."""
        open_ones = _ALARMS.where(AlarmRow.closed_ns.is_(None)).order_by(AlarmRow.level.desc(), AlarmRow.id)
        ended = _ALARMS.where(AlarmRow.closed_ns.is_not(None)).order_by(AlarmRow.id.desc()).limit(closed)
        with self.session() as session:
            return _records(row for query in (open_ones, ended) for row in session.scalars(query))


def _moved(session: Session, diagnosis: Diagnosis, name: str) -> alarms.ShiftComparison | None:
    """Compare the shift of a coefficient of a window's wheel with its siblings; None where that is not possible.

    Of each wheel the latest window is used, if it ends within one window's length of this one.
    """
    length = diagnosis.window_end_ns - diagnosis.window_start_ns
    wanted = (
        select(EstimateRow)
        .filter_by(spacecraft=diagnosis.spacecraft, name=name)
        .where(EstimateRow.window_end_ns > diagnosis.window_end_ns - (alarms.MOST_EARLIER + alarms.LATEST) * length)
        .where(EstimateRow.window_end_ns < diagnosis.window_end_ns + length)
        .order_by(EstimateRow.window_end_ns)
    )
    windows: dict[str, list[EstimateRow]] = {}
    for row in session.scalars(wanted):
        windows.setdefault(row.wheel, []).append(row)
    shifts = {}
    for wheel, rows in windows.items():
        latest = rows[-1]
        numbers = np.array([(row.value, row.std) for row in rows], dtype=np.float64)  # None becomes NaN
        values, stds = numbers.T
        low, high = (np.nan if bound is None else bound for bound in (latest.nominal_low, latest.nominal_high))
        shift = alarms.shift_of(values, stds, np.array([row.active for row in rows]), (low, high))
        if latest.window_end_ns >= diagnosis.window_end_ns - length and shift is not None:
            shifts[wheel] = shift
    return alarms.compare_shifts(name, diagnosis.wheel, shifts)


def _state_of(session: Session, key: tuple[str, str, str]) -> AlarmStateRow:
    """Return the state of an alarm by spacecraft, wheel and name; a new one is added where there is none."""
    state = session.get(AlarmStateRow, key)
    if state is None:
        spacecraft, wheel, name = key
        state = AlarmStateRow(spacecraft=spacecraft, wheel=wheel, name=name, recent="", last_window_ns=-1)
        session.add(state)
    return state


def _alarm(state: AlarmStateRow, row: AlarmRow | None) -> Alarm:
    """Return the state machine's form of an alarm."""
    recent = tuple(Level(int(digit)) for digit in state.recent)
    if row is None:
        return Alarm(recent)
    level, peak, acknowledged = map(Level, (row.level, row.peak, row.acknowledged_level))
    return Alarm(recent, row.phase, level, peak, acknowledged, row.raised_ns, row.changed_ns)


def _write(row: AlarmRow, alarm: Alarm, time_ns: int) -> None:
    """Update the alarm's row; one that has cleared is closed, and keeps its peak and when it was raised."""
    row.phase, row.level = alarm.phase, int(alarm.level)
    if alarm.raised_ns is None or alarm.changed_ns is None:
        row.closed_ns = row.changed_ns = time_ns
        return
    row.peak, row.acknowledged_level = int(alarm.peak), int(alarm.acknowledged_level)
    row.raised_ns, row.changed_ns = alarm.raised_ns, alarm.changed_ns


def _changed(session: Session) -> list[AlarmRecord]:
    """Return the alarms that a session has changed."""
    session.flush()
    return _records(sorted(session.info.get(CHANGED, ()), key=lambda row: row.id))


def _records(rows: Iterable[AlarmRow]) -> list[AlarmRecord]:
    """Return alarms with their audit trails, in the order given."""
    return [AlarmRecord.model_validate(row, from_attributes=True) for row in rows]


def _reason(diagnosis: Diagnosis, name: str) -> str:
    if name != alarms.MODEL_ALARM:
        return diagnosis.reason
    suspected = f"; suspected: {diagnosis.suspected_effect}" if diagnosis.suspected_effect else ""
    return f"The friction model does not fit this wheel's telemetry{suspected}."


# ---- retention times -------------------------------------------------------------------------------------------------


# Records older than so many days before the latest window of their wheel are removed; open alarms are always kept.
DIAGNOSES_DAYS: Final = 180.0  # older ones are not added again, either
ESTIMATES_DAYS: Final = 730.0
ALARMS_DAYS: Final = 3650.0  # closed ones, with their audit trail


def oldest_ns(end_ns: int, days: float) -> int:
    """Return the time so many days before the latest window's end."""
    return end_ns - int(days * SECONDS_PER_DAY) * NANOSECONDS_PER_SECOND


# ---- retired wheels --------------------------------------------------------------------------------------------------
# Each change is an audit event that is never changed; a wheel's state is that of its last event. A retired wheel
# reappears when its telemetry arrives, even if the history cannot be written at present: events of this process take
# precedence over the database until they are written. Other dashboards may use the same history; their events are read
# periodically.


class RetiredWheels:
    """Which wheels are retired, and the audit events of that. It may be called from any thread.

    Parameters
    ----------
    database
        Of the history.
    wall_ns
        This machine's clock [ns].

    Raises
    ------
    HistoryError
        If the database cannot be read.
    """

    def __init__(self, database: Database, wall_ns: Callable[[], int]) -> None:
        self._session = database.session
        self._wall_ns = wall_ns
        self._lock = RLock()
        with self._session() as session:
            self._last = _latest(session)

    def latest(self) -> list[RetirementEvent]:
        """Return the last event of each wheel that has one."""
        with self._lock:
            return list(self._last.values())

    def names(self) -> set[tuple[str, str]]:
        """Return spacecraft and wheel of all that are retired."""
        return {(event.spacecraft, event.wheel) for event in self.latest() if event.retired}

    def events(self, spacecraft: str, wheel: str) -> list[RetirementEvent]:
        """Return all audit events of a wheel, the oldest first; raises HistoryError."""
        wanted = select(WheelEventRow).filter_by(spacecraft=spacecraft, wheel=wheel).order_by(WheelEventRow.id)
        with self._session() as session:
            return [_event(row) for row in session.scalars(wanted)]

    def refresh(self) -> list[RetirementEvent]:
        """Read the history again, when all events of this process are written; returns other dashboards' new events.

        Raises
        ------
        HistoryError
            If the history cannot be read; nothing is changed then.
        """
        with self._lock, self._session() as session:  # no event of this process between reading and keeping
            new = {name: event for name, event in _latest(session).items() if self._last.get(name) != event}
            self._last |= new
        return list(new.values())

    def change(self, spacecraft: str, wheel: str, person: str, note: str = "", *, retire: bool) -> RetirementEvent:
        """Retire a wheel, or bring a retired one back to the list; returns the audit event.

        Raises
        ------
        InputError
            If the wheel is already in that state, or one to be retired has an alarm that is not acknowledged.
        HistoryError
            If the database cannot be written; nothing is changed then.
        """
        source, name = f"{spacecraft}/{wheel}", {"spacecraft": spacecraft, "wheel": wheel}
        with self._session() as session:
            last = _latest(session).get((spacecraft, wheel))
            if last is not None and last.retired:
                if retire:
                    raise InputError(source, f"is retired already, by {last.person}")
                time_ns = last.time_ns
            else:
                if not retire:
                    raise InputError(source, "is not retired")
                waits = select(AlarmRow.name).filter_by(**name, closed_ns=None).where(AlarmRow.phase != "acknowledged")
                if waiting := session.scalars(waits).all():
                    raise InputError(source, f"has alarms to acknowledge first: {', '.join(waiting)}")
                time_ns = session.scalar(select(func.max(DiagnosisRow.window_end_ns)).filter_by(**name))
            event = RetirementEvent(
                **name, event="retired" if retire else "brought_back", time_ns=time_ns,
                wall_ns=self._wall_ns(), person=person, note=note,
            )  # fmt: skip
            session.add(WheelEventRow(**event.model_dump()))
        return self._keep(event)

    def _keep(self, event: RetirementEvent) -> RetirementEvent:
        with self._lock:
            self._last[event.spacecraft, event.wheel] = event
        return event

    def telemetry_arrived(
        self, spacecraft: str, wheel: str, window_end_ns: int | None = None
    ) -> RetirementEvent | None:
        """Report samples or a window of a wheel; returns the event to be recorded if a retired wheel reappears by that.

        A window that was known when the wheel was retired is a repetition, and does not bring it back.
        """
        with self._lock:
            last = self._last.get((spacecraft, wheel))
            if last is None or not last.retired:
                return None
            if window_end_ns is not None and last.time_ns is not None and window_end_ns <= last.time_ns:
                return None
            changes = {"event": "telemetry_arrived", "wall_ns": self._wall_ns(), "person": "", "note": ""}
            return self._keep(last.model_copy(update=changes))

    def record(self, events: Iterable[RetirementEvent]) -> None:
        """Write the events of wheels that reappeared; events of wheels that are not retired are ignored.

        Raises
        ------
        HistoryError
            If the database cannot be written; nothing is changed then.
        """
        with self._session() as session:
            last = _latest(session)
            for event in events:
                name = event.spacecraft, event.wheel
                if name in last and last[name].retired:
                    session.add(WheelEventRow(**event.model_dump()))
                    last[name] = event


def _latest(session: Session) -> dict[tuple[str, str], RetirementEvent]:
    """Return the last event of each wheel in the database, by spacecraft and wheel."""
    last = select(func.max(WheelEventRow.id)).group_by(WheelEventRow.spacecraft, WheelEventRow.wheel)
    wanted = select(WheelEventRow).where(WheelEventRow.id.in_(last)).order_by(WheelEventRow.id)
    return {(row.spacecraft, row.wheel): _event(row) for row in session.scalars(wanted)}


def _event(row: WheelEventRow) -> RetirementEvent:
    return RetirementEvent.model_validate(row, from_attributes=True)
