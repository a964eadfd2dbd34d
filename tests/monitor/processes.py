"""Helpers of tests of the whole service: monitors in processes and threads, and a listener to their messages."""

import json
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from threading import Event, Thread
from typing import Any, Final

import zenoh

from benchmarks.references import SilentBus
from rwa_monitor.dashboard.space_packets import UdpAddress
from rwa_monitor.monitor.bus import SamplesPublisher
from rwa_monitor.monitor.recording import MAX_FILE_BYTES
from rwa_monitor.monitor.replay import recover_state
from rwa_monitor.monitor.service import Clock, Monitor, RunOptions, run
from rwa_monitor.monitor.setup import Setup
from rwa_monitor.samples import Samples
from rwa_monitor.wheel.wheel import Wheel
from tests.monitor.support import model, wheel
from tests.program import command

PATIENCE_S = 200.0  # for actions of a second or two, longer where all cores are busy


def wait_for(condition: Callable[[], Any], what: str, patience_s: float = PATIENCE_S) -> Any:
    """Wait until a condition holds, and return its value."""
    end = time.monotonic() + patience_s
    while not (found := condition()):
        assert time.monotonic() < end, f"waited in vain for {what}"
        Event().wait(0.02)
    return found


def options(**changes: Any) -> RunOptions:
    """Return options of a monitor of the test wheel that often reports."""
    return RunOptions(**{"setup": Setup(wheel(), model=model()), "status_period_s": 0.05, **changes})


@dataclass
class Driven:
    """A monitor that continues from the recordings in a folder, without a loop: the test advances its clock."""

    folder: Path
    of_wheel: Wheel = field(default_factory=wheel)
    bus: Any = field(default_factory=SilentBus)
    max_file_bytes: int = MAX_FILE_BYTES
    max_record_bytes: int | None = None
    now_s: float = 0.0
    log_lines: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.folder.mkdir(exist_ok=True)
        run_options = RunOptions(
            setup=Setup(self.of_wheel, model=model()),
            record=self.folder,
            max_file_bytes=self.max_file_bytes,
            max_record_bytes=self.max_record_bytes,
            log_verdicts=False,
        )
        past = recover_state(self.folder, run_options.setup, Event(), self.log_lines.append)
        clock = Clock(wall_ns=lambda: round(self.now_s * 1e9), monotonic_s=lambda: self.now_s)
        self.recorder = run_options.recorder(self.folder, past.predecessor, clock.wall_ns)
        self.monitor = Monitor(run_options, self.bus, self.recorder, self.log_lines.append, clock)
        self.monitor.begin(past)


def put_pieces(
    publisher: SamplesPublisher, samples: Samples, size: int, *, backwards: bool = False
) -> SamplesPublisher:
    """Publish samples in messages of a size."""
    for start in range(0, len(samples), size)[:: -1 if backwards else 1]:
        publisher.put(samples[start : start + size])
    return publisher


class Listener:
    """Gathers what the monitor publishes on a session, by kind."""

    def __init__(self, session: zenoh.Session) -> None:
        self.received: list[tuple[str, bytes]] = []
        self._subscriber = session.declare_subscriber(
            "rwa/**", lambda sample: self.received.append((str(sample.key_expr), sample.payload.to_bytes()))
        )

    def kind(self, kind: str) -> list[bytes]:
        return [payload for key, payload in self.received if key.endswith(f"/{kind}")]

    def status(self) -> dict[str, Any]:
        statuses = self.kind("status")
        content: dict[str, Any] = json.loads(statuses[-1]) if statuses else {}
        return content


@contextmanager
def process(*arguments: str | Path, until: str = "") -> Iterator[subprocess.Popen[str]]:
    """Run the program in a process of its own, once it has logged some words where these are given, and end it."""
    with subprocess.Popen(command(*arguments), stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as child:
        try:
            assert not until or any(until in line for line in child.stderr), "it ended"
            yield child
        finally:
            if child.poll() is None:
                child.kill()


# A router by itself, of the configuration in its argument.
ROUTER: Final = """
import sys, zenoh
zenoh.init_log_from_env_or("off")
with zenoh.open(zenoh.Config.from_json5(sys.argv[1])):
    print("the router is up", flush=True)
    sys.stdin.read()
"""


@contextmanager
def script(text: str, argument: str) -> Iterator[subprocess.Popen[str]]:
    """Run a script in another process until it is ended, once it has printed its first line."""
    with subprocess.Popen(
        [sys.executable, "-c", text, argument], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as child:
        assert child.stdout.readline()
        try:
            yield child
        finally:
            child.communicate("")


def told_before(words: str, *arguments: str | Path) -> list[str]:
    """Run the program until it prints some words, and end it; return all its lines until then."""
    with process(*arguments) as child:
        lines = [child.stderr.readline()]
        while words not in lines[-1]:
            lines.append(child.stderr.readline())
        child.send_signal(signal.SIGTERM)
        child.communicate(timeout=60)
    return lines


def free_udp() -> UdpAddress:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return UdpAddress("127.0.0.1", probe.getsockname()[1])


@contextmanager
def monitor(
    session: zenoh.Session, run_options: RunOptions, log: Callable[[str], None] = lambda _: None, **others: Any
) -> Iterator[list[str]]:
    """Run the monitor in a thread on an embedded session; yields its log, each line of which goes to `log` as well."""
    stop, log_lines, failed = Event(), [], []

    def target() -> None:
        try:
            run(run_options, stop, session=session, log=lambda line: (log_lines.append(line), log(line)), **others)
        except BaseException as error:  # noqa: BLE001 - reported to the test below
            failed.append(error)

    thread = Thread(target=target)
    thread.start()
    try:
        wait_for(lambda: bool(failed) or any("monitoring" in line for line in log_lines), "the monitor")
        yield log_lines
    finally:
        stop.set()
        thread.join(PATIENCE_S)
        assert not thread.is_alive()
    if failed:
        raise failed[0]
