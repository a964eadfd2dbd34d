"""A clean stop: SIGINT and SIGTERM set an event, and whoever works looks at it."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Event
from types import FrameType


@contextmanager
def stop_on_signals() -> Iterator[Event]:
    """Give an event that SIGINT or SIGTERM sets; a second SIGINT interrupts at once, as it does elsewhere."""
    stop = Event()

    def stop_cleanly(number: int, frame: FrameType | None) -> None:
        del number, frame
        stop.set()
        signal.signal(signal.SIGINT, signal.default_int_handler)

    before = {number: signal.signal(number, stop_cleanly) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
