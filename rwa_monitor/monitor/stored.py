"""Stored telemetry of a wheel: dumps that come hours late, in any order, laid beside the live samples of that time.

Time is cut into the windows of the live samples before, or else of a grid that is fixed by the clock and not by what
came first, so that the windows are the same in whatever order dumps come. A window is due when all its slots are taken,
or when the dump has gone on elsewhere; what still comes for it makes it due again. Like the rest of the core it has no
clock of the machine.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from rwa_monitor.messages import ClockNs, Count, Slot
from rwa_monitor.monitor.ingest import Counts, Rows, fits
from rwa_monitor.samples import MAX_TIME_NS, MIN_TIME_NS, FloatArray, IntArray, SlotGrid
from rwa_monitor.switching.carried_state import CarriedState

# Kept of a wheel that has dumps: 24 hours at 8 Hz, 12 MB where friction is given, 6 MB for each further channel.
KEPT_SLOTS: Final = 691_200
MAX_WINDOWS: Final = 64  # of a wheel, kept or open at once: one that comes late has those after it diagnosed again
LEFT_SHARE: Final = 8  # samples for other windows, as a part of a window, after which a dump has gone on elsewhere


@dataclass(slots=True)
class StoredWindow:
    """What has come for one window.

    Attributes
    ----------
    values
        float64 (window slots,) of every channel, NaN where there is no good sample.
    stored
        Whether some of it was stored.
    due
        Whether something has come since it was diagnosed last.
    diagnosed
        Whether it was.
    elsewhere
        Samples for other windows since the last one for this.
    """

    values: dict[str, FloatArray]
    stored: bool = False
    due: bool = False
    diagnosed: bool = False
    elsewhere: Count = 0

    def slots(self) -> IntArray:
        """Return the slots that are taken, int64 (n,)."""
        return np.flatnonzero(np.isfinite(self.values["speed_rad_s"]))

    @property
    def is_full(self) -> bool:
        """Whether all slots are taken."""
        return bool(np.isfinite(self.values["speed_rad_s"]).all())


@dataclass(slots=True)
class StoredTelemetry:
    """The latest windows of a wheel that has dumps, live and stored samples together.

    Attributes
    ----------
    period_ns, window_slots, phase_ns
        The grid: window k begins at `phase_ns` + k·`window_slots`·`period_ns`.
    windows
        By number.
    states
        The carried state after windows, live and stored, by their ends [ns].
    newest
        Number of the latest window that a message was for, None before the first.
    waiting
        Stored samples far ahead of all others, which the next ones judge: a dump after days, or wild times.
    """

    period_ns: Count
    window_slots: Count
    phase_ns: ClockNs
    windows: dict[Slot, StoredWindow] = field(default_factory=dict)
    states: dict[ClockNs, CarriedState] = field(default_factory=dict)
    newest: Slot | None = None
    waiting: Rows | None = None

    @property
    def kept(self) -> int:
        """Windows before the newest one that are kept."""
        return min(-(-KEPT_SLOTS // self.window_slots), MAX_WINDOWS)

    def fits(self, period_ns: int, window_slots: int, channels: Sequence[str]) -> bool:
        """Return whether it can be of a core with such a wheel."""
        rows = self.waiting
        kept: list[tuple[Mapping[str, FloatArray], int]] = [(one.values, window_slots) for one in self.windows.values()]
        kept += [] if rows is None else [(rows.values, len(rows))]
        numbers = [*self.windows, self.newest or 0]
        return (
            (self.period_ns, self.window_slots) == (period_ns, window_slots)
            and all(MIN_TIME_NS <= self.grid_of(number).origin_ns <= MAX_TIME_NS for number in numbers)
            and all(fits(values, count, channels) for values, count in kept)
        )

    def grid_of(self, number: int) -> SlotGrid:
        """Return the slot grid that begins with a window."""
        return SlotGrid(self.phase_ns + number * self.window_slots * self.period_ns, self.period_ns)

    # ---- samples in -------------------------------------------------------------------------------------------------

    def add(self, rows: Rows, counts: Counts | None) -> bool:
        """Lay samples into their windows, where a slot is not taken yet.

        Parameters
        ----------
        rows
            The samples, in any order.
        counts
            Where to count what became of stored samples; None for live ones, which are counted already.

        Returns
        -------
        bool
            Whether some came later than anything is kept.
        """
        pieces = (rows[start : start + self.window_slots] for start in range(0, len(rows), self.window_slots))
        return sum(self._add(piece, counts) for piece in pieces) > 0

    def _add(self, rows: Rows, counts: Counts | None) -> bool:
        middle = self._middle(rows)
        if counts is not None:
            waited, self.waiting = self.waiting, None
            if waited is not None and abs(self._middle(waited) - middle) <= self.kept:
                rows = waited.followed_by(rows)
            else:
                if waited is not None:
                    counts.rejected += len(waited)
                    counts.queued -= len(waited)
                if self.newest is not None and middle > self.newest + self.kept:
                    self.waiting = rows
                    return False
        elif self.newest is not None and middle < self.newest - self.kept:  # the wheel's clock was set back
            self.windows.clear()
            self.newest = middle
        self.newest = middle if self.newest is None else max(self.newest, middle)
        slots = self.grid_of(0).slot_of(rows.time_ns)
        numbers = slots // self.window_slots
        good, fresh = rows.good(), np.zeros(len(rows), dtype=np.bool_)
        late, wild = numbers < self.newest - self.kept, numbers > self.newest + self.kept
        within = ~(late | wild)
        places = slots - numbers * self.window_slots
        for number in np.unique(numbers[good & within]).tolist():
            window = self.windows.get(number) or StoredWindow(
                {name: np.full(self.window_slots, np.nan) for name in rows.values}
            )
            own = np.flatnonzero((numbers == number) & good)
            own = own[np.isnan(window.values["speed_rad_s"][places[own]])]
            own = own[np.unique(places[own], return_index=True)[1]]  # the first of those for one slot
            if not own.size:
                continue
            self.windows[number] = window
            fresh[own] = True
            for name, values in rows.values.items():
                window.values[name][places[own]] = values[own]
            window.stored |= counts is not None
            window.due |= window.stored or window.diagnosed
            window.elsewhere = -len(rows)
        for window in self.windows.values():
            window.elsewhere += len(rows)
        if counts is not None:
            counts.late += int(late.sum())
            counts.rejected += int(wild.sum())
            counts.masked += int((within & ~good).sum())
            counts.used += int(fresh.sum())
            counts.duplicate += int((within & good & ~fresh).sum())
            counts.queued -= len(rows)
        return bool(late.any())

    def _middle(self, rows: Rows) -> int:
        """Return the window of samples that are together: of the one in the middle, as a single time may be wild."""
        rank = len(rows) // 2
        return int(self.grid_of(0).slot_of(int(np.partition(rows.time_ns, rank)[rank]))) // self.window_slots

    # ---- windows out ------------------------------------------------------------------------------------------------

    def due(self, *, to_the_end: bool) -> Iterator[tuple[SlotGrid, StoredWindow, CarriedState, bool]]:
        """Yield the windows that are to be diagnosed, the earliest first, and those after them that it changes.

        Each comes with its grid, the state before it, and whether that is the one at its very beginning. The state
        after it is to be noted before the next one is asked for.

        Parameters
        ----------
        to_the_end
            Whether nothing more will come.
        """
        earlier_changed = False
        oldest = (self.newest or 0) - self.kept
        for number, window in sorted(self.windows.items()):
            grid = self.grid_of(number)
            closed = window.diagnosed or self.grid_of(number + 1).origin_ns in self.states
            left = window.elsewhere >= self.window_slots // LEFT_SHARE or number < oldest
            fresh = window.due and (to_the_end or left or window.is_full)
            if not fresh and not (earlier_changed and (closed or window.is_full)):
                continue
            earlier_changed = True
            before_ns = max((end_ns for end_ns in self.states if end_ns <= grid.origin_ns), default=None)
            before = CarriedState.empty() if before_ns is None else self.states[before_ns]
            yield grid, window, before, before_ns == grid.origin_ns
            window.due, window.diagnosed = False, True
        for number in [number for number in self.windows if number < oldest]:
            del self.windows[number]

    def note(self, end_ns: int, state: CarriedState) -> None:
        """Keep the state after a window, live or stored."""
        self.states[end_ns] = state
        while len(self.states) > 2 * MAX_WINDOWS:
            del self.states[min(self.states)]
