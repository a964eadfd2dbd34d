"""Publishes telemetry of wheels on the bus as a satellite's computer would: reliably, numbered, with a history."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from threading import Event
from typing import Any

from rwa_monitor.samples import Samples


def publish(
    telemetry: Mapping[str, Samples],
    session: Any,
    *,
    speed: float = 1.0,
    batch_samples: int = 256,
    linger_s: float = 0.0,
    stop: Event | None = None,
    on_batch: Callable[[str, int], None] | None = None,
) -> int:
    """Publish samples of one or more wheels in the pace of their own time.

    Parameters
    ----------
    telemetry
        Samples by bus key ("rwa/<spacecraft>/<wheel>/samples").
    session
        An open Zenoh session (`bus.open_session`).
    speed
        Times faster than real time; `math.inf` for as fast as the bus takes it.
    batch_samples
        Samples of one message.
    linger_s
        How long to stay on the bus afterwards, so that late subscribers get the history [s].
    stop
        Ends it early when set.
    on_batch
        Called with (key, samples sent so far) after each message.

    Returns
    -------
    int
        Samples sent.
    """
    raise NotImplementedError
