"""The dashboard under load: many wheels and clients, and the response times of server and browser.

    python benchmarks/dashboard_load.py [--wheels 1000] [--clients 50] [--seconds 20]

One process serves the dashboard, as `rwa-monitor dashboard` does; another one simulates the monitors over Zenoh on
loopback; a third one keeps the feeds of all clients open and queries the API meanwhile. A real browser shows the fleet:
it is measured by the gaps between its animation frames and by its long tasks. Exit code 1 when a target is missed.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import httpx
import numpy as np
import psutil
import websockets

from benchmarks.speed.live import free_endpoint
from rwa_monitor.messages import Status
from rwa_monitor.monitor.bus import BusOptions, open_session
from tests.history.support import diagnosis

CHROMIUM: Final = "/usr/bin/chromium"
MAX_FRAME_MS: Final = 50.0  # of the browser's main thread
MAX_P99_MS: Final = 50.0  # of an answer of the server
SETTLE_S: Final = 3.0  # until all pages, opened at once, are loaded
UPDATES_PER_S: Final = 10  # frames of the feed a second: its period is 0.1 s
PATHS: Final = ("api/alarms", "api/wheels/sat/wheel_7", "api/wheels/sat/wheel_7/windows?limit=50", "api/recordings")
FRAMES: Final = """() => {
  window.frames_ms = []; window.tasks_ms = []; window.updates = 0;
  let before = performance.now();
  const tick = (now) => { window.frames_ms.push(now - before); before = now; requestAnimationFrame(tick); };
  requestAnimationFrame(tick);
  new PerformanceObserver((list) => { for (const task of list.getEntries()) window.tasks_ms.push(task.duration); })
    .observe({ entryTypes: ["longtask"] });
}"""


@dataclass(frozen=True, slots=True)
class Figures:
    """Measured figures; times in ms."""

    wheels: int
    clients: int
    seconds: float
    statuses_per_s: float
    diagnoses_per_s: float
    browser_frame_p50: float
    browser_frame_p99: float
    browser_frame_max: float
    browser_long_tasks: int
    browser_rows: int
    answers: int
    answer_p50: float
    answer_p99: float
    answer_p99_by_path: dict[str, float]
    feed_frames_per_s: float
    feed_age_p99: float
    feed_megabytes_per_s: float
    server_cpu: float
    server_megabytes: float
    machine_lag_p99: float

    def missed(self) -> list[str]:
        """Return the targets that were missed, in words."""
        found = []
        if self.browser_frame_p99 > MAX_FRAME_MS:
            found.append(f"browser frames p99 {self.browser_frame_p99:.1f} ms > {MAX_FRAME_MS:.0f} ms")
        if self.answer_p99 > MAX_P99_MS:
            found.append(f"server p99 {self.answer_p99:.1f} ms > {MAX_P99_MS:.0f} ms")
        if self.feed_frames_per_s < 0.8 * UPDATES_PER_S:
            found.append(f"{self.feed_frames_per_s:.1f} updates a second < {UPDATES_PER_S}")
        return found


# ---- the monitors ----------------------------------------------------------------------------------------------------


def play_monitors(endpoint: str, wheels: int, rate: float, diagnoses_per_s: float) -> None:
    """Send `rate` statuses per second of each wheel, evenly spread, and some diagnoses, until killed."""
    template = Status(
        spacecraft="sat", wheel="", samples_received=0, samples_used=0, samples_masked=0, samples_late=0,
        samples_duplicate=0, samples_rejected=0, samples_queued=0, slots_missed=0, messages_rejected=0,
        messages_dropped=0, messages_missed=0, queue_depth=0, window_fill=0.0, last_error=None,
        recording="rwa-000001.mcap", software="rwa-monitor", model_sha256="0" * 64, publisher="p", windows=1,
        last_sample_ns=1, diagnosis_s=0.02, now_wall_ns=1,
    )  # fmt: skip
    with open_session(BusOptions(connect=(endpoint,))) as session:
        names = [f"wheel_{n}" for n in range(wheels)]
        for n, name in enumerate(names):
            session.put(
                f"rwa/sat/{name}/diagnosis", diagnosis(0, severity=1.0 if n % 7 == 0 else None, wheel=name).to_json()
            )
        begin, sent, diagnosed = time.monotonic(), 0, 0
        print("playing", flush=True)
        while True:
            due = int((time.monotonic() - begin) * wheels * rate)
            for k in range(sent, due):
                wheel = names[k % wheels]
                now = template.model_copy(
                    update={"wheel": wheel, "window_fill": (k // wheels % 100) / 100, "last_sample_ns": k + 1}
                )
                session.put(f"rwa/sat/{wheel}/status", now.to_json())
            sent = max(sent, due)
            for k in range(diagnosed, int((time.monotonic() - begin) * diagnoses_per_s)):
                wheel = names[k * 31 % wheels]
                bad = 0.5 + (k % 5) if k % 4 == 0 else None
                session.put(
                    f"rwa/sat/{wheel}/diagnosis", diagnosis(1 + k // wheels, severity=bad, wheel=wheel).to_json()
                )
                diagnosed = k + 1
            time.sleep(0.01)


# ---- the clients -----------------------------------------------------------------------------------------------------


async def look(address: str, clients: int, seconds: float) -> dict[str, Any]:
    """Keep feeds open and ask the API once a second for each of them; return what was measured."""
    frames = [0] * clients
    size = 0
    ages: list[float] = []
    answers: list[tuple[int, float]] = []
    lags: list[float] = []
    begin = time.monotonic()
    end = begin + SETTLE_S + seconds

    async def follow(n: int) -> None:
        nonlocal size
        async with websockets.connect(
            address.replace("http", "ws") + "api/feed", max_size=2**26, compression=None
        ) as feed:
            await feed.recv()
            while time.monotonic() < begin + SETTLE_S:
                await feed.recv()
            while time.monotonic() < end:
                text = await feed.recv()
                frames[n] += 1
                size += len(text)
                if n == 0:
                    sent = [one["received_wall_ns"] for one in json.loads(text) if one["received_wall_ns"]]
                    ages.extend((time.time_ns() - one) / 1e6 for one in sent)

    async def ask(n: int, client: httpx.AsyncClient) -> None:
        await asyncio.sleep(SETTLE_S + n / clients)
        k = n
        while time.monotonic() < end:
            asked = time.perf_counter()
            answer = await client.get(address + PATHS[k % len(PATHS)])
            answers.append((k % len(PATHS), (time.perf_counter() - asked) * 1e3))
            answer.raise_for_status()
            k += 1
            await asyncio.sleep(1.0)

    def nap() -> None:
        """Measure by how much an idle thread oversleeps 5 ms: the latency of the machine, not of the dashboard."""
        while time.monotonic() < end:
            asleep = time.perf_counter()
            time.sleep(0.005)
            lags.append((time.perf_counter() - asleep) * 1e3 - 5.0)

    async with httpx.AsyncClient(limits=httpx.Limits(max_connections=clients), timeout=30.0) as client:
        napping = asyncio.to_thread(nap)
        await asyncio.gather(napping, *(follow(n) for n in range(clients)), *(ask(n, client) for n in range(clients)))
    return {
        "answers": len(answers),
        "answer_p50": float(np.percentile([ms for _, ms in answers], 50)),
        "answer_p99": float(np.percentile([ms for _, ms in answers], 99)),
        "answer_p99_by_path": {
            path: float(np.percentile([ms for k, ms in answers if k == n] or [np.nan], 99))
            for n, path in enumerate(PATHS)
        },
        "machine_lag_p99": float(np.percentile(lags, 99)),
        "feed_frames_per_s": min(frames) / seconds,
        "feed_age_p99": float(np.percentile(ages, 99)),
        "feed_megabytes_per_s": size / seconds / 1e6,
    }


def browse(address: str, during: Any) -> tuple[dict[str, Any], Any]:
    """Show the fleet in a browser while `during` runs; return the browser's figures and the result of `during`."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"])
        page = started.new_page(viewport={"width": 1280, "height": 900})
        page.goto(address)
        page.locator(".wheel").first.wait_for()
        page.wait_for_timeout(3_000)
        page.evaluate(FRAMES)
        given = during()
        frames = np.array(page.evaluate("window.frames_ms"))[1:]
        tasks = page.evaluate("window.tasks_ms")
        rows = page.locator(".wheel").count()
        started.close()
    return {
        "browser_frame_p50": float(np.percentile(frames, 50)),
        "browser_frame_p99": float(np.percentile(frames, 99)),
        "browser_frame_max": float(frames.max()),
        "browser_long_tasks": len(tasks),
        "browser_rows": rows,
    }, given


# ---- all together ----------------------------------------------------------------------------------------------------


@contextmanager
def program(*command: str) -> Iterator[subprocess.Popen[str]]:
    """Run a Python program of this tree in parallel, and kill it at the end."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    process = subprocess.Popen(
        [sys.executable, *command], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def measure(wheels: int, clients: int, seconds: float, diagnoses_per_s: float, rate: float = 1.0) -> Figures:
    """Run server, monitors, clients and browser once, and return the figures."""
    endpoint = free_endpoint()
    with (
        TemporaryDirectory() as folder,
        program(
            "-m", "rwa_monitor", "dashboard", "--no-browser", "--port", "0", "--record", folder, "-l", endpoint
        ) as server,
    ):
        assert server.stderr is not None
        line = next(line for line in server.stderr if "the page is at" in line)
        address = line.split("the page is at ")[1].split("#")[0].strip()
        with program(
            __file__,
            "--play",
            endpoint,
            "--wheels",
            str(wheels),
            "--rate",
            str(rate),
            "--diagnoses",
            str(diagnoses_per_s),
        ) as monitors:
            assert monitors.stdout is not None
            assert monitors.stdout.readline()
            process = psutil.Process(server.pid)

            def during() -> tuple[dict[str, Any], float]:
                before = process.cpu_times()
                with program(
                    __file__, "--look", address, "--clients", str(clients), "--seconds", str(seconds)
                ) as looking:
                    found = looking.communicate()[0]
                after = process.cpu_times()
                used = (after.user + after.system - before.user - before.system) / (SETTLE_S + seconds)
                return json.loads(found), used

            browser, (clients_found, used) = browse(address, during)
            memory = process.memory_info().rss / 1e6
    return Figures(
        wheels=wheels, clients=clients, seconds=seconds, statuses_per_s=wheels * rate, diagnoses_per_s=diagnoses_per_s,
        server_cpu=used, server_megabytes=memory, **browser, **clients_found,
    )  # fmt: skip


def main() -> int:
    """Measure, or run one of the parts as a separate process; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--wheels", type=int, default=1_000)
    parser.add_argument("--clients", type=int, default=50)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--rate", type=float, default=1.0, help="statuses of each wheel a second; a monitor sends one")
    parser.add_argument("--diagnoses", type=float, default=20.0, help="a second, of all wheels together")
    parser.add_argument("--json", type=Path, help="file for the figures")
    parser.add_argument("--play", help=argparse.SUPPRESS)
    parser.add_argument("--look", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.play:
        play_monitors(options.play, options.wheels, options.rate, options.diagnoses)
    elif options.look:
        print(json.dumps(asyncio.run(look(options.look, options.clients, options.seconds))))
    else:
        figures = measure(options.wheels, options.clients, options.seconds, options.diagnoses, options.rate)
        print(json.dumps(asdict(figures), indent=2))
        if options.json:
            options.json.write_text(json.dumps(asdict(figures), indent=2) + "\n")
        for missed in figures.missed():
            print(f"missed: {missed}")
        return 1 if figures.missed() else 0
    return 0


if __name__ == "__main__":
    sys.exit(main())
