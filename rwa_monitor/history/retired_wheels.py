"""Wheels that a person has retired: they leave the list of wheels, and nothing of them is removed.

Each change is an audit event that is never changed; where a wheel stands is in its last event. A retired wheel
reappears when its telemetry arrives, also where the history cannot be written just now: what was done here goes before
what is written, until all of it is. Other dashboards may work on the same history; what they write is read again and
again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from threading import RLock

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from rwa_monitor.errors import InputError
from rwa_monitor.history.database import AlarmRow, Database, DiagnosisRow, WheelEventRow
from rwa_monitor.history.records import RetirementEvent, signed


class RetiredWheels:
    """Which wheels are retired, and the audit events of it. It may be called from any thread.

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
        self._database = database
        self._wall_ns = wall_ns
        self._lock = RLock()
        self._changes = 0  # made here so far
        self._last = {(event.spacecraft, event.wheel): event for event in self._read()}

    def latest(self) -> list[RetirementEvent]:
        """Return the last event of each wheel that has one."""
        with self._lock:
            return list(self._last.values())

    def names(self) -> set[tuple[str, str]]:
        """Return spacecraft and wheel of all that are retired."""
        return {(event.spacecraft, event.wheel) for event in self.latest() if event.retired}

    def events(self, spacecraft: str, wheel: str) -> list[RetirementEvent]:
        """Return all that was done with a wheel, the oldest first; raises HistoryError."""
        wanted = select(WheelEventRow).filter_by(spacecraft=spacecraft, wheel=wheel).order_by(WheelEventRow.id)
        with self._database.session() as session:
            return [_event(row) for row in session.scalars(wanted)]

    def refresh(self) -> list[RetirementEvent]:
        """Read the history again, where all that was done here is written; returns what others did since then.

        Raises
        ------
        HistoryError
            If the history cannot be read; nothing is changed then.
        """
        with self._lock:
            changes = self._changes
        written = self._read()
        with self._lock:
            if changes != self._changes:
                return []  # something was done here meanwhile, perhaps after the history was read: the next time
            new = [event for event in written if self._last.get((event.spacecraft, event.wheel)) != event]
            self._last |= {(event.spacecraft, event.wheel): event for event in new}
        return new

    def retire(self, spacecraft: str, wheel: str, person: str, note: str = "") -> RetirementEvent:
        """Retire a wheel; returns the audit event.

        Raises
        ------
        InputError
            If the wheel is retired already, an alarm of it waits to be acknowledged, or the name is missing or too
            long.
        HistoryError
            If the database cannot be written; nothing is changed then.
        """
        person, note = signed(person, note)
        with self._database.session() as session:
            last = _last(session, spacecraft, wheel)
            if last is not None and last.retired:
                raise InputError(f"{spacecraft}/{wheel}", f"is retired already, by {last.person}")
            alarms = select(AlarmRow.name).filter_by(spacecraft=spacecraft, wheel=wheel, closed_ns=None)
            waiting = session.scalars(alarms.where(AlarmRow.phase != "acknowledged")).all()
            if waiting:
                raise InputError(f"{spacecraft}/{wheel}", f"has alarms to acknowledge first: {', '.join(waiting)}")
            windows = select(func.max(DiagnosisRow.window_end_ns)).filter_by(spacecraft=spacecraft, wheel=wheel)
            event = RetirementEvent(
                spacecraft=spacecraft, wheel=wheel, event="put_aside", time_ns=session.scalar(windows),
                wall_ns=self._wall_ns(), person=person, note=note,
            )  # fmt: skip
            session.add(WheelEventRow(**event.model_dump()))
        return self._keep(event)

    def restore(self, spacecraft: str, wheel: str, person: str, note: str = "") -> RetirementEvent:
        """Bring a retired wheel back to the list; returns the audit event.

        Raises
        ------
        InputError
            If the wheel is not retired, or the name is missing or too long.
        HistoryError
            If the database cannot be written; nothing is changed then.
        """
        person, note = signed(person, note)
        with self._database.session() as session:
            last = _last(session, spacecraft, wheel)
            if last is None or not last.retired:
                raise InputError(f"{spacecraft}/{wheel}", "is not retired")
            changes = {"event": "brought_back", "wall_ns": self._wall_ns(), "person": person, "note": note}
            event = last.model_copy(update=changes)
            session.add(WheelEventRow(**event.model_dump()))
        return self._keep(event)

    def _keep(self, event: RetirementEvent) -> RetirementEvent:
        with self._lock:
            self._changes += 1
            self._last[event.spacecraft, event.wheel] = event
        return event

    def telemetry_arrived(
        self, spacecraft: str, wheel: str, window_end_ns: int | None = None
    ) -> RetirementEvent | None:
        """Note samples or a window of a wheel; returns the event to be recorded if the wheel reappears by that.

        A window that was known when the wheel was retired is a repetition, and brings nothing back.
        """
        with self._lock:
            last = self._last.get((spacecraft, wheel))
            if last is None or not last.retired:
                return None
            if window_end_ns is not None and last.time_ns is not None and window_end_ns <= last.time_ns:
                return None
            changes = {"event": "spoke_again", "wall_ns": self._wall_ns(), "person": "", "note": ""}
            return self._keep(last.model_copy(update=changes))

    def record(self, events: Iterable[RetirementEvent]) -> None:
        """Write down which wheels reappeared; of one that is not retired nothing is written.

        Raises
        ------
        HistoryError
            If the database cannot be written; nothing is changed then.
        """
        with self._database.session() as session:
            for event in events:
                last = _last(session, event.spacecraft, event.wheel)
                if last is not None and last.retired:
                    session.add(WheelEventRow(**event.model_dump()))

    def _read(self) -> list[RetirementEvent]:
        """Return the last event of every wheel as the database has it."""
        last = select(func.max(WheelEventRow.id)).group_by(WheelEventRow.spacecraft, WheelEventRow.wheel)
        wanted = select(WheelEventRow).where(WheelEventRow.id.in_(last)).order_by(WheelEventRow.id)
        with self._database.session() as session:
            return [_event(row) for row in session.scalars(wanted)]


def _last(session: Session, spacecraft: str, wheel: str) -> RetirementEvent | None:
    wanted = select(WheelEventRow).filter_by(spacecraft=spacecraft, wheel=wheel).order_by(WheelEventRow.id.desc())
    row = session.scalar(wanted.limit(1))
    return None if row is None else _event(row)


def _event(row: WheelEventRow) -> RetirementEvent:
    return RetirementEvent.model_validate(row, from_attributes=True)
