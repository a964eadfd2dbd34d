"""How many wheels one `rwa-monitor run` serves on one core: `python -m benchmarks.fleet_live --wheels 1000`.

This process stands for the fleet: each wheel sends a message of eight samples once a second, over TCP on loopback. The
monitor is pinned to one core, this process to the others. The lag of a wheel is the age of its oldest message that the
monitor's own `status` does not count yet; 0 where it counts all.
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
from dataclasses import dataclass, field

import numpy as np
import psutil
import zenoh

from benchmarks.output import add_output_option, put_out
from rwa_monitor.evaluation.speed.live import free_endpoint
from rwa_monitor.live.bus import BusOptions, open_session
from rwa_monitor.live.publisher import SamplesPublisher
from rwa_monitor.physics.scenario import Scenario
from rwa_monitor.physics.telemetry import simulate
from rwa_monitor.physics.wheel import built_in_wheel

RATE_HZ = 8
SETTLE_S = 30.0  # for discovery of all publishers, after which lag and processor time count


@dataclass
class Wheel:
    """What was sent of one wheel, and what the monitor says it got."""

    publisher: SamplesPublisher
    put_s: list[float] = field(default_factory=list)
    received: int = 0


@dataclass(frozen=True)
class Measured:
    """What came out."""

    wheels: int
    seconds: float
    lags_s: np.ndarray[tuple[int], np.dtype[np.float64]]
    share_of_core: float
    memory_MB: float
    sent: int
    received: int


def measure(wheels: int, seconds: float) -> Measured:
    """Serve wheels for some seconds after settling."""
    cores = sorted(os.sched_getaffinity(0))
    endpoint = free_endpoint()
    with tempfile.TemporaryDirectory() as folder, open_session(BusOptions(listen=(endpoint,))) as session:
        command = [sys.executable, "-m", "rwa_monitor", "run", "-e", endpoint, "--record", f"{folder}/recordings"]
        monitor = subprocess.Popen(["taskset", "-c", str(cores[0]), *command], stderr=subprocess.DEVNULL)
        os.sched_setaffinity(0, cores[1:] or cores)
        try:
            return _drive(psutil.Process(monitor.pid), session, wheels, seconds)
        finally:
            os.sched_setaffinity(0, cores)
            monitor.send_signal(signal.SIGTERM)
            monitor.wait(60)


def _drive(monitor: psutil.Process, session: zenoh.Session, count: int, seconds: float) -> Measured:
    samples = simulate(Scenario(), built_in_wheel(), np.random.default_rng(1)).samples
    lags: list[float] = []
    counting = False
    fleet = [Wheel(SamplesPublisher(session, f"rwa/fleet/wheel_{n}/samples")) for n in range(count)]

    def on_status(message: zenoh.Sample) -> None:
        number = int(str(message.key_expr).split("/")[2].removeprefix("wheel_"))
        wheel, now = fleet[number], time.monotonic()
        wheel.received = json.loads(message.payload.to_bytes())["samples_received"]
        done = wheel.received // RATE_HZ
        if counting:
            lags.append(now - wheel.put_s[done] if done < len(wheel.put_s) else 0.0)

    subscriber = session.declare_subscriber("rwa/fleet/*/status", on_status)
    began = time.monotonic()
    cpu_s = 0.0
    second = 0
    while (elapsed := time.monotonic() - began) < SETTLE_S + seconds:
        if not counting and elapsed >= SETTLE_S:
            counting, cpu_s = True, _cpu_s(monitor)
        part = samples[second * RATE_HZ : (second + 1) * RATE_HZ]
        for number, wheel in enumerate(fleet):
            # Spread over the second, as wheels of many satellites are.
            due = began + second + number / count
            time.sleep(max(0.0, due - time.monotonic()))
            wheel.put_s.append(time.monotonic())
            wheel.publisher.put(part)
        second += 1
    used = _cpu_s(monitor) - cpu_s
    memory = monitor.memory_info().rss / 1e6
    deadline = time.monotonic() + 30.0
    sent = second * RATE_HZ * count
    while sum(wheel.received for wheel in fleet) < sent and time.monotonic() < deadline:
        time.sleep(0.5)
    subscriber.undeclare()
    received = sum(wheel.received for wheel in fleet)
    return Measured(count, seconds, np.array(lags), used / seconds, memory, sent, received)


def _cpu_s(process: psutil.Process) -> float:
    times = process.cpu_times()
    return float(times.user + times.system)


def page(found: list[Measured]) -> str:
    """Return what was measured as a table."""
    rows = [
        f"| {m.wheels} | {np.median(m.lags_s):.2f} s | {np.quantile(m.lags_s, 0.99):.2f} s | {m.lags_s.max():.2f} s | "
        f"{100 * m.share_of_core:.0f} % | {m.memory_MB:.0f} MB | {m.sent} | {m.sent - m.received} |"
        for m in found
    ]
    load = ", ".join(f"{value:.1f}" for value in os.getloadavg())
    head = (
        "# A fleet live\n\n<!-- Written by `make fleet-live`. -->\n\n"
        "One `rwa-monitor run` that records, pinned to one core; the fleet publishes from a process on the others.\n"
        "The lag of a wheel is the age of its oldest message that the monitor's own `status` does not count yet.\n"
        f"Wanted: 1,000 wheels at {RATE_HZ} Hz with a lag under a second.\n\n"
        f"A message of {RATE_HZ} samples a second from each wheel, over {found[0].seconds:.0f} s after settling."
    )
    columns = "| wheels | lag, median | 99 % | largest | share of the core | memory | samples sent | lost |"
    return "\n".join([f"{head} Load of the machine: {load}.", "", columns, "|---" * 8 + "|", *rows, ""])


def main() -> None:
    """Measure, and put out the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--wheels", type=int, nargs="+", default=[100, 1000])
    parser.add_argument("--seconds", type=float, default=60.0)
    add_output_option(parser)
    options = parser.parse_args()
    put_out(page([measure(wheels, options.seconds) for wheels in options.wheels]), options.output)


if __name__ == "__main__":
    main()
