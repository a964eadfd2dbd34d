"""Brings what arrives into the order of the wheel's slots, and accounts for every sample.

Two steps. The `Sequencer` sorts whole messages: those of one publisher into the order of their batch numbers, and a
second live publisher out. The `OrderGuard` gives each sample its slot and says what becomes of it. Neither knows a
clock: what they decide depends on the messages alone, so that a replay decides alike.

    received = used + masked + late + duplicate + rejected + queued, always.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from rwa_monitor.physics.wheel import Limits
from rwa_monitor.samples import BoolArray, IntArray, Samples
from rwa_monitor.slots import SlotGrid

# A message that overtook others waits for them while at most this many wait. Zenoh keeps the order of one publisher, so
# only a recovered message comes late, and it comes soon; more would delay every window behind a message that is lost.
HOLD_BACK_MESSAGES: Final = 4
# A new publisher takes over after this many messages without one of the old: a restart. Until then they wait.
CHALLENGE_MESSAGES: Final = 3
# Numbers of skipped batches that are remembered, to tell a late sample from a repeated one.
MAX_SKIPPED: Final = 1_000
# Times that the slot arithmetic holds in 64 bits for any two of them: 1954 to 2096, if the clock counts from 1970.
MIN_TIME_NS: Final = -500_000_000_000_000_000
MAX_TIME_NS: Final = 4_000_000_000_000_000_000
# Slots written to the ring buffer in one go.
PIECE_SLOTS: Final = 4_096


@dataclass(slots=True)
class Counts:
    """What became of the samples of one wheel, since the start.

    Attributes
    ----------
    received
        All samples in messages that could be read.
    used
        Taken into their slot with good values.
    masked
        Taken, but a value is missing or not finite: the slot counts as empty.
    late
        Their slot had already passed.
    duplicate
        Their slot had already been taken.
    rejected
        Beyond the wheel's limits, with an impossible time, or from a second live publisher.
    queued
        Waiting for messages before them.
    slots_missed
        Slots that passed without a sample.
    messages_missed
        Gaps in the batch numbers.
    """

    received: int = 0
    used: int = 0
    masked: int = 0
    late: int = 0
    duplicate: int = 0
    rejected: int = 0
    queued: int = 0
    slots_missed: int = 0
    messages_missed: int = 0


# ---- messages --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Batch:
    """One message of samples: who sent it ("" when it does not say), its number (None likewise), the samples.

    `passed` is True for a number that was given up as missing: its samples come late and never step the clock.
    """

    publisher: str
    number: int | None
    samples: Samples
    passed: bool = False


@dataclass(frozen=True, slots=True)
class PublisherChanged:
    """A new publisher took over a wheel (a restart)."""

    before: str
    after: str


@dataclass(frozen=True, slots=True)
class PublisherConflict:
    """Two publishers are live on one wheel; the samples of `refused` were rejected."""

    current: str
    refused: str
    samples: int


@dataclass(frozen=True, slots=True)
class MessagesMissed:
    """Batch numbers that did not come in time."""

    publisher: str
    first: int
    count: int


SequenceEvent = PublisherChanged | PublisherConflict | MessagesMissed


@dataclass(slots=True)
class Sequencer:
    """Puts the messages of a wheel's publisher in order and keeps a second publisher out.

    A publisher is the current one until another has sent `CHALLENGE_MESSAGES` messages without one of the current
    publisher between them; those wait (`queued`) and are then taken. If the current one speaks again first, the other's
    messages are rejected as a conflict.
    """

    counts: Counts
    current: str | None = None
    expected: int | None = None
    held: dict[int, Batch] = field(default_factory=dict)
    skipped: dict[int, None] = field(default_factory=dict)  # an ordered set
    challenge: list[Batch] = field(default_factory=list)

    def put(self, batch: Batch, frontier_ns: int | None) -> tuple[list[Batch], list[SequenceEvent]]:
        """Take a message; return the messages that are ready now, in order, and what happened.

        Parameters
        ----------
        batch
            The message.
        frontier_ns
            Time of the latest sample taken so far, None before the first [ns].
        """
        self.counts.received += len(batch.samples)
        self.counts.queued += len(batch.samples)
        if self.current is None:
            self._begin(batch)
        if batch.publisher != self.current:
            return self._challenged_by(batch, frontier_ns)
        events = self._end_challenge()
        ready, more = self._in_order(batch, frontier_ns)
        return ready, [*events, *more]

    def flush(self, frontier_ns: int | None) -> tuple[list[Batch], list[SequenceEvent]]:
        """Release everything that waits, in order: nothing more will come."""
        ready, events = self._release(len(self.held))
        if self.challenge:
            more_ready, more_events = self._take_over(frontier_ns)
            last_ready, last_events = self._release(len(self.held))
            ready += more_ready + last_ready
            events += more_events + last_events
        return ready, events

    def _begin(self, batch: Batch) -> None:
        self.current = batch.publisher
        self.held.clear()
        self.skipped.clear()
        # A publisher whose first message overtook others has small numbers; one that we join late has any.
        self.expected = 0 if batch.number is not None and batch.number < HOLD_BACK_MESSAGES else batch.number

    def _challenged_by(self, batch: Batch, frontier_ns: int | None) -> tuple[list[Batch], list[SequenceEvent]]:
        events: list[SequenceEvent] = []
        if self.challenge and self.challenge[0].publisher != batch.publisher:
            events += self._end_challenge()
        self.challenge.append(batch)
        if len(self.challenge) < CHALLENGE_MESSAGES:
            return [], events
        left, left_events = self._release(len(self.held))
        ready, more = self._take_over(frontier_ns)
        return left + ready, [*events, *left_events, *more]

    def _end_challenge(self) -> list[SequenceEvent]:
        """Reject what a second publisher sent while the current one is alive."""
        if not self.challenge:
            return []
        count = sum(len(batch.samples) for batch in self.challenge)
        refused = self.challenge[0].publisher
        self.challenge.clear()
        self.counts.queued -= count
        self.counts.rejected += count
        return [PublisherConflict(current=self.current or "", refused=refused, samples=count)]

    def _take_over(self, frontier_ns: int | None) -> tuple[list[Batch], list[SequenceEvent]]:
        batches, self.challenge = self.challenge, []
        events: list[SequenceEvent] = [PublisherChanged(before=self.current or "", after=batches[0].publisher)]
        self._begin(min(batches, key=lambda batch: -1 if batch.number is None else batch.number))
        ready: list[Batch] = []
        for batch in batches:
            more, more_events = self._in_order(batch, frontier_ns)
            ready += more
            events += more_events
        return ready, events

    def _in_order(self, batch: Batch, frontier_ns: int | None) -> tuple[list[Batch], list[SequenceEvent]]:
        if batch.number is None or self.expected is None:
            if batch.number is not None:
                self.expected = batch.number + 1
            return [batch], []
        if batch.number < self.expected:
            return self._passed(batch, batch.number, frontier_ns)
        if batch.number in self.held:  # the same message twice while it waits
            self._count_duplicate(batch)
            return [], []
        self.held[batch.number] = batch
        return self._release(1 if len(self.held) > HOLD_BACK_MESSAGES else 0)

    def _passed(self, batch: Batch, number: int, frontier_ns: int | None) -> tuple[list[Batch], list[SequenceEvent]]:
        """Take a message whose number has passed: a late one, a new count under an old name, or a repetition."""
        if number in self.skipped:
            del self.skipped[number]
            return [replace(batch, passed=True)], []
        if frontier_ns is not None and len(batch.samples) > 0 and int(batch.samples.time_ns[0]) > frontier_ns:
            # The numbers begin anew and the time goes on: a publisher that restarted under a fixed name.
            ready, events = self._release(len(self.held))
            self._begin(batch)
            self.expected = number + 1
            return [*ready, batch], events
        self._count_duplicate(batch)
        return [], []

    def _count_duplicate(self, batch: Batch) -> None:
        self.counts.queued -= len(batch.samples)
        self.counts.duplicate += len(batch.samples)

    def _release(self, at_least: int) -> tuple[list[Batch], list[SequenceEvent]]:
        """Release what is next in order, and at least so many of those that wait, over the gaps before them."""
        ready: list[Batch] = []
        events: list[SequenceEvent] = []
        while self.held:
            number = min(self.held)
            if number != self.expected:
                if len(ready) >= at_least:
                    break
                events.append(self._skip(number))
            ready.append(self.held.pop(number))
            self.expected = number + 1
        return ready, events

    def _skip(self, number: int) -> MessagesMissed:
        """Give up the batches before `number`, but remember them."""
        first = number if self.expected is None else self.expected
        self.counts.messages_missed += number - first
        self.skipped.update(dict.fromkeys(range(max(first, number - MAX_SKIPPED), number)))
        while len(self.skipped) > MAX_SKIPPED:
            del self.skipped[next(iter(self.skipped))]
        return MessagesMissed(self.current or "", first, number - first)


# ---- samples ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Piece:
    """Samples that go on from the last slot.

    Attributes
    ----------
    stop
        Row at which the rest of the message begins.
    epoch
        The new slot grid where an epoch begins with the first row, otherwise None.
    step_ns
        By how much the clock stepped before that [ns]; 0 at the wheel's first sample.
    rows, slots
        int64 (n,): rows of the message that take a slot, and their slots, strictly increasing.
    """

    stop: int
    epoch: SlotGrid | None
    step_ns: int
    rows: IntArray
    slots: IntArray


class OrderGuard:
    """Gives samples their slots and counts what becomes of each.

    Parameters
    ----------
    period_ns, window_slots
        Of the wheel; a clock step of more than a window begins a new epoch.
    limits
        Samples beyond are rejected.
    torque_constant_Nm_A
        To hold a motor torque against the current limit; None leaves it unchecked.
    counts
        Where to count.

    Attributes
    ----------
    grid
        Slot grid of the running epoch; None before the first sample.
    frontier
        First slot that is still open: all before it are taken or missed.
    last_ns
        Time of the latest sample that took a slot.
    """

    def __init__(
        self, period_ns: int, window_slots: int, limits: Limits, torque_constant_Nm_A: float | None, counts: Counts
    ) -> None:
        self.period_ns = period_ns
        self.window_slots = window_slots
        self.limits = limits
        self.torque_constant_Nm_A = torque_constant_Nm_A
        self.counts = counts
        self.grid: SlotGrid | None = None
        self.frontier = 0
        self.last_ns: int | None = None

    def beyond_limits(self, samples: Samples) -> BoolArray:
        """Return which samples cannot be telemetry of this wheel, bool (n,)."""
        wrong = (samples.time_ns < MIN_TIME_NS) | (samples.time_ns > MAX_TIME_NS)
        max_current = self.limits.max_current_A
        max_torque = None
        if max_current is not None and self.torque_constant_Nm_A is not None:
            max_torque = max_current * self.torque_constant_Nm_A
        for values, limit in (
            (samples.speed_rad_s, self.limits.max_speed_rad_s),
            (samples.motor_current_A, max_current),
            (samples.motor_torque_Nm, max_torque),
        ):
            if values is not None and limit is not None:
                wrong |= np.isfinite(values) & (np.abs(values) > limit)
        return wrong

    def next_piece(
        self,
        batch: Batch,
        allowed: BoolArray,
        good: BoolArray,
        start: int,
        is_filled: Callable[[IntArray], BoolArray],
    ) -> Piece:
        """Place the rows from `start` on, as far as one piece goes, and count them.

        A piece ends before a clock step and before the slots grow by more than `PIECE_SLOTS`, so that the caller can
        write it into a buffer of bounded size before asking on.

        Parameters
        ----------
        batch
            The message.
        allowed, good
            bool (n,): rows that are not rejected, and those with good values.
        start
            First row.
        is_filled
            Tells which slots behind the frontier a sample came for.
        """
        counts = self.counts
        rows = start + np.flatnonzero(allowed[start:])
        if rows.size == 0:
            rejected = allowed.size - start
            counts.rejected += rejected
            counts.queued -= rejected
            return Piece(allowed.size, None, 0, rows, rows)

        times = batch.samples.time_ns
        first_ns = int(times[rows[0]])
        step_ns = 0 if self.last_ns is None else first_ns - self.last_ns
        begins = self.grid is None or self._steps(first_ns, batch)
        if self.grid is None or begins:
            self.grid = SlotGrid(first_ns, self.period_ns)
            self.frontier = 0
            is_filled = _nothing_filled

        slots = self.grid.slot_of(times[rows])
        before = np.maximum.accumulate(np.concatenate(([self.frontier - 1], slots[:-1])))
        count = self._piece_length(slots, before, batch)
        stop = int(rows[count]) if count < rows.size else int(allowed.size)
        rejected = (stop - start) - count
        rows, slots, before = rows[:count], slots[:count], before[:count]

        ahead = slots > before
        if batch.passed:
            ahead &= slots - before <= self.window_slots
        behind_rows, behind = rows[~ahead], slots[~ahead]
        rows, slots = rows[ahead], slots[ahead]

        taken = is_filled(behind) | np.isin(behind, slots)
        counts.duplicate += int(taken.sum())
        counts.late += int(behind_rows.size - taken.sum())
        counts.rejected += rejected
        counts.used += int(good[rows].sum())
        counts.masked += int(rows.size - good[rows].sum())
        counts.queued -= rejected + count
        if rows.size:
            counts.slots_missed += int(slots[-1]) + 1 - self.frontier - int(rows.size)
            self.frontier = int(slots[-1]) + 1
            self.last_ns = int(times[rows[-1]])
        return Piece(stop, self.grid if begins else None, step_ns, rows, slots)

    def end_epoch(self) -> None:
        """Let the next sample begin a new epoch."""
        self.grid = None
        self.frontier = 0

    def _steps(self, time_ns: int, batch: Batch) -> bool:
        """Tell whether a sample at this time is more than a window away from the last one."""
        if batch.passed or self.last_ns is None or self.grid is None:
            return False
        slot = int(self.grid.slot_of(np.array([time_ns]))[0])
        return abs(slot - (self.frontier - 1)) > self.window_slots

    def _piece_length(self, slots: IntArray, before: IntArray, batch: Batch) -> int:
        """Count the rows up to the next clock step, or up to where the piece gets too long; at least one."""
        ends = slots > self.frontier + PIECE_SLOTS
        if not batch.passed:
            ends |= np.abs(slots - before) > self.window_slots
        ends[0] = False
        return int(np.argmax(ends)) if ends.any() else int(slots.size)


def _nothing_filled(slots: IntArray) -> BoolArray:
    return np.zeros(slots.size, dtype=np.bool_)
