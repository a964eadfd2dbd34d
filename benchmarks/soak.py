"""Ten minutes at 100,000 samples a second into one `rwa-monitor run`, over TCP: `make soak`; writes docs/soak.md.

Publishers in a separate process send reliably at the given rate: if the monitor cannot keep up, they are slowed down,
which is reported. Memory, lag and losses are those of the monitor's own `status` and of the system.

The monitor's buffer for late subscribers fills with closed windows, of which these minutes have few. So a second
monitor gets short windows: its buffer is full after half of its time, and from then on its memory must stay constant.
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
from collections import defaultdict, deque
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path
from threading import Event
from typing import Any

import numpy as np

from benchmarks.beside import Beside
from benchmarks.page import add_output_option, page, put_out, table
from benchmarks.speed.live import free_endpoint
from rwa_monitor.monitor.backfill import INBOX_BYTES
from rwa_monitor.monitor.bus import OUTPUT_HISTORY, BusOptions, SamplesPublisher, open_session
from rwa_monitor.samples import Samples
from rwa_monitor.simulation.record import simulate
from rwa_monitor.simulation.scenario import Scenario
from rwa_monitor.wheel.wheel import Wheel, built_in_wheel

BATCH = 256  # samples of a message
PERIOD_NS = 125_000_000
SLOTS = 80_000  # of the record that each wheel repeats, and of a window unless stated otherwise
SHORT_SLOTS = 2_000  # of a window of the second monitor
SHORT_WHEELS = 20
SHORT_SHARE = 0.3  # of the rate: about as many diagnoses as one core can do
SHORT_TIME = 0.4  # of the time
READING_S = 5.0
LEAST_S = 60.0  # then the shorter run has four readings: two to settle, and two for a slope
GIVE_UP_S = 60.0


@dataclass(frozen=True)
class Case:
    """Load of one monitor: wheels, samples per second of all wheels together, duration [s], slots of a window."""

    wheels: int
    rate: float
    seconds: float
    window: int

    @property
    def wheel(self) -> Wheel:
        """The built-in wheel with windows of this length."""
        built_in = built_in_wheel()
        window = built_in.window.model_copy(update={"samples": self.window, "hop": self.window})
        return built_in.model_copy(update={"window": window})


@dataclass
class Received:
    """Output of the monitor: the last status of each wheel, and sizes of messages kept for late subscribers."""

    status: dict[str, dict[str, Any]] = field(default_factory=dict)
    kept: dict[str, deque[int]] = field(default_factory=lambda: defaultdict(lambda: deque(maxlen=OUTPUT_HISTORY)))

    def take(self, key: str, payload: bytes) -> None:
        """Store a message of the monitor."""
        kind = key.rsplit("/", 1)[1]
        if kind == "status":
            self.status[key] = json.loads(payload)
        elif kind != "samples":
            self.kept[key].append(len(payload))

    def kept_MB(self) -> tuple[float, float]:
        """Return the size of the messages that the monitor keeps, and the expected size once its buffers are full."""
        sizes = [list(of_key) for of_key in list(self.kept.values())]
        full = sum(OUTPUT_HISTORY * float(np.mean(of_key)) for of_key in sizes)
        return sum(map(sum, sizes)) / 1e6, full / 1e6


@dataclass
class Reading:
    """One reading of the monitor's state."""

    at_s: float
    resident_MB: float
    kept_MB: tuple[float, float]
    windows: int
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
                # Each wheel is at a different place of the record, so that adjacent messages in a recording differ.
                turn, place = divmod(number + 13 * wheel, len(parts))
                part = parts[place]
                shift_ns = turn * SLOTS * PERIOD_NS
                publisher.put(Samples(part.time_ns + shift_ns, part.speed_rad_s, part.friction_torque_Nm))
                sent.value += len(part)
            number += 1
        done.wait()  # until everything has arrived, or nothing more arrives
        for publisher in publishers:
            publisher.close()


def main() -> int:
    """Soak both monitors, write the page, return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--rate", type=float, default=100_000.0, help="samples per second, all wheels together")
    parser.add_argument("--wheels", type=int, default=50)
    parser.add_argument("--beside", help="what else ran on the machine, for the report; default: how busy it was")
    add_output_option(parser)
    arguments = parser.parse_args()
    if arguments.seconds < LEAST_S:
        parser.error(f"--seconds {arguments.seconds:g}: the slope of memory needs {LEAST_S:.0f} seconds at least")
    cases = [
        Case(arguments.wheels, arguments.rate, arguments.seconds, SLOTS),
        Case(SHORT_WHEELS, SHORT_SHARE * arguments.rate, SHORT_TIME * arguments.seconds, SHORT_SLOTS),
    ]
    columns, others = [], Beside()
    for case in cases:
        with tempfile.TemporaryDirectory(prefix="rwa-soak-") as folder:
            columns.append(_figures(case, *_soak(case, Path(folder))))
    beside = arguments.beside or f"other work that kept {others.cores():.1f} of them busy"
    put_out(to_markdown(cases[0], columns, beside), arguments.output)
    return 0


def _soak(case: Case, folder: Path) -> tuple[list[Reading], int]:
    """Run a monitor under load until it has taken all samples; return the readings and its exit code."""
    endpoint = free_endpoint()
    (folder / "wheel.toml").write_text(case.wheel.to_toml())
    command = [sys.executable, "-m", "rwa_monitor", "run", "-l", endpoint, "--record", str(folder / "recordings")]
    command += ["--record-limit", "1", "--wheel", str(folder / "wheel.toml")]
    received = Received()
    with (folder / "monitor.log").open("w") as log, subprocess.Popen(command, stderr=log) as monitor:
        try:
            while "monitoring" not in (folder / "monitor.log").read_text():
                assert monitor.poll() is None, (folder / "monitor.log").read_text()
                Event().wait(0.1)
            context = get_context("spawn")
            sent = context.Value("q", 0, lock=False)
            done = context.Event()
            parameters = (endpoint, case.wheels, case.rate, case.seconds, sent, done)
            publisher = context.Process(target=publisher_process, args=parameters)
            with open_session(BusOptions(mode="client", connect=(endpoint,))) as session:
                for kind in ("status", "diagnosis", "changepoints", "discrepancy"):
                    session.declare_subscriber(
                        f"rwa/soak/*/{kind}",
                        lambda sample: received.take(str(sample.key_expr), sample.payload.to_bytes()),
                    )
                publisher.start()
                readings = []
                begin_s = time.monotonic()
                while publisher.is_alive():
                    publisher.join(READING_S)
                    readings.append(_reading(monitor.pid, sent.value, received, folder, begin_s))
                    if readings[-1].at_s > case.seconds and _at_rest(readings):
                        done.set()
            monitor.send_signal(signal.SIGTERM)
            return readings, monitor.wait(60.0)
        finally:
            if monitor.poll() is None:
                monitor.kill()


def _at_rest(readings: list[Reading]) -> bool:
    """Return whether everything has arrived, or nothing for a minute."""
    last = readings[-1]
    before = [reading for reading in readings if reading.at_s < last.at_s - GIVE_UP_S]
    # Publishers start later than this clock: they have finished when nothing was sent since the previous reading.
    return last.received == last.sent == readings[-2].sent or bool(before and before[-1].received == last.received)


def _reading(pid: int, sent: int, received: Received, folder: Path, begin_s: float) -> Reading:
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    latest = list(received.status.values())
    return Reading(
        at_s=time.monotonic() - begin_s,
        resident_MB=int(fields[21]) * os.sysconf("SC_PAGE_SIZE") / 1e6,
        kept_MB=received.kept_MB(),
        windows=sum(s["windows"] for s in latest),
        sent=sent,
        received=sum(s["samples_received"] for s in latest),
        dropped=max((s["messages_dropped"] for s in latest), default=0),
        missed=sum(s["messages_missed"] for s in latest),
        waiting=max((s["queue_depth"] for s in latest), default=0),
        recorded_MB=sum(path.stat().st_size for path in (folder / "recordings").glob("*.mcap")) / 1e6,
        cpu_s=(int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK"),
    )


def _slope(readings: list[Reading]) -> float:
    """Return the growth rate of resident memory, by least squares [MB/min]."""
    return float(np.polyfit([r.at_s for r in readings], [r.resident_MB for r in readings], 1)[0]) * 60.0


def _figures(case: Case, readings: list[Reading], status: int) -> dict[str, str]:
    """Return the figures of one monitor, by name."""
    flowing = [reading for reading in readings if 0.0 < reading.at_s < case.seconds]
    quarter = max(2, len(flowing) // 4)
    settled, latest = flowing[quarter:], flowing[-quarter:]
    first, last = settled[0], readings[-1]
    rate = (settled[-1].received - first.received) / (settled[-1].at_s - first.at_s)
    cpu = (settled[-1].cpu_s - first.cpu_s) / (settled[-1].at_s - first.at_s)
    lag_s = [(r.sent - r.received) / case.rate for r in settled]
    return {
        "wheels; samples of a window": f"{case.wheels}; {case.window:,}",
        "minutes": f"{case.seconds / 60.0:.0f}",
        "samples sent": f"{last.sent:,}",
        "samples received": f"{last.received:,}",
        "samples lost": f"{last.sent - last.received:,}",
        "seconds until the last had arrived, after the last was sent": f"{last.at_s - flowing[-1].at_s:.0f}",
        "messages that the inbox had no room for and that were asked for again": f"{last.dropped}",
        "messages missed": f"{last.missed}",
        "rate that the monitor kept up [samples/s]": f"{rate:,.0f} of {case.rate:,.0f}",
        "processors that it used": f"{cpu:.2f}",
        "lag behind the publishers, median and largest [s]": f"{np.median(lag_s):.2f}, {max(lag_s):.2f}",
        "messages waiting, largest": f"{max(r.waiting for r in settled)}",
        "windows diagnosed of each wheel": f"{last.windows / case.wheels:.0f}",
        "memory after a quarter of the time, three quarters, and at the end [MB]": (
            f"{first.resident_MB:.0f}, {latest[0].resident_MB:.0f}, {latest[-1].resident_MB:.0f}"
        ),
        "largest [MB]": f"{max(r.resident_MB for r in flowing):.0f}",
        "slope of memory over the last three quarters [MB/min]": f"{_slope(settled):+.2f}",
        "slope over the last quarter [MB/min]": f"{_slope(latest):+.2f}",
        "kept for late subscribers, after a quarter and at the end; when full of the like [MB]": (
            f"{first.kept_MB[0]:.1f}, {last.kept_MB[0]:.1f}; {last.kept_MB[1]:.1f}"
        ),
        "recordings on the disk, largest and at the end [MB]": (
            f"{max(r.recorded_MB for r in readings):.0f}, {last.recorded_MB:.0f}"
        ),
        "exit code after SIGTERM": f"{status}",
    }


def to_markdown(case: Case, columns: list[dict[str, str]], beside: str) -> str:
    """Return docs/soak.md."""
    rows = [[name, *(column[name] for column in columns)] for name in columns[0]]
    return page(
        f"Soak: {case.seconds / 60.0:.0f} minutes at {case.rate:,.0f} samples a second",
        f"""`make soak`: one monitor process for all wheels, messages of {BATCH} samples over TCP on loopback, recording
with `--record-limit 1`. The lag counts samples that were sent and not yet in a `status`, which comes once a second: up
to a second of it is the age of the status. On {os.cpu_count()} processors, beside it ran {beside}.

{table(["", "as in flight, hurried", "short windows"], rows)}

## What the memory holds, and its bounds

- **Open windows**: some 2.4 MB a wheel once a window of {SLOTS:,} samples has been full ([speed.md](speed.md)).
- **Messages kept for late subscribers**: the last {OUTPUT_HISTORY} diagnoses, provisional changepoints and discrepancy
  reports of each wheel, and 0.3 kB of Zenoh's with each: 0.7 MB a wheel. Diagnoses fill their place with the windows
  that are closed: {OUTPUT_HISTORY} of them take eleven days at 8 Hz, and more than these minutes here. This is what
  grows in the first column. In the second, diagnoses are full after half of the time; changepoints, which are rarer,
  go on for some minutes.
- **Messages that wait** while the monitor has no time: at most {INBOX_BYTES / 1e6:.0f} MB in the inbox, and as many
  behind a gap that is asked for. Then publishers are slowed down.
- **A new recording** begins with a checkpoint of each wheel, of 1.7 MB where its window is nearly full. They are made
  and written one by one, while messages go on. When all were made first, that was 140 MB, and took up to ten seconds in
  which 40 MB of messages waited: from one highest peak to the next, memory rose by 8.6 MB a minute.
- **The index of the recording** that is being written, until the next file: MCAP's summary lists every message, at
  0.6 kB a second of one wheel at 8 Hz (30 MB in a file of half a day) and 71 kB a second of a thousand wheels (335 MB).
  Smaller files (`--record-limit`) bound it; without it readers could not find a message without reading all.
- **Messages of wheels whose model does not fit**, for a search: at most 64 MB.

`tests/monitor/test_memory.py` counts what Python allocates: nothing is kept of windows that were closed and of files
that were ended, and a new file takes the memory of one checkpoint however many wheels there are.""",
    )


if __name__ == "__main__":
    sys.exit(main())
