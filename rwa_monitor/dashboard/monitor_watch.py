"""Which wheels have a monitor that speaks: one that does not any more is an alarm of its own.

A monitor speaks of each of its wheels once a second. It is expected from its first word on, also by a dashboard that is
started after it died: the history keeps for which wheels one was ever heard. It is expected, too, where samples come:
with `run --wheels` and `--shard` a wheel may be nobody's. Silence is counted on a clock that nobody sets, from this
dashboard's start at the earliest.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Final

from rwa_monitor.history.records import MonitorWord
from rwa_monitor.monitor.monitor import STATUS_PERIOD_S
from rwa_monitor.words import time_text

# A restart takes a monitor some seconds, and one that diagnoses many wheels at once may be late by as many.
SILENT_PERIODS: Final = 30
SILENT_S: Final = SILENT_PERIODS * STATUS_PERIOD_S


@dataclass(slots=True)
class _Monitor:
    """What is known of the monitor of one wheel; `written` is what the history knows of its silence, None: nothing.

    While it has not been heard, `heard_s` is when the wait for it began: with the first samples, if those are known.
    """

    heard_s: float
    heard_wall_ns: int | None = None
    samples_wall_ns: int | None = None
    time_ns: int | None = None
    written: bool | None = None


class MonitorWatch:
    """The monitors of all wheels, as one dashboard hears them.

    Parameters
    ----------
    silent_s
        Silence from which it is an alarm [s]; 0 for none.
    expected
        Wheels, by spacecraft and name, whose monitor the history knows, and whether its alarm is up.
    clock_s, wall_ns
        A clock that nobody sets [s], and this machine's [ns].
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

    def hear(self, spacecraft: str, wheel: str, time_ns: int | None) -> None:
        """Note that the monitor of a wheel spoke, and the time of the wheel's latest sample [ns], if it knows one."""
        known = self._monitors.setdefault((spacecraft, wheel), _Monitor(0.0))
        known.heard_s, known.heard_wall_ns = self._clock_s(), self._wall_ns()
        known.time_ns = known.time_ns if time_ns is None else time_ns

    def expect(self, spacecraft: str, wheel: str) -> None:
        """Note that samples of a wheel came: somebody should monitor it."""
        if (spacecraft, wheel) not in self._monitors:
            self._monitors[spacecraft, wheel] = _Monitor(self._clock_s(), samples_wall_ns=self._wall_ns())

    def news(self, aside: Collection[tuple[str, str]], trouble: str) -> list[MonitorWord]:
        """Return what the history does not know yet: monitors that are heard, and those that are not any more.

        Parameters
        ----------
        aside
            Wheels that are put aside: nobody waits for their monitors.
        trouble
            What is wrong with the dashboard's own connection, in words; "" where nothing is.
        """
        if not self._silent_s:
            return []
        now_s = self._clock_s()
        found = []
        for name, one in self._monitors.items():
            silent = now_s - one.heard_s > self._silent_s
            if not silent and one.heard_wall_ns is None:
                continue  # expected, and not heard yet: what is written stands
            if silent != one.written and not (silent and name in aside):
                reason = self._reason(one, now_s, trouble) if silent else ""
                found.append(MonitorWord(*name, silent, one.time_ns, reason))
        return found

    def written(self, words: Iterable[MonitorWord]) -> None:
        """Note that the history knows this now."""
        for word in words:
            self._monitors[word.spacecraft, word.wheel].written = word.silent

    def _reason(self, one: _Monitor, now_s: float, trouble: str) -> str:
        if one.samples_wall_ns is not None and one.heard_wall_ns is None:
            since = f"samples of this wheel came first, at {time_text(one.samples_wall_ns)}"
        elif one.heard_wall_ns is None:
            since = f"this dashboard was started, at {time_text(self._start_wall_ns)}"
        else:
            since = time_text(one.heard_wall_ns)
        said = f"No monitor has been heard since {since}: {now_s - one.heard_s:.0f} s and longer."
        return f"{said} {trouble}" if trouble else said
