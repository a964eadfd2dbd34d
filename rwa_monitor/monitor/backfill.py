"""Closes gaps in publishers' message sequences before messages are passed on.

Zenoh's advanced subscriber queries each publisher's history when it starts, and for messages that it missed. Three
faults were observed (Zenoh 1.10). A live message that overtakes the history makes Zenoh discard the history as older:
one in eight starts while messages flow. A query that is lost with a connection is not repeated. And in a long history
that arrives at once, a message may end with the beginning of another one: once in some 30 histories of 4,000 messages
of 12 kB. Therefore the messages of a publisher, which Zenoh numbers, are held while an earlier one is missing or could
not be read, and that one is requested again; messages of other publishers pass. Duplicates are recognised later by
their batch number.

After an outage, or a start of the monitor, all publishers of a fleet have gaps at once. The size of their answers,
which may be whole histories, is unknown until they arrive: so a limited number of publishers is queried at a time, the
next ones when those have answered, and no further one while too many answers have not been passed on.
"""

import time
from collections import OrderedDict, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from threading import Condition, Event
from typing import Any, Final, NamedTuple

import zenoh

from rwa_monitor.messages import MAX_MESSAGE_BYTES, MAX_WHEELS

TIMEOUT_S: Final = 2.0  # for an answer, or for room in the inbox: publishers close a connection that blocks for 5 s
# Pauses after an answer before messages that are still missing are requested again [s]; then they count as lost.
PAUSES_S: Final = (0.2, 0.5, 1.0, 2.0)
MAX_ASKED: Final = 32  # publishers whose answers are awaited at a time: as many histories may arrive at once
INBOX_MESSAGES: Final = 65_536
INBOX_BYTES: Final = 128 * 2**20  # some 8,700 messages of 256 samples: 77 hours of one wheel at 8 Hz


class Arrival(NamedTuple):
    """A message that arrived: its key, its content, its publisher, and its sequence number at that publisher.

    `source` is zid/eid of the publisher in Zenoh, "" where it is not named; `number` counts from 0. `is_gap` marks a
    placeholder, not a message: all messages before `number` were sent, so that missing ones are to be requested.
    `again` marks a message that was requested once more because it could not be read.
    """

    key: str
    payload: bytes
    source: str = ""
    number: int = 0
    is_gap: bool = False
    again: bool = False


class Inbox:
    """A bounded queue from Zenoh's threads to the thread that processes messages.

    Attributes
    ----------
    max_messages, max_bytes
        Limits of its content, in messages and bytes.
    max_wait_s
        How long to wait for room before a message is dropped and counted [s].
    dropped
        Messages dropped so far.
    wake
        Set when a message has arrived.
    """

    def __init__(self) -> None:
        self.max_messages = INBOX_MESSAGES
        self.max_bytes = INBOX_BYTES
        self.max_wait_s = TIMEOUT_S
        self.dropped = 0
        self.wake = Event()
        self._messages: deque[Arrival] = deque()
        self._lost: dict[str, Arrival] = {}  # of each publisher the last message that was dropped, without its content
        self._bytes = 0
        self._room = Condition()  # held for a few operations only
        self._may_wait = True  # for room: not again after a wait in vain, until a message is taken
        self._open = True  # Zenoh still calls callbacks after undeclare(): they check this

    def __len__(self) -> int:
        """Count the messages that wait."""
        return len(self._messages)

    def receive(self, sample: zenoh.Sample) -> None:
        """Append a sample of Zenoh, as its callback in other threads; ignore it once the inbox is closed."""
        if self._open and sample.kind == zenoh.SampleKind.PUT:
            self.put(arrival_of(sample))

    def put(self, message: Arrival) -> None:
        """Append a message; when full, wait for room, or drop and count it after a while."""
        source = message.source
        with self._room:
            # While the reader is stalled, only the first message waits.
            if not self._fits(message) and not (
                self._may_wait and self._room.wait_for(lambda: self._fits(message), self.max_wait_s)
            ):
                self._may_wait = False
                self.dropped += 1
                if source and (source in self._lost or len(self._lost) < MAX_WHEELS):
                    self._lost[source] = message._replace(payload=b"")
            else:
                self._messages.append(message)
                self._bytes += len(message.payload)
        self.wake.set()

    def take(self) -> Arrival | None:
        """Return the oldest message, or None when there is none."""
        with self._room:
            if not self._messages:
                return None
            message = self._messages.popleft()
            self._bytes -= len(message.payload)
            self._may_wait = True
            self._room.notify_all()
            return message

    def take_lost(self) -> list[Arrival]:
        """Return the last message of each publisher that was dropped since the last call, without its content."""
        with self._room:
            lost, self._lost = list(self._lost.values()), {}
            return lost

    def close(self) -> None:
        """Release all threads that wait for room, and accept no more samples."""
        self._open = False
        with self._room:
            self.max_wait_s = 0.0
            self._room.notify_all()

    def _fits(self, message: Arrival) -> bool:
        return len(self._messages) < self.max_messages and self._bytes + len(message.payload) <= self.max_bytes


# Requests the messages that a publisher sent before a given one, from a number on; calls the first function for each
# answer, and the second one after the last.
Ask = Callable[[Arrival, int, Callable[[Arrival], None], Callable[[], None]], None]


@dataclass(slots=True, eq=False)
class _Gap:
    """Messages first … before - 1 of a publisher are missing; those after them wait.

    `asked_s` is None until the publisher has been queried. `unread` is the message that could not be read, as it
    arrived: it is passed on if the publisher no longer has it.
    """

    first: int
    before: Arrival
    asked_s: float | None = None
    pauses_s: list[float] = field(default_factory=lambda: list(PAUSES_S))
    found: dict[int, Arrival] = field(default_factory=dict)  # by number: a repeated query is answered in full again
    found_bytes: int = 0
    answered_s: float | None = None
    held: deque[Arrival] = field(default_factory=deque)
    unread: Arrival | None = None

    def take(self, message: Arrival) -> None:
        """Take an answer, in any thread."""
        if message.number >= self.first and message.number not in self.found:
            self.found[message.number] = message
            self.found_bytes += len(message.payload)

    def is_awaited(self, now_s: float) -> bool:
        """Return whether an answer is awaited."""
        return self.asked_s is not None and self.answered_s is None and now_s < self.asked_s + TIMEOUT_S


class Backfill:
    """Takes messages from the inbox and passes them on in order, with the gaps in them closed.

    Parameters
    ----------
    ask
        Requests messages of a publisher; may call back in any thread.
    max_bytes
        Limit of the messages held here: beyond it nothing more is taken from the inbox until there is room. Also of the
        answers: beyond it no further publisher is queried.
    clock_s
        A monotonic clock [s].

    Attributes
    ----------
    missed
        Number of messages that could not be recovered, by key.
    """

    def __init__(self, ask: Ask, max_bytes: int, clock_s: Callable[[], float] = time.monotonic) -> None:
        self.missed: dict[str, int] = {}
        self._ask = ask
        self._max_bytes = max_bytes
        self._clock_s = clock_s
        self._next: OrderedDict[str, int] = OrderedDict()  # number of the next message of each publisher
        self._gaps: dict[str, _Gap] = {}
        self._held_bytes = 0
        self._ready: deque[Arrival] = deque()
        self._unreadable_sources: deque[str] = deque(maxlen=MAX_WHEELS)  # a message of theirs was so twice

    def __len__(self) -> int:
        """Count the messages that wait here."""
        return len(self._ready) + sum(len(gap.held) for gap in self._gaps.values())

    def take(self, take: Callable[[], Arrival | None]) -> Arrival | None:
        """Return the next message, None when there is none yet; `take` takes one from the inbox."""
        for source in list(self._gaps):
            if self._ready:
                break  # one gap at a time: the messages that it held stay in memory until they are taken
            self._settle(source)
        while not self._ready and self._held_bytes <= self._max_bytes:
            arrival = take()
            if arrival is None:
                break
            self._sort(arrival)
        self._ask_next()
        return self._ready.popleft() if self._ready else None

    def _sort(self, arrival: Arrival) -> None:
        """Pass a message on, or hold it until those before it have arrived."""
        source, number = arrival.source, arrival.number
        following = self._next.get(source, 0)
        if source in self._gaps or (source and number > following):
            self._hold(self._gaps.setdefault(source, _Gap(following, arrival)), arrival)
            return
        self._pass(arrival)

    def miss(self, dropped: Arrival) -> None:
        """Request a message that arrived and was dropped, and all before it that are missing.

        Later messages would reveal the gap, but there may be none.
        """
        self._sort(Arrival(dropped.key, b"", dropped.source, dropped.number + 1, is_gap=True))
        self._ask_next()

    def ask_again(self, unread: Arrival) -> bool:
        """Request a message that could not be read once more; the messages after it are held.

        Returns False where that is useless: its publisher is not known, or the message was unreadable twice. A
        publisher with such a message is not queried for other unreadable ones.
        """
        source, number = unread.source, unread.number
        if unread.again:
            self._unreadable_sources.append(source)
        if not source or source in self._unreadable_sources:
            return False
        gap = _Gap(number, Arrival(unread.key, b"", source, number + 1, is_gap=True), pauses_s=[], unread=unread)
        following = [arrival for arrival in self._ready if arrival.source == source]
        self._ready = deque(arrival for arrival in self._ready if arrival.source != source)
        for arrival in following:
            self._hold(gap, arrival)
        if source in self._gaps:  # a later gap will be detected again
            gap.held += self._gaps.pop(source).held
        self._gaps[source] = gap
        self._ask_next()
        return True

    def _pass(self, arrival: Arrival) -> None:
        if arrival.is_gap:
            return
        self._ready.append(arrival)
        if arrival.source:
            self._next[arrival.source] = max(self._next.pop(arrival.source, 0), arrival.number + 1)
            if len(self._next) > MAX_WHEELS:  # a publisher that is forgotten is only queried again
                self._next.popitem(last=False)

    def _hold(self, gap: _Gap, arrival: Arrival) -> None:
        gap.held.append(arrival)
        self._held_bytes += len(arrival.payload)

    def _ask_next(self) -> None:
        """Query as many of the publishers not yet queried as the limits allow."""
        unasked = [gap for gap in self._gaps.values() if gap.asked_s is None]
        if not unasked:
            return
        now_s = self._clock_s()
        awaited = sum(gap.is_awaited(now_s) for gap in self._gaps.values())
        found_bytes = sum(gap.found_bytes for gap in self._gaps.values())
        for gap in unasked[: max(0, MAX_ASKED - awaited)]:
            if found_bytes <= self._max_bytes:
                self._ask_for(gap)

    def _ask_for(self, gap: _Gap) -> None:
        def answered() -> None:
            gap.answered_s = self._clock_s()

        gap.asked_s, gap.answered_s = self._clock_s(), None
        self._ask(gap.before, gap.first, gap.take, answered)

    def _settle(self, source: str) -> None:
        """Pass on the held messages if the gap is closed or given up; query again if it may still close."""
        gap, now_s = self._gaps[source], self._clock_s()
        if gap.asked_s is None or gap.is_awaited(now_s):
            return
        end_s = gap.asked_s + TIMEOUT_S if gap.answered_s is None else gap.answered_s
        if len(gap.found) < gap.before.number - gap.first and gap.pauses_s:
            if now_s >= end_s + gap.pauses_s[0]:
                gap.pauses_s.pop(0)
                self._ask_for(gap)
            return
        del self._gaps[source]
        found = dict(gap.found)  # a late answer may still come
        if gap.unread is not None:
            found = {gap.first: found.get(gap.first, gap.unread)._replace(again=True)}
        lost = gap.before.number - gap.first - len(found)
        if lost > 0 and gap.first > 0:  # messages before the first one received of a publisher do not count
            self.missed[gap.before.key] = self.missed.get(gap.before.key, 0) + lost
        for number in sorted(found):
            self._pass(found[number])
        self._next[source] = max(self._next.get(source, 0), gap.before.number)
        for arrival in gap.held:
            self._held_bytes -= len(arrival.payload)
            self._sort(arrival)


def arrival_of(sample: zenoh.Sample) -> Arrival:
    """Return a sample of Zenoh as a message; an oversized one is cut one byte above the limit."""
    info = sample.source_info
    source, number = "", 0
    if info is not None:
        source, number = f"{info.source_id.zid}/{info.source_id.eid}", info.source_sn
    return Arrival(str(sample.key_expr), sample.payload.to_bytes()[: MAX_MESSAGE_BYTES + 1], source, number)


def ask_publisher(session: zenoh.Session, wake: Event) -> Ask:
    """Return a function that queries publishers' history over a session; it sets `wake` after the last answer."""

    def ask(before: Arrival, first: int, found: Callable[[Arrival], None], finished: Callable[[], None]) -> None:
        """Request the messages from number `first` on that the publisher of a message sent before it."""

        def on_reply(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                found(arrival_of(reply.ok))

        def on_end() -> None:
            finished()
            wake.set()

        handler: Any = zenoh.handlers.Callback(on_reply, drop=on_end)
        session.get(
            f"{before.key}/@adv/pub/{before.source}/**?_sn={first}..{before.number - 1}",
            handler,
            timeout=TIMEOUT_S,
            accept_replies=zenoh.ReplyKeyExpr.ANY,
            consolidation=zenoh.ConsolidationMode.NONE,  # or only the latest answer arrives
        )

    return ask
