"""What the tests of the monitor room share: a wheel with short windows, and simulated telemetry for it."""

import socket
import threading
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import zenoh

from benchmarks.references import reference_wheel
from rwa_monitor.diagnosis.model import Model, built_in_model
from rwa_monitor.messages import Diagnosis
from rwa_monitor.monitor.bus import send
from rwa_monitor.monitor.checkpoint import Checkpoint
from rwa_monitor.monitor.core import Event, WheelCore, outputs_of
from rwa_monitor.monitor.ingest import Counts
from rwa_monitor.monitor.recording import read_chain
from rwa_monitor.samples import Samples
from rwa_monitor.simulation.record import simulate
from rwa_monitor.simulation.scenario import Scenario
from rwa_monitor.wheel.wheel import Wheel

WINDOW = 1_024
KEY = "rwa/sat/wheel_1/samples"


@cache
def model() -> Model:
    return built_in_model()


@cache
def wheel(samples: int = WINDOW, hop: int | None = None, effects: bool = False, heat: bool = False) -> Wheel:
    """Return the reference wheel with another window; with effects, one without and one with a memory.

    With `heat`, viscous friction follows the temperature, with a lag, and differs between the directions.
    """
    tables = reference_wheel().to_tables()
    tables["window"]["samples"] = samples
    tables["window"]["hop"] = samples if hop is None else hop
    if effects:
        tables["effect"] = [
            {"name": "stribeck", "parameters": {"strength_Nm": 5e-4, "stribeck_speed_rad_s": 8.0}},
            {"name": "lubricant_lag", "parameters": {"strength_Nm_s_rad": 2e-6, "time_constant_s": 40.0}},
        ]
    if heat:
        law = {"strength_Nm_s_rad": 5.333e-6, "activation_temperature_K": 4300.0, "sensor_lag_s": 60.0}
        tables["effect"] = [
            *tables.get("effect", []),
            {"name": "viscosity_temperature", "parameters": law},
            {"name": "viscous_asymmetry", "parameters": {"strength_Nm_s_rad": 3e-7}},
        ]
    return Wheel.from_tables(tables, "test wheel")


@cache
def telemetry(slots: int, seed: int = 1, given: bool = True) -> Samples:
    """Return simulated telemetry of the test wheel, friction given or to be derived from current."""
    scenario = Scenario(duration_s=slots * 0.125, friction_given=given)
    return simulate(scenario, wheel(), np.random.default_rng(seed)).samples


def spoiled(samples: Samples, seed: int) -> Samples:
    """Return telemetry with gaps and values that were not measured."""
    rng = np.random.default_rng(seed)
    speed = samples.speed_rad_s.copy()
    speed[rng.random(speed.size) < 0.004] = np.nan
    keep = rng.random(speed.size) >= 0.01
    keep[speed.size // 3 : speed.size // 3 + 70] = False
    keep[0] = True
    channels = {name: values[keep] for name, values in samples.channels() if name not in {"time_ns", "speed_rad_s"}}
    return Samples(time_ns=samples.time_ns[keep], speed_rad_s=speed[keep], **channels)


def pieces(samples: Samples, cuts: Sequence[int]) -> Iterator[Samples]:
    """Cut samples at the given rows; pieces may be empty."""
    borders = [0, *sorted(cuts), len(samples)]
    for start, stop in pairwise(borders):
        yield samples[start:stop]


def publish(telemetry_of: Mapping[str, Samples], session: zenoh.Session, **options: Any) -> int:
    """Publish samples on the bus by key, as `send` has it."""
    return send(session, telemetry_of, **{"stop": threading.Event(), **options})


def messages_of(events: Sequence[Event], name: str = "wheel_1") -> list[tuple[str, bytes]]:
    """Return what the monitor publishes about events: (key, JSON)."""
    return [(output.topic, output.payload) for output in outputs_of(events, "sat", name)]


def diagnoses(messages: Sequence[tuple[str, bytes]]) -> list[bytes]:
    return [payload for key, payload in messages if key.endswith("/" + Diagnosis.kind)]


def adds_up(counts: Counts | dict[str, Any]) -> bool:
    """Return whether each sample received is in one of the parts, of a core's counts or of a status."""
    of = counts if isinstance(counts, dict) else {f"samples_{name}": value for name, value in asdict(counts).items()}
    parts = ("used", "masked", "late", "duplicate", "rejected", "queued")
    return bool(of["samples_received"] == sum(of[f"samples_{part}"] for part in parts))


def resumed(data: bytes, of_wheel: Wheel) -> WheelCore:
    """Return the core of a checkpoint's bytes."""
    return WheelCore.resume(Checkpoint.from_json(data, "test"), of_wheel, model())


def recorded(folder: Path, schema: str = Diagnosis.schema_name(), name: str = "") -> list[bytes]:
    """Return the payloads of a kind in a chain of recordings, of one wheel or all."""
    return [
        message.payload
        for recording in read_chain(folder)
        for message in recording.messages
        if message.schema == schema and name in ("", message.topic.split("/")[2])
    ]


def batch_diagnoses(samples: Samples, of_wheel: Wheel, whole: bool = True, name: str = "wheel_1") -> list[bytes]:
    """Return the diagnosis messages of a whole table, without the partial one where only whole ones are wanted."""
    core = WheelCore(of_wheel, model())
    events = core.feed(samples)
    return diagnoses(messages_of(events if whole else [*events, *core.finish()], name))


_RESERVED: list[socket.socket] = []


def free_port() -> int:
    """Return a port of loopback that stays free until this process ends, for whoever listens on it by its number.

    A socket is bound to it and never listens: the system gives the port to nobody else who asks for any, and lets
    those listen who set SO_REUSEADDR, as all servers do that may start again on the port they had.
    """
    held = socket.socket()
    held.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    held.bind(("127.0.0.1", 0))
    _RESERVED.append(held)
    return int(held.getsockname()[1])
