"""Orders what arrives: whole messages by publisher and number, then samples into slots.

Messages of one publisher are put into the order of their numbers, and a second live publisher is rejected. Each sample
is assigned to its slot, and accounted for:

    received = used + masked + late + duplicate + rejected + queued, always.

The machine's clock is not used: decisions depend on messages and samples alone, so that a replay makes the same ones,
and what becomes of a sample does not depend on how samples are divided into messages.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from operator import attrgetter
from typing import Final, NamedTuple, Self

import numpy as np

from rwa_monitor.messages import ClockNs, Count
from rwa_monitor.samples import (
    CHANNELS,
    MAX_TIME_NS,
    MIN_TIME_NS,
    NANOSECONDS_PER_SECOND,
    BoolArray,
    FloatArray,
    IntArray,
    Samples,
    SlotGrid,
)
from rwa_monitor.telemetry.slots import RingBuffer
from rwa_monitor.wheel.wheel import Wheel
from rwa_monitor.words import counted, time_text

# At most this many messages wait for one before them. Zenoh keeps the order of one publisher, so only a recovered
# message is late, and not by much; a larger limit would delay every window after a message that is lost.
HOLD_BACK_MESSAGES: Final = 4
# A new publisher takes over after this many messages without one of the current publisher: a restart. Until then they
# wait. They must also have as many samples as that many of the current publisher's largest messages, each counted with
# at most TAKEOVER_SAMPLES: two publishers of different message sizes must not alternate.
TAKEOVER_MESSAGES: Final = 3
TAKEOVER_SAMPLES: Final = 2_048
# Factor on both limits where a second live publisher is more likely than a restart.
UNCERTAIN_FACTOR: Final = 10
# Names of replaced publishers, and numbers of skipped batches, that are remembered; the latter to distinguish late
# samples from repeated ones.
MAX_REMEMBERED: Final = 1_000


@dataclass(slots=True)
class Counts:
    """What became of the samples of one wheel, since the start.

    Attributes
    ----------
    received
        All samples in messages that could be read.
    used
        Assigned to their slot with good values.
    masked
        Assigned, but a value is missing, not finite or invalid: the slot counts as empty.
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

    received: Count = 0
    used: Count = 0
    masked: Count = 0
    late: Count = 0
    duplicate: Count = 0
    rejected: Count = 0
    queued: Count = 0
    slots_missed: Count = 0
    messages_missed: Count = 0

    def settle(self, **parts: int) -> None:
        """Count samples that were queued as used, masked, late, duplicate or rejected."""
        for name, count in parts.items():
            setattr(self, name, getattr(self, name) + int(count))
            self.queued -= int(count)


class Batch(NamedTuple):
    """One message of samples: who sent it ("" where it is not named), its number (None likewise), the samples.

    `passed` is True for a number that was given up as missing: its samples are late and never step the clock.
    """

    publisher: str
    number: Count | None
    samples: Samples
    passed: bool = False


class Trouble(NamedTuple):
    """A report to the operator about a wheel's telemetry.

    Attributes
    ----------
    kind
        Reports of the same kind need not be repeated: "publisher conflict", "speed_rad_s hangs".
    text
        In words.
    """

    kind: str
    text: str


Ready = Iterator[Batch | Trouble]  # messages in order, and reports


@dataclass(slots=True)
class Sequencer:
    """Puts the messages of a wheel's publisher in order and rejects those of a second publisher.

    A publisher is the current one until another has sent `TAKEOVER_MESSAGES` messages, with as many samples as that
    many of the current one, without one of the current publisher between them; those wait (`queued`) and are then
    taken. If the current one sends again first, the other's messages are rejected as a conflict. A publisher has a new
    name at each start: one that was replaced before, or whose times are not later than those taken already, is more
    likely a second live publisher than a restart, and must send `UNCERTAIN_FACTOR` times as much.
    """

    counts: Counts = field(default_factory=Counts)
    current: str | None = None
    expected: Count | None = None
    held: dict[int, Batch] = field(default_factory=dict)
    skipped: dict[int, None] = field(default_factory=dict)  # an ordered set
    takeover: list[Batch] = field(default_factory=list)
    takeover_uncertain: bool = False
    largest: Count = 0  # samples of the current publisher's largest message
    replaced: list[str] = field(default_factory=list)
    latest_ns: ClockNs | None = None  # the latest median time of the current publisher's messages

    def put(self, batch: Batch, frontier_ns: int | None) -> Ready:
        """Take a message; yield the messages that are ready now, in order, and reports.

        Parameters
        ----------
        batch
            The message.
        frontier_ns
            Time of the latest sample taken so far, None before the first [ns].
        """
        count = len(batch.samples)
        self.counts.received += count
        self.counts.queued += count
        if self.current is None:
            self._begin(batch)
        if batch.publisher == self.current:
            yield from self._reject_takeover()
            yield from self._in_order(batch, frontier_ns)
        else:
            yield from self._other_publisher(batch, frontier_ns)

    def flush(self, frontier_ns: int | None) -> Ready:
        """Release everything that waits, in order, at the end of the telemetry."""
        yield from self._release(len(self.held))
        if self.takeover_uncertain:
            yield from self._reject_takeover()
        if self.takeover:
            yield from self._take_over(frontier_ns)
            yield from self._release(len(self.held))

    def _begin(self, batch: Batch) -> None:
        self.current = batch.publisher
        self.held.clear()
        self.skipped.clear()
        self.largest = 0
        # A small number: the first message may have overtaken others. A larger one: we subscribed late.
        self.expected = 0 if batch.number is not None and batch.number < HOLD_BACK_MESSAGES else batch.number

    def _other_publisher(self, batch: Batch, frontier_ns: int | None) -> Ready:
        if self.takeover and self.takeover[0].publisher != batch.publisher:
            yield from self._reject_takeover()
        if not self.takeover:
            repeats = frontier_ns is not None and len(batch.samples) > 0 and batch.samples.time_ns[-1] <= frontier_ns
            self.takeover_uncertain = bool(repeats) or batch.publisher in self.replaced
        self.takeover.append(batch)
        if self._is_restart():
            yield from self._release(len(self.held))
            yield from self._take_over(frontier_ns)

    def _is_restart(self) -> bool:
        """Return whether the other publisher has sent enough to be taken for a restart."""
        messages = TAKEOVER_MESSAGES * (UNCERTAIN_FACTOR if self.takeover_uncertain else 1)
        samples = messages * min(self.largest, TAKEOVER_SAMPLES)
        return len(self.takeover) >= messages and sum(len(batch.samples) for batch in self.takeover) >= samples

    def _reject_takeover(self) -> Iterator[Trouble]:
        """Reject the messages of a second publisher, if any, as the current one is alive."""
        if not self.takeover:
            return
        count = sum(len(batch.samples) for batch in self.takeover)
        refused = self.takeover[0].publisher
        self.takeover.clear()
        self.takeover_uncertain = False
        self.counts.settle(rejected=count)
        text = f"two live publishers on one wheel: {counted(count, 'sample')} of {refused!r} rejected"
        yield Trouble("publisher conflict", f"{text}, {self.current!r} goes on")

    def _take_over(self, frontier_ns: int | None) -> Ready:
        batches, self.takeover, self.takeover_uncertain = self.takeover, [], False
        if self.current is not None:
            self.replaced = [*self.replaced, self.current][-MAX_REMEMBERED:]
        text = f"publisher {batches[0].publisher!r} took over from {self.current!r}, which had gone silent"
        yield Trouble("publisher change", text)
        self.latest_ns = None
        self._begin(min(batches, key=lambda batch: -1 if batch.number is None else batch.number))
        for batch in batches:
            yield from self._in_order(batch, frontier_ns)

    def _in_order(self, batch: Batch, frontier_ns: int | None) -> Ready:
        """Take a message of the current publisher, whether it is the next one or not."""
        self.largest = max(self.largest, len(batch.samples))
        if batch.number is None or self.expected is None:
            if batch.number is not None:
                self.expected = batch.number + 1
            yield batch
        elif batch.number < self.expected:
            yield from self._passed(batch, batch.number, frontier_ns)
        elif batch.number in self.held:  # the same message twice while it waits
            self.counts.settle(duplicate=len(batch.samples))
        else:
            self.held[batch.number] = batch
            yield from self._release(1 if len(self.held) > HOLD_BACK_MESSAGES else 0)
        if len(batch.samples):
            middle_ns = median_time(batch.samples.time_ns)
            self.latest_ns = middle_ns if self.latest_ns is None else max(self.latest_ns, middle_ns)

    def _passed(self, batch: Batch, number: int, frontier_ns: int | None) -> Ready:
        """Take a message whose number has passed: late, repeated, or numbered anew by a restarted publisher."""
        times = batch.samples.time_ns
        known_ns = [time_ns for time_ns in (frontier_ns, self.latest_ns) if time_ns is not None]
        if number in self.skipped:
            del self.skipped[number]
            yield batch._replace(passed=True)
        elif number < HOLD_BACK_MESSAGES and known_ns and times.size and int(times.min()) > max(known_ns):
            # The numbers begin anew and time advances: a publisher that restarted under a fixed name. A message that is
            # repeated from a history is earlier than one before it, also when the clock has stepped back since.
            yield from self._release(len(self.held))
            self._begin(batch)
            self.expected = number + 1
            yield batch
        else:
            self.counts.settle(duplicate=len(batch.samples))

    def _release(self, at_least: int) -> Ready:
        """Release the next messages in order, and at least so many of those that wait, skipping gaps before them."""
        released = 0
        while self.held:
            number = min(self.held)
            if number != self.expected:
                if released >= at_least:
                    break
                yield self._skip(number)
            self.expected = number + 1
            yield self.held.pop(number)
            released += 1

    def _skip(self, number: int) -> Trouble:
        """Give up the missing batches before `number`, but remember their numbers."""
        first = number if self.expected is None else self.expected
        self.counts.messages_missed += number - first
        self.skipped.update(dict.fromkeys(range(max(first, number - MAX_REMEMBERED), number)))
        while len(self.skipped) > MAX_REMEMBERED:
            del self.skipped[next(iter(self.skipped))]
        text = f"missing: {counted(number - first, 'message')} of {self.current!r}, from batch {first} on"
        return Trouble("messages missed", text)


def median_time(time_ns: IntArray) -> int:
    """Return the median of times: a single wrong time stamp does not matter."""
    rank = time_ns.size // 2
    return int(np.partition(time_ns, rank)[rank])


# ---- samples into slots ----------------------------------------------------------------------------------------------


_channels_of: Final = attrgetter(*CHANNELS)  # all channels of samples in one call: every message needs them

# Limit in SI units where the wheel file has none: no wheel has more, and sums of squares do not overflow.
MAX_MAGNITUDE: Final = 1e6
# Slots written to the ring buffer, and samples processed, at a time.
PIECE_SLOTS: Final = 4_096


@dataclass(frozen=True, slots=True)
class Rows:
    """Samples within the wheel's limits, with the values for the ring buffer.

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
        """Return these samples followed by the others."""
        values = {name: np.concatenate((array, others.values[name])) for name, array in self.values.items()}
        return Rows(np.concatenate((self.time_ns, others.time_ns)), values)

    def good(self) -> BoolArray:
        """Return which samples have both values that a diagnosis needs (speed, torque), bool (n,)."""
        return np.isfinite(self.values["speed_rad_s"]) & np.isfinite(self.values["torque_Nm"])


def fits(values: Mapping[str, FloatArray], count: int, channels: Sequence[str]) -> bool:
    """Return whether values of a checkpoint fit these channels: `count` values of each, none of them infinite."""
    sound = (one.size == count and not np.isinf(one).any() for one in values.values())
    return set(values) == set(channels) and all(sound)


class Piece(NamedTuple):
    """Samples after the last slot taken.

    Attributes
    ----------
    slots
        int64 (n,), strictly increasing.
    values
        float64 (n,) of every channel of the ring buffer.
    """

    slots: IntArray
    values: Mapping[str, FloatArray]


class SlotAssignment:
    """Assigns samples to slots and counts what becomes of each.

    An epoch begins with two samples that agree: a sample more than a window away from the last one waits for the next.
    If that continues from the last one, or agrees with neither, the waiting sample is rejected: a wrong time stamp.

    Parameters
    ----------
    wheel
        Has the period and the limits, beyond which samples are rejected; a clock step of more than a window begins an
        epoch.
    counts
        Where to count.

    Attributes
    ----------
    grid
        Slot grid of the current epoch; None before the first sample.
    last_ns
        Time of the latest sample that took a slot.
    waiting
        One sample, accepted or rejected by the next one; None for none.
    """

    def __init__(self, wheel: Wheel, counts: Counts) -> None:
        self.period_ns = wheel.period_ns
        self.window_slots = wheel.window.samples
        known = {
            "speed_rad_s": wheel.limits.max_speed_rad_s,
            "motor_current_A": wheel.limits.max_current_A,
            "motor_torque_Nm": wheel.max_motor_torque_Nm,
        }
        self._limits = [MAX_MAGNITUDE if (limit := known.get(name)) is None else limit for name in CHANNELS]
        self.counts = counts
        self.grid: SlotGrid | None = None
        self.last_ns: int | None = None
        self.waiting: Rows | None = None

    def reject_beyond_limits(self, samples: Samples) -> BoolArray | None:
        """Return which samples can be telemetry of this wheel, bool (n,), and count the others as rejected.

        None where all samples can be and every value is finite, as nearly always.
        """
        wrong = (samples.time_ns < MIN_TIME_NS) | (samples.time_ns > MAX_TIME_NS)
        clean = not wrong.any()
        for values, limit in zip(_channels_of(samples), self._limits, strict=True):
            if values is not None and not (within := np.abs(values) <= limit).all():
                clean = False
                wrong |= ~within & np.isfinite(values)
        if clean:
            return None
        self.counts.settle(rejected=wrong.sum())
        return ~wrong

    def place(
        self, rows: Rows, ring: RingBuffer, *, passed: bool = False, last: bool = False
    ) -> Iterator[Piece | SlotGrid | Trouble]:
        """Assign samples to slots, count them, and yield pieces, new slot grids and reports, in order.

        A piece ends before a clock step and before the slots grow by more than `PIECE_SLOTS`, so that the caller can
        write it into a buffer of bounded size before the next one; the slot grid of a new epoch precedes its pieces.

        Parameters
        ----------
        rows
            The samples.
        ring
            The slots of the epoch so far: all before its end are taken or missed.
        passed
            Whether these are samples of a message that was given up: they are late and never step the clock.
        last
            Whether nothing comes after these rows, so that none can wait.
        """
        if self.waiting is not None and not passed and len(rows):
            rows, self.waiting = self.waiting.followed_by(rows), None
        counts, time_ns, good = self.counts, rows.time_ns, rows.good()
        strays: list[int] = []
        start = 0
        while start < len(rows):
            if self.grid is None and passed:  # a message that was given up before any sample was taken
                counts.settle(late=len(rows) - start)
                break
            if self.grid is not None:
                count, piece = self._go_on(self.grid, rows, good, start, ring, passed=passed)
                if piece is not None:
                    yield piece
                if count:
                    start += count
                    continue
            # It does not continue from the last one: the next sample with another time decides.
            first_ns, following = int(time_ns[start]), _next_time(time_ns, start)
            undecided, grid = following == len(rows), SlotGrid(first_ns, self.period_ns)
            # A table of one sample is a window of one sample.
            alone = undecided and last and self.grid is None
            if alone or (not undecided and self._agree(grid, int(time_ns[following]), ring.end)):
                step_ns = 0 if self.last_ns is None else first_ns - self.last_ns
                self.grid = grid
                yield grid
                if step_ns:
                    text = (
                        f"the wheel's clock stepped by {step_ns / NANOSECONDS_PER_SECOND:.3f} s, to"
                        f" {time_text(first_ns)}: a new epoch began, the open window was closed as it was"
                    )
                    yield Trouble("clock step", text)
                continue
            counts.settle(duplicate=following - start - 1)
            if undecided and not last:
                self.waiting = rows[start : start + 1]
                break
            counts.settle(rejected=1)
            strays.append(first_ns)
            start = following
        if strays:
            rejected = f"{counted(len(strays), 'sample')} rejected with a time far from those before and after"
            yield Trouble("stray samples", f"{rejected}, the first at {time_text(strays[0])}")

    def _agree(self, grid: SlotGrid, next_ns: int, frontier: int) -> bool:
        """Return whether the next sample is within a window of slot 0 of a new grid, and nearer to it than to the last.

        The last is the latest slot of the current grid, if there is one.
        """
        distance = abs(grid.slot_of(next_ns))
        nearer = self.grid is None or distance < abs(self.grid.slot_of(next_ns) - (frontier - 1))
        return distance <= self.window_slots and nearer

    def _go_on(
        self, grid: SlotGrid, rows: Rows, good: BoolArray, start: int, ring: RingBuffer, *, passed: bool
    ) -> tuple[int, Piece | None]:
        """Assign the rows from `start` on to the current grid, up to the next clock step.

        Returns
        -------
        count
            How many rows these are: 0 if the clock step is at `start`.
        piece
            Those of them that take a slot; None where none does.
        """
        counts = self.counts
        slots = grid.slot_of(rows.time_ns[start : start + PIECE_SLOTS])
        step = slots - np.maximum.accumulate(np.append(ring.end - 1, slots[:-1]))  # from the latest slot before
        far = np.abs(step) > self.window_slots
        ends = slots > ring.end + PIECE_SLOTS
        ends[0] = False
        if not passed:
            ends |= far
        count = int(ends.argmax()) if ends.any() else slots.size
        slots, ahead = slots[:count], ((step > 0) & ~far)[:count]
        ahead_count, used = int(ahead.sum()), int((ahead & good[start : start + count]).sum())
        if count < len(rows):
            rows = rows[start : start + count]
        if ahead_count < count:
            behind, taking = slots[~ahead], np.flatnonzero(ahead)
            rows, slots = rows[taking], slots[taking]
            duplicate = (ring.is_filled(behind) | np.isin(behind, slots)).sum()
            counts.settle(duplicate=duplicate, late=behind.size - duplicate)
        counts.settle(used=used, masked=ahead_count - used)
        if not ahead_count:
            return count, None
        counts.slots_missed += int(slots[-1]) + 1 - ring.end - ahead_count
        self.last_ns = int(rows.time_ns[-1])
        return count, Piece(slots, rows.values)


def _next_time(time_ns: IntArray, start: int) -> int:
    """Return the next row with another time than row `start`, n where there is none."""
    for stop in (start + PIECE_SLOTS, time_ns.size):  # nearby rows first
        other = np.flatnonzero(time_ns[start + 1 : stop] != time_ns[start])
        if other.size:
            return start + 1 + int(other[0])
    return int(time_ns.size)
