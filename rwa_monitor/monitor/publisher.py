"""Publishes telemetry of wheels on the bus as a satellite's computer would: reliably, numbered, with a history."""

from __future__ import annotations

import math
import secrets
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from threading import Event
from typing import Any, Final, TypeVar

import zenoh

from rwa_monitor.messages import REPLAY, SamplesMessage, key_of, samples_json, split_key
from rwa_monitor.monitor.bus import reliable_publisher
from rwa_monitor.monitor.recording.reader import recorded_inputs
from rwa_monitor.samples import NANOSECONDS_PER_SECOND, Samples, Timeliness

HISTORY_MESSAGES: Final = 8_192  # 3 days of one wheel at 8 Hz in messages of 256; some 120 MB if all are kept
Content = TypeVar("Content")
LINGER_S: Final = 1.0  # closing right after the last message may lose it: `put` hands it over before it is sent


def messages_publisher(session: zenoh.Session, key: str, history: int = HISTORY_MESSAGES) -> Any:
    """Declare a publisher of messages of samples, with a history for as long as the longest outage lasts."""
    return reliable_publisher(session, key, SamplesMessage.encoding(), history)


class SamplesPublisher:
    """Numbers one wheel's samples and publishes them reliably, under a random name; `data` as in `SamplesMessage`."""

    def __init__(self, session: zenoh.Session, key: str, data: Timeliness | None = None) -> None:
        self.name = secrets.token_hex(8)
        self.data = data
        self.batch = 0
        self._publisher = messages_publisher(session, key)

    def put(self, samples: Samples) -> None:
        """Publish samples as the next message."""
        self._publisher.put(samples_json(samples, self.name, self.batch, self.data))
        self.batch += 1

    def close(self) -> None:
        """Leave the bus; the history is gone then."""
        self._publisher.undeclare()


def send(
    telemetry: Mapping[str, Samples],
    sinks: Mapping[str, SamplesPublisher],
    *,
    speed: float = 1.0,
    batch_samples: int = 256,
    linger_s: float = LINGER_S,
    stop: Event | None = None,
) -> int:
    """Send samples of one or more wheels in the pace of their own time, and close the sinks.

    Parameters
    ----------
    telemetry
        Samples by bus key ("rwa/<spacecraft>/<wheel>/samples").
    sinks
        Where those of each wheel go, such as its `SamplesPublisher`.
    speed
        Times faster than real time; `math.inf` for as fast as the bus takes it.
    batch_samples
        Samples of one message at most. A message goes out when its last sample is due.
    linger_s
        How long to stay on the bus afterwards, so that late subscribers get the history [s].
    stop
        Ends it early when set.

    Returns
    -------
    int
        Samples sent.
    """
    stop = Event() if stop is None else stop
    sent = 0
    first_ns = min((int(samples.time_ns[0]) for samples in telemetry.values() if len(samples)), default=0)
    try:
        for key, batch in _paced(_batches(telemetry, batch_samples), speed, stop, first_ns):
            sinks[key].put(batch)
            sent += len(batch)
        stop.wait(linger_s)
    finally:
        for sink in sinks.values():
            sink.close()
    return sent


def _paced(
    messages: Iterable[tuple[int, str, Content]], speed: float, stop: Event, first_ns: int | None = None
) -> Iterator[tuple[str, Content]]:
    """Yield key and content of messages when they are due; the pace begins with `first_ns`, or the first of them."""
    begin_s = time.monotonic()
    for due_ns, key, content in messages:
        first_ns = due_ns if first_ns is None else first_ns
        due_s = begin_s + (due_ns - first_ns) / NANOSECONDS_PER_SECOND / speed
        if stop.wait(0.0 if math.isinf(speed) else max(0.0, due_s - time.monotonic())):
            return
        yield key, content


def _batches(telemetry: Mapping[str, Samples], size: int) -> Iterator[tuple[int, str, Samples]]:
    """Cut all telemetry into messages: (time of the last sample, key, samples), in the order of time."""
    cuts: list[tuple[int, int, str, int]] = []
    for key, samples in telemetry.items():
        due_ns = int(samples.time_ns[0]) if len(samples) else 0
        for start in range(0, len(samples), size):
            # Where a wheel's clock steps back, its messages still go out in their own order.
            due_ns = max(due_ns, int(samples.time_ns[min(start + size, len(samples)) - 1]))
            cuts.append((due_ns, len(cuts), key, start))
    for due_ns, _, key, start in sorted(cuts):
        yield due_ns, key, telemetry[key][start : start + size]


def replay_to_bus(
    recordings: Path | Sequence[Path],
    session: zenoh.Session,
    *,
    speed: float = 1.0,
    stop: Event | None = None,
) -> int:
    """Publish a recording's inputs on the bus again, as they came, in the pace of their time.

    They go out under the name of their wheel with `REPLAY` behind it, so that nobody takes them for the wheel's own.

    Parameters
    ----------
    recordings
        As for `replay`.
    session
        An open Zenoh session.
    speed
        Times faster than real time; `math.inf` for as fast as the bus takes it.
    stop
        Ends it early when set.

    Returns
    -------
    int
        Messages published.

    Raises
    ------
    InputError
        If a path is no recording.
    """
    stop = Event() if stop is None else stop
    publishers: dict[str, Any] = {}
    sent = 0
    try:
        inputs = ((message.time_ns, message.topic, message.payload) for message in recorded_inputs(recordings))
        for topic, payload in _paced(inputs, speed, stop):
            if topic not in publishers:
                spacecraft, wheel, _ = split_key(topic)
                key = key_of(SamplesMessage, spacecraft, wheel.removesuffix(REPLAY) + REPLAY)
                publishers[topic] = messages_publisher(session, key)
            publishers[topic].put(payload)
            sent += 1
        stop.wait(LINGER_S)
    finally:
        for publisher in publishers.values():
            publisher.undeclare()
    return sent
