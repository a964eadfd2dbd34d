"""Listens on the bus and passes on what it hears: to the fleet, to the history, to the feed.

Zenoh's threads only fill the inbox; one thread of ours does the rest. A history that cannot be written just now holds
nobody up: its windows wait, and are written when it can be again.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from threading import Event, Thread
from typing import Any, Final, Self

import zenoh
from zenoh import ext

from rwa_monitor.dashboard.feed import Hub
from rwa_monitor.dashboard.fleet import Fleet, Received
from rwa_monitor.dashboard.trace import thinned_json
from rwa_monitor.errors import InputError
from rwa_monitor.history.records import AlarmRecord
from rwa_monitor.history.store import History, HistoryError
from rwa_monitor.live.bus import Inbox
from rwa_monitor.messages import (
    MAX_MESSAGE_BYTES,
    Changepoints,
    Diagnosis,
    Discrepancy,
    Message,
    SamplesMessage,
    Status,
    split_key,
)

KINDS: Final[dict[str, type[Message]]] = {kind.kind: kind for kind in (Diagnosis, Changepoints, Status, Discrepancy)}
IDLE_WAIT_S: Final = 0.1
RETRY_S: Final = 1.0
MAX_WAITING: Final = 10_000  # windows that wait for the history


class Listener:
    """From the bus into the dashboard; use it with `with`.

    Parameters
    ----------
    session
        An open Zenoh session; it is left open.
    key_expression
        What to listen to.
    fleet, history, hub
        Where it goes.
    say
        Takes lines of talk.
    """

    def __init__(
        self,
        session: zenoh.Session,
        key_expression: str,
        fleet: Fleet,
        history: History,
        hub: Hub,
        say: Callable[[str], None],
    ) -> None:
        self.fleet, self.history, self.hub, self.say = fleet, history, hub, say
        self.inbox = Inbox()
        self.refused = 0
        self._waiting: deque[Diagnosis] = deque(maxlen=MAX_WAITING)
        self._retry_due_s = 0.0
        self._alarms: dict[int, AlarmRecord] = {}
        self._stop = Event()
        self._thread = Thread(target=self._run, name="dashboard listener", daemon=True)
        self._subscriber: Any = ext.declare_advanced_subscriber(
            session,
            key_expression,
            self._on_sample,
            history=ext.HistoryConfig(detect_late_publishers=True),
            recovery=ext.RecoveryConfig(periodic_queries=None, heartbeat=True),
        )

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._stop.set()
        with suppress(zenoh.ZError):  # the session may have been closed under us
            self._subscriber.undeclare()
        self._thread.join()

    def _on_sample(self, sample: zenoh.Sample) -> None:
        """Called in Zenoh's threads: append, and nothing else."""
        if not self._stop.is_set() and sample.kind == zenoh.SampleKind.PUT:
            self.inbox.put(str(sample.key_expr), sample.payload.to_bytes()[: MAX_MESSAGE_BYTES + 1])

    def _run(self) -> None:
        while not self._stop.is_set():
            self.inbox.wake.clear()
            while not self._stop.is_set() and (message := self.inbox.take()) is not None:
                self.receive(message.key, message.payload)
            if self._waiting and time.monotonic() >= self._retry_due_s:
                self._store()
            self.inbox.wake.wait(IDLE_WAIT_S)

    def receive(self, key: str, payload: bytes) -> None:
        """Pass on one message; one that is none of ours is counted and dropped."""
        try:
            spacecraft, wheel, kind = split_key(key)
            if kind == SamplesMessage.kind:
                self._receive_samples(key, payload, spacecraft, wheel)
                return
            if kind not in KINDS:
                return
            message = KINDS[kind].parse(payload, key)
        except InputError:
            self.refused += 1
            return
        known = self.fleet.wheel(spacecraft, wheel)
        if known is None:
            self.refused += 1
            return
        received = Received(key, message.to_json(), time.time_ns())
        self.fleet.take(known, message, received)
        self.hub.post(received)
        if isinstance(message, Diagnosis):
            self._waiting.append(message)
            self._store()

    def _receive_samples(self, key: str, payload: bytes, spacecraft: str, wheel: str) -> None:
        samples = SamplesMessage.parse(payload, key).samples()
        known = self.fleet.wheel(spacecraft, wheel)
        if known is None:
            self.refused += 1
            return
        with self.fleet.lock:
            picked = known.trace.add(samples)
        if len(picked) and self.hub.watched(f"{spacecraft}/{wheel}"):
            self.hub.post(Received(key, thinned_json(picked), time.time_ns()))

    def _store(self) -> None:
        """Write what waits into the history, and tell of alarms that changed."""
        try:
            while self._waiting:
                self.history.add(self._waiting[0])
                self._waiting.popleft()
            alarms = self.history.alarms()
        except HistoryError as error:
            self._retry_due_s = time.monotonic() + RETRY_S
            if not self.hub.note:
                self.say(str(error))
            self.hub.note = f"{error}. {len(self._waiting)} windows wait to be stored."
            return
        self.hub.note = ""
        for alarm in alarms:
            if self._alarms.get(alarm.id) != alarm:
                self.hub.post(alarm_entry(alarm))
        self._alarms = {alarm.id: alarm for alarm in alarms}


def alarm_entry(alarm: AlarmRecord) -> Received:
    """Return an alarm as an entry of the feed."""
    return Received(f"rwa/{alarm.spacecraft}/{alarm.wheel}/alarm", alarm.to_json(), time.time_ns())
