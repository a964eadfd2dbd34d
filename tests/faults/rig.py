"""Real processes and real sockets: a router, a publisher and the monitor, each in a process of its own, over TCP.

        publisher ──► router ◄── link ◄── monitor ──► folder of recordings
                        ▲
                     listener (this process)

The link is a proxy that can be cut or frozen. Processes are forked from a server that has imported everything
and has no session: they start in a tenth of a second and can be killed like any other.
"""

from __future__ import annotations

import json
import os
import resource
import signal
import socket
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from threading import Event, Thread
from typing import Any, Final

import zenoh
from zenoh import ext

from rwa_monitor.cli.options import stop_on_signals
from rwa_monitor.monitor.bus import MAX_HISTORY, BusOptions, messages_publisher, open_session
from rwa_monitor.monitor.recorder import MAX_FILE_BYTES
from rwa_monitor.monitor.service import RunOptions, run
from rwa_monitor.monitor.setup import Setup
from tests.faults.history import Put, wheel
from tests.monitor.processes import PATIENCE_S, wait_for
from tests.monitor.support import free_port, model

LEASE_MS: Final = 1_000  # a peer that is silent for longer is disconnected: pauses and outages last up to 1.6 s
TMPFS_BYTES: Final = 80 * 2**20  # the recorder leaves 64 MiB to others
processes = get_context("forkserver")
processes.set_forkserver_preload(["tests.faults.preload"])


# ---- in processes of their own ---------------------------------------------------------------------------------------


def _talk_into(log: Path) -> None:
    file = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    os.dup2(file, sys.stdout.fileno())
    os.dup2(file, sys.stderr.fileno())


def router_process(config: Path, port: int, connection: Connection, log: Path) -> None:
    _talk_into(log)
    with open_session(BusOptions(mode="router", listen=(f"tcp/127.0.0.1:{port}",), config=config)):
        connection.send("ready")
        connection.recv()


def publisher_process(config: Path, port: int, kept: int, connection: Connection, log: Path) -> None:
    _talk_into(log)
    bus = BusOptions(mode="client", connect=(f"tcp/127.0.0.1:{port}",), config=config)
    with open_session(bus) as session:
        publishers: dict[str, Any] = {}
        connection.send("ready")
        while (put := connection.recv()) is not None:
            name = f"{put.key} {put.publisher}"
            if name not in publishers and put.publisher == "intruder":
                publishers[name] = _plain_publisher(session, put.key)
            elif name not in publishers:
                publishers[name] = messages_publisher(session, put.key, kept)
            publishers[name].put(put.payload)


def _plain_publisher(session: zenoh.Session, key: str) -> Any:
    """Return a publisher without history, once it has a subscriber."""
    publisher = session.declare_publisher(key, congestion_control=zenoh.CongestionControl.BLOCK)
    wait_for(lambda: publisher.matching_status.matching, "somebody who listens")
    return publisher


def monitor_process(options: RunOptions, log: Path) -> None:
    _talk_into(log)
    with stop_on_signals() as stop:
        run(options, stop, log=lambda line: print(line, flush=True))


# ---- the link --------------------------------------------------------------------------------------------------------


class Link:
    """A TCP proxy on loopback that can be cut (connections end, none is taken) or frozen (nothing passes)."""

    def __init__(self, target: int) -> None:
        self.target = target
        self._closed = False
        self._cut = Event()
        self._flows = Event()
        self._flows.set()
        self._sockets: set[socket.socket] = set()
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        Thread(target=self._accept, daemon=True).start()

    def cut(self) -> None:
        self._cut.set()
        self._drop()

    def freeze(self) -> None:
        self._flows.clear()

    def heal(self) -> None:
        self._cut.clear()
        self._flows.set()

    def close(self) -> None:
        self._closed = True
        self._flows.set()
        self._listener.close()
        self._drop()

    def _drop(self) -> None:
        for end in list(self._sockets):
            _shut(end)
            end.close()
        self._sockets.clear()

    def _accept(self) -> None:
        while not self._closed:
            try:
                near, _ = self._listener.accept()
            except OSError:
                return
            if self._cut.is_set():
                near.close()
                continue
            try:
                far = socket.create_connection(("127.0.0.1", self.target), timeout=1.0)
            except OSError:  # the router is down
                near.close()
                continue
            far.settimeout(None)
            self._sockets |= {near, far}
            Thread(target=self._pump, args=(near, far), daemon=True).start()
            Thread(target=self._pump, args=(far, near), daemon=True).start()

    def _pump(self, source: socket.socket, sink: socket.socket) -> None:
        with suppress(OSError, ValueError):
            while data := source.recv(65_536):
                self._flows.wait()
                sink.sendall(data)
        for end in (source, sink):
            _shut(end)


def _shut(end: socket.socket) -> None:
    with suppress(OSError):
        end.shutdown(socket.SHUT_RDWR)


# ---- the rig ---------------------------------------------------------------------------------------------------------


class Rig:
    """All processes of one history.

    Parameters
    ----------
    folder
        An empty folder for everything.
    kept
        Messages that the publisher keeps.
    small_disk
        Whether the recordings go on a disk of their own, of 80 MiB (needs root).
    small_files
        Whether each recording ends as soon as it may, at twice the size that it begins with.

    Attributes
    ----------
    flipped
        The recording in which a bit was flipped, None while there is none.
    heard
        Messages of the monitor by kind and wheel, in the order of their receipt.
    """

    def __init__(self, folder: Path, kept: int, *, small_disk: bool, small_files: bool) -> None:
        self.folder = folder
        self.flipped: Path | None = None
        self.kept = kept
        self.max_file_bytes = 1 if small_files else MAX_FILE_BYTES
        self.recordings = folder / "recordings"
        self.recordings.mkdir()
        self.heard: dict[tuple[str, str], list[bytes]] = defaultdict(list)
        self.log = folder / "talk.log"
        self._stack = ExitStack()
        self._config = folder / "zenoh.json5"
        self._config.write_text(json.dumps(_zenoh_settings()))
        self._port = free_port()
        self.link = Link(self._port)
        self._stack.callback(self.link.close)
        if small_disk:
            self._stack.enter_context(_small_disk(self.recordings))
        self.router: BaseProcess | None = None
        self.publisher: BaseProcess | None = None
        self.monitor: BaseProcess | None = None
        self._said_before = 0  # bytes logged before the present monitor started
        self._publisher_end: Connection | None = None
        self._router_end: Connection | None = None

    def __enter__(self) -> Rig:
        self.start_router()
        bus = BusOptions(mode="client", connect=(f"tcp/127.0.0.1:{self._port}",), config=self._config)
        self._session = self._stack.enter_context(open_session(bus))
        self._listener: Any = ext.declare_advanced_subscriber(
            self._session,
            "rwa/**",
            self._hear,
            history=ext.HistoryConfig(detect_late_publishers=True, max_samples=MAX_HISTORY),
            recovery=ext.RecoveryConfig(periodic_queries=None, heartbeat=True),
        )
        self.start_publisher()
        self.start_monitor()
        return self

    def __exit__(self, *_error: object) -> None:
        for process in (self.monitor, self.publisher, self.router):
            if process is not None and process.is_alive():
                process.kill()
                process.join()
        self._stack.close()

    def _hear(self, sample: zenoh.Sample) -> None:
        _, _, name, kind = str(sample.key_expr).split("/")
        if kind in {"diagnosis", "status"}:
            self.heard[kind, name].append(sample.payload.to_bytes())

    def status(self, name: str) -> dict[str, Any]:
        """Return the latest status of a wheel."""
        heard = self.heard["status", name]
        content: dict[str, Any] = json.loads(heard[-1]) if heard else {}
        return content

    # ---- processes ---------------------------------------------------------------------------------------------------

    def _started(self, target: Callable[..., None], *arguments: object) -> tuple[BaseProcess, Connection]:
        """Start a process that reports when it is ready; returns it and this end of its pipe."""
        end, other = processes.Pipe()
        process = processes.Process(target=target, args=(self._config, self._port, *arguments, other, self.log))
        process.start()
        other.close()
        assert end.poll(PATIENCE_S)
        end.recv()
        return process, end

    def start_router(self) -> None:
        self.router, self._router_end = self._started(router_process)

    def start_publisher(self) -> None:
        self.publisher, self._publisher_end = self._started(publisher_process, self.kept)

    def start_monitor(self) -> None:
        options = RunOptions(
            setup=Setup(wheel(), model=model()),
            record=self.recordings,
            max_file_bytes=self.max_file_bytes,
            bus=BusOptions(mode="client", connect=(f"tcp/127.0.0.1:{self.link.port}",), config=self._config),
            status_period_s=0.1,
        )
        self._said_before = self.log.stat().st_size if self.log.exists() else 0
        self.monitor = processes.Process(target=monitor_process, args=(options, self.log))
        self.monitor.start()

    def stop_monitor(self) -> tuple[int | None, float]:
        """Stop it in order; return its exit code and how long it took [s]."""
        wait_for(lambda: self.monitor is None or not self.monitor.is_alive() or self._monitoring(), "the monitor")
        begin_s = time.monotonic()
        os.kill(self.monitor.pid, signal.SIGTERM)
        self.monitor.join(PATIENCE_S)
        return self.monitor.exitcode, time.monotonic() - begin_s

    def _monitoring(self) -> bool:
        """Return whether the present monitor has reported that it monitors: from then on it handles signals."""
        return b"monitoring" in self.log.read_bytes()[self._said_before :]

    def put(self, put: Put) -> None:
        self._publisher_end.send(put)
        if put.pause_s:
            Event().wait(put.pause_s)

    # ---- faults ------------------------------------------------------------------------------------------------------

    def kill(self, process: BaseProcess | None) -> None:
        process.kill()
        process.join()

    def signal_monitor(self, number: signal.Signals) -> None:
        os.kill(self.monitor.pid, number)

    def renew_publisher(self) -> None:
        """Kill the publisher, with its history, and start another one."""
        self.kill(self.publisher)
        self.start_publisher()

    def fill_disk(self) -> None:
        """Fill the small disk to the last byte."""
        with (self.recordings / "ballast").open("wb", buffering=0) as file, suppress(OSError):
            while True:
                file.write(bytes(2**16))

    def free_disk(self) -> None:
        (self.recordings / "ballast").unlink()

    def fail_disk(self) -> None:
        """Make each write beyond the present size of the recording fail, as a broken disk would."""
        wait_for(lambda: any(self.recordings.glob("*.mcap")), "a recording")
        size = max(path.stat().st_size for path in self.recordings.glob("*.mcap"))
        resource.prlimit(self.monitor.pid, resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY))

    def flip_bit(self, share: float) -> None:
        """Flip a bit of the last recording, at this share of its length."""
        path = max(self.recordings.glob("*.mcap"))
        data = bytearray(path.read_bytes())
        bit = int(share * 8 * len(data))
        data[bit // 8] ^= 1 << bit % 8
        path.write_bytes(data)
        self.flipped = path

    def mend_disk(self) -> None:
        with suppress(ProcessLookupError):
            resource.prlimit(self.monitor.pid, resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY,) * 2)


def _zenoh_settings() -> dict[str, Any]:
    """Return Zenoh settings that detect and repair an outage within a second, so that histories are short."""
    return {
        "connect": {
            "timeout_ms": -1,
            "exit_on_failure": False,
            "retry": {"period_init_ms": 50, "period_max_ms": 200, "period_increase_factor": 1.5},
        },
        "transport": {"link": {"tx": {"lease": LEASE_MS, "keep_alive": 4}}},
    }


@contextmanager
def _small_disk(folder: Path) -> Iterator[None]:
    """Mount a small file system in memory."""
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={TMPFS_BYTES}", "rwa-faults", folder], check=True)
    try:
        yield
    finally:
        subprocess.run(["umount", "--lazy", folder], check=True)
