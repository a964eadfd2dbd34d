"""Which wheels somebody has put aside: a wheel that is retired leaves the list, and nothing of it is removed.

Each deed is a line that is never changed; where a wheel stands is what its last line says. A wheel that is put aside
comes back by itself when it speaks again.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from threading import Lock

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from rwa_monitor.errors import InputError
from rwa_monitor.history.database import Database
from rwa_monitor.history.records import WheelLine, signed
from rwa_monitor.history.tables import AlarmRow, DiagnosisRow, WheelEventRow


class WheelList:
    """The deeds on the list of wheels, in the history's database.

    Parameters
    ----------
    database
        Of the history.
    wall_ns
        This machine's clock [ns].
    """

    def __init__(self, database: Database, wall_ns: Callable[[], int]) -> None:
        self._database = database
        self._wall_ns = wall_ns

    def put_aside(self, spacecraft: str, wheel: str, person: str, note: str = "") -> WheelLine:
        """Put a wheel aside; returns the line that says so.

        Raises
        ------
        InputError
            If the wheel is put aside already, an alarm of it waits to be acknowledged, or the name is missing or too
            long.
        HistoryError
            If the database cannot be written; nothing is changed then.
        """
        person, note = signed(person, note)
        with self._database.session() as session:
            last = _last(session, spacecraft, wheel)
            if last is not None and last.aside:
                raise InputError(f"{spacecraft}/{wheel}", f"is put aside already, by {last.person}")
            alarms = select(AlarmRow.name).filter_by(spacecraft=spacecraft, wheel=wheel, closed_ns=None)
            waiting = session.scalars(alarms.where(AlarmRow.phase != "acknowledged")).all()
            if waiting:
                raise InputError(f"{spacecraft}/{wheel}", f"has alarms to acknowledge first: {', '.join(waiting)}")
            windows = select(func.max(DiagnosisRow.window_end_ns)).filter_by(spacecraft=spacecraft, wheel=wheel)
            line = WheelLine(
                spacecraft=spacecraft, wheel=wheel, event="put_aside", time_ns=session.scalar(windows),
                wall_ns=self._wall_ns(), person=person, note=note,
            )  # fmt: skip
            session.add(WheelEventRow(**line.model_dump()))
            return line

    def bring_back(self, spacecraft: str, wheel: str, person: str, note: str = "") -> WheelLine:
        """Bring a wheel back that is put aside; returns the line that says so.

        Raises
        ------
        InputError
            If the wheel is not put aside, or the name is missing or too long.
        HistoryError
            If the database cannot be written; nothing is changed then.
        """
        person, note = signed(person, note)
        with self._database.session() as session:
            last = _last(session, spacecraft, wheel)
            if last is None or not last.aside:
                raise InputError(f"{spacecraft}/{wheel}", "is not put aside")
            changes = {"event": "brought_back", "wall_ns": self._wall_ns(), "person": person, "note": note}
            line = last.model_copy(update=changes)
            session.add(WheelEventRow(**line.model_dump()))
            return line

    def spoke_again(self, lines: Iterable[WheelLine]) -> None:
        """Write down which wheels spoke again; of one that is not put aside nothing is written.

        Raises
        ------
        HistoryError
            If the database cannot be written; nothing is changed then.
        """
        with self._database.session() as session:
            for line in lines:
                last = _last(session, line.spacecraft, line.wheel)
                if last is not None and last.aside:
                    session.add(WheelEventRow(**line.model_dump()))

    def lines(self, spacecraft: str, wheel: str) -> list[WheelLine]:
        """Return all that was done with a wheel, the oldest first."""
        wanted = select(WheelEventRow).filter_by(spacecraft=spacecraft, wheel=wheel).order_by(WheelEventRow.id)
        with self._database.session() as session:
            return [_line(row) for row in session.scalars(wanted)]

    def latest(self) -> list[WheelLine]:
        """Return the last line of every wheel that has one."""
        last = select(func.max(WheelEventRow.id)).group_by(WheelEventRow.spacecraft, WheelEventRow.wheel)
        wanted = select(WheelEventRow).where(WheelEventRow.id.in_(last)).order_by(WheelEventRow.id)
        with self._database.session() as session:
            return [_line(row) for row in session.scalars(wanted)]


def _last(session: Session, spacecraft: str, wheel: str) -> WheelLine | None:
    wanted = select(WheelEventRow).filter_by(spacecraft=spacecraft, wheel=wheel).order_by(WheelEventRow.id.desc())
    row = session.scalar(wanted.limit(1))
    return None if row is None else _line(row)


def _line(row: WheelEventRow) -> WheelLine:
    return WheelLine.model_validate({name: getattr(row, name) for name in WheelLine.model_fields})


# ---- as the dashboard shows them -------------------------------------------------------------------------------------


class Aside:
    """The last line of each wheel that was ever put aside. It may be called from any thread.

    Parameters
    ----------
    wheel_list
        The history's.

    Raises
    ------
    HistoryError
        If the history cannot be read.
    """

    def __init__(self, wheel_list: WheelList) -> None:
        self._list = wheel_list
        self._lock = Lock()
        self._deeds = 0  # done here so far
        self._last = {(line.spacecraft, line.wheel): line for line in wheel_list.latest()}

    def lines(self) -> list[WheelLine]:
        """Return the last line of each wheel that has one."""
        with self._lock:
            return list(self._last.values())

    def names(self) -> set[tuple[str, str]]:
        """Return spacecraft and wheel of all that are put aside."""
        return {(line.spacecraft, line.wheel) for line in self.lines() if line.aside}

    def refresh(self) -> list[WheelLine]:
        """Read the history again, where all that was done here is written; returns what others did since then.

        Raises
        ------
        HistoryError
            If the history cannot be read; nothing is changed then.
        """
        with self._lock:
            deeds = self._deeds
        written = self._list.latest()
        with self._lock:
            if deeds != self._deeds:
                return []  # something was done here meanwhile, perhaps after the history was read: the next time
            new = [line for line in written if self._last.get((line.spacecraft, line.wheel)) != line]
            self._last |= {(line.spacecraft, line.wheel): line for line in new}
        return new

    def put(self, spacecraft: str, wheel: str, person: str, note: str) -> WheelLine:
        """Put a wheel aside; raises as `WheelList.put_aside`."""
        return self._keep(self._list.put_aside(spacecraft, wheel, person, note))

    def bring_back(self, spacecraft: str, wheel: str, person: str, note: str) -> WheelLine:
        """Bring a wheel back; raises as `WheelList.bring_back`."""
        return self._keep(self._list.bring_back(spacecraft, wheel, person, note))

    def hear(self, spacecraft: str, wheel: str, window_end_ns: int | None = None) -> WheelLine | None:
        """Note that a wheel spoke, with samples or with a window; returns the line to be written if it is back by that.

        A window that was known when the wheel was put aside is a repetition, and brings nothing back.
        """
        with self._lock:
            last = self._last.get((spacecraft, wheel))
            if last is None or not last.aside:
                return None
            if window_end_ns is not None and last.time_ns is not None and window_end_ns <= last.time_ns:
                return None
            changes = {"event": "spoke_again", "wall_ns": time.time_ns(), "person": "", "note": ""}
            self._deeds += 1
            self._last[spacecraft, wheel] = line = last.model_copy(update=changes)
            return line

    def _keep(self, line: WheelLine) -> WheelLine:
        with self._lock:
            self._deeds += 1
            self._last[line.spacecraft, line.wheel] = line
        return line
