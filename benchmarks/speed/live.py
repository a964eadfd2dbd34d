"""Measures the live monitor: its incremental step, the path from the bus to the recording, and its memory."""

from __future__ import annotations

import json
import os
import socket
import tempfile
import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from threading import Event
from typing import Final

import numpy as np
from mcap.writer import Writer

from benchmarks.speed.detection import seven_scales
from benchmarks.speed.race import Lap, Runner, laps
from benchmarks.window import Window
from rwa_monitor.changepoints.evidence import WindowAccumulator
from rwa_monitor.diagnosis.model import Model, built_in_model
from rwa_monitor.messages import SamplesMessage
from rwa_monitor.monitor.bus import BusOptions, MonitorBus, SamplesPublisher, open_session
from rwa_monitor.monitor.core import WheelCore
from rwa_monitor.monitor.recorder import REFUSED
from rwa_monitor.monitor.recording import RECORDING_SUFFIX, read_recording, recordings_of
from rwa_monitor.monitor.replay import RecoveredState
from rwa_monitor.monitor.service import Clock, Monitor, RunOptions
from rwa_monitor.monitor.setup import Setup
from rwa_monitor.samples import Samples
from rwa_monitor.simulation.record import simulate
from rwa_monitor.simulation.scenario import Scenario
from rwa_monitor.wheel.wheel import Wheel, built_in_wheel

BATCH: Final = 256  # samples of a message
LONGEST_REPEATED: Final = 10_000  # samples up to which a length is run more than once: they take a millisecond
REPEATED: Final = 20  # runs then, each with a new core
STEP_BATCH: Final = f"ours, batches of {BATCH}: guard, ring buffer, detection"
STEP_AT_ONCE: Final = "ours, the same core, the window at once"
STEP_STAGE: Final = "ours, stage 1 alone, the window at once"
STEP_KERNEL: Final = "ours, the seven-scale kernel alone, the window at once"


def samples_of(window: Window, first: int, count: int) -> Samples:
    """Return `count` samples from slot `first` on; the window is repeated endlessly."""
    slots = np.arange(first, first + count)
    place = slots % window.speed_rad_s.size
    return Samples(slots * window.wheel.period_ns, window.speed_rad_s[place], window.torque_Nm[place])


def stream_of(wheel: Wheel, windows: int, rng: np.random.Generator) -> Window:
    """Return `windows` consecutive windows of a simulated wheel as one, for `samples_of` to repeat."""
    samples = simulate(Scenario(duration_s=windows * wheel.window.samples * wheel.sample_period_s), wheel, rng).samples
    return Window.of(samples, wheel)


# ---- the step --------------------------------------------------------------------------------------------------------


def step_laps(window: Window, model: Model) -> list[Lap]:
    """Time the incremental step over a window that is not yet closed, and the same work done at once."""
    size = window.speed_rad_s.size // BATCH * BATCH - BATCH
    batches = [samples_of(window, start, BATCH) for start in range(0, size, BATCH)]
    whole = samples_of(window, 0, size)

    def step() -> object:
        core = WheelCore(window.wheel, model)
        for number, batch in enumerate(batches):
            core.feed(batch, "benchmark", number)
        return core

    def stage() -> object:
        accumulator = WindowAccumulator(window.wheel, slots=size)
        accumulator.append(window.speed_rad_s[:size], window.torque_Nm[:size], window.good[:size])
        return accumulator

    return laps(
        [
            Runner(STEP_BATCH, "ours", step),
            Runner(STEP_AT_ONCE, "ours", lambda: WheelCore(window.wheel, model).feed(whole)),
            Runner(STEP_STAGE, "ours", stage),
            Runner(STEP_KERNEL, "ours", seven_scales(window)),
        ],
        rounds=7,
    )


def cost_by_length(window: Window, model: Model, lengths: tuple[int, ...]) -> dict[int, float]:
    """Return the time per sample [s] of one core fed in batches, windows closed and diagnosed, by number of samples.

    For short lengths, which a disturbance could dominate, it is the least over `REPEATED` new cores.
    """
    # Untimed: loads everything that a first window and the windows after it need.
    _cost(window, model, window.speed_rad_s.size + window.wheel.window.samples + 2 * BATCH)
    return {
        length: min(_cost(window, model, length) for _ in range(REPEATED if length <= LONGEST_REPEATED else 1))
        for length in lengths
    }


def _cost(window: Window, model: Model, length: int) -> float:
    """Return the time per sample [s] of a new core."""
    core, batches, spent = WheelCore(window.wheel, model), max(length // BATCH, 1), 0.0
    for number in range(batches):
        batch = samples_of(window, number * BATCH, BATCH)
        begin = time.thread_time()
        core.feed(batch, "benchmark", number)
        spent += time.thread_time() - begin
    return spent / (batches * BATCH)


# ---- from the bus to the recording -----------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class PipeRate:
    """Throughput of samples from the bus into a recording.

    Attributes
    ----------
    sent, recorded
        Samples.
    seconds
        From the first message that arrived to the last that was written.
    busy_s
        Processor time of the serving thread within it, without waiting for the sender.
    account
        Text on messages that were not recorded exactly once; "" where all were.
    """

    sent: int
    recorded: int
    seconds: float
    busy_s: float
    account: str = ""

    @property
    def rate(self) -> float:
        """Samples a second of the serving thread's processor time."""
        return self.recorded / self.busy_s


def race_pipes(window: Window, messages: int, rounds: int) -> tuple[list[PipeRate], list[PipeRate]]:
    """Send the same messages through the bare pipe and through the monitor, in turns.

    Parameters
    ----------
    window
        Gives the samples.
    messages
        Number of messages of `BATCH` samples in each round.
    rounds
        Number of rounds.

    Returns
    -------
    tuple
        The bare pipe's rates, and the monitor's.
    """
    bare, ours = [], []
    for _ in range(rounds):
        bare.append(_through(window, messages, bare_pipe))
        ours.append(_through(window, messages, monitor_pipe))
    return bare, ours


Pipe = Callable[[str, Path, int], PipeRate]


def _through(window: Window, messages: int, pipe: Pipe) -> PipeRate:
    """Send messages from a separate process into a pipe in this one, over TCP."""
    endpoint = free_endpoint()
    sender = get_context("spawn").Process(
        target=_send, args=(endpoint, samples_of(window, 0, messages * BATCH)), daemon=True
    )
    sender.start()
    try:
        with tempfile.TemporaryDirectory(prefix="rwa-speed-") as folder:
            return pipe(endpoint, Path(folder), messages)
    finally:
        sender.terminate()
        sender.join()


def _send(endpoint: str, samples: Samples) -> None:
    """Publish samples as fast as the bus takes them, then wait until this process is terminated."""
    parts = [samples[start : start + BATCH] for start in range(0, len(samples), BATCH)]
    with open_session(BusOptions(mode="peer", connect=(endpoint,))) as session:
        publisher = SamplesPublisher(session, "rwa/speed/wheel_1/samples")
        for part in parts:
            publisher.put(part)
        Event().wait()


def bare_pipe(endpoint: str, folder: Path, messages: int) -> PipeRate:
    """Take messages from the bus, read their JSON, write them to an MCAP file, without computations or checks."""
    recorded, begin, busy = 0, 0.0, 0.0
    with (
        open_session(BusOptions(mode="peer", listen=(endpoint,))) as session,
        closing(MonitorBus(session)) as bus,
        (folder / f"bare{RECORDING_SUFFIX}").open("wb") as file,
    ):
        bus.subscribe("rwa/*/*/samples")
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema(SamplesMessage.schema_name(), "jsonschema", b"{}")
        channel = writer.register_channel("rwa/speed/wheel_1/samples", "json", schema)
        for number in range(messages):
            while (message := bus.take()) is None:
                bus.inbox.wake.wait(0.1)
            if number == 0:
                begin, busy = time.perf_counter(), time.thread_time()
            content = json.loads(message.payload)
            writer.add_message(channel, content["time_ns"][-1], message.payload, content["time_ns"][-1])
            recorded += len(content["time_ns"])
        writer.finish()  # type: ignore[no-untyped-call]
        seconds, busy_s = time.perf_counter() - begin, time.thread_time() - busy
    return PipeRate(messages * BATCH, recorded, seconds, busy_s)


def monitor_pipe(endpoint: str, folder: Path, messages: int) -> PipeRate:
    """Run the monitor on the messages: record, check, detect, diagnose, record, publish."""
    options = RunOptions(setup=Setup(model=built_in_model()), bus=BusOptions(mode="peer", listen=(endpoint,)))
    clock = Clock()
    recorder = options.recorder(folder, None, clock.wall_ns)
    begin, busy = 0.0, 0.0
    with open_session(options.bus) as session, closing(MonitorBus(session)) as bus:
        logged: list[str] = []
        monitor = Monitor(options, bus, recorder, logged.append, clock)
        monitor.begin(RecoveredState())
        bus.subscribe(options.wheels)
        bus.show_alive()
        left = messages
        while left:
            while (message := bus.take()) is None:
                bus.inbox.wake.wait(0.1)
            if left == messages:
                begin, busy = time.perf_counter(), time.thread_time()
            left -= monitor.receive(message)
            monitor.tick()
        monitor.close()
        seconds, busy_s = time.perf_counter() - begin, time.thread_time() - busy
        account = {"lost by the bus": sum(bus.backfill.missed.values()), "dropped": bus.inbox.dropped}
    recordings = [read_recording(path) for path in recordings_of(folder)]
    found = [message for recording in recordings for message in recording.messages]
    inputs = [
        SamplesMessage.parse(one.payload, one.topic) for one in found if one.topic.endswith(f"/{SamplesMessage.kind}")
    ]
    account["recorded twice"] = len(inputs) - len({one.batch for one in inputs})
    account["refused"] = sum(one.topic.endswith(f"/{REFUSED}") for one in found)
    account["parts of the recording not readable"] = sum(len(recording.problems) for recording in recordings)
    words = [f"{count} {what}" for what, count in account.items() if count]
    words += [line for line in logged if "refused" in line]
    return PipeRate(messages * BATCH, sum(len(one.time_ns) for one in inputs), seconds, busy_s, ", ".join(words))


def free_endpoint() -> str:
    """Return a Zenoh endpoint on loopback whose port is currently free."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


# ---- memory ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Memory:
    """Resident memory of a process that holds the cores of some wheels, each with a window nearly full [bytes]."""

    wheels: int
    all_channels: bool
    empty: int
    full: int

    @property
    def of_a_wheel(self) -> float:
        """Memory per additional wheel [bytes]."""
        return (self.full - self.empty) / self.wheels


def memory_of(window: Window, wheels: int, *, all_channels: bool) -> Memory | None:
    """Measure in a separate process; None where the system does not report a process's resident memory."""
    if not RESIDENT.exists():
        return None
    size = window.speed_rad_s.size - BATCH  # the window stays open
    samples = samples_of(window, 0, size)
    if all_channels:
        # Friction then comes from the motor's current, and the bearing's temperature is kept too.
        constant = window.wheel.torque_constant_Nm_A or 1.0
        samples = Samples(
            samples.time_ns,
            samples.speed_rad_s,
            motor_current_A=window.torque_Nm[:size] / constant,
            motor_torque_Nm=window.torque_Nm[:size],
            motor_voltage_V=np.ones(size),
            bearing_temperature_degC=np.full(size, 20.0),
        )
    with get_context("spawn").Pool(1) as pool:
        empty, full = pool.apply(_resident, (samples, wheels))
    return Memory(wheels, all_channels, empty, full)


RESIDENT: Final = Path("/proc/self/statm")


def _resident(samples: Samples, wheels: int) -> tuple[int, int]:
    """Return the resident memory [bytes] before and after the cores of `wheels` wheels were fed."""
    wheel, model = built_in_wheel(), built_in_model()
    parts = [samples[start : start + FEED] for start in range(0, len(samples), FEED)]
    _feed(WheelCore(wheel, model), parts)  # loads everything that a core needs
    before = _resident_now()
    cores = []
    for _ in range(wheels):
        cores.append(WheelCore(wheel, model))
        _feed(cores[-1], parts)
    return before, _resident_now()


FEED: Final = 4_096  # samples of a message: large, as memory is measured here and not time


def _feed(core: WheelCore, parts: list[Samples]) -> None:
    for number, part in enumerate(parts):
        core.feed(part, "benchmark", number)


def _resident_now() -> int:
    return int(RESIDENT.read_text(encoding="ascii").split()[1]) * os.sysconf("SC_PAGE_SIZE")
