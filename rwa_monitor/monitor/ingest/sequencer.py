"""Sorts whole messages: those of one publisher into the order of their numbers, and a second live publisher out.

It has no clock: what is decided depends on the messages alone, so that a replay decides alike.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np

from rwa_monitor.messages import ClockNs, Count
from rwa_monitor.samples import Samples
from rwa_monitor.words import counted

# A message that overtook others waits for them while at most this many wait. Zenoh keeps the order of one publisher, so
# only a recovered message comes late, and it comes soon; more would delay every window behind a message that is lost.
HOLD_BACK_MESSAGES: Final = 4
# A new publisher takes over after this many messages without one of the old: a restart. Until then they wait.
TAKEOVER_MESSAGES: Final = 3
# They must also hold as many samples as this many messages of the old one, of which so many samples count at most: two
# publishers of different message sizes must not take turns.
TAKEOVER_SAMPLES: Final = 2_048
# So many times longer must the old one have been silent where a second live publisher is more likely than a restart.
UNCERTAIN_FACTOR: Final = 10
# Names of replaced publishers that are remembered.
MAX_REPLACED: Final = 8
# Numbers of skipped batches that are remembered, to distinguish a late sample from a repeated one.
MAX_SKIPPED: Final = 1_000


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

    received: Count = 0
    used: Count = 0
    masked: Count = 0
    late: Count = 0
    duplicate: Count = 0
    rejected: Count = 0
    queued: Count = 0
    slots_missed: Count = 0
    messages_missed: Count = 0


class Batch(NamedTuple):
    """One message of samples: who sent it ("" where it is not named), its number (None likewise), the samples.

    `passed` is True for a number that was given up as missing: its samples come late and never step the clock.
    """

    publisher: str
    number: Count | None
    samples: Samples
    passed: bool = False


class Trouble(NamedTuple):
    """What an operator should read about a wheel's telemetry.

    Attributes
    ----------
    kind
        The same for what need not be reported again and again: "publisher conflict", "speed_rad_s hangs".
    text
        In words.
    """

    kind: str
    text: str


Ready = Iterator[Batch | Trouble]  # messages, in order, and what happened


@dataclass(slots=True)
class Sequencer:
    """Puts the messages of a wheel's publisher in order and keeps a second publisher out.

    A publisher is the current one until another has sent `TAKEOVER_MESSAGES` messages, with as many samples as that
    many of the current one, without one of the current publisher between them; those wait (`queued`) and are then
    taken. If the current one sends again first, the other's messages are rejected as a conflict. Names are new at each
    start of a publisher: one that was replaced before, or that sends times which the current one has sent already, is
    more likely a second live publisher than a restart, and waits `UNCERTAIN_FACTOR` times longer.
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
    latest_ns: ClockNs | None = None  # median time of the current publisher's latest message, before any clock step

    def put(self, batch: Batch, frontier_ns: int | None) -> Ready:
        """Take a message; yield the messages that are ready now, in order, and what happened.

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
        """Release everything that waits, in order: nothing more will come."""
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
        if batch.publisher in self.replaced:
            self.replaced.remove(batch.publisher)
        # A publisher whose first message overtook others has small numbers; one that we join late has any.
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
        """Return whether the other publisher has sent enough for a restart."""
        messages = TAKEOVER_MESSAGES * (UNCERTAIN_FACTOR if self.takeover_uncertain else 1)
        samples = messages * min(self.largest, TAKEOVER_SAMPLES)
        return len(self.takeover) >= messages and sum(len(batch.samples) for batch in self.takeover) >= samples

    def _reject_takeover(self) -> Iterator[Trouble]:
        """Reject what a second publisher sent, if there is one, while the current one is alive."""
        if not self.takeover:
            return
        count = sum(len(batch.samples) for batch in self.takeover)
        refused = self.takeover[0].publisher
        self.takeover.clear()
        self.takeover_uncertain = False
        self.counts.queued -= count
        self.counts.rejected += count
        text = f"two live publishers on one wheel: {counted(count, 'sample')} of {refused!r} rejected"
        yield Trouble("publisher conflict", f"{text}, {self.current!r} goes on")

    def _take_over(self, frontier_ns: int | None) -> Ready:
        batches, self.takeover, self.takeover_uncertain = self.takeover, [], False
        if self.current is not None:
            self.replaced = [*self.replaced, self.current][-MAX_REPLACED:]
        text = f"publisher {batches[0].publisher!r} took over from {self.current!r}, which had gone silent"
        yield Trouble("publisher change", text)
        self.latest_ns = None
        self._begin(min(batches, key=lambda batch: -1 if batch.number is None else batch.number))
        for batch in batches:
            yield from self._in_order(batch, frontier_ns)

    def _in_order(self, batch: Batch, frontier_ns: int | None) -> Ready:
        """Take a message of the current publisher, in its turn or not."""
        self.largest = max(self.largest, len(batch.samples))
        if batch.number is None or self.expected is None:
            if batch.number is not None:
                self.expected = batch.number + 1
            yield batch
        elif batch.number < self.expected:
            yield from self._passed(batch, batch.number, frontier_ns)
        elif batch.number in self.held:  # the same message twice while it waits
            self._count_duplicate(batch)
        else:
            self.held[batch.number] = batch
            yield from self._release(1 if len(self.held) > HOLD_BACK_MESSAGES else 0)
        time_ns = batch.samples.time_ns
        if time_ns.size:
            # The middle one: a single wild time does not matter.
            rank = time_ns.size // 2
            middle_ns = int(np.partition(time_ns, rank)[rank])
            self.latest_ns = middle_ns if self.latest_ns is None else max(self.latest_ns, middle_ns)

    def _passed(self, batch: Batch, number: int, frontier_ns: int | None) -> Ready:
        """Take a message whose number has passed: a late one, a new count under an old name, or a repetition."""
        times = batch.samples.time_ns
        known_ns = [time_ns for time_ns in (frontier_ns, self.latest_ns) if time_ns is not None]
        if number in self.skipped:
            del self.skipped[number]
            yield batch._replace(passed=True)
        elif number < HOLD_BACK_MESSAGES and known_ns and times.size and int(times.min()) > max(known_ns):
            # The numbers begin anew and the time goes on: a publisher that restarted under a fixed name. What comes
            # again out of a history is earlier than something before it, also when the clock has stepped back since.
            yield from self._release(len(self.held))
            self._begin(batch)
            self.expected = number + 1
            yield batch
        else:
            self._count_duplicate(batch)

    def _count_duplicate(self, batch: Batch) -> None:
        self.counts.queued -= len(batch.samples)
        self.counts.duplicate += len(batch.samples)

    def _release(self, at_least: int) -> Ready:
        """Release what is next in order, and at least so many of those that wait, over the gaps before them."""
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
        """Give up the batches before `number`, but keep their numbers."""
        first = number if self.expected is None else self.expected
        self.counts.messages_missed += number - first
        self.skipped.update(dict.fromkeys(range(max(first, number - MAX_SKIPPED), number)))
        while len(self.skipped) > MAX_SKIPPED:
            del self.skipped[next(iter(self.skipped))]
        text = f"missing: {counted(number - first, 'message')} of {self.current!r}, from batch {first} on"
        return Trouble("messages missed", text)
