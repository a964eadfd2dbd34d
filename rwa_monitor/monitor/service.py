"""The live monitor: `run` subscribes to samples, diagnoses, publishes and records until it is told to stop.

One thread does everything in order: take a message from the inbox, record it, feed the wheel's core, record what the
core says, bring a diagnosis to the disk, publish. Other threads only fill the inbox (`bus.Inbox`): when it is full,
reliable publishers are slowed down to our pace, and what may be dropped in the end is counted and shown in `status`.

After a crash the cores are rebuilt from the last recording, and what came in between is taken from the publishers'
history (`backfill`). A diagnosis that had not reached the disk is made again, byte for byte, and stands in the new
recording; those of the last recordings are published again in any case.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack, suppress
from pathlib import Path
from threading import Event

import zenoh

from rwa_monitor.build import build
from rwa_monitor.monitor.bus import Inbox, MonitorBus, check_wheels, endpoints, open_session
from rwa_monitor.monitor.bus_watch import BusNews, BusWatch
from rwa_monitor.monitor.earlier_run import Past, read_past
from rwa_monitor.monitor.monitor import Clock, Monitor
from rwa_monitor.monitor.recording.recorder import FolderLock, Recorder
from rwa_monitor.monitor.run_options import RunOptions
from rwa_monitor.monitor.supervisor import Supervisor
from rwa_monitor.monitor.wheel_words import first_verdict


def run(
    options: RunOptions,
    stop: Event,
    *,
    session: zenoh.Session | None = None,
    say: Callable[[str], None] = print,
    supervisor: Supervisor | None = None,
) -> None:
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
    supervisor
        Hears when the monitor is ready, alive and stopping; None: nobody does.

    Raises
    ------
    InputError
        If an option, the wheel, the model or the recording in the folder cannot be used.
    RwaMonitorError
        If the bus cannot be reached.
    """
    say = _unbreakable(say)
    supervisor = supervisor or Supervisor({})
    check_wheels(options.wheels)
    setup = options.setup()
    for key in ("", ""), *options.own_wheels:
        setup.new_core(*key)  # a wheel that cannot be served is told at once
    with ExitStack() as stack:
        if options.record is not None:
            stack.enter_context(FolderLock(options.record))
        clock = Clock()

        def starting() -> None:
            supervisor.starting(clock.monotonic_s())

        recorder: Recorder | None = None
        past = Past()
        if options.record is not None:
            past = read_past(options.record, setup, stop, say, starting)
            if stop.is_set():
                return
            recorder = _recorder(options, options.record, past, clock)
        if session is None:
            session = stack.enter_context(open_session(options.bus))
        bus = stack.enter_context(MonitorBus(session, Inbox()))
        monitor = Monitor(options, bus, recorder, say, clock)
        stack.callback(monitor.close)
        monitor.begin(past, starting)
        del past  # what was published again needs no place for as long as the monitor runs
        bus.subscribe(options.wheels)
        bus.offer_health()
        say(doing := f"monitoring {options.wheels}" + (f", recording in {options.record}" if options.record else ""))
        if options.tell_verdicts and (wait := first_verdict([options.wheel, *options.own_wheels.values()])):
            say(wait)
        supervisor.ready(doing)
        news = BusNews(BusWatch(session, endpoints(options.bus)), say)
        while not stop.is_set():
            supervisor.alive(clock.monotonic_s())
            news.look(clock.monotonic_s())
            monitor.step()
        supervisor.stopping()


def _recorder(options: RunOptions, folder: Path, past: Past, clock: Clock) -> Recorder:
    """Return what records, in a folder, after what lies there."""
    return Recorder(
        folder,
        wheel_toml=options.wheel.to_toml(),
        own_wheels=options.setup().wheels.own_attachments(),
        model_json=options.model.to_json() if options.model else "",
        settings={**options.settings(), "build": build()},
        predecessor=past.predecessor,
        wall_ns=clock.wall_ns,
        max_file_bytes=options.max_file_bytes,
        max_total_bytes=options.max_record_bytes,
    )


def _unbreakable(say: Callable[[str], None]) -> Callable[[str], None]:
    """Return a way to talk that does not end the monitor when nobody listens any more, or the log's disk is full."""

    def told(line: str) -> None:
        with suppress(OSError):  # what matters stands in `status` too
            say(line)

    return told
