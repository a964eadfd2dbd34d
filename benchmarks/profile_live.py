"""Time spent in each stage of the live path, from a message's bytes to the recording: `make profile`, docs/profile.md.

Messages of 256 samples go through the monitor as in `rwa-monitor run`, in one thread, without a bus. Stages are timed
around their functions, with little overhead; the list of functions is cProfile's, which overestimates the cost of
Python calls.
"""

from __future__ import annotations

import argparse
import cProfile
import pstats
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any
from unittest.mock import patch

from benchmarks.machine import machine_in_words
from benchmarks.page import add_output_option, page, put_out, table
from benchmarks.references import SilentBus
from benchmarks.speed.live import BATCH, samples_of
from benchmarks.window import Window, window_of
from rwa_monitor.changepoints.evidence import WindowAccumulator
from rwa_monitor.diagnosis.model import built_in_model
from rwa_monitor.messages import SamplesMessage, samples_json
from rwa_monitor.monitor import core
from rwa_monitor.monitor.backfill import Arrival
from rwa_monitor.monitor.core import WheelCore
from rwa_monitor.monitor.ingest import Sequencer, SlotAssignment
from rwa_monitor.monitor.recorder import Recorder
from rwa_monitor.monitor.service import Clock, Monitor, RunOptions
from rwa_monitor.monitor.setup import Setup
from rwa_monitor.simulation.datasets import generate
from rwa_monitor.telemetry.slots import FrictionSource, RingBuffer, SensorValidation
from rwa_monitor.wheel.wheel import built_in_wheel

KEY = "rwa/profile/wheel_1/samples"
# Nesting follows from the stack of running stages: each is charged only its own time.
STAGES: dict[str, tuple[Any, str]] = {
    "read the message: JSON, pydantic": (SamplesMessage, "parse"),
    "lists to arrays": (SamplesMessage, "samples"),
    "sequencer": (Sequencer, "put"),
    "slot assignment": (SlotAssignment, "_go_on"),
    "ring buffer": (RingBuffer, "extend"),
    "sensor validation": (SensorValidation, "run"),
    "friction": (FrictionSource, "friction"),
    "detection: stage 1": (WindowAccumulator, "append"),
    "close: stage 1's end": (WindowAccumulator, "close"),
    "diagnosis: stages 2 to 4": (core, "diagnose_window"),
    "record messages and outputs: MCAP, zstd": (Recorder, "write"),
    "bring to the disk": (Recorder, "sync"),
    "flush, rotate, status by the clock": (Monitor, "tick"),
    "the core around them": (WheelCore, "feed"),
    "the monitor around it": (Monitor, "receive"),
}


class Stopwatch:
    """Own time of each stage: that of its function, less that of nested stages."""

    def __init__(self) -> None:
        self.seconds = dict.fromkeys(STAGES, 0.0)
        self._inside = [0.0]

    def around(self, stage: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return the function, timed."""

        def timed(*arguments: Any, **words: Any) -> Any:
            self._inside.append(0.0)
            begin = time.thread_time()
            try:
                return function(*arguments, **words)
            finally:
                spent = time.thread_time() - begin
                self.seconds[stage] += spent - self._inside.pop()
                self._inside[-1] += spent

        return timed


def monitor_in(folder: Path) -> Monitor:
    """Return a monitor that records in a folder."""
    options = RunOptions(setup=Setup(model=built_in_model()))
    recorder = options.recorder(folder, None, time.time_ns)
    recorder.begin({}, time.monotonic())
    return Monitor(options, SilentBus(), recorder, lambda _: None, Clock())


def run(messages: list[bytes]) -> None:
    """Pass all messages through a monitor."""
    with tempfile.TemporaryDirectory() as folder:
        monitor = monitor_in(Path(folder))
        for payload in messages:
            monitor.receive(Arrival(KEY, payload))
            monitor.tick()
        monitor.close()


def stages(messages: list[bytes]) -> dict[str, float]:
    """Return the own time of each stage [s]."""
    watch = Stopwatch()
    with ExitStack() as stack:
        for stage, (owner, name) in STAGES.items():
            if stage == "read the message: JSON, pydantic":
                timed = watch.around(stage, SamplesMessage.parse)
                stack.enter_context(patch.object(owner, name, staticmethod(timed)))
            else:
                stack.enter_context(patch.object(owner, name, watch.around(stage, getattr(owner, name))))
        run(messages)
    return watch.seconds


def functions(messages: list[bytes], count: int) -> list[list[str]]:
    """Return the functions with the most own time: name, calls, share."""
    profile = cProfile.Profile(time.thread_time)  # by wall-clock time, waiting for the disk would come first
    profile.runcall(run, messages)
    found = pstats.Stats(profile)
    total = found.total_tt  # type: ignore[attr-defined]
    rows = sorted(found.stats.items(), key=lambda item: -item[1][2])[:count]  # type: ignore[attr-defined]
    return [
        [f"`{Path(file).name.removesuffix('.py')}.{name}`" if line else f"`{name}`", f"{calls}", f"{own / total:.1%}"]
        for (file, line, name), (_, calls, own, _, _) in rows
    ]


def main() -> int:
    """Profile, write the page, return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--windows", type=int, default=3, help="windows of 80,000 samples")
    parser.add_argument("--seed", type=int, default=8_129)
    add_output_option(parser)
    arguments = parser.parse_args()
    labelled = window_of(next(iter(generate("paper", 1, arguments.seed))))
    window = Window(
        built_in_wheel(),
        labelled.speed_rad_s,
        labelled.torque_Nm,
        labelled.good,
        labelled.noise_std,
        labelled.slope,
    )
    count = arguments.windows * window.speed_rad_s.size // BATCH + 1
    messages = [samples_json(samples_of(window, n * BATCH, BATCH), "profile", n) for n in range(count)]
    run(messages[: window.speed_rad_s.size // BATCH + 1])  # fills the caches
    seconds = stages(messages)
    put_out(to_markdown(seconds, count, functions(messages, 20), arguments), arguments.output)
    return 0


def to_markdown(seconds: dict[str, float], count: int, found: list[list[str]], arguments: argparse.Namespace) -> str:
    """Return docs/profile.md."""
    total = sum(seconds.values())
    rows = [
        [stage, f"{1e6 * own / count:.1f}", f"{1e9 * own / count / BATCH:.0f}", f"{own / total:.1%}"]
        for stage, own in sorted(seconds.items(), key=lambda item: -item[1])
    ]
    most = [stage for stage, _ in sorted(seconds.items(), key=lambda item: -item[1])[:3]]
    at_8_hz = total / count / BATCH * 8.0
    return page(
        "Where the time of the live path goes",
        f"""Made by `make profile` ({arguments.windows} windows, seed {arguments.seed}) on: {machine_in_words()}.

{count} messages of {BATCH} samples through the monitor, from their bytes to the recording:
{1e6 * total / count:.0f} µs of processor time a message, {1e9 * total / count / BATCH:.0f} ns a sample,
{count * BATCH / total:,.0f} samples a second on one core. A wheel at 8 Hz takes {at_8_hz:.1e} of the core in such
messages. Most of it goes to: {"; ".join(most)}.

{table(["stage", "µs a message", "ns a sample", "share"], rows)}

A window that closes costs its stages once in {80_000 // BATCH} messages; the table spreads it over them.

## Functions

Own time by cProfile, which makes calls of Python look dearer than they are; a compiled kernel counts in the function
that calls it.

{table(["function", "calls", "share"], found)}""",
    )


if __name__ == "__main__":
    raise SystemExit(main())
