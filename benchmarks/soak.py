"""Ten minutes at 100,000 samples a second into one `rwa-monitor run`, over TCP: `make soak`; writes docs/soak.md.

Publishers in a process of their own send as fast as is asked, reliably: one that cannot keep up is slowed down, and
that is told. Memory, lag and losses are those that the monitor's own `status` and the system say.
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
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from threading import Event
from typing import Any

import numpy as np

from rwa_monitor.live.bus import BusOptions, open_session
from rwa_monitor.live.publisher import SamplesPublisher
from rwa_monitor.physics.scenario import Scenario
from rwa_monitor.physics.telemetry import simulate
from rwa_monitor.physics.wheel import built_in_wheel
from rwa_monitor.samples import Samples

BATCH = 256  # samples of a message
PERIOD_NS = 125_000_000
SLOTS = 80_000  # of a window; each wheel repeats one window over and over
READING_S = 5.0
GIVE_UP_S = 60.0


@dataclass
class Reading:
    """One look at the monitor."""

    at_s: float
    resident_MB: float
    sent: int
    received: int
    dropped: int
    missed: int
    waiting: int
    recorded_MB: float
    cpu_s: float


def publisher_process(endpoint: str, wheels: int, rate: float, duration_s: float, sent: Any, done: Any) -> None:
    """Publish samples of all wheels in turn at a rate; `sent` counts them, and `done` ends it."""
    samples = simulate(
        Scenario.from_toml(f"[scenario]\nduration_s = {SLOTS * 0.125}\n", "soak"),
        built_in_wheel(),
        np.random.default_rng(1),
    ).samples
    parts = [samples[start : start + BATCH] for start in range(0, SLOTS, BATCH)]
    with open_session(BusOptions(mode="client", connect=(endpoint,))) as session:
        publishers = [SamplesPublisher(session, f"rwa/soak/wheel_{n}/samples") for n in range(wheels)]
        begin_s = time.monotonic()
        number = 0
        while (now_s := time.monotonic() - begin_s) < duration_s:
            ahead_s = sent.value / rate - now_s
            if ahead_s > 0:
                Event().wait(ahead_s)
            for wheel, publisher in enumerate(publishers):
                # Each wheel is at another place of the record, so that neighbours in a recording differ.
                turn, place = divmod(number + 13 * wheel, len(parts))
                part = parts[place]
                shift_ns = turn * SLOTS * PERIOD_NS
                publisher.put(Samples(part.time_ns + shift_ns, part.speed_rad_s, part.friction_torque_Nm))
                sent.value += len(part)
            number += 1
        done.wait()  # until all of it has arrived, or nothing comes any more
        for publisher in publishers:
            publisher.close()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--rate", type=float, default=100_000.0, help="samples per second, all wheels together")
    parser.add_argument("--wheels", type=int, default=50)
    parser.add_argument("--beside", default="nothing else", help="what else ran on the machine, for the report")
    parser.add_argument("-o", "--output", type=Path)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="rwa-soak-") as folder:
        readings, status = _soak(arguments, Path(folder))
    text = _report(arguments, readings, status)
    print(text)
    if arguments.output:
        arguments.output.write_text(text)
    return 0


def _soak(arguments: argparse.Namespace, folder: Path) -> tuple[list[Reading], int]:
    endpoint = f"tcp/127.0.0.1:{_free_port()}"
    command = [sys.executable, "-m", "rwa_monitor", "run", "-l", endpoint, "--record", str(folder / "recordings")]
    command += ["--record-limit", "1"]
    status: dict[str, dict[str, Any]] = {}
    with (folder / "talk.log").open("w") as log, subprocess.Popen(command, stderr=log) as monitor:
        try:
            while "monitoring" not in (folder / "talk.log").read_text():
                assert monitor.poll() is None, (folder / "talk.log").read_text()
                Event().wait(0.1)
            context = get_context("spawn")
            sent = context.Value("q", 0, lock=False)
            done = context.Event()
            parameters = (endpoint, arguments.wheels, arguments.rate, arguments.seconds, sent, done)
            publisher = context.Process(target=publisher_process, args=parameters)
            with open_session(BusOptions(mode="client", connect=(endpoint,))) as session:
                session.declare_subscriber(
                    "rwa/soak/*/status",
                    lambda sample: status.update({str(sample.key_expr): json.loads(sample.payload.to_bytes())}),
                )
                publisher.start()
                readings = []
                begin_s = time.monotonic()
                while publisher.is_alive():
                    publisher.join(READING_S)
                    readings.append(_reading(monitor.pid, sent.value, status, folder, begin_s))
                    if readings[-1].at_s > arguments.seconds and _at_rest(readings):
                        done.set()
            monitor.send_signal(signal.SIGTERM)
            return readings, monitor.wait(60.0)
        finally:
            if monitor.poll() is None:
                monitor.kill()


def _at_rest(readings: list[Reading]) -> bool:
    """Tell whether all has arrived, or nothing has for a minute."""
    last = readings[-1]
    before = [reading for reading in readings if reading.at_s < last.at_s - GIVE_UP_S]
    return last.received == last.sent or bool(before and before[-1].received == last.received)


def _reading(pid: int, sent: int, status: dict[str, dict[str, Any]], folder: Path, begin_s: float) -> Reading:
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    latest = list(status.values())
    return Reading(
        at_s=time.monotonic() - begin_s,
        resident_MB=int(fields[21]) * os.sysconf("SC_PAGE_SIZE") / 1e6,
        sent=sent,
        received=sum(s["samples_received"] for s in latest),
        dropped=max((s["messages_dropped"] for s in latest), default=0),
        missed=sum(s["messages_missed"] for s in latest),
        waiting=max((s["queue_depth"] for s in latest), default=0),
        recorded_MB=sum(path.stat().st_size for path in (folder / "recordings").glob("*.mcap")) / 1e6,
        cpu_s=(int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK"),
    )


def _report(arguments: argparse.Namespace, readings: list[Reading], status: int) -> str:
    flowing = [reading for reading in readings if 0.0 < reading.at_s < arguments.seconds]
    settled = flowing[len(flowing) // 4 :]
    last = readings[-1]
    slope = np.polyfit([r.at_s for r in settled], [r.resident_MB for r in settled], 1)[0] * 60.0
    rate = (settled[-1].received - settled[0].received) / (settled[-1].at_s - settled[0].at_s)
    cpu = (settled[-1].cpu_s - settled[0].cpu_s) / (settled[-1].at_s - settled[0].at_s)
    lag_s = [(r.sent - r.received) / arguments.rate for r in settled]
    rows = [
        ("samples sent", f"{last.sent:,}"),
        ("samples received", f"{last.received:,}"),
        ("samples lost", f"{last.sent - last.received:,}"),
        ("seconds until the last had arrived, after the last was sent", f"{last.at_s - flowing[-1].at_s:.0f}"),
        ("messages that the inbox had no room for and that were asked for again", f"{last.dropped}"),
        ("messages missed", f"{last.missed}"),
        ("rate that the monitor kept up [samples/s]", f"{rate:,.0f} of {arguments.rate:,.0f}"),
        ("processors that it used", f"{cpu:.2f}"),
        ("lag behind the publishers, median and largest [s]", f"{np.median(lag_s):.2f}, {max(lag_s):.2f}"),
        ("messages waiting in the inbox, largest", f"{max(r.waiting for r in settled)}"),
        (
            "memory after a quarter of the time, and at the end [MB]",
            f"{settled[0].resident_MB:.0f}, {settled[-1].resident_MB:.0f}",
        ),
        ("slope of memory over the last three quarters [MB/min]", f"{slope:+.2f}"),
        (
            "recordings on the disk, largest and at the end [MB]",
            f"{max(r.recorded_MB for r in readings):.0f}, {last.recorded_MB:.0f}",
        ),
        ("exit code after SIGTERM", f"{status}"),
    ]
    table = "\n".join(f"| {name} | {value} |" for name, value in rows)
    return f"""# Soak: {arguments.seconds / 60.0:.0f} minutes at {arguments.rate:,.0f} samples a second

`make soak` ({arguments.wheels} wheels in one monitor process, windows of 80,000 slots, messages of {BATCH} samples over
TCP on loopback, recording with `--record-limit 1`). The lag counts samples that were sent and not yet in a `status`,
which comes once a second: up to a second of it is the age of the status. On {os.cpu_count()} processors, beside it ran
{arguments.beside}.

| | |
|---|---|
{table}
"""


def _free_port() -> int:
    import socket

    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


if __name__ == "__main__":
    sys.exit(main())
