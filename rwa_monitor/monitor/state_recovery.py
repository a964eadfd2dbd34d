"""Rebuilds monitor cores from a recording: from its checkpoints and its inputs, as the service had processed them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from threading import Event
from typing import Any, Final, get_args

from rwa_monitor.changepoints.stage_results import Method
from rwa_monitor.diagnosis.model import Model
from rwa_monitor.errors import InputError
from rwa_monitor.messages import Changepoints, Diagnosis, Discrepancy, SamplesMessage, split_key
from rwa_monitor.monitor.checkpoint import Checkpoint
from rwa_monitor.monitor.core import WheelCore
from rwa_monitor.monitor.outputs import CARRIED_SCHEMA, Output, outputs_of
from rwa_monitor.monitor.recording.reader import (
    CHECKPOINT_PREFIX,
    Attached,
    PassingRecording,
    RecordedMessage,
    Recording,
)
from rwa_monitor.monitor.wheel_set import WheelSet, key_of_name

# What a replay must give again; health follows from the diagnosis, status has the wall clock in it.
COMPARED_SCHEMAS: Final = (Changepoints.schema_name(), Diagnosis.schema_name(), CARRIED_SCHEMA)
KEPT_SCHEMAS: Final = (*COMPARED_SCHEMAS, Discrepancy.schema_name())
MAX_KEPT_BYTES: Final = 2**30  # of messages of these, of a recording


@dataclass(frozen=True, slots=True)
class Setup:
    """What a recording was made with: the constants of its wheels, what was learned, and how jumps are assigned."""

    wheels: WheelSet
    model: Model | None
    method: Method

    @classmethod
    def of(cls, recording: Recording) -> Setup:
        """Read the setup from a recording's attachments; raises InputError where one is missing or damaged."""
        source = str(recording.path)
        settings = recording.settings()
        method: Method | None = settings.get("method")
        if method is None or method not in get_args(Method):
            raise InputError(source, f"{method!r} is none of {', '.join(get_args(Method))}", "settings.json: method")
        wheels = WheelSet.of_attachments(recording.attachments, source)
        model_text = _text(recording, "model.json")
        model = Model.from_json(model_text, f"{source}: model.json") if model_text else None
        return cls(wheels, model, method)

    def new_core(self, spacecraft: str, wheel: str) -> WheelCore:
        """Return the core of a wheel of which nothing is known yet."""
        return WheelCore(self.wheels.of(spacecraft, wheel), self.model, method=self.method)

    def identity_of(self, spacecraft: str, wheel: str) -> tuple[str, str, Method]:
        """Return what the diagnoses of a wheel depend on: the hashes of its constants and the model, and the method."""
        return self.wheels.of(spacecraft, wheel).sha256(), self.model.sha256() if self.model else "", self.method


def _text(recording: Recording, name: str) -> str:
    if name not in recording.attachments:
        raise InputError(str(recording.path), "is missing: this is no recording of rwa-monitor run", name)
    try:
        return recording.attachments[name].decode()
    except UnicodeDecodeError as error:
        raise InputError(str(recording.path), "is no UTF-8 text", name) from error


@dataclass(slots=True)
class Rebuilt:
    """A recording, run again.

    Attributes
    ----------
    cores
        By (spacecraft, wheel), as they stand after the last input.
    outputs
        What the monitor says about the inputs, changepoints and diagnoses, in order.
    inputs
        Messages of samples processed.
    spans_ns
        First and last time of the samples on each topic [ns].
    """

    cores: dict[tuple[str, str], WheelCore] = field(default_factory=dict)
    outputs: list[Output] = field(default_factory=list)
    inputs: int = 0
    spans_ns: dict[str, tuple[int, int]] = field(default_factory=dict)


def _resume(path: Path, name: str, data: bytes, setup: Setup, rebuilt: Rebuilt) -> None:
    """Bring a core to where its checkpoint stands."""
    spacecraft, wheel = key_of_name(name.removeprefix(CHECKPOINT_PREFIX).removesuffix(".json"))
    checkpoint = Checkpoint.from_json(data, f"{path}: {name}")
    rebuilt.cores[spacecraft, wheel] = WheelCore.resume(
        checkpoint, setup.wheels.of(spacecraft, wheel), setup.model, method=setup.method
    )


def run_passing(
    passing: PassingRecording,
    stop: Event,
    on_progress: Callable[[Attached | RecordedMessage], None],
    before: Rebuilt | None = None,
) -> Rebuilt:
    """Run a recording while it is read, so that no more of it is in memory than the cores.

    Parameters
    ----------
    passing
        What to run. Its `recording` gets what is small: all attachments but checkpoints, and the messages of
        `KEPT_SCHEMAS`.
    stop
        Ends it early when set.
    on_progress
        Called with each checkpoint and message when it is done.
    before
        The recording before it, run, where this one holds the state of some wheels only.

    Raises
    ------
    InputError
        If the recording cannot be read, or lacks what it was made with; if a checkpoint or an input is damaged.
    """
    recording, rebuilt = passing.recording, Rebuilt(before.cores if before else {})
    setup: Setup | None = None
    kept_bytes = 0
    for part in passing.parts():
        if stop.is_set():
            break
        if isinstance(part, Attached) and not part.name.startswith(CHECKPOINT_PREFIX):
            recording.attachments[part.name] = part.data
            continue
        # The recorder writes what a recording was made with before all else.
        setup = setup or Setup.of(recording)
        if isinstance(part, Attached):
            _resume(recording.path, part.name, part.data, setup, rebuilt)
        else:
            _run_input(recording.path, part, setup, rebuilt)
            if part.schema in KEPT_SCHEMAS:
                kept_bytes += len(part.data)
                if kept_bytes > MAX_KEPT_BYTES:
                    reason = f"holds more than {MAX_KEPT_BYTES:,} bytes of what a monitor says"
                    raise InputError(str(recording.path), reason)
                recording.messages.append(part)
        on_progress(part)
    return rebuilt


def _run_input(path: Path, recorded: RecordedMessage, setup: Setup, rebuilt: Rebuilt) -> None:
    """Feed a message to its core where it is one of samples."""
    if recorded.schema != SamplesMessage.schema_name():
        return
    spacecraft, wheel, _ = split_key(recorded.topic)
    message = SamplesMessage.parse(recorded.data, f"{path}: {recorded.topic}")
    if (spacecraft, wheel) not in rebuilt.cores:
        rebuilt.cores[spacecraft, wheel] = setup.new_core(spacecraft, wheel)
    events = rebuilt.cores[spacecraft, wheel].feed(message.samples(), message.publisher, message.batch)
    rebuilt.inputs += 1
    first_ns, last_ns = rebuilt.spans_ns.get(recorded.topic, (message.time_ns[0], message.time_ns[0]))
    rebuilt.spans_ns[recorded.topic] = min(first_ns, *message.time_ns), max(last_ns, *message.time_ns)
    rebuilt.outputs += [output for output in outputs_of(events, spacecraft, wheel) if output.schema in COMPARED_SCHEMAS]


def inherited_counts(settings: dict[str, Any]) -> dict[str, int]:
    """Return how many outputs, by topic, a recording holds for inputs of its predecessor."""
    inherited = settings.get("inherited", {})
    if not isinstance(inherited, dict):
        return {}
    return {str(topic): int(count) for topic, count in inherited.items() if isinstance(count, int)}
