"""How many wheels one `rwa-monitor run` serves on one core: `python -m benchmarks.fleet_live --wheels 1000`.

This process simulates the fleet: each wheel sends a message of eight samples once a second, over TCP on loopback. The
monitor is pinned to one core, this process to the others. The lag of a wheel is the age of its oldest message that the
monitor's own `status` does not count yet; 0 where it counts all.

The last fleet continues nearly full windows, from a recording that its monitor finds at the start. That monitor ends a
recording after one minute, so that the next one, with the state of all wheels, begins during the measurement.
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
from dataclasses import dataclass, field, replace
from pathlib import Path
from threading import Event, Thread
from typing import IO

import numpy as np
import psutil
import zenoh
from mcap.writer import MCAP0_MAGIC

from benchmarks.beside import Beside
from benchmarks.machine import describe_machine
from benchmarks.page import add_output_option, page, put_out, table
from benchmarks.speed.live import free_endpoint
from rwa_monitor.diagnosis.model import built_in_model
from rwa_monitor.monitor.bus import BusOptions, SamplesPublisher, open_session
from rwa_monitor.monitor.core import WheelCore
from rwa_monitor.monitor.recording import recordings_of
from rwa_monitor.monitor.service import RunOptions
from rwa_monitor.monitor.setup import Setup
from rwa_monitor.samples import Samples
from rwa_monitor.simulation.record import simulate
from rwa_monitor.simulation.scenario import Scenario
from rwa_monitor.wheel.wheel import built_in_wheel

RATE_HZ = 8
SETTLE_S = 30.0  # for discovery of all publishers, after which lag and processor time count
FULL_SLOTS = 76_000  # of the 80,000 of a window
FILE_AGE_S = 60.0  # largest age of a recording of the fleet with full windows; a day otherwise
# The command `run` with another limit of a recording's age.
RUN = f"""
from rwa_monitor.monitor import recorder
recorder.MAX_FILE_AGE_S = {FILE_AGE_S}
from rwa_monitor.cli.main import main
main()
"""


@dataclass
class Wheel:
    """Messages sent of one wheel, and samples that the monitor reports as received."""

    publisher: SamplesPublisher
    put_s: list[float] = field(default_factory=list)
    received: int = 0


@dataclass(frozen=True)
class Measured:
    """Measured figures."""

    wheels: int
    seconds: float
    lags_s: np.ndarray[tuple[int], np.dtype[np.float64]]
    share_of_core: float
    memory_MB: float
    sent: int
    received: int
    beside_cores: float
    file_MB: float = 0.0
    rotation_s: float = 0.0


class Rotation:
    """Measures how long two recordings are written at the same time, and the size of the new one at the end of it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.took_s = self.file_MB = 0.0
        self._ended = Event()
        self._thread = Thread(target=self._look, daemon=True)
        self._thread.start()

    def _look(self) -> None:
        began_s: float | None = None
        while not self._ended.wait(0.25):
            *before, last = recordings_of(self.folder)
            # The previous recording is not ended: some wheels are still recorded in it.
            if before and not _is_ended(before[-1]):
                began_s = began_s or time.monotonic()
            elif began_s is not None and not self.took_s:
                self.took_s, self.file_MB = time.monotonic() - began_s, last.stat().st_size / 1e6

    def end(self) -> None:
        """Stop measuring."""
        self._ended.set()
        self._thread.join()


def _is_ended(path: Path) -> bool:
    with path.open("rb") as file:
        file.seek(-len(MCAP0_MAGIC), os.SEEK_END)
        return file.read() == MCAP0_MAGIC


def record_full_windows(folder: Path, samples: Samples, wheels: int) -> None:
    """Make a recording as left by a monitor whose windows are nearly full."""
    core = WheelCore(built_in_wheel(), built_in_model())
    for begin in range(0, len(samples), 256):
        core.feed(samples[begin : begin + 256])
    state = core.checkpoint()
    options = RunOptions(setup=Setup(core.wheel, model=core.model))
    folder.mkdir()
    recorder = options.recorder(folder, None, time.time_ns)
    recorder.begin({f"fleet/wheel_{number}": lambda: state for number in range(wheels)}, 0.0)
    recorder.close(0.0)


def measure(wheels: int, seconds: float, filled: int = 0) -> Measured:
    """Measure a monitor for some seconds after settling; each wheel's window already holds `filled` slots."""
    cores = sorted(os.sched_getaffinity(0))
    endpoint = free_endpoint()
    samples = simulate(Scenario(duration_s=11_000.0), built_in_wheel(), np.random.default_rng(1)).samples
    with tempfile.TemporaryDirectory() as name, open_session(BusOptions(listen=(endpoint,))) as session:
        folder = Path(name) / "recordings"
        if filled:
            record_full_windows(folder, samples[:filled], wheels)
        program = ["-c", RUN] if filled else ["-m", "rwa_monitor"]
        command = [
            "taskset",
            "-c",
            str(cores[0]),
            sys.executable,
            *program,
            "run",
            "-e",
            endpoint,
            "--record",
            str(folder),
        ]
        monitor = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
        os.sched_setaffinity(0, cores[1:] or cores)
        assert monitor.stderr is not None
        monitoring = Event()
        Thread(target=_listen, args=(monitor.stderr, monitoring), daemon=True).start()
        try:
            monitoring.wait(300.0)
            rotation = Rotation(folder) if filled else None
            found = _drive(psutil.Process(monitor.pid), session, samples, filled, wheels, seconds)
            if rotation is None:
                return found
            rotation.end()
            return replace(found, rotation_s=rotation.took_s, file_MB=rotation.file_MB)
        finally:
            os.sched_setaffinity(0, cores)
            monitor.send_signal(signal.SIGTERM)
            monitor.wait(60)


def _listen(log: IO[str], monitoring: Event) -> None:
    for line in log:
        if ": monitoring " in line:
            monitoring.set()


def _drive(
    monitor: psutil.Process, session: zenoh.Session, samples: Samples, filled: int, count: int, seconds: float
) -> Measured:
    lags: list[float] = []
    counting = False
    fleet = [Wheel(SamplesPublisher(session, f"rwa/fleet/wheel_{n}/samples")) for n in range(count)]

    def on_status(message: zenoh.Sample) -> None:
        number = int(str(message.key_expr).split("/")[2].removeprefix("wheel_"))
        wheel, now = fleet[number], time.monotonic()
        wheel.received = json.loads(message.payload.to_bytes())["samples_received"] - filled
        done = wheel.received // RATE_HZ
        if counting:
            lags.append(now - wheel.put_s[done] if done < len(wheel.put_s) else 0.0)

    subscriber = session.declare_subscriber("rwa/fleet/*/status", on_status)
    began = time.monotonic()
    cpu_s = 0.0
    beside = Beside()
    second = 0
    while (elapsed := time.monotonic() - began) < SETTLE_S + seconds:
        if not counting and elapsed >= SETTLE_S:
            counting, cpu_s, beside = True, _cpu_s(monitor), Beside()
        part = samples[filled + second * RATE_HZ : filled + (second + 1) * RATE_HZ]
        for number, wheel in enumerate(fleet):
            # Spread over the second, like wheels of many satellites.
            due = began + second + number / count
            time.sleep(max(0.0, due - time.monotonic()))
            wheel.put_s.append(time.monotonic())
            wheel.publisher.put(part)
        second += 1
    used, beside_cores = _cpu_s(monitor) - cpu_s, beside.cores()
    memory = monitor.memory_info().rss / 1e6
    deadline = time.monotonic() + 30.0
    sent = second * RATE_HZ * count
    while sum(wheel.received for wheel in fleet) < sent and time.monotonic() < deadline:
        time.sleep(0.5)
    subscriber.undeclare()  # type: ignore[no-untyped-call]
    received = sum(wheel.received for wheel in fleet)
    return Measured(count, seconds, np.array(lags), used / seconds, memory, sent, received, beside_cores)


def _cpu_s(process: psutil.Process) -> float:
    times = process.cpu_times()
    return float(times.user + times.system)


def to_markdown(found: list[Measured], full: Measured) -> str:
    """Return the page with the measured figures."""
    named = [*((f"{m.wheels:,}", m) for m in found), (f"{full.wheels:,}, full windows, rotation", full)]
    rows = [
        [
            name,
            f"{np.median(m.lags_s):.2f} s",
            f"{np.quantile(m.lags_s, 0.99):.2f} s",
            f"{m.lags_s.max():.2f} s",
            f"{100 * m.share_of_core:.0f} %",
            f"{m.memory_MB:.0f} MB",
            str(m.sent),
            str(m.sent - m.received),
            f"{m.beside_cores:.1f}",
        ]
        for name, m in named
    ]
    late = [
        f"{name} ({m.beside_cores:.1f} processors busy with other work)" for name, m in named if m.lags_s.max() >= 1.0
    ]
    verdict = f"Not met by the largest lag: {'; '.join(late)}." if late else "Met in each row."
    load = ", ".join(f"{value:.1f}" for value in os.getloadavg())
    introduction = (
        "<!-- Written by `make fleet-live`. -->\n\n"
        "One `rwa-monitor run` that records, pinned to one core; the fleet publishes from a process on the others.\n"
        "The lag of a wheel is the age of its oldest message that the monitor's own `status` does not count yet.\n"
        f"Wanted: 1,000 wheels at {RATE_HZ} Hz with a lag under a second.\n{verdict}\n\n"
        f"A message of {RATE_HZ} samples a second from each wheel, over {found[0].seconds:.0f} s after settling.\n"
        f"On: {describe_machine()['processor']}; load of the machine {load}.\n"
        "The last column gives how many processors other work kept busy meanwhile."
    )
    brought = (
        f"was brought over, {full.file_MB:,.0f} MB in {full.rotation_s:.0f} s"
        if full.rotation_s
        else "was being brought over to the end: the machine had no time for it"
    )
    tail = (
        f"In the last row all windows have {FULL_SLOTS:,} of 80,000 slots from the beginning, and the recording ends\n"
        f"after {FILE_AGE_S:.0f} s instead of a day: within the {full.seconds:.0f} s that count, the next one was\n"
        f"begun and the state of one wheel after the other {brought}."
    )
    head = ["wheels", "lag, median", "99 %", "largest", "share of the core", "memory", "samples sent", "lost", "beside"]
    return page("A fleet live", introduction, table(head, rows), tail)


def main() -> None:
    """Measure, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--wheels", type=int, nargs="+", default=[100, 1000])
    parser.add_argument("--full-wheels", type=int, default=1000, help="of the fleet whose windows are nearly full")
    parser.add_argument("--seconds", type=float, default=60.0)
    add_output_option(parser)
    options = parser.parse_args()
    # The other fleets run for 30 s of settling and the given time; this one at least until the rotation has ended.
    full = measure(options.full_wheels, max(options.seconds, 120.0), FULL_SLOTS)
    put_out(to_markdown([measure(wheels, options.seconds) for wheels in options.wheels], full), options.output)


if __name__ == "__main__":
    main()
