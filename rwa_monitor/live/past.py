"""What an earlier run of the monitor left behind in its recordings, and where a new one goes on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from threading import Event

from rwa_monitor.errors import InputError
from rwa_monitor.live import rebuild
from rwa_monitor.live.core import WheelCore
from rwa_monitor.live.outputs import Output
from rwa_monitor.live.recorder import Predecessor, predecessor_of
from rwa_monitor.live.recording import RECORDING_SUFFIX, Recording, read_recording
from rwa_monitor.messages import Diagnosis


@dataclass(slots=True)
class Past:
    """What the recordings of a folder tell.

    Attributes
    ----------
    predecessor
        The last recording.
    cores
        As they stood after its last input.
    unrecorded
        Outputs of its inputs that had not reached the disk.
    latest
        The latest diagnosis of each wheel on the disk, by key.
    """

    predecessor: Predecessor | None = None
    cores: dict[tuple[str, str], WheelCore] = field(default_factory=dict)
    unrecorded: list[Output] = field(default_factory=list)
    latest: dict[str, Output] = field(default_factory=dict)


def read_past(folder: Path, setup: rebuild.Setup, stop: Event, say: Callable[[str], None]) -> Past:
    """Rebuild the cores from the last recording of a folder that can be used; incomplete when stopped."""
    past = Past()
    for path in sorted(folder.glob(f"*{RECORDING_SUFFIX}"), reverse=True):
        if past.predecessor is None:
            past.predecessor = predecessor_of(path)
        try:
            recording = read_recording(path)
            recorded_setup = rebuild.Setup.of(recording)
        except InputError as error:
            say(f"{error}; going back to the recording before it")
            continue
        for problem in recording.problems:
            say(f"{path}: {problem}")
        if not recorded_setup.equals(setup):
            say(f"{path} was made with another wheel, model or method: the monitor starts anew")
            return past
        rebuilt = rebuild.start(recording, setup)
        rebuild.run_inputs(recording, setup, rebuilt, stop)
        past.cores = rebuilt.cores
        past.unrecorded = _unrecorded(recording, rebuilt.outputs)
        past.latest = _latest(recording)
        say(f"going on from {path}: {len(past.cores)} wheels, {rebuilt.inputs} messages")
        return past
    return past


def _unrecorded(recording: Recording, outputs: list[Output]) -> list[Output]:
    """Return the outputs that the recording does not hold: those after the last one that it does, by topic."""
    held: dict[str, int] = {}
    for message in recording.messages:
        if message.schema in rebuild.COMPARED_SCHEMAS:
            held[message.topic] = held.get(message.topic, 0) + 1
    for topic, count in rebuild.inherited_counts(recording.settings()).items():
        held[topic] = held.get(topic, 0) - count
    missing = []
    for output in outputs:
        if held.get(output.key, 0) > 0:
            held[output.key] -= 1
        else:
            missing.append(output)
    return missing


def _latest(recording: Recording) -> dict[str, Output]:
    """Return the latest diagnosis of each wheel, by key."""
    latest: dict[str, Output] = {}
    for message in recording.messages:
        if message.schema == Diagnosis.schema_name():
            diagnosis = Diagnosis.parse(message.data, f"{recording.path}: {message.topic}")
            latest[message.topic] = Output(
                message.topic, Diagnosis, message.schema, message.data, diagnosis.window_end_ns
            )
    return latest
