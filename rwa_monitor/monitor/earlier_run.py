"""What an earlier run of the monitor left behind in its recordings, and where a new one goes on."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from threading import Event
from typing import Final

from rwa_monitor.errors import InputError
from rwa_monitor.messages import Diagnosis
from rwa_monitor.monitor import state_recovery
from rwa_monitor.monitor.core import WheelCore
from rwa_monitor.monitor.outputs import Output
from rwa_monitor.monitor.recording.chain import RECORDING_SUFFIX
from rwa_monitor.monitor.recording.reader import (
    SOME_CHECKPOINTS,
    PassingRecording,
    RecordedMessage,
    Recording,
    last_settings,
)
from rwa_monitor.monitor.recording.recorder import Predecessor, predecessor_of
from rwa_monitor.words import counted, first_few

# How far back diagnoses are published again at a start: an outage may have begun before several crashes.
REPEATED_FILES: Final = 16
REPEATED_BYTES: Final = 64 * 2**20
TELL_S: Final = 5.0  # between two words about how far the rebuilding has come
MAX_LISTED: Final = 5  # names in one line of talk


@dataclass(slots=True)
class Past:
    """What the recordings of a folder tell.

    Attributes
    ----------
    predecessor
        The last recording.
    cores
        As they stood after its last input; without those whose wheel file, model or method is another one now.
    unrecorded
        Outputs of its inputs that had not reached the disk.
    diagnoses
        On the disk, of the last recordings, in order: the bus may not have heard them, and a late subscriber asks.
    """

    predecessor: Predecessor | None = None
    cores: dict[tuple[str, str], WheelCore] = field(default_factory=dict)
    unrecorded: list[Output] = field(default_factory=list)
    diagnoses: list[Output] = field(default_factory=list)


def read_past(
    folder: Path,
    setup: state_recovery.Setup,
    stop: Event,
    say: Callable[[str], None],
    on_progress: Callable[[], None] = lambda: None,
) -> Past:
    """Rebuild the cores from the last recording of a folder that can be used; incomplete when stopped.

    Parameters
    ----------
    folder
        Of the recordings.
    setup
        What the monitor goes on with.
    stop
        Ends it early when set.
    say
        Takes lines of talk; a large fleet takes minutes, of which it hears every `TELL_S`.
    on_progress
        Called often, for a supervisor that waits.
    """
    past = Past()
    paths = sorted(folder.glob(f"*{RECORDING_SUFFIX}"), reverse=True)
    for place, path in enumerate(paths):
        try:
            files = _that_hold_all(paths[place:], say)
            if past.predecessor is None:
                past.predecessor = _predecessor(files)
            ran = _run(files, stop, say, on_progress)
            setup_then = state_recovery.Setup.of(ran[-1][0])
        except InputError as error:
            if past.predecessor is None:
                past.predecessor = predecessor_of(path)
            say(f"{error}; going back to the recording before it")
            continue
        cores, inputs = ran[-1][1].cores, sum(rebuilt.inputs for _, rebuilt in ran)
        past.cores = _same(cores, setup_then, setup)
        if anew := sorted(f"{spacecraft}/{wheel}" for spacecraft, wheel in cores.keys() - past.cores.keys()):
            wheels = first_few(anew, MAX_LISTED)
            say(f"{path} was made with another wheel file, model or method of {wheels}: begun anew")
        past.diagnoses = _earlier_diagnoses(paths[place + len(files) :])
        for recording, rebuilt in ran:
            for problem in recording.problems:
                say(f"{recording.path}: {problem}")
            past.unrecorded += _unrecorded(recording, rebuilt.outputs)
            past.diagnoses += _diagnoses(recording)
        say(f"going on from {path}: {counted(len(past.cores), 'wheel')}, {counted(inputs, 'message')}")
        return past
    return past


def _that_hold_all(paths: Sequence[Path], say: Callable[[str], None]) -> list[Path]:
    """Return the recordings, in order, that hold the state of all wheels: the first of `paths`, and often it alone.

    A monitor that ended while it brought the wheels from one recording over into the next left two.
    """
    last = paths[0]
    settings = last_settings(last)
    if settings.get("checkpoints") != SOME_CHECKPOINTS:
        return [last]
    before = (settings.get("predecessor") or {}).get("name")
    if len(paths) > 1 and paths[1].name == before:
        return [paths[1], last]
    say(f"{last}: holds some wheels only, and {before}, which holds the others, is not there")
    return [last]


def _predecessor(files: Sequence[Path]) -> Predecessor:
    rest = predecessor_of(files[0]) if len(files) > 1 else None
    return predecessor_of(files[-1], rest)


def _run(
    files: Sequence[Path], stop: Event, say: Callable[[str], None], on_progress: Callable[[], None]
) -> list[tuple[Recording, state_recovery.Rebuilt]]:
    """Run recordings, each on the cores of the one before it."""
    ran: list[tuple[Recording, state_recovery.Rebuilt]] = []
    for path in files:
        passing = PassingRecording(path)
        look = _Teller(passing, say, on_progress).look
        ran.append((passing.recording, state_recovery.run_passing(passing, stop, look, ran[-1][1] if ran else None)))
    return ran


class _Teller:
    """Says how far a long rebuilding has come."""

    def __init__(self, passing: PassingRecording, say: Callable[[str], None], on_progress: Callable[[], None]) -> None:
        self._passing = passing
        self._say = say
        self._on_progress = on_progress
        self._due_s = time.monotonic() + TELL_S

    def look(self, _part: object) -> None:
        """Say it where it is due."""
        self._on_progress()
        if time.monotonic() >= self._due_s:
            self._due_s = time.monotonic() + TELL_S
            self._say(f"rebuilding the state from {self._passing.recording.path}: {self._passing.share:.0%} of it done")


def _same(
    cores: dict[tuple[str, str], WheelCore], before: state_recovery.Setup, now: state_recovery.Setup
) -> dict[tuple[str, str], WheelCore]:
    """Return the cores whose diagnoses depend on nothing that has changed."""
    return {key: core for key, core in cores.items() if before.identity_of(*key) == now.identity_of(*key)}


def _unrecorded(recording: Recording, outputs: list[Output]) -> list[Output]:
    """Return the outputs that the recording does not hold.

    These are those after the last one that it does, by topic; where something in the middle is damaged they are told by
    their content.
    """
    if recording.problems:
        present = {(message.topic, message.data) for message in recording.messages}
        return [output for output in outputs if (output.key, output.payload) not in present]
    held: dict[str, int] = {}
    for message in recording.messages:
        if message.schema in state_recovery.COMPARED_SCHEMAS:
            held[message.topic] = held.get(message.topic, 0) + 1
    for topic, count in state_recovery.inherited_counts(recording.settings()).items():
        held[topic] = held.get(topic, 0) - count
    missing = []
    for output in outputs:
        if held.get(output.key, 0) > 0:
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
            found = [*_diagnoses_in(path), *found]
        except (OSError, InputError):  # a damaged file was or will be told of by a replay; here it only repeats less
            break
    return found


def _diagnoses_in(path: Path) -> list[Output]:
    """Return the diagnoses of a recording of which nothing else is kept."""
    passing = PassingRecording(path)
    for part in passing.parts():
        if isinstance(part, RecordedMessage) and part.schema == Diagnosis.schema_name():
            passing.recording.messages.append(part)
    return _diagnoses(passing.recording)


def _diagnoses(recording: Recording) -> list[Output]:
    """Return the diagnoses of a recording, in order."""
    return [
        Output(
            message.topic,
            Diagnosis,
            message.schema,
            message.data,
            Diagnosis.parse(message.data, f"{recording.path}: {message.topic}").window_end_ns,
        )
        for message in recording.messages
        if message.schema == Diagnosis.schema_name()
    ]
