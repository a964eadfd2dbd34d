"""The live monitor: `run` subscribes to samples, diagnoses, publishes and records until it is stopped.

One thread does everything in order: take a message from the inbox, record it, feed the wheel's core, record what the
core reports, bring a diagnosis to the disk, publish. Other threads only fill the inbox (`bus.Inbox`): when it is full,
reliable publishers are slowed down to our pace, and what may be dropped in the end is counted and shown in `status`.

After a crash the state is recovered from the last recording, and what came in between is taken from the publishers'
history (`backfill`). A diagnosis that had not reached the disk is made again, byte for byte, and stands in the new
recording; those of the last recordings are published again in any case.
"""

from __future__ import annotations

import os
import socket
from collections.abc import Callable, Mapping
from contextlib import ExitStack, closing, suppress
from pathlib import Path
from threading import Event
from typing import Final

import zenoh

from rwa_monitor.build import build
from rwa_monitor.errors import InputError
from rwa_monitor.messages import PERIOD_S
from rwa_monitor.monitor.bus import BusWatch, MonitorBus, check_wheels, endpoints, open_session
from rwa_monitor.monitor.ingest.backfill import Inbox
from rwa_monitor.monitor.monitor import Clock, Monitor, RunOptions
from rwa_monitor.monitor.recording.recorder import Recorder, locked
from rwa_monitor.monitor.state_recovery import RecoveredState, recover_state


def run(
    options: RunOptions,
    stop: Event,
    *,
    session: zenoh.Session | None = None,
    log: Callable[[str], None] = print,
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
    log
        Takes one line of the log (stderr on the command line).
    supervisor
        Gets notice when the monitor is ready, alive and stopping; None: there is none.

    Raises
    ------
    InputError
        If an option, the wheel, the model or the recording in the folder cannot be used.
    RwaMonitorError
        If the bus cannot be reached.
    """
    log = _unbreakable(log)
    supervisor = supervisor or Supervisor({})
    check_wheels(options.wheels)
    setup = options.setup()
    for key in ("", ""), *options.own_wheels:
        setup.new_core(*key)  # a wheel that cannot be served is refused at once
    with ExitStack() as stack:
        if options.record is not None:
            stack.enter_context(locked(options.record))
        clock = Clock()

        recorder: Recorder | None = None
        recovered = RecoveredState()
        if options.record is not None:
            recovered = recover_state(options.record, setup, stop, log)
            if stop.is_set():
                return
            recorder = Recorder(
                options.record,
                attachments=setup.attachments(),
                settings={**options.settings(), "build": build()},
                predecessor=recovered.predecessor,
                wall_ns=clock.wall_ns,
                max_file_bytes=options.max_file_bytes,
                max_total_bytes=options.max_record_bytes,
            )
        if session is None:
            session = stack.enter_context(open_session(options.bus))
        bus = stack.enter_context(closing(MonitorBus(session, Inbox())))
        monitor = Monitor(options, bus, recorder, log, clock)
        stack.callback(monitor.close)
        monitor.begin(recovered)
        del recovered  # what was published again needs no place for as long as the monitor runs
        bus.subscribe(options.wheels)
        bus.offer_health()
        log(doing := f"monitoring {options.wheels}" + (f", recording in {options.record}" if options.record else ""))
        supervisor.ready(doing)
        watch = BusWatch(session, endpoints(options.bus))
        while not stop.is_set():
            supervisor.alive(clock.monotonic_s())
            watch.log_changes(clock.monotonic_s(), log)
            monitor.step()
        supervisor.stopping()


def _unbreakable(log: Callable[[str], None]) -> Callable[[str], None]:
    """Return a log that does not end the monitor when its reader has gone, or its disk is full."""

    def logged(line: str) -> None:
        with suppress(OSError):  # what matters stands in `status` too
            log(line)

    return logged


# ---- the supervisor of the process -----------------------------------------------------------------------------------


SIGNS_PER_SILENCE: Final = 3.0  # so that one that comes late is no alarm


class Supervisor:
    """The supervisor of this process, in the protocol of systemd (sd_notify(3)); does nothing where there is none.

    A supervisor names a datagram socket in NOTIFY_SOCKET and the longest silence in WATCHDOG_USEC. The sign of life is
    sent by the thread that diagnoses, between two messages: it stops when that thread stalls, even if the rest of the
    process goes on, and the supervisor then restarts the service, which goes on from its recording.

    A container's supervisor reads no socket but runs a command inside, the health check: for it the time of a file
    shows when the last sign of life was.

    Parameters
    ----------
    environment
        Where NOTIFY_SOCKET, WATCHDOG_USEC and WATCHDOG_PID may stand; empty for no supervisor.
    alive
        A file that each sign of life touches, for a health check; None: none is.

    Attributes
    ----------
    period_s
        Between two signs of life; None where none are expected.
    """

    def __init__(self, environment: Mapping[str, str], alive: Path | None = None) -> None:
        self._address = environment.get("NOTIFY_SOCKET", "")
        if self._address.startswith("@"):  # an abstract socket of Linux
            self._address = "\0" + self._address[1:]
        silence = environment.get("WATCHDOG_USEC", "")
        ours = environment.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
        self.period_s: float | None = None
        if self._address and ours and silence.isdecimal() and int(silence) > 0:
            self.period_s = int(silence) * 1e-6 / SIGNS_PER_SILENCE  # stated in µs
        elif alive is not None:
            self.period_s = PERIOD_S
        self._alive = alive
        self._due_s = float("-inf")

    def ready(self, status: str) -> None:
        """Report that the service has begun, and what it does; raises InputError if the file cannot be made."""
        if self._alive is not None:
            try:
                self._alive.touch()
            except OSError as error:
                raise InputError(str(self._alive), f"cannot be touched: {error.strerror}") from error
        self._send(f"READY=1\nSTATUS={status}")

    def alive(self, now_s: float) -> None:
        """Give a sign of life where one is due; call it often, from the thread that must not stall."""
        if self.period_s is not None and now_s >= self._due_s:
            self._due_s = now_s + self.period_s
            self._send("WATCHDOG=1")
            if self._alive is not None:
                with suppress(OSError):  # a file that grows old is what the health check looks for
                    self._alive.touch()

    def stopping(self) -> None:
        """Report that the service ends, on purpose."""
        self._send("STOPPING=1")

    def _send(self, text: str) -> None:
        if not self._address:
            return
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as end:
            end.setblocking(False)
            # A supervisor that does not listen must not stop the monitor; what it misses it acts upon itself.
            with suppress(OSError):
                end.sendto(text.encode(), self._address)
