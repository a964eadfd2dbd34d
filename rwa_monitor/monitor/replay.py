"""Reruns recordings: to recover the state of a monitor that starts, and to check that diagnoses are reproduced.

A replay runs given recordings; a monitor that starts continues from those that an earlier run left in its folder.
Messages are compared in order: lengths, types, bytes, then field by field with a tolerance.
"""

import json
import math
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from threading import Event
from typing import Any, Final

import zenoh
from mcap.records import Attachment

from rwa_monitor import messages
from rwa_monitor.errors import InputError
from rwa_monitor.messages import Changepoints, Diagnosis, Discrepancy, EncodedMessage, Health, SamplesMessage, Status
from rwa_monitor.monitor.bus import messages_publisher, paced
from rwa_monitor.monitor.checkpoint import Checkpoint
from rwa_monitor.monitor.core import Carried, WheelCore, outputs_of
from rwa_monitor.monitor.recorder import Predecessor, predecessor_of
from rwa_monitor.monitor.recording import (
    CHECKPOINT_PREFIX,
    MAX_FILE_BYTES,
    RECORDING_SUFFIX,
    Recording,
    file_sha256,
    recorded_inputs,
    recordings_of,
    time_span,
)
from rwa_monitor.monitor.searches import job_of, search
from rwa_monitor.monitor.setup import Setup, key_of_name
from rwa_monitor.words import Log, counted, first_few

# Messages that a replay must reproduce; health follows from the diagnosis, status contains the wall clock.
COMPARED_SCHEMAS: Final = (Changepoints.schema_name(), Diagnosis.schema_name(), Carried.schema_name())
REPEATED_SCHEMAS: Final = (Diagnosis.schema_name(), Health.schema_name())
KEPT_SCHEMAS: Final = (*COMPARED_SCHEMAS, Health.schema_name(), Discrepancy.schema_name())
# Called with the recording and each checkpoint and message of it when that has been processed.
OnProgress = Callable[[Recording, Attachment | EncodedMessage], None]


@dataclass(slots=True)
class RecordingRun:
    """A recording that was rerun.

    Attributes
    ----------
    recording
        With all attachments except checkpoints, and the messages of `KEPT_SCHEMAS`.
    cores
        By (spacecraft, wheel), in their state after the last input.
    outputs
        The outputs for the inputs (`COMPARED_SCHEMAS`), in order.
    inputs
        Number of messages of samples processed.
    inherited, own
        The recorded outputs (`COMPARED_SCHEMAS`): those before the first input, for inputs of the predecessor, and the
        others.
    """

    recording: Recording
    cores: dict[tuple[str, str], WheelCore]
    outputs: list[EncodedMessage] = field(default_factory=list)
    inputs: int = 0
    inherited: list[EncodedMessage] = field(default_factory=list)
    own: list[EncodedMessage] = field(default_factory=list)


def run_recording(path: Path, stop: Event, on_progress: OnProgress, before: RecordingRun | None = None) -> RecordingRun:
    """Run a recording while it is read, so that its checkpoints and samples are not kept in memory.

    Parameters
    ----------
    path
        The recording.
    stop
        Ends it early when set.
    on_progress
        Called after each checkpoint and message.
    before
        The run of the previous recording, where this one holds the state of some wheels only.

    Raises
    ------
    InputError
        If the recording cannot be read, or has no wheel or model attached; if a checkpoint or an input is damaged.
    """
    recording = Recording(path)
    run = RecordingRun(recording, before.cores if before else {})
    setup: Setup | None = None
    kept_bytes = 0
    for part in recording.parts():
        if stop.is_set():
            break
        if isinstance(part, Attachment) and not part.name.startswith(CHECKPOINT_PREFIX):
            recording.attachments[part.name] = part.data
            continue
        # The recorder writes wheels and model before anything else.
        setup = setup or Setup.of(recording)
        if isinstance(part, Attachment):
            key = key_of_name(part.name.removeprefix(CHECKPOINT_PREFIX).removesuffix(".json"))
            checkpoint = Checkpoint.from_json(part.data, f"{path}: {part.name}")
            run.cores[key] = WheelCore.resume(checkpoint, setup.wheel(*key), setup.model)
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
    key = messages.split_key(recorded.topic)[:2]
    message = SamplesMessage.parse(recorded.payload, f"{path}: {recorded.topic}")
    if key not in run.cores:
        run.cores[key] = setup.new_core(*key)
    events = run.cores[key].feed(message.samples(), message.publisher, message.batch, message.data)
    run.inputs += 1
    run.outputs += [output for output in outputs_of(events, *key) if output.schema in COMPARED_SCHEMAS]


# ---- the state from the recordings of a folder -----------------------------------------------------------------------


# Size of recordings whose diagnoses are published again at a start: an outage may have begun before several crashes.
REPEATED_BYTES: Final = 64 * 2**20


@dataclass(slots=True)
class RecoveredState:
    """The state that the recordings of a folder hold.

    Attributes
    ----------
    predecessor
        The last recording.
    cores
        In their state after its last input, except those of wheels whose wheel file or model has changed since.
    statuses
        The last recorded status of each wheel, by topic.
    unrecorded
        Outputs for its inputs that had not reached the disk.
    diagnoses
        Recorded diagnoses with their health, of the last recordings, in order: they may not have reached the bus, and
        late subscribers ask for them.
    """

    predecessor: Predecessor | None = None
    cores: dict[tuple[str, str], WheelCore] = field(default_factory=dict)
    statuses: dict[str, EncodedMessage] = field(default_factory=dict)
    unrecorded: list[EncodedMessage] = field(default_factory=list)
    diagnoses: list[EncodedMessage] = field(default_factory=list)


def recover_state(folder: Path, setup: Setup, stop: Event, log: Log) -> RecoveredState:
    """Recover the cores from the last recording of a folder that can be used; incomplete when stopped.

    Parameters
    ----------
    folder
        Of the recordings.
    setup
        Wheels and model of the monitor that starts.
    stop
        Ends it early when set.
    log
        Takes lines of the log; a large fleet takes minutes, with a line every `LOG_PERIOD_S`.
    """
    paths = sorted(folder.glob(f"*{RECORDING_SUFFIX}"), reverse=True)
    recovered = RecoveredState(predecessor_of(paths[0]) if paths else None)
    due_s = time.monotonic() + messages.LOG_PERIOD_S

    def on_part(recording: Recording, part: Attachment | EncodedMessage) -> None:
        nonlocal due_s
        if isinstance(part, EncodedMessage) and part.schema == Status.schema_name():
            recovered.statuses[part.topic] = part
        if time.monotonic() >= due_s:
            due_s = time.monotonic() + messages.LOG_PERIOD_S
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
            log(f"{path} was made with another wheel file or model of {first_few(anew)}: begun anew")
        recovered.diagnoses = _earlier_diagnoses(paths[place + len(runs) :])
        for run in runs:
            for problem in run.recording.problems:
                log(f"{run.recording.path}: {problem}")
            recovered.unrecorded += _unrecorded(run)
            recovered.diagnoses += _repeated(run.recording.messages)
        log(f"going on from {path}: {counted(len(recovered.cores), 'wheel')}, {counted(inputs, 'message')}")
        return recovered
    return recovered


def _needed_before(path: Path, settings: dict[str, Any], earlier: Sequence[Path], log: Log) -> Path | None:
    """Return the previous recording if this one holds the state of some wheels only; None if it holds all.

    A monitor that ended while it moved the wheels from one recording to the next left two such files.
    """
    if settings.get("checkpoints") != "some":
        return None
    before = (settings.get("predecessor") or {}).get("name")
    if earlier and earlier[0].name == before:
        return earlier[0]
    log(f"{path}: holds some wheels only, and {before}, which holds the others, is not there")
    return None


def _unrecorded(run: RecordingRun) -> list[EncodedMessage]:
    """Return the outputs that the recording does not hold.

    On each topic these are the outputs beyond the number recorded; if part of the recording is damaged, outputs are
    compared by content.
    """
    if run.recording.problems:
        present = {(message.topic, message.payload) for message in run.recording.messages}
        return [output for output in run.outputs if (output.topic, output.payload) not in present]
    held = Counter(message.topic for message in run.own)
    missing = []
    for output in run.outputs:
        held[output.topic] -= 1
        if held[output.topic] < 0:
            missing.append(output)
    return missing


def _earlier_diagnoses(paths: Sequence[Path]) -> list[EncodedMessage]:
    """Return the diagnoses in earlier recordings (`paths`, latest first), of at most `REPEATED_BYTES` of them."""
    found: list[EncodedMessage] = []
    size = 0
    for path in paths:
        try:
            size += path.stat().st_size
            if size > REPEATED_BYTES:
                break
            found = [*_repeated(Recording(path).parts()), *found]
        except (OSError, InputError):  # a replay reports a damaged file; here fewer diagnoses are published again
            break
    return found


def _repeated(parts: Iterable[Attachment | EncodedMessage]) -> list[EncodedMessage]:
    return [part for part in parts if isinstance(part, EncodedMessage) and part.schema in REPEATED_SCHEMAS]


# ---- comparing -------------------------------------------------------------------------------------------------------


# The same code on another machine: its vector units may sum in another order, which changes the last bits.
RELATIVE_TOLERANCE: Final = 1e-9
# A difference of large numbers can be zero but for rounding; no torque, time or probability reported is as small.
ABSOLUTE_TOLERANCE: Final = 1e-15
# Fields that count for `bytes_equal` only, with the reason: a hash of floats has no tolerance.
HASHES_OF_WHAT_IS_COMPARED: Final = {
    "provenance.prior_sha256": "the state that it hashes is compared as rwa.Carried",
    "sha256": "the state beside it in rwa.Carried is compared",
}
ABSENT: Final = object()  # placeholder for a field that one of two messages lacks
MAX_DIFFERENCES: Final = 10_000  # listed; further ones are only counted


def differences(left: Any, right: Any, path: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Yield (path, left, right) wherever two JSON values differ by more than 1e-9 relative."""
    if isinstance(left, dict) and isinstance(right, dict):
        pairs = [(key, left.get(key, ABSENT), right.get(key, ABSENT)) for key in {**left, **right}]
    elif isinstance(left, list) and isinstance(right, list):
        if len(left) != len(right):
            yield f"{path}.length" if path else "length", len(left), len(right)
        pairs = [(str(position), *both) for position, both in enumerate(zip(left, right, strict=False))]
    else:
        if not _agree(left, right):
            yield path, left, right
        return
    for key, one, other in pairs:
        yield from differences(one, other, f"{path}.{key}" if path else key)


def _agree(left: Any, right: Any) -> bool:
    if {type(left), type(right)} in ({float}, {int, float}):  # counts, slots and times are exact
        return left == right or math.isclose(left, right, rel_tol=RELATIVE_TOLERANCE, abs_tol=ABSOLUTE_TOLERANCE)
    return type(left) is type(right) and bool(left == right)


def _parse(payload: bytes) -> Any:
    try:
        return json.loads(payload)
    except (ValueError, RecursionError):
        return f"no JSON: {payload[:40]!r}"


def _short(value: Any) -> str:
    text = "nothing" if value is ABSENT else json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 80 else f"{text[:77]}..."


# ---- the replay ------------------------------------------------------------------------------------------------------


@dataclass(slots=True)
class Report:
    """The result of a replay.

    Attributes
    ----------
    files
        Recordings read, in chain order.
    compared
        Messages compared, by type name ("rwa.Diagnosis", "rwa.Changepoints").
    differences
        Differences beyond the tolerance, and links of the chain that are broken, a line each.
    fields
        Their number by field, without positions in lists; that of broken links as "chain".
    bytes_equal
        Whether every compared message has equal bytes.
    unreadable
        Parts of the files that could not be read, a line each.
    notes
        Remarks, such as "holds no closed window".
    messages
        The replayed outputs (topic, JSON bytes), in order.
    """

    files: list[Path] = field(default_factory=list)
    compared: Counter[str] = field(default_factory=Counter)
    differences: list[str] = field(default_factory=list)
    fields: Counter[str] = field(default_factory=Counter)
    bytes_equal: bool = True
    unreadable: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    messages: list[tuple[str, bytes]] = field(default_factory=list)
    _lost_tail: list[EncodedMessage] = field(default_factory=list)  # outputs lost with the end of the previous file

    def _add(self, name: str, line: str) -> None:
        """Count a difference by its field, and keep its line."""
        self.bytes_equal = False
        self.fields[name] += 1
        if len(self.differences) < MAX_DIFFERENCES:
            self.differences.append(line)

    def _differ(self, message: str, path: str, recorded: str, replayed: str) -> None:
        """Add one field that differs: which message, where in it, and both values."""
        name = ".".join(part for part in path.split(".") if not part.isdigit())
        self._add(name, f"{message}: {path}: recorded {recorded}, replayed {replayed}")

    def compare(self, recorded: Sequence[EncodedMessage], replayed: Sequence[EncodedMessage]) -> None:
        """Compare recorded with replayed messages, in order."""
        if len(recorded) != len(replayed):
            self._differ("all messages", "length", str(len(recorded)), str(len(replayed)))
        for position, (old, new) in enumerate(zip(recorded, replayed, strict=False)):
            name = f"{old.topic} ({position})"
            if (old.topic, old.schema) != (new.topic, new.schema):
                self._differ(name, "type", f"{old.schema} on {old.topic}", f"{new.schema} on {new.topic}")
                break  # the messages that follow do not correspond
            self.compared[old.schema] += 1
            if old.payload == new.payload:
                continue
            self.bytes_equal = False
            for path, left, right in differences(_parse(old.payload), _parse(new.payload)):
                if path not in HASHES_OF_WHAT_IS_COMPARED:
                    self._differ(name, path, _short(left), _short(right))

    @property
    def equal(self) -> bool:
        """True when nothing differs beyond 1e-9 relative, and there was something to compare."""
        return not self.differences and sum(self.compared.values()) > 0

    def short(self) -> str:
        """Return the short report: a few lines, differences counted per field."""
        listed = sorted(self.fields.items(), key=lambda item: (-item[1], item[0]))
        return "\n".join((self._summary(), *(f"  {count} × {name}" for name, count in listed)))

    def long(self) -> str:
        """Return the long report: every difference."""
        return "\n".join((self._summary(), *(f"  {line}" for line in self.differences)))

    def _summary(self) -> str:
        what = ", ".join(f"{count} {name}" for name, count in sorted(self.compared.items())) or "nothing"
        files = counted(len(self.files), "file")
        if not self.compared:
            result = "nothing could be compared"
        elif self.differences:
            result = counted(self.fields.total(), "difference")
        else:
            result = "equal, byte for byte" if self.bytes_equal else "equal to 1e-9 relative, bytes differ"
        return f"{files}: {what} compared: {result}"

    # ---- recordings of a chain ------------------------------------------------------------------------------------

    def run(self, path: Path, on_progress: OnProgress) -> None:
        """Run the next recording of the chain and compare."""
        done = run_recording(path, Event(), on_progress)
        recording = done.recording
        settings, setup = recording.settings(), Setup.of(recording)
        self._check_link(recording, settings)
        self.unreadable += [f"{recording.path}: {problem}" for problem in recording.problems]
        published = [output for output in done.outputs if output.schema != Carried.schema_name()]
        self.messages += [(output.topic, output.payload) for output in published]

        inherited, own, replayed = done.inherited, done.own, done.outputs
        if settings.get("checkpoints") == "some":  # it was begun while the previous file was being written
            self._note(recording, "holds the wheels that had come over from the file before it when the monitor ended")
        elif self.files and inherited:
            self.compare(inherited, self._lost_tail)
            self._lost_tail = []
        elif self._lost_tail:
            self._note(recording, f"begins after {len(self._lost_tail)} outputs that were lost with the file before it")
            self._lost_tail = []
        if not recording.finished:
            self._note(recording, "was not closed in order")
            replayed, lost = replayed[: len(own)], replayed[len(own) :]
            self._lost_tail += lost
        self.compare(own, replayed)

        self._search_again(recording, setup)
        if not any(message.schema == Diagnosis.schema_name() for message in recording.messages):
            self._note(recording, f"holds no closed window ({counted(done.inputs, 'message')} of samples)")
        self.files.append(recording.path)

    def _search_again(self, recording: Recording, setup: Setup) -> None:
        """Repeat the discrepancy searches whose reports are recorded, and compare by content."""
        for message in recording.messages:
            if message.schema == Discrepancy.schema_name():
                report = Discrepancy.parse(message.payload, f"{recording.path}: {message.topic}")
                again, _ = search(job_of(report, self._inputs_of(report, recording.path), setup))
                self.compare([message], [message._replace(payload=again.to_json())])

    def _inputs_of(self, report: Discrepancy, path: Path) -> Iterator[EncodedMessage]:
        """Return the messages of samples in the files so far, except files that end before a report begins."""
        spans = ((file, time_span(file)) for file in (*self.files, path))
        return recorded_inputs([file for file, span in spans if span and span[1] >= report.start_ns])

    def _check_link(self, recording: Recording, settings: dict[str, Any]) -> None:
        """Check that a recording names the file before it as its predecessor, and that file's hash."""
        named = settings.get("predecessor")
        if not isinstance(named, dict):
            if self.files:
                self._note(recording, f"names no predecessor, {self.files[-1].name} comes before it")
            return
        name, sha256 = str(named.get("name", "")), named.get("sha256", "")
        if not self.files:
            self._note(recording, f"goes on from {name}, which is not replayed")
        elif (before := self.files[-1]).name != name:
            self._add("chain", f"{recording.path}: goes on from {name}, but {before.name} comes before it")
        elif sha256 is None:
            self._note(recording, f"was begun while {name} was written, and does not hold its hash")
        elif sha256 != file_sha256(before):
            self._add("chain", f"{before}: is not the file that {recording.path.name} goes on from")

    def _note(self, recording: Recording, text: str) -> None:
        self.notes.append(f"{recording.path}: {text}")


def replay(recordings: Path | Sequence[Path], on_progress: OnProgress = lambda *_: None) -> Report:
    """Rerun the core on recordings (a file, a folder as a chain, or several files), and compare the outputs.

    Exit codes on the command line: with --verify 1 unless `report.equal`; with --exact also unless
    `report.bytes_equal`; 3 where `report.unreadable` is not empty and the rest agrees.

    Parameters
    ----------
    recordings
        A file, a folder whose recordings form a chain, or several files in order.
    on_progress
        As for `run_recording`.

    Raises
    ------
    InputError
        If a path is no recording, or its attachments cannot be used.
    """
    report = Report()
    for path in recordings_of(recordings):
        report.run(path, on_progress)
    return report


# ---- onto the bus ----------------------------------------------------------------------------------------------------


def replay_to_bus(
    recordings: Path | Sequence[Path],
    session: zenoh.Session,
    *,
    speed: float = 1.0,
    stop: Event,
) -> int:
    """Publish a recording's inputs on the bus again, as they arrived, paced by their recorded time.

    They are published under their wheel's name with `REPLAY` appended, so as not to be mistaken for live samples.

    Parameters
    ----------
    recordings
        As for `replay`.
    session
        An open Zenoh session.
    speed
        Times faster than real time; `math.inf` for as fast as the bus takes it.
    stop
        Ends it early when set.

    Returns
    -------
    int
        Messages published.

    Raises
    ------
    InputError
        If a path is no recording.
    """
    publishers: dict[str, Any] = {}
    sent = 0
    inputs = ((message.time_ns, message.topic, message.payload) for message in recorded_inputs(recordings))
    with ExitStack() as stack:
        for topic, payload in paced(inputs, speed, stop):
            if topic not in publishers:
                publishers[topic] = messages_publisher(session, messages.replay_key(topic))
                stack.callback(publishers[topic].undeclare)
            publishers[topic].put(payload)
            sent += 1
        stop.wait(messages.PERIOD_S)  # closing right after the last message may lose it
    return sent
