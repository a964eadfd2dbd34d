"""Tells a supervisor that the monitor is ready, alive and stopping, in the protocol of systemd (sd_notify(3)).

A supervisor that speaks it names a datagram socket in NOTIFY_SOCKET and the longest silence in WATCHDOG_USEC. The sign
of life is sent by the thread that diagnoses, between two messages: it stops when that thread stalls, even if the rest
of the process goes on, and the supervisor then restarts the service, which goes on from its recording.

A container's supervisor listens to no socket but runs a command inside, the health check: for it the time of a file
tells when the last sign of life was.
"""

from __future__ import annotations

import os
import socket
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Final

from rwa_monitor.errors import InputError

MICROSECONDS: Final = 1e6
SIGNS_PER_SILENCE: Final = 3.0  # so that one that comes late is no alarm
FILE_PERIOD_S: Final = 1.0  # between two signs in a file, where no socket asks for more
START_SILENCE_S: Final = 60.0  # that a start may take without going on


class Supervisor:
    """The supervisor of this process; does nothing where there is none.

    Parameters
    ----------
    environment
        Where NOTIFY_SOCKET, WATCHDOG_USEC and WATCHDOG_PID may stand; empty for no supervisor.
    alive
        A file that each sign of life touches, for a health check; None: none is.

    Attributes
    ----------
    period_s
        Between two signs of life; None where nobody waits for them.
    """

    def __init__(self, environment: Mapping[str, str], alive: Path | None = None) -> None:
        self._address = environment.get("NOTIFY_SOCKET", "")
        if self._address.startswith("@"):  # an abstract socket of Linux
            self._address = "\0" + self._address[1:]
        silence = environment.get("WATCHDOG_USEC", "")
        ours = environment.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
        self.period_s: float | None = None
        if self._address and ours and silence.isdecimal() and int(silence) > 0:
            self.period_s = int(silence) / MICROSECONDS / SIGNS_PER_SILENCE
        elif alive is not None:
            self.period_s = FILE_PERIOD_S
        self._alive = alive
        self._due_s = float("-inf")
        self._start_due_s = float("-inf")

    def starting(self, now_s: float) -> None:
        """Say that the start goes on, where that is due, so that a long one is waited for; call it often."""
        if now_s >= self._start_due_s:
            self._start_due_s = now_s + FILE_PERIOD_S
            self._send(f"EXTEND_TIMEOUT_USEC={START_SILENCE_S * MICROSECONDS:.0f}")

    def ready(self, status: str) -> None:
        """Say that the service has begun, and what it does; raises InputError if the file cannot be made."""
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
        """Say that the service ends, on purpose."""
        self._send("STOPPING=1")

    def _send(self, text: str) -> None:
        if not self._address:
            return
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as end:
            end.setblocking(False)
            # A supervisor that does not listen must not stop the monitor; what it misses it acts upon itself.
            with suppress(OSError):
                end.sendto(text.encode(), self._address)
