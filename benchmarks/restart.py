"""Times and memory of restarting a killed monitor of a fleet with full windows: `python -m benchmarks.restart`.

A fleet of wheels fills windows of 80,000 slots as fast as one `rwa-monitor run` takes them, over TCP on loopback. When
they are nearly full the monitor is ended by SIGKILL, and in the next window by SIGTERM; the fleet continues to send,
and a new monitor continues from the recordings. Reported are the time until it monitors, its peak memory, the longest
time without a line of log, and whether all diagnoses equal those of `diagnose` for the same samples.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from threading import Event, Thread
from typing import Final

import numpy as np
import zenoh

from benchmarks.beside import Beside
from benchmarks.machine import describe_machine, peak_memory_bytes
from benchmarks.page import add_output_option, page, put_out, table
from benchmarks.speed.live import free_endpoint
from rwa_monitor.diagnosis.model import built_in_model
from rwa_monitor.messages import Diagnosis, samples_json
from rwa_monitor.monitor.bus import BusOptions, messages_publisher, open_session
from rwa_monitor.monitor.core import diagnose_samples, outputs_of
from rwa_monitor.samples import Samples
from rwa_monitor.simulation.record import simulate
from rwa_monitor.simulation.scenario import Scenario
from rwa_monitor.wheel.wheel import built_in_wheel

BATCH: Final = 256  # samples of a message
SLOTS: Final = 80_000  # of a window
FULL: Final = 0.95  # share of a window filled when the monitor is ended
OUTAGE_MESSAGES: Final = 4  # messages that each wheel sends while no monitor runs: two minutes at 8 Hz
AHEAD: Final = 8  # messages of each wheel that are sent before the monitor has acknowledged them in its status
HISTORY: Final = 64  # messages that each publisher keeps
WINDOWS: Final = 2
SEED: Final = 50_001
PATIENCE_S: Final = 600.0


def telemetry() -> Samples:
    """Return the telemetry that every wheel sends: slightly more than two windows."""
    seconds = (WINDOWS * SLOTS + 4 * BATCH) * 0.125
    return simulate(Scenario(duration_s=seconds), built_in_wheel(), np.random.default_rng(SEED)).samples


def fleet_process(endpoint: str, wheels: int, orders: Connection) -> None:
    """Publish messages [first, stop) of all wheels for each order received; reply when they are published."""
    samples = telemetry()
    with open_session(BusOptions(listen=(endpoint,))) as session:
        publishers = [messages_publisher(session, f"rwa/fleet/wheel_{n}/samples", HISTORY) for n in range(wheels)]
        orders.send(True)
        while (order := orders.recv()) is not None:
            for number in range(*order):
                payload = samples_json(samples[number * BATCH : (number + 1) * BATCH], "publisher", number)
                for publisher in publishers:
                    publisher.put(payload)
            orders.send(True)
        for publisher in publishers:
            publisher.undeclare()


@dataclass
class Received:
    """Output of the monitors: number of samples taken and the diagnoses, of each wheel."""

    taken: dict[str, int] = field(default_factory=dict)
    diagnoses: dict[str, set[bytes]] = field(default_factory=dict)

    def take(self, message: zenoh.Sample) -> None:
        """Store a status or a diagnosis."""
        key, payload = str(message.key_expr), message.payload.to_bytes()
        if key.endswith("/status"):
            status = json.loads(payload)  # net of repeats: after a start publishers resend the messages that they keep
            self.taken[key] = status["samples_received"] - status["samples_duplicate"] - status["samples_queued"]
        else:
            self.diagnoses.setdefault(key, set()).add(payload)


@dataclass
class Start:
    """One start of the monitor."""

    what: str
    monitoring_s: float = 0.0
    caught_up_s: float = 0.0
    silent_s: float = 0.0
    peak_MB: float = 0.0
    peak_later_MB: float = 0.0
    read_MB: float = 0.0
    stopped_s: float = 0.0


class Monitor:
    """A `rwa-monitor run` with its log lines and their times."""

    def __init__(self, endpoint: str, folder: Path, what: str) -> None:
        self.start = Start(what)
        last = max(folder.glob("*.mcap"), default=None)
        self.start.read_MB = last.stat().st_size / 1e6 if last else 0.0
        command = [sys.executable, "-m", "rwa_monitor", "run", "-e", endpoint, "--record", str(folder)]
        self.began_s = self.said_s = time.monotonic()
        self.lines: list[str] = []
        self.process = subprocess.Popen([*command, "--record-limit", "20"], stderr=subprocess.PIPE, text=True)
        self.monitoring = Event()
        Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        assert self.process.stderr is not None
        for line in self.process.stderr:
            now_s = time.monotonic()
            self.lines.append(line.rstrip())
            print(f"  {now_s - self.began_s:6.1f} s  {line.rstrip()}", file=sys.stderr)
            if not self.monitoring.is_set():
                self.start.silent_s = max(self.start.silent_s, now_s - self.said_s)
                self.said_s = now_s
            if ": monitoring " in line:
                self.start.monitoring_s = now_s - self.began_s
                self.start.peak_MB = self.peak_MB()
                self.monitoring.set()

    def peak_MB(self) -> float:
        """Return its peak resident memory."""
        return peak_memory_bytes(self.process.pid) / 1e6

    def wait_until(self, done: Callable[[], bool], what: str) -> float:
        """Wait until a condition holds; return the time since the start [s]."""
        while not done():
            if self.process.poll() is not None:
                raise RuntimeError(f"the monitor ended with {self.process.returncode} before {what}")
            if time.monotonic() - self.began_s > PATIENCE_S:
                raise TimeoutError(what)
            Event().wait(0.05)
        return time.monotonic() - self.began_s

    def end(self, how: signal.Signals) -> None:
        """End the process by a signal."""
        self.start.peak_later_MB = self.peak_MB()
        began_s = time.monotonic()
        self.process.send_signal(how)
        self.process.wait(PATIENCE_S)
        self.start.stopped_s = time.monotonic() - began_s


def expected_windows() -> list[Diagnosis]:
    """Return the diagnoses that `diagnose` prints for the full windows."""
    events = diagnose_samples(telemetry(), built_in_wheel(), built_in_model())
    whole = [event for event in events if not event.diagnosis.partial]
    return [
        Diagnosis.parse(output.payload, output.topic)
        for output in outputs_of(whole, "fleet", "wheel_0")
        if output.schema == Diagnosis.schema_name()
    ]


def measure(wheels: int, folder: Path) -> tuple[list[Start], int, int]:
    """Return the starts, the number of expected windows of all wheels, and the number received exactly as expected."""
    endpoint = free_endpoint()
    context = get_context("spawn")
    orders, fleets_end = context.Pipe()
    fleet = context.Process(target=fleet_process, args=(endpoint, wheels, fleets_end), daemon=True)
    fleet.start()
    orders.recv()
    received, starts, sent = Received(), [], 0

    def send(stop: int, monitor: Monitor | None = None) -> None:
        """Let all wheels send up to message `stop`; with a monitor, no faster than it takes the messages."""
        nonlocal sent
        while sent < stop:
            following = min(sent + AHEAD, stop)
            orders.send((sent, following))
            orders.recv()
            sent = following
            if monitor is not None:
                monitor.wait_until(all_taken, "it had taken all")

    def all_taken() -> bool:
        return len(received.taken) == wheels and min(received.taken.values()) >= sent * BATCH

    with open_session(BusOptions(mode="client", connect=(endpoint,))) as session:
        for kind in ("status", "diagnosis"):
            session.declare_subscriber(f"rwa/fleet/*/{kind}", received.take)
        for number, (what, how) in enumerate(
            (
                ("the first, with nothing recorded", signal.SIGKILL),
                ("after SIGKILL", signal.SIGTERM),
                ("after SIGTERM", signal.SIGTERM),
            )
        ):
            received.taken.clear()
            monitor = Monitor(endpoint, folder, what)
            monitor.monitoring.wait(PATIENCE_S)
            monitor.start.caught_up_s = monitor.wait_until(all_taken if sent else lambda: True, "it had caught up")
            full = min(number + FULL, WINDOWS) * SLOTS / BATCH
            send(round(full) if number < WINDOWS else WINDOWS * SLOTS // BATCH + 4, monitor)
            monitor.end(how)
            starts.append(monitor.start)
            if number < WINDOWS:
                send(sent + OUTAGE_MESSAGES)
    orders.send(None)
    fleet.join(60.0)
    expected = expected_windows()
    right = 0
    for wheel in range(wheels):
        wanted = {_as_of(window, f"wheel_{wheel}") for window in expected}
        right += len(wanted & received.diagnoses.get(f"rwa/fleet/wheel_{wheel}/diagnosis", set()))
    return starts, wheels * len(expected), right


def _as_of(window: Diagnosis, wheel: str) -> bytes:
    """Return a diagnosis as that of another wheel."""
    return window.model_copy(update={"wheel": wheel}).to_json()


def to_markdown(wheels: int, starts: list[Start], expected: int, right: int, beside_cores: float) -> str:
    """Return the page with the measured figures."""
    rows = [
        [
            start.what,
            f"{start.read_MB:,.0f} MB",
            f"{start.monitoring_s:.0f} s",
            f"{start.silent_s:.0f} s",
            f"{start.caught_up_s - start.monitoring_s:.0f} s",
            f"{start.peak_MB:,.0f} MB",
            f"{start.peak_later_MB:,.0f} MB",
            f"{start.stopped_s:.1f} s",
        ]
        for start in starts
    ]
    head = [
        "start",
        "recording it goes on from",
        "until it monitors",
        "longest silence until then",
        "until it has what was sent meanwhile",
        "largest memory until it monitors",
        "and until it was ended",
        "until it had ended",
    ]
    load = ", ".join(f"{value:.1f}" for value in os.getloadavg())
    return page(
        "A restart of a fleet",
        f"""<!-- Written by `make restart`. -->

One `rwa-monitor run` that records {wheels:,} wheels, whose windows of {SLOTS:,} slots are {FULL:.0%} full when it is
ended: by SIGKILL, and in the next window by SIGTERM. Each wheel sends {OUTAGE_MESSAGES} messages of {BATCH} samples
while no monitor is there, {OUTAGE_MESSAGES * BATCH / 8:.0f} s at 8 Hz, and keeps its last {HISTORY}. All wheels send
the same samples (seed {SEED}), as fast as the monitor takes them; so all windows close at once.

**{right:,} of {expected:,} windows are byte for byte what `diagnose` prints for the samples.**

{table(head, rows)}

On: {describe_machine()["processor"]}; load of the machine {load}; other work kept {beside_cores:.1f} processors busy
meanwhile.

A monitor goes on from the checkpoints in its last recording, and takes the inputs after them once more; where it ended
while the wheels were brought over from the recording before, those in that one, too. It reads and releases them one by
one, so that it needs the memory of its open windows (2.7 MB a wheel) and some
200 MB. A recording grows to twice what it begins with, so that the inputs may take longer than the checkpoints. Every
five seconds it logs how far it is, and has systemd wait. The messages that all publishers have kept come again
at each start: they pass through the inbox. What is missing before them is asked for of 32 publishers at a time, and of
no further one while more than 128 MB of answers lie here, so that a fleet's histories do not lie in memory at once.""",
    )


def main() -> None:
    """Measure, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--wheels", type=int, default=400)
    add_output_option(parser)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="rwa-restart-") as folder:
        beside = Beside()
        text = to_markdown(options.wheels, *measure(options.wheels, Path(folder)), beside.cores())
    put_out(text, options.output)


if __name__ == "__main__":
    main()
