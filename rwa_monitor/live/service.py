"""The live monitor: `run` subscribes to samples, diagnoses, publishes and records until it is told to stop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from threading import Event

from rwa_monitor.diagnosis.results import Method
from rwa_monitor.live.bus import BusOptions
from rwa_monitor.physics.wheel import Wheel, built_in_wheel


@dataclass(frozen=True, slots=True)
class RunOptions:
    """All settings of `run`; every one of them is in the recording.

    Attributes
    ----------
    wheels
        Key expression of the samples to listen to.
    wheel
        Constants of the wheels.
    model
        rwa_monitor.diagnosis.model.Model, or None for the built-in one.
    method
        "joint" or "paper".
    record
        Folder of the recordings, or None to record nothing.
    bus
        How to reach the bus.
    shard
        (I, N): this process serves share I of N, 1 ≤ I ≤ N.
    status_period_s
        Wall-clock time from one status message to the next [s].
    """

    wheels: str = "rwa/*/*/samples"
    wheel: Wheel = field(default_factory=built_in_wheel)
    model: object | None = None
    method: Method = "joint"
    record: Path | None = None
    bus: BusOptions = field(default_factory=BusOptions)
    shard: tuple[int, int] = (1, 1)
    status_period_s: float = 1.0


def run(options: RunOptions, stop: Event, *, session: object | None = None, say: Callable[[str], None] = print) -> None:
    """Monitor until `stop` is set; returns within two seconds of that.

    Parameters
    ----------
    options
        See `RunOptions`.
    stop
        Set it from a signal handler or another thread.
    session
        An open Zenoh session to use (the demo's embedded one); it is left open. None: opens and closes its own.
    say
        Takes one line of talk for the user (stderr on the command line).

    Raises
    ------
    InputError
        If an option, the wheel, the model or the recording in the folder cannot be used.
    """
    raise NotImplementedError
