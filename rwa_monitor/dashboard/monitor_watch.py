"""Which wheels have a monitor that reports: one that does not any more is an alarm of its own.

A monitor publishes the status of each of its wheels once a second. It is expected from its first status on, also by a
dashboard that is started after it died: the history keeps which wheels ever had one. It is expected, too, where samples
come: with `run --wheels` and `--shard` a wheel may have no monitor. Silence is measured on a clock that only goes
forward, from this dashboard's start at the earliest.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Final

from rwa_monitor.history.records import MonitorState
from rwa_monitor.monitor.monitor import STATUS_PERIOD_S
from rwa_monitor.words import time_text

# A restart takes a monitor some seconds, and one that diagnoses many wheels at once may be late by as many.
SILENT_PERIODS: Final = 30
SILENT_S: Final = SILENT_PERIODS * STATUS_PERIOD_S


@dataclass(slots=True)
class _Monitor:
    """The monitor of one wheel; `written` is what the history holds of its silence, None: nothing.

    Before its first status, `last_s` is when the wait for it began: with the first samples, if those are known.
    """

    last_s: float
    last_wall_ns: int | None = None
    samples_wall_ns: int | None = None
    time_ns: int | None = None
    written: bool | None = None


class MonitorWatch:
    """The monitors of all wheels, as one dashboard receives their status.

    Parameters
    ----------
    silent_s
        Silence from which it is an alarm [s]; 0 for none.
    expected
        Wheels, by spacecraft and name, whose monitor is in the history, and whether its alarm is up.
    clock_s, wall_ns
        A clock that only goes forward [s], and this machine's [ns].
    """

    def __init__(
        self,
        silent_s: float,
        expected: Mapping[tuple[str, str], bool],
        clock_s: Callable[[], float] = time.monotonic,
        wall_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self._silent_s = silent_s
        self._clock_s, self._wall_ns = clock_s, wall_ns
        self._start_wall_ns = wall_ns()
        self._monitors = {name: _Monitor(clock_s(), written=alarmed) for name, alarmed in expected.items()}

    def take_status(self, spacecraft: str, wheel: str, time_ns: int | None) -> None:
        """Note a status of a wheel's monitor, and the time of the wheel's latest sample [ns], if it has one."""
        known = self._monitors.setdefault((spacecraft, wheel), _Monitor(0.0))
        known.last_s, known.last_wall_ns = self._clock_s(), self._wall_ns()
        known.time_ns = known.time_ns if time_ns is None else time_ns

    def expect(self, spacecraft: str, wheel: str) -> None:
        """Note that samples of a wheel came: it should have a monitor."""
        if (spacecraft, wheel) not in self._monitors:
            self._monitors[spacecraft, wheel] = _Monitor(self._clock_s(), samples_wall_ns=self._wall_ns())

    def news(self, retired: Collection[tuple[str, str]], trouble: str) -> list[MonitorState]:
        """Return what the history does not hold yet: monitors that report, and those that do not any more.

        Parameters
        ----------
        retired
            Wheels whose monitors are no longer expected.
        trouble
            What is wrong with the dashboard's own connection, in words; "" where nothing is.
        """
        if not self._silent_s:
            return []
        now_s = self._clock_s()
        found = []
        for name, one in self._monitors.items():
            silent = now_s - one.last_s > self._silent_s
            if not silent and one.last_wall_ns is None:
                continue  # expected, without a status yet: what is written stands
            if silent != one.written and not (silent and name in retired):
                reason = self._reason(one, now_s, trouble) if silent else ""
                found.append(MonitorState(*name, silent, one.time_ns, reason))
        return found

    def written(self, states: Iterable[MonitorState]) -> None:
        """Note that the history holds this now."""
        for state in states:
            self._monitors[state.spacecraft, state.wheel].written = state.silent

    def _reason(self, one: _Monitor, now_s: float, trouble: str) -> str:
        if one.samples_wall_ns is not None and one.last_wall_ns is None:
            since = f"samples of this wheel came first, at {time_text(one.samples_wall_ns)}"
        elif one.last_wall_ns is None:
            since = f"this dashboard was started, at {time_text(self._start_wall_ns)}"
        else:
            since = time_text(one.last_wall_ns)
        reason = f"No monitor has reported since {since}: {now_s - one.last_s:.0f} s and longer."
        return f"{reason} {trouble}" if trouble else reason
