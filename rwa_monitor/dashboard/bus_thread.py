"""Takes what the bus says to a thread of ours: Zenoh's threads only fill the inbox."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from threading import Event, Thread
from typing import Any, Final

import zenoh
from zenoh import ext

from rwa_monitor.messages import MAX_MESSAGE_BYTES
from rwa_monitor.monitor.bus import Inbox

IDLE_WAIT_S: Final = 0.1


class BusThread:
    """A subscription and the one thread that works on what it brings. What was published before is asked for, too.

    Parameters
    ----------
    session
        An open Zenoh session; it is left open.
    key_expression
        What to listen to.
    receive
        Takes key and payload of each message, cut behind the largest size that a message may have.
    tend
        Called whenever the inbox is empty, again and again while nothing comes.
    name
        Of the thread.
    """

    def __init__(
        self,
        session: zenoh.Session,
        key_expression: str,
        receive: Callable[[str, bytes], None],
        tend: Callable[[], None] = lambda: None,
        *,
        name: str,
    ) -> None:
        self._receive, self._tend = receive, tend
        self._inbox = Inbox()
        self._stop = Event()
        self._thread = Thread(target=self._run, name=name, daemon=True)
        self._subscriber: Any = ext.declare_advanced_subscriber(
            session,
            key_expression,
            self._on_sample,
            history=ext.HistoryConfig(detect_late_publishers=True),
            recovery=ext.RecoveryConfig(periodic_queries=None, heartbeat=True),
        )

    def start(self) -> None:
        """Begin to work on what came since the subscription."""
        self._thread.start()

    def stop(self) -> None:
        """Work on nothing more, and wait for the thread."""
        self._stop.set()
        with suppress(zenoh.ZError):  # the session may have been closed under us
            self._subscriber.undeclare()
        self._inbox.wake.set()
        self._thread.join()

    def _on_sample(self, sample: zenoh.Sample) -> None:
        """Called in Zenoh's threads: append, and nothing else."""
        if not self._stop.is_set() and sample.kind == zenoh.SampleKind.PUT:
            self._inbox.put(str(sample.key_expr), sample.payload.to_bytes()[: MAX_MESSAGE_BYTES + 1])

    def _run(self) -> None:
        while not self._stop.is_set():
            self._inbox.wake.clear()
            while not self._stop.is_set() and (message := self._inbox.take()) is not None:
                self._receive(message.key, message.payload)
            self._tend()
            self._inbox.wake.wait(IDLE_WAIT_S)
