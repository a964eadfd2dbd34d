"""Wheels that somebody has put aside, as the dashboard shows them: the API changes it, the listener brings back.

A wheel that speaks is back at once, also where the history cannot be written just now: what is here goes before what is
written, until all of it is. Other dashboards may work on the same history; what they write is read again and again.
"""

from __future__ import annotations

import time
from threading import Lock

from rwa_monitor.history.records import WheelLine
from rwa_monitor.history.wheel_list import WheelList


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
