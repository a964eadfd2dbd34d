"""Stored telemetry of a wheel: dumps that arrive hours late, in any order, merged with the live samples of that time.

Windows continue the grid of the live samples so far, or else have a phase fixed by the wheel's clock and not by the
first arrival, so that they are the same in whatever order dumps arrive. A window is due for diagnosis when all its
slots are taken, or when the dump has moved on to other windows; samples that still arrive for it make it due again. As
in the rest of the core, the machine's clock is not used.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from rwa_monitor.messages import ClockNs, Count, Slot
from rwa_monitor.monitor.ingest import Counts, Rows, fits, median_time
from rwa_monitor.samples import MAX_TIME_NS, MIN_TIME_NS, FloatArray, IntArray, SlotGrid
from rwa_monitor.switching.carried_state import CarriedState

# Kept of a wheel that has dumps: 24 hours at 8 Hz, 12 MB where friction is given, 6 MB for each further channel.
KEPT_SLOTS: Final = 691_200
MAX_WINDOWS: Final = 64  # of a wheel, kept or open at once: a late one has those after it diagnosed again
LEFT_SHARE: Final = 8  # a dump has left a window after 1/8 of a window of samples for other windows


@dataclass(slots=True)
class StoredWindow:
    """The samples received for one window.

    Attributes
    ----------
    values
        float64 (window slots,) of every channel, NaN where there is no good sample.
    stored
        Whether some of the samples were stored ones.
    due
        Whether it is to be diagnosed: samples have arrived since it last was, and it has stored ones.
    diagnosed
        Whether it has been diagnosed with stored samples.
    elsewhere
        Number of samples for other windows since the last one for this.
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
        Stored samples far ahead of all others, until the next ones confirm or reject them: a dump after days, or wrong
        times.
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
        """Number of windows before the newest one that are kept."""
        return min(-(-KEPT_SLOTS // self.window_slots), MAX_WINDOWS)

    def fits(self, period_ns: int, window_slots: int, channels: Sequence[str]) -> bool:
        """Return whether this state of a checkpoint fits a core with such a wheel."""
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
        """Add samples to their windows, in slots that are not taken yet.

        Parameters
        ----------
        rows
            The samples, in any order.
        counts
            Where to count what became of stored samples; None for live ones, which are counted already.

        Returns
        -------
        bool
            Whether some are older than the windows that are kept.
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
                    counts.settle(rejected=len(waited))
                if self.newest is not None and middle > self.newest + self.kept:
                    self.waiting = rows
                    return False
        elif self.newest is not None and middle < self.newest - self.kept:  # the wheel's clock was set back
            self.windows.clear()
            self.newest = middle
        self.newest = middle if self.newest is None else max(self.newest, middle)
        numbers, places = np.divmod(self.grid_of(0).slot_of(rows.time_ns), self.window_slots)
        good, fresh = rows.good(), np.zeros(len(rows), dtype=np.bool_)
        late, wild = numbers < self.newest - self.kept, numbers > self.newest + self.kept
        within = ~(late | wild)
        for number in np.unique(numbers[good & within]).tolist():
            if number not in self.windows:
                self.windows[number] = StoredWindow({name: np.full(self.window_slots, np.nan) for name in rows.values})
            window = self.windows[number]
            own = np.flatnonzero((numbers == number) & good)
            own = own[np.isnan(window.values["speed_rad_s"][places[own]])]
            own = own[np.unique(places[own], return_index=True)[1]]  # the first of those for one slot
            if not own.size:
                continue
            fresh[own] = True
            for name, values in rows.values.items():
                window.values[name][places[own]] = values[own]
            window.stored |= counts is not None
            window.due |= window.stored or window.diagnosed
            window.elsewhere = -len(rows)
        for window in self.windows.values():
            window.elsewhere += len(rows)
        if counts is not None:
            masked, duplicate = within & ~good, within & good & ~fresh
            counts.settle(late=late.sum(), rejected=wild.sum(), masked=masked.sum(), used=fresh.sum())
            counts.settle(duplicate=duplicate.sum())
        return bool(late.any())

    def _middle(self, rows: Rows) -> int:
        """Return the number of the window of the median time: a single time may be wrong."""
        return self.grid_of(0).slot_of(median_time(rows.time_ns)) // self.window_slots

    # ---- windows out ------------------------------------------------------------------------------------------------

    def due(self, *, to_the_end: bool) -> Iterator[tuple[SlotGrid, StoredWindow, CarriedState, bool]]:
        """Yield the windows that are due, the earliest first, and the later ones whose prior state changes by that.

        Each comes with its slot grid, the latest state before it, and whether that state's window ends where this one
        begins. The caller must `note` the state after it before it takes the next one.

        Parameters
        ----------
        to_the_end
            Whether the telemetry has ended.
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
