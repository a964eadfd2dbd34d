"""Gives each sample its slot, and accounts for every one of them.

    received = used + masked + late + duplicate + rejected + queued, always.

It has no clock of the machine: what is decided depends on the samples alone, and not on how they are cut into messages.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from operator import attrgetter
from typing import Final, NamedTuple, Self

import numpy as np

from rwa_monitor.kernels.ingest import all_between, assign_slots
from rwa_monitor.monitor.ingest.sequencer import Counts
from rwa_monitor.samples import CHANNELS, MAX_TIME_NS, MIN_TIME_NS, BoolArray, FloatArray, IntArray, Samples, SlotGrid
from rwa_monitor.telemetry.ring_buffer import RingBuffer
from rwa_monitor.wheel.wheel import Limits

_channels_of: Final = attrgetter(*CHANNELS)  # of samples, all at once: asked of every message

# In SI units: no wheel, with limits of its own or without, has more. Sums of squares stay far from overflow.
MAX_MAGNITUDE: Final = 1e6
# Slots written to the ring buffer, and samples looked at, in one go.
PIECE_SLOTS: Final = 4_096


@dataclass(frozen=True, slots=True)
class Rows:
    """Samples within the wheel's limits, with the values that go into the ring buffer.

    Attributes
    ----------
    time_ns
        int64 (n,).
    values
        float64 (n,) of every channel of the ring buffer, NaN where not measured.
    """

    time_ns: IntArray
    values: Mapping[str, FloatArray]

    def __len__(self) -> int:
        """Count the samples."""
        return int(self.time_ns.size)

    def __getitem__(self, selection: slice | IntArray) -> Self:
        """Select samples, all channels alike."""
        values = {name: array[selection] for name, array in self.values.items()}
        return type(self)(self.time_ns[selection], values)

    def followed_by(self, others: Rows) -> Rows:
        """Return these samples and then the others."""
        values = {name: np.concatenate((array, others.values[name])) for name, array in self.values.items()}
        return Rows(np.concatenate((self.time_ns, others.time_ns)), values)

    def good(self) -> BoolArray:
        """Return which samples have both values that a diagnosis needs, bool (n,)."""
        return np.isfinite(self.values["speed_rad_s"]) & np.isfinite(self.values["torque_Nm"])


_NO_SLOTS: Final[IntArray] = np.zeros(0, dtype=np.int64)


class Piece(NamedTuple):
    """Samples that go on from the last slot.

    Attributes
    ----------
    stop
        Row at which the rest of the samples begins.
    epoch
        The new slot grid where an epoch begins with the first row, otherwise None.
    step_ns
        By how much the clock stepped before that [ns]; 0 at the wheel's first sample.
    rows, slots
        Rows that take a slot, neighbours or int64 (n,), and their slots, int64 (n,), strictly increasing.
    stray
        True where the row before `stop` was rejected for its time.
    waits
        True where row `stop` can only be judged together with the next sample.
    """

    stop: int
    epoch: SlotGrid | None = None
    step_ns: int = 0
    rows: slice | IntArray = slice(0, 0)
    slots: IntArray = _NO_SLOTS
    stray: bool = False
    waits: bool = False


class SlotAssignment:
    """Gives samples their slots and counts what becomes of each.

    An epoch begins with two samples that agree: a sample more than a window away from the last one waits for the next.
    If that goes on where the last one was, or agrees with neither, the one that waited is rejected: a wild time stamp.

    Parameters
    ----------
    period_ns, window_slots
        Of the wheel; a clock step of more than a window begins a new epoch.
    limits
        Samples beyond are rejected.
    max_motor_torque_Nm
        Limit of a motor torque; None leaves it unchecked.
    counts
        Where to count.

    Attributes
    ----------
    grid
        Slot grid of the running epoch; None before the first sample.
    last_ns
        Time of the latest sample that took a slot.
    """

    def __init__(
        self, period_ns: int, window_slots: int, limits: Limits, max_motor_torque_Nm: float | None, counts: Counts
    ) -> None:
        self.period_ns = period_ns
        self.window_slots = window_slots
        known = {
            "speed_rad_s": limits.max_speed_rad_s,
            "motor_current_A": limits.max_current_A,
            "motor_torque_Nm": max_motor_torque_Nm,
        }
        self._limits = [MAX_MAGNITUDE if (limit := known.get(name)) is None else limit for name in CHANNELS]
        self.counts = counts
        self.grid: SlotGrid | None = None
        self.last_ns: int | None = None

    def reject_beyond_limits(self, samples: Samples) -> BoolArray | None:
        """Return which samples can be telemetry of this wheel, bool (n,), and count the others as rejected.

        None where every value is there and all can be, as nearly always.
        """
        channels = [
            (values, limit)
            for values, limit in zip(_channels_of(samples), self._limits, strict=True)
            if values is not None
        ]
        clean = all(all_between(values, -limit, limit) for values, limit in channels)
        if clean and all_between(samples.time_ns, MIN_TIME_NS, MAX_TIME_NS):
            return None
        wrong = (samples.time_ns < MIN_TIME_NS) | (samples.time_ns > MAX_TIME_NS)
        for values, limit in channels:
            wrong |= (np.abs(values) > limit) & np.isfinite(values)
        count = int(np.count_nonzero(wrong))
        self.counts.rejected += count
        self.counts.queued -= count
        return ~wrong

    def next_piece(
        self,
        time_ns: IntArray,
        good: BoolArray,
        start: int,
        ring: RingBuffer,
        *,
        passed: bool = False,
        last: bool = False,
    ) -> Piece:
        """Place the rows from `start` on, as far as one piece goes, and count them.

        A piece ends before a clock step and before the slots grow by more than `PIECE_SLOTS`, so that the caller can
        write it into a buffer of bounded size before asking on; one that begins an epoch holds no rows.

        Parameters
        ----------
        time_ns, good
            int64 and bool (n,): the samples' times, and which have good values.
        start
            First row, below n.
        ring
            The slots of the epoch so far: all before its end are taken or missed.
        passed
            Whether these are samples of a message that was given up: they come late and never step the clock.
        last
            Whether nothing comes after these rows, so that none can wait.
        """
        if self.grid is None and passed:  # a message that was given up before any sample was taken
            self.counts.late += len(time_ns) - start
            self.counts.queued -= len(time_ns) - start
            return Piece(len(time_ns))
        piece = None if self.grid is None else self._go_on(self.grid, time_ns, good, start, ring, passed=passed)
        return self._begin(time_ns, start, ring.end, last=last) if piece is None else piece

    def _begin(self, time_ns: IntArray, start: int, frontier: int, *, last: bool) -> Piece:
        """Judge a sample that cannot go on from the last one by the next sample with another time."""
        counts = self.counts
        first_ns = int(time_ns[start])
        following = _next_time(time_ns, start)
        undecided = following == time_ns.size
        if undecided and not last:
            counts.duplicate += following - start - 1
            counts.queued -= following - start - 1
            return Piece(start, waits=True)
        grid = SlotGrid(first_ns, self.period_ns)
        alone = undecided and self.grid is None  # a table of one sample is a window of one sample
        if alone or (not undecided and self._agree(grid, int(time_ns[following]), frontier)):
            self.grid = grid
            return Piece(start, epoch=grid, step_ns=0 if self.last_ns is None else first_ns - self.last_ns)
        counts.rejected += 1
        counts.duplicate += following - start - 1
        counts.queued -= following - start
        return Piece(following, stray=True)

    def _agree(self, grid: SlotGrid, next_ns: int, frontier: int) -> bool:
        """Return whether the next sample lies near slot 0 of a new grid, and nearer than to the last sample."""
        distance = abs(grid.slot_of(next_ns))
        nearer = self.grid is None or distance < abs(self.grid.slot_of(next_ns) - (frontier - 1))
        return distance <= self.window_slots and nearer

    def _go_on(
        self,
        grid: SlotGrid,
        time_ns: IntArray,
        good: BoolArray,
        start: int,
        ring: RingBuffer,
        *,
        passed: bool,
    ) -> Piece | None:
        """Place the rows from `start` on into the running grid, up to the next clock step; None where it is there."""
        counts = self.counts
        piece_ns, piece_good = time_ns[start : start + PIECE_SLOTS], good[start : start + PIECE_SLOTS]
        slots, ahead = np.empty(piece_ns.size, dtype=np.int64), np.empty(piece_ns.size, dtype=np.bool_)
        count, ahead_count, used = assign_slots(
            piece_ns,
            piece_good,
            grid.origin_ns,
            grid.period_ns,
            ring.end,
            ring.end + PIECE_SLOTS,
            self.window_slots,
            passed,
            slots,
            ahead,
        )
        if count == 0:
            return None
        rows: slice | IntArray = slice(start, start + count)
        if count < slots.size:
            slots = slots[:count]
        if ahead_count < count:
            behind = slots[~ahead[:count]]
            taking = np.flatnonzero(ahead[:count])
            rows, slots = start + taking, slots[taking]
            taken = ring.is_filled(behind) | np.isin(behind, slots)
            counts.duplicate += int(taken.sum())
            counts.late += int(behind.size - taken.sum())
        counts.used += used
        counts.masked += ahead_count - used
        counts.queued -= count
        if ahead_count:
            counts.slots_missed += int(slots[-1]) + 1 - ring.end - ahead_count
            self.last_ns = int(time_ns[rows][-1])
        return Piece(start + count, rows=rows, slots=slots)


def _next_time(time_ns: IntArray, start: int) -> int:
    """Return the next row with another time than row `start`, n where there is none."""
    for stop in (start + PIECE_SLOTS, time_ns.size):  # near first
        other = np.flatnonzero(time_ns[start + 1 : stop] != time_ns[start])
        if other.size:
            return start + 1 + int(other[0])
    return int(time_ns.size)
