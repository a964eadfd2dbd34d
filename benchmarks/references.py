"""Makes the reference recordings in `replay/`: small, complete, and each with required events.

The monitor itself makes them, without a bus: simulated telemetry in, a recording out, under clocks that count
messages, so that the same code gives the same bytes. `manifest.json` states the expected result of each replay.
Renew them after a change that is meant to change diagnoses:

    make references            (python -m benchmarks.references replay)
"""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from hashlib import sha256
from itertools import count
from pathlib import Path
from threading import Event
from typing import Any, Final

import numpy as np

from rwa_monitor.diagnosis.model import built_in_model
from rwa_monitor.messages import Diagnosis, EncodedMessage, SamplesMessage, Status, samples_json
from rwa_monitor.monitor.backfill import Arrival, Backfill, Inbox
from rwa_monitor.monitor.bus import MonitorBus
from rwa_monitor.monitor.recording import read_recording, recordings_of
from rwa_monitor.monitor.replay import recover_state
from rwa_monitor.monitor.service import Clock, Monitor, RunOptions
from rwa_monitor.monitor.setup import Setup
from rwa_monitor.samples import NANOSECONDS_PER_SECOND, Samples
from rwa_monitor.simulation.record import simulate
from rwa_monitor.simulation.scenario import Scenario
from rwa_monitor.wheel.wheel import EffectBlock, TemperatureRange, Wheel, built_in_wheel
from rwa_monitor.words import SOFTWARE

WINDOW_SLOTS: Final = 4_000
BATCH: Final = 200  # samples of a message
FRICTION_STEP_Nm: Final = 1e-8  # resolution of a telemetry word; far below the noise of 3.9e-5 N m
KEY: Final = "rwa/reference/wheel_1/samples"
MANIFEST: Final = "manifest.json"


def reference_wheel() -> Wheel:
    """Return the built-in wheel with a window of 4,000 slots and all durations shortened by the same factor."""
    tables = built_in_wheel().to_tables()
    scale = WINDOW_SLOTS / tables["window"]["samples"]
    tables["wheel"]["name"] = "reference"
    tables["window"].update(samples=WINDOW_SLOTS, hop=WINDOW_SLOTS)
    for system in tables["fss"]:
        for law in system["durations"]:
            law.update(low=max(1, round(law["low"] * scale)), high=max(2, round(law["high"] * scale)))
    return Wheel.from_tables(tables, "reference wheel")


def warm_wheel() -> Wheel:
    """Return the same with a lubricant that thins by 5 % a kelvin, and a sensor beside the bearing."""
    wheel = reference_wheel()
    assert wheel.nominal is not None
    law = EffectBlock(
        name="viscosity_temperature",
        parameters={
            "strength_Nm_s_rad": wheel.nominal.viscous_Nm_s_rad,
            "activation_temperature_K": 4300.0,
            "sensor_lag_s": 300.0,
        },
    )
    learned_at = TemperatureRange(low_degC=5.0, high_degC=35.0)
    return wheel.model_copy(update={"effect": (law,), "temperature": learned_at})


# ---- what happens ----------------------------------------------------------------------------------------------------

Messages = list[tuple[str, bytes]]


@dataclass(frozen=True, slots=True)
class Reference:
    """One reference.

    Attributes
    ----------
    name, about
        Folder, and description.
    scenario
        Text of a scenario file: the events of the wheel.
    seed
        Seed of the simulator.
    wheel
        Returns the wheel.
    runs
        Turns the telemetry into the messages of one or more runs of the monitor; all but the last end in a crash.
    required
        Required events by name, each as a test of the summary (see `summary`).
    """

    name: str
    about: str
    scenario: str
    seed: int
    wheel: Callable[[], Wheel] = reference_wheel
    runs: Callable[[Samples], list[Messages]] = field(default=lambda samples: [_messages(samples, "first")])
    required: dict[str, Callable[[dict[str, Any]], bool]] = field(default_factory=dict)


def _messages(samples: Samples, publisher: str, first: int = 0) -> Messages:
    """Cut samples into numbered messages."""
    starts = range(0, len(samples), BATCH)
    return [
        (KEY, samples_json(samples[start : start + BATCH], publisher, first + number))
        for number, start in enumerate(starts)
    ]


def _bad_day(samples: Samples) -> list[Messages]:
    """Return the messages of two runs with all kinds of faults of telemetry and publishers."""
    speed = samples.speed_rad_s.copy()
    friction = np.array(samples.friction_torque_Nm)
    speed[700:720] = np.nan  # not measured
    friction[1_500:1_540] = np.inf  # not finite
    speed[2_100:2_103] = 5.0e4  # beyond the wheel's limits: a wrong unit
    time_ns = samples.time_ns.copy()
    time_ns[11_000:] += 3 * WINDOW_SLOTS * 125_000_000  # the clock steps by three windows
    samples = replace(samples, time_ns=time_ns, speed_rad_s=speed, friction_torque_Nm=friction)
    keep = np.ones(len(samples), dtype=np.bool_)
    keep[3_130:3_170] = False  # a gap
    first = _messages(samples[keep][:6_000], "first")
    second = _messages(samples[keep][6_000:], "second")  # the publisher restarts under a new name

    del first[8]  # lost for good
    first.insert(12, first[11])  # delivered twice
    first.insert(20, first.pop(14))  # delivered when its slots have passed
    first[22:24] = [first[23], first[22]]  # swapped, but delivered in time
    first.insert(16, (KEY, b'{"time_ns": [1, 2], "speed_rad_s": [1.0]}'))  # lengths differ
    first.insert(18, (KEY, b"\x00 no JSON"))
    intruder = _messages(samples[5_000:5_400], "intruder", 70)
    first[26:26] = intruder[:1]  # a second publisher while the first one lives
    first[28:28] = intruder[1:]
    return [first[:21], first[21:] + second]  # the monitor is killed in between


REFERENCES: Final = (
    Reference(
        name="nominal",
        about="a healthy wheel, three windows",
        scenario="[scenario]\nduration_s = 1550.0\n",
        seed=11,
        required={
            "three whole windows": lambda seen: len(seen["verdicts"]) == 3,
            "all nominal": lambda seen: set(seen["verdicts"]) == {"nominal"},
            "jumps were found": lambda seen: seen["changepoints"] > 10,
        },
    ),
    Reference(
        name="dry",
        about="dry friction grows by 30 % after the first window",
        scenario="[scenario]\nduration_s = 2050.0\n[anomalies.dry]\nfactor = 1.3\nonset_s = 500.0\n",
        seed=12,
        required={
            "nominal before": lambda seen: seen["verdicts"][0] == "nominal",
            "dry alone at the end": lambda seen: seen["active"][-1] == ["dry"],
        },
    ),
    Reference(
        name="two_anomalies",
        about="dry friction +30 % and switching system 1 at 1.6 times its friction, derived from current",
        scenario="[scenario]\nduration_s = 2050.0\nfriction_given = false\n"
        "[anomalies.dry]\nfactor = 1.3\n[anomalies.fss_1]\nfactor = 1.6\n",
        seed=13,
        required={
            "both at once at the end": lambda seen: seen["active"][-1] == ["dry", "fss_1"],
        },
    ),
    Reference(
        name="heat",
        about="a bearing that warms and cools by 20 K; from its fifth window on viscous friction is too large by 30 %",
        scenario="[scenario]\nduration_s = 4050.0\n[temperature]\nmean_degC = 20.0\nswing_K = 10.0\n"
        "[anomalies.viscous]\nfactor = 1.3\nonset_s = 2000.0\n",
        seed=15,
        wheel=warm_wheel,
        required={
            "eight whole windows": lambda seen: len(seen["verdicts"]) == 8,
            "nominal while it warms and cools": lambda seen: set(seen["verdicts"][:4]) == {"nominal"},
            "viscous alone from the fifth on": lambda seen: all(active == ["viscous"] for active in seen["active"][4:]),
        },
    ),
    Reference(
        name="bad_day",
        about="gaps, duplicates, late, non-finite and impossible samples, refused messages, a clock step, "
        "a second publisher, a restarted publisher, and a killed monitor",
        scenario="[scenario]\nduration_s = 1800.0\n",
        seed=14,
        runs=_bad_day,
        required={
            "two files": lambda seen: len(seen["files"]) == 2,
            "a window after the restart": lambda seen: len(seen["verdicts"]) >= 2,
            "a window with lost slots": lambda seen: min(seen["coverage"]) < 0.97,
            "a partial window at the clock step": lambda seen: any(seen["partial"]),
            "refused messages": lambda seen: seen["refused"] == 2,
            "samples of every kind": lambda seen: all(
                seen["counts"][f"samples_{what}"] > 0 for what in ("used", "masked", "late", "duplicate", "rejected")
            ),
            "missed slots": lambda seen: seen["counts"]["slots_missed"] >= 40,
            "missed messages": lambda seen: seen["counts"]["messages_missed"] >= 1,
        },
    ),
)


# ---- making them -----------------------------------------------------------------------------------------------------


class SilentBus(MonitorBus):
    """A bus without publishers and subscribers: it has no session."""

    def __init__(self) -> None:
        self.inbox = Inbox()
        self.backfill = Backfill(lambda *_: None, self.inbox.max_bytes)

    def publish(self, message: EncodedMessage) -> None:
        """Publish to nobody."""


def make(reference: Reference, folder: Path) -> None:
    """Make one reference recording, or a chain of them, in a new folder."""
    options = RunOptions(setup=Setup(reference.wheel(), model=built_in_model()), record=folder)
    scenario = Scenario.from_toml(reference.scenario, reference.name)
    samples = simulate(scenario, options.setup.common, np.random.default_rng(reference.seed)).samples
    runs = reference.runs(_as_telemetry(samples, heat=bool(options.setup.common.effect)))
    folder.mkdir(parents=True)
    ticks = count()
    # Messages come every 25 s of the wheel's time; the machine's clocks advance by 1 s per call.
    clock = Clock(wall_ns=lambda: next(ticks) * NANOSECONDS_PER_SECOND, monotonic_s=lambda: float(next(ticks)))
    for number, messages in enumerate(runs):
        _run(options, folder, messages, clock, killed=number + 1 < len(runs))


def _as_telemetry(samples: Samples, *, heat: bool) -> Samples:
    """Return the channels of a spacecraft's telemetry, rounded to its words; with `heat`, temperature too."""
    friction = samples.friction_torque_Nm
    if friction is None:
        return Samples(samples.time_ns, samples.speed_rad_s, motor_current_A=samples.motor_current_A)
    steps = np.round(friction / FRICTION_STEP_Nm)
    measured = samples.bearing_temperature_degC if heat else None
    return Samples(
        samples.time_ns,
        samples.speed_rad_s,
        friction_torque_Nm=np.round(steps * FRICTION_STEP_Nm, 8),
        bearing_temperature_degC=None if measured is None else np.round(measured, 1),
    )


def _run(options: RunOptions, folder: Path, messages: Messages, clock: Clock, *, killed: bool) -> None:
    past = recover_state(folder, options.setup, Event(), lambda _: None)
    recorder = options.recorder(folder, past.predecessor, clock.wall_ns)
    monitor = Monitor(options, SilentBus(), recorder, lambda _: None, clock)
    monitor.begin(past)
    for key, payload in messages:
        monitor.receive(Arrival(key, payload))
        monitor.tick()
    if killed:
        recorder.sync(clock.monotonic_s())
        recorder.abandon()
    else:
        monitor.close()


# ---- what is in them -------------------------------------------------------------------------------------------------


def summary(folder: Path) -> dict[str, Any]:
    """Return the summary of a reference, as it is in the manifest."""
    files: dict[str, str] = {}
    diagnoses: list[Diagnosis] = []
    statuses: list[Status] = []
    inputs = changepoints = refused = 0
    for path in recordings_of(folder):
        files[path.name] = sha256(path.read_bytes()).hexdigest()
        for message in read_recording(path).messages:
            if message.schema == Diagnosis.schema_name():
                diagnoses.append(Diagnosis.parse(message.payload, message.topic))
            elif message.schema == Status.schema_name():
                statuses.append(Status.parse(message.payload, message.topic))
            inputs += message.schema == SamplesMessage.schema_name()
            changepoints += message.schema == "rwa.Changepoints"
            refused += message.schema == "rwa.Refused"
    last = statuses[-1].model_dump()
    return {
        "files": files,
        "inputs": inputs,
        "refused": refused,
        "changepoints": changepoints,
        "verdicts": [diagnosis.verdict for diagnosis in diagnoses],
        "active": [[name for name, entry in d.anomalies.items() if entry.active] for d in diagnoses],
        "coverage": [diagnosis.coverage for diagnosis in diagnoses],
        "partial": [diagnosis.partial for diagnosis in diagnoses],
        "counts": {name: value for name, value in last.items() if name.startswith(("samples_", "slots_", "messages_"))},
    }


def missing(reference: Reference, seen: dict[str, Any]) -> list[str]:
    """Return the required events that did not happen in a reference."""
    return [what for what, happened in reference.required.items() if not happened(seen)]


def renew(folder: Path) -> Iterator[tuple[Reference, dict[str, Any]]]:
    """Make all references and their manifest again; yield each with its summary."""
    manifest: dict[str, Any] = {"software": SOFTWARE, "recordings": {}}
    for reference in REFERENCES:
        target = folder / reference.name
        if target.exists():
            shutil.rmtree(target)
        make(reference, target)
        seen = summary(target)
        manifest["recordings"][reference.name] = {"about": reference.about, **seen}
        yield reference, seen
    (folder / MANIFEST).write_text(json.dumps(manifest, indent=1) + "\n", encoding="utf-8")


def main(arguments: Sequence[str]) -> int:
    """Renew the references in a folder (`replay` by default); exit code 1 if a required event is missing."""
    failed = False
    for reference, seen in renew(Path(arguments[0]) if arguments else Path("replay")):
        absent = missing(reference, seen)
        failed |= bool(absent)
        note = f"MISSING: {', '.join(absent)}" if absent else "as required"
        sys.stdout.write(f"{reference.name}: {seen['verdicts']} {seen['active']}: {note}\n")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
