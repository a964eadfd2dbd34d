"""State recovery: monitor cores as a recording's checkpoints and inputs make them again.

A replay runs single recordings; a monitor that starts goes on from those that an earlier run left in its folder.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from threading import Event
from typing import Final

from rwa_monitor.errors import InputError
from rwa_monitor.messages import Changepoints, Diagnosis, Discrepancy, SamplesMessage, split_key
from rwa_monitor.monitor.checkpoint import Checkpoint
from rwa_monitor.monitor.core import WheelCore
from rwa_monitor.monitor.events import Carried, Output, outputs_of
from rwa_monitor.monitor.recording.reader import (
    CHECKPOINT_PREFIX,
    RECORDING_SUFFIX,
    SOME_CHECKPOINTS,
    Attached,
    PassingRecording,
    RecordedMessage,
    Recording,
)
from rwa_monitor.monitor.recording.recorder import Predecessor, predecessor_of
from rwa_monitor.monitor.setup import Setup, key_of_name
from rwa_monitor.words import counted, first_few

# What a replay must give again; health follows from the diagnosis, status has the wall clock in it.
COMPARED_SCHEMAS: Final = (Changepoints.schema_name(), Diagnosis.schema_name(), Carried.schema_name())
KEPT_SCHEMAS: Final = (*COMPARED_SCHEMAS, Discrepancy.schema_name())
Comparable = tuple[str, str, bytes]  # topic, schema, JSON
MAX_KEPT_BYTES: Final = 2**30  # of messages of these, of a recording


@dataclass(slots=True)
class RecordingRun:
    """A recording, run again.

    Attributes
    ----------
    cores
        By (spacecraft, wheel), as they stand after the last input.
    outputs
        The outputs for the inputs, changepoints and diagnoses, in order.
    inputs
        Messages of samples processed.
    inherited, own
        The outputs that the recording holds: those before the first input are for inputs of its predecessor.
    """

    cores: dict[tuple[str, str], WheelCore] = field(default_factory=dict)
    outputs: list[Output] = field(default_factory=list)
    inputs: int = 0
    inherited: list[Comparable] = field(default_factory=list)
    own: list[Comparable] = field(default_factory=list)


def run_recording(
    passing: PassingRecording,
    stop: Event,
    on_progress: Callable[[Attached | RecordedMessage], None],
    before: RecordingRun | None = None,
) -> RecordingRun:
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
    recording, run = passing.recording, RecordingRun(before.cores if before else {})
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
            key = key_of_name(part.name.removeprefix(CHECKPOINT_PREFIX).removesuffix(".json"))
            checkpoint = Checkpoint.from_json(part.data, f"{recording.path}: {part.name}")
            run.cores[key] = WheelCore.resume(checkpoint, setup.wheels.of(*key), setup.model, method=setup.method)
        else:
            _run_input(recording.path, part, setup, run)
            if part.schema in KEPT_SCHEMAS:
                kept_bytes += len(part.data)
                if kept_bytes > MAX_KEPT_BYTES:
                    reason = f"holds more than {MAX_KEPT_BYTES:,} bytes of outputs"
                    raise InputError(str(recording.path), reason)
                recording.messages.append(part)
            if part.schema in COMPARED_SCHEMAS:
                (run.own if run.inputs else run.inherited).append((part.topic, part.schema, part.data))
        on_progress(part)
    return run


def _run_input(path: Path, recorded: RecordedMessage, setup: Setup, run: RecordingRun) -> None:
    """Feed a message to its core where it is one of samples."""
    if recorded.schema != SamplesMessage.schema_name():
        return
    spacecraft, wheel, _ = split_key(recorded.topic)
    message = SamplesMessage.parse(recorded.data, f"{path}: {recorded.topic}")
    if (spacecraft, wheel) not in run.cores:
        run.cores[spacecraft, wheel] = setup.new_core(spacecraft, wheel)
    events = run.cores[spacecraft, wheel].feed(message.samples(), message.publisher, message.batch)
    run.inputs += 1
    run.outputs += [output for output in outputs_of(events, spacecraft, wheel) if output.schema in COMPARED_SCHEMAS]


# ---- from the recordings of a folder ---------------------------------------------------------------------------------


# How far back diagnoses are published again at a start: an outage may have begun before several crashes.
REPEATED_FILES: Final = 16
REPEATED_BYTES: Final = 64 * 2**20
PROGRESS_S: Final = 5.0  # between two lines on the progress of a recovery
MAX_LISTED: Final = 5  # names in one line of the log


@dataclass(slots=True)
class RecoveredState:
    """The state that the recordings of a folder hold.

    Attributes
    ----------
    predecessor
        The last recording.
    cores
        As they stood after its last input; without those whose wheel file, model or method is another one now.
    unrecorded
        Outputs of its inputs that had not reached the disk.
    diagnoses
        On the disk, of the last recordings, in order: they may not have reached the bus, and a late subscriber asks.
    """

    predecessor: Predecessor | None = None
    cores: dict[tuple[str, str], WheelCore] = field(default_factory=dict)
    unrecorded: list[Output] = field(default_factory=list)
    diagnoses: list[Output] = field(default_factory=list)


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
    for place, path in enumerate(paths):
        try:
            ran = _run([path], stop, log)
            files = _with_the_one_before(paths[place:], ran[0][0], log)
            if len(files) > 1:
                ran = _run(files, stop, log)
            setup_then = Setup.of(ran[-1][0])
        except InputError as error:
            log(f"{error}; going back to the recording before it")
            continue
        cores, inputs = ran[-1][1].cores, sum(run.inputs for _, run in ran)
        recovered.cores = {
            key: core for key, core in cores.items() if setup_then.identity_of(*key) == setup.identity_of(*key)
        }
        if anew := sorted(f"{spacecraft}/{wheel}" for spacecraft, wheel in cores.keys() - recovered.cores.keys()):
            wheels = first_few(anew, MAX_LISTED)
            log(f"{path} was made with another wheel file, model or method of {wheels}: begun anew")
        recovered.diagnoses = _earlier_diagnoses(paths[place + len(files) :])
        for recording, run in ran:
            for problem in recording.problems:
                log(f"{recording.path}: {problem}")
            recovered.unrecorded += _unrecorded(recording, run)
            recovered.diagnoses += _diagnoses(recording.path, recording.messages)
        log(f"going on from {path}: {counted(len(recovered.cores), 'wheel')}, {counted(inputs, 'message')}")
        return recovered
    return recovered


def _with_the_one_before(paths: Sequence[Path], recording: Recording, log: Callable[[str], None]) -> list[Path]:
    """Return the recordings, in order, that hold the state of all wheels: the first of `paths`, and often it alone.

    A monitor that ended while it brought the wheels from one recording over into the next left two.
    """
    settings = recording.settings()
    if settings.get("checkpoints") != SOME_CHECKPOINTS:
        return [paths[0]]
    before = (settings.get("predecessor") or {}).get("name")
    if len(paths) > 1 and paths[1].name == before:
        return [paths[1], paths[0]]
    log(f"{paths[0]}: holds some wheels only, and {before}, which holds the others, is not there")
    return [paths[0]]


def _run(files: Sequence[Path], stop: Event, log: Callable[[str], None]) -> list[tuple[Recording, RecordingRun]]:
    """Run recordings, each on the cores of the one before it, and log the progress of a long run."""
    due_s = time.monotonic() + PROGRESS_S

    def on_part(passing: PassingRecording, _part: object) -> None:
        nonlocal due_s
        if time.monotonic() >= due_s:
            due_s = time.monotonic() + PROGRESS_S
            log(f"recovering the state from {passing.recording.path}: {passing.share:.0%} of it done")

    ran: list[tuple[Recording, RecordingRun]] = []
    for passing in map(PassingRecording, files):
        run = run_recording(passing, stop, partial(on_part, passing), ran[-1][1] if ran else None)
        ran.append((passing.recording, run))
    return ran


def _unrecorded(recording: Recording, run: RecordingRun) -> list[Output]:
    """Return the outputs that the recording does not hold.

    These are those after the last one that it does, by topic; where something in the middle is damaged, by content.
    """
    if recording.problems:
        present = {(message.topic, message.data) for message in recording.messages}
        return [output for output in run.outputs if (output.key, output.payload) not in present]
    held = Counter(topic for topic, _, _ in run.own)
    missing = []
    for output in run.outputs:
        if held[output.key] > 0:
            held[output.key] -= 1
        else:
            missing.append(output)
    return missing


def _earlier_diagnoses(paths: Sequence[Path]) -> list[Output]:
    """Return the diagnoses in the recordings before the last one, latest first in `paths`, as far as is worth it."""
    found: list[Output] = []
    size = 0
    for path in paths[:REPEATED_FILES]:
        try:
            size += path.stat().st_size
            if size > REPEATED_BYTES:
                break
            found = [*_diagnoses(path, PassingRecording(path).parts()), *found]
        except (OSError, InputError):  # a replay reports a damaged file; here it only repeats less
            break
    return found


def _diagnoses(path: Path, parts: Iterable[Attached | RecordedMessage]) -> list[Output]:
    """Return the diagnoses in a recording, in order."""
    return [
        Output(
            part.topic,
            Diagnosis,
            part.data,
            Diagnosis.parse(part.data, f"{path}: {part.topic}").window_end_ns,
        )
        for part in parts
        if isinstance(part, RecordedMessage) and part.schema == Diagnosis.schema_name()
    ]
