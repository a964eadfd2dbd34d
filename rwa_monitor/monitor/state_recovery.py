"""State recovery: monitor cores as a recording's checkpoints and inputs make them again.

A replay runs single recordings; a monitor that starts goes on from those that an earlier run left in its folder.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from threading import Event
from typing import Any, Final, TypeGuard

from rwa_monitor.errors import InputError
from rwa_monitor.messages import Changepoints, Diagnosis, Discrepancy, EncodedMessage, SamplesMessage, split_key
from rwa_monitor.monitor.checkpoint import Checkpoint
from rwa_monitor.monitor.core import WheelCore
from rwa_monitor.monitor.events import Carried, outputs_of
from rwa_monitor.monitor.recording.reader import (
    CHECKPOINT_PREFIX,
    MAX_FILE_BYTES,
    RECORDING_SUFFIX,
    SOME_CHECKPOINTS,
    Attached,
    Recording,
)
from rwa_monitor.monitor.recording.recorder import Predecessor, predecessor_of
from rwa_monitor.monitor.setup import Setup, key_of_name
from rwa_monitor.words import counted, first_few

# What a replay must give again; health follows from the diagnosis, status has the wall clock in it.
COMPARED_SCHEMAS: Final = (Changepoints.schema_name(), Diagnosis.schema_name(), Carried.schema_name())
KEPT_SCHEMAS: Final = (*COMPARED_SCHEMAS, Discrepancy.schema_name())


@dataclass(slots=True)
class RecordingRun:
    """A recording, run again.

    Attributes
    ----------
    recording
        With what is small of it: all attachments but checkpoints, and the messages of `KEPT_SCHEMAS`.
    cores
        By (spacecraft, wheel), as they stand after the last input.
    outputs
        The outputs for the inputs, changepoints and diagnoses, in order.
    inputs
        Messages of samples processed.
    inherited, own
        The outputs that the recording holds: those before the first input are for inputs of its predecessor.
    """

    recording: Recording
    cores: dict[tuple[str, str], WheelCore]
    outputs: list[EncodedMessage] = field(default_factory=list)
    inputs: int = 0
    inherited: list[EncodedMessage] = field(default_factory=list)
    own: list[EncodedMessage] = field(default_factory=list)


def run_recording(
    path: Path,
    stop: Event,
    on_progress: Callable[[Recording, Attached | EncodedMessage], None],
    before: RecordingRun | None = None,
) -> RecordingRun:
    """Run a recording while it is read, so that no more of it is in memory than the cores.

    Parameters
    ----------
    path
        What to run.
    stop
        Ends it early when set.
    on_progress
        Called with the recording and each checkpoint and message when it is done.
    before
        The recording before it, run, where this one holds the state of some wheels only.

    Raises
    ------
    InputError
        If the recording cannot be read, or lacks what it was made with; if a checkpoint or an input is damaged.
    """
    recording = Recording(path)
    run = RecordingRun(recording, before.cores if before else {})
    setup: Setup | None = None
    kept_bytes = 0
    for part in recording.parts():
        if stop.is_set():
            break
        if isinstance(part, Attached) and not part.name.startswith(CHECKPOINT_PREFIX):
            recording.attachments[part.name] = part.data
            continue
        # The recorder writes what a recording was made with before all else.
        setup = setup or Setup.of(recording)
        if isinstance(part, Attached):
            key = key_of_name(part.name.removeprefix(CHECKPOINT_PREFIX).removesuffix(".json"))
            checkpoint = Checkpoint.from_json(part.data, f"{path}: {part.name}")
            run.cores[key] = WheelCore.resume(checkpoint, setup.wheels.of(*key), setup.model)
        elif part.schema == SamplesMessage.schema_name():
            _run_input(path, part, setup, run)
        elif part.schema in KEPT_SCHEMAS:
            kept_bytes += len(part.payload)
            if kept_bytes > MAX_FILE_BYTES:
                raise InputError(str(path), f"holds more than {MAX_FILE_BYTES:,} bytes of outputs")
            recording.messages.append(part)
            if part.schema in COMPARED_SCHEMAS:
                (run.own if run.inputs else run.inherited).append(part)
        on_progress(recording, part)
    return run


def _run_input(path: Path, recorded: EncodedMessage, setup: Setup, run: RecordingRun) -> None:
    """Feed a message of samples to its core."""
    spacecraft, wheel, _ = split_key(recorded.topic)
    message = SamplesMessage.parse(recorded.payload, f"{path}: {recorded.topic}")
    if (spacecraft, wheel) not in run.cores:
        run.cores[spacecraft, wheel] = setup.new_core(spacecraft, wheel)
    events = run.cores[spacecraft, wheel].feed(message.samples(), message.publisher, message.batch, message.data)
    run.inputs += 1
    run.outputs += [output for output in outputs_of(events, spacecraft, wheel) if output.schema in COMPARED_SCHEMAS]


# ---- from the recordings of a folder ---------------------------------------------------------------------------------


# How far back diagnoses are published again at a start: an outage may have begun before several crashes.
REPEATED_BYTES: Final = 64 * 2**20
PROGRESS_S: Final = 5.0  # between two lines on the progress of a recovery


@dataclass(slots=True)
class RecoveredState:
    """The state that the recordings of a folder hold.

    Attributes
    ----------
    predecessor
        The last recording.
    cores
        As they stood after its last input; without those whose wheel file or model is another one now.
    unrecorded
        Outputs of its inputs that had not reached the disk.
    diagnoses
        On the disk, of the last recordings, in order: they may not have reached the bus, and a late subscriber asks.
    """

    predecessor: Predecessor | None = None
    cores: dict[tuple[str, str], WheelCore] = field(default_factory=dict)
    unrecorded: list[EncodedMessage] = field(default_factory=list)
    diagnoses: list[EncodedMessage] = field(default_factory=list)


def recover_state(
    folder: Path,
    setup: Setup,
    stop: Event,
    log: Callable[[str], None],
) -> RecoveredState:
    """Recover the cores from the last recording of a folder that can be used; incomplete when stopped.

    Parameters
    ----------
    folder
        Of the recordings.
    setup
        What the monitor goes on with.
    stop
        Ends it early when set.
    log
        Takes lines of the log; a large fleet takes minutes, with a line every `PROGRESS_S`.
    """
    paths = sorted(folder.glob(f"*{RECORDING_SUFFIX}"), reverse=True)
    recovered = RecoveredState(predecessor_of(paths[0]) if paths else None)
    due_s = time.monotonic() + PROGRESS_S

    def on_part(recording: Recording, _part: object) -> None:
        nonlocal due_s
        if time.monotonic() >= due_s:
            due_s = time.monotonic() + PROGRESS_S
            log(f"recovering the state from {recording.path}: {recording.share:.0%} of it done")

    for place, path in enumerate(paths):
        try:
            runs = [run_recording(path, stop, on_part)]
            if before := _needed_before(path, runs[0].recording.settings(), paths[place + 1 :], log):
                first = run_recording(before, stop, on_part)
                runs = [first, run_recording(path, stop, on_part, first)]
            setup_then = Setup.of(runs[-1].recording)
        except InputError as error:
            log(f"{error}; going back to the recording before it")
            continue
        cores, inputs = runs[-1].cores, sum(run.inputs for run in runs)
        recovered.cores = {
            key: core for key, core in cores.items() if setup_then.identity_of(*key) == setup.identity_of(*key)
        }
        if anew := sorted(f"{spacecraft}/{wheel}" for spacecraft, wheel in cores.keys() - recovered.cores.keys()):
            wheels = first_few(anew)
            log(f"{path} was made with another wheel file or model of {wheels}: begun anew")
        recovered.diagnoses = _earlier_diagnoses(paths[place + len(runs) :])
        for run in runs:
            for problem in run.recording.problems:
                log(f"{run.recording.path}: {problem}")
            recovered.unrecorded += _unrecorded(run)
            recovered.diagnoses += filter(_is_diagnosis, run.recording.messages)
        log(f"going on from {path}: {counted(len(recovered.cores), 'wheel')}, {counted(inputs, 'message')}")
        return recovered
    return recovered


def _needed_before(
    path: Path, settings: dict[str, Any], earlier: Sequence[Path], log: Callable[[str], None]
) -> Path | None:
    """Return the recording before one that holds the state of some wheels only; None where it holds all, as most do.

    A monitor that ended while it brought the wheels from one recording over into the next left two.
    """
    if settings.get("checkpoints") != SOME_CHECKPOINTS:
        return None
    before = (settings.get("predecessor") or {}).get("name")
    if earlier and earlier[0].name == before:
        return earlier[0]
    log(f"{path}: holds some wheels only, and {before}, which holds the others, is not there")
    return None


def _unrecorded(run: RecordingRun) -> list[EncodedMessage]:
    """Return the outputs that the recording does not hold.

    These are those after the last one that it does, by topic; where something in the middle is damaged, by content.
    """
    if run.recording.problems:
        present = {(message.topic, message.payload) for message in run.recording.messages}
        return [output for output in run.outputs if (output.topic, output.payload) not in present]
    held = Counter(message.topic for message in run.own)
    missing = []
    for output in run.outputs:
        if held[output.topic] > 0:
            held[output.topic] -= 1
        else:
            missing.append(output)
    return missing


def _earlier_diagnoses(paths: Sequence[Path]) -> list[EncodedMessage]:
    """Return the diagnoses in the recordings before the last one, latest first in `paths`, as far as is worth it."""
    found: list[EncodedMessage] = []
    size = 0
    for path in paths:
        try:
            size += path.stat().st_size
            if size > REPEATED_BYTES:
                break
            found = [*(part for part in Recording(path).parts() if _is_diagnosis(part)), *found]
        except (OSError, InputError):  # a replay reports a damaged file; here it only repeats less
            break
    return found


def _is_diagnosis(part: Attached | EncodedMessage) -> TypeGuard[EncodedMessage]:
    return isinstance(part, EncodedMessage) and part.schema == Diagnosis.schema_name()
