"""Replays recordings: the same core on the recorded inputs must give the recorded diagnoses.

Messages are compared in order: lengths, types, bytes, then field by field with a tolerance.
"""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from threading import Event
from typing import Any, Final

from rwa_monitor.messages import Diagnosis, Discrepancy, EncodedMessage
from rwa_monitor.monitor.events import Carried
from rwa_monitor.monitor.recording.reader import (
    SOME_CHECKPOINTS,
    Attached,
    Recording,
    file_sha256,
    recorded_inputs,
    recordings_of,
    time_span,
)
from rwa_monitor.monitor.searches import job_of, search
from rwa_monitor.monitor.setup import Setup, WheelSet
from rwa_monitor.monitor.state_recovery import run_recording
from rwa_monitor.words import counted

# Same code on another machine: sums may be taken in another order by its vector units, which moves the last bits.
RELATIVE_TOLERANCE: Final = 1e-9
# A difference of large numbers can be zero but for rounding; no torque, time or probability of ours is as small.
ABSOLUTE_TOLERANCE: Final = 1e-15
# Fields that are compared by their bytes only, with the reason: a hash of floats has no tolerance.
HASHES_OF_WHAT_IS_COMPARED: Final = {
    "provenance.prior_sha256": "the state that it hashes is compared as rwa.Carried",
    "sha256": "the state beside it in rwa.Carried is compared",
}
ABSENT: Final = object()  # stands for a field that one of two messages lacks
MAX_DIFFERENCES: Final = 10_000  # listed one by one; the rest is counted


@dataclass(frozen=True, slots=True)
class Difference:
    """One field that differs: which message, where in it, and both values."""

    message: str
    path: str
    recorded: str
    replayed: str

    def __str__(self) -> str:
        """Return one line."""
        return f"{self.message}: {self.path}: recorded {self.recorded}, replayed {self.replayed}"

    @property
    def field(self) -> str:
        """The place without positions in lists, so that like differences count together."""
        return ".".join(part for part in self.path.split(".") if not part.isdigit())


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
    """What a replay found.

    Attributes
    ----------
    files
        Recordings read, in chain order.
    compared
        Messages compared, by type name ("rwa.Diagnosis", "rwa.Changepoints").
    broken
        Links of the chain that do not hold, a line each.
    found
        Differences beyond the tolerance.
    bytes_equal
        True where every compared message has equal bytes.
    unreadable
        What could not be read of the files, in words; empty when whole.
    notes
        Remarks, such as "holds no whole window".
    messages
        The replayed outputs (topic, JSON bytes), in order.
    """

    files: list[Path] = field(default_factory=list)
    compared: Counter[str] = field(default_factory=Counter)
    broken: list[str] = field(default_factory=list)
    found: list[Difference] = field(default_factory=list)
    bytes_equal: bool = True
    unreadable: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    messages: list[tuple[str, bytes]] = field(default_factory=list)

    @property
    def differences(self) -> list[str]:
        """One line per difference beyond the tolerance; empty when all agree."""
        return [*self.broken, *map(str, self.found)]

    @property
    def fields(self) -> Counter[str]:
        """Differences counted by field."""
        return Counter(difference.field for difference in self.found) + Counter(chain=len(self.broken))

    def add(self, difference: Difference) -> None:
        """Note a difference."""
        self.bytes_equal = False
        if len(self.found) < MAX_DIFFERENCES:
            self.found.append(difference)

    def compare(self, recorded: Sequence[EncodedMessage], replayed: Sequence[EncodedMessage]) -> None:
        """Compare recorded with replayed messages, in order."""
        if len(recorded) != len(replayed):
            self.add(Difference("all messages", "length", str(len(recorded)), str(len(replayed))))
        for position, (old, new) in enumerate(zip(recorded, replayed, strict=False)):
            name = f"{old.topic} ({position})"
            if (old.topic, old.schema) != (new.topic, new.schema):
                self.add(Difference(name, "type", f"{old.schema} on {old.topic}", f"{new.schema} on {new.topic}"))
                break  # what follows is out of step
            self.compared[old.schema] += 1
            if old.payload == new.payload:
                continue
            self.bytes_equal = False
            for path, left, right in differences(_parse(old.payload), _parse(new.payload)):
                if path not in HASHES_OF_WHAT_IS_COMPARED:
                    self.add(Difference(name, path, _short(left), _short(right)))

    @property
    def equal(self) -> bool:
        """True when nothing differs beyond 1e-9 relative, and there was something to compare."""
        return not self.differences and sum(self.compared.values()) > 0

    def short(self) -> str:
        """Return the short report: a few lines, differences counted per field."""
        lines = [self._summary()]
        listed = sorted(self.fields.items(), key=lambda item: (-item[1], item[0]))
        return "\n".join((*lines, *(f"  {count} × {name}" for name, count in listed)))

    def long(self) -> str:
        """Return the long report: every difference."""
        return "\n".join((self._summary(), *(f"  {line}" for line in self.differences)))

    def _summary(self) -> str:
        what = ", ".join(f"{count} {name}" for name, count in sorted(self.compared.items())) or "nothing"
        files = counted(len(self.files), "file")
        if not self.compared:
            result = "nothing could be compared"
        elif self.differences:
            result = counted(len(self.differences), "difference")
        else:
            result = "equal, byte for byte" if self.bytes_equal else "equal to 1e-9 relative, bytes differ"
        return f"{files}: {what} compared: {result}"


def replay(recordings: Path | Sequence[Path], on_message: Callable[[int], None] = lambda _: None) -> Report:
    """Re-run the core on a recording (a file, a folder as a chain, or several files) and compare with what it holds.

    Exit codes on the command line: with --verify 1 unless `report.equal`; with --exact also unless
    `report.bytes_equal`; 3 where `report.unreadable` is not empty and the rest agrees.

    Parameters
    ----------
    recordings
        A file, a folder whose recordings form a chain, or several files in order.
    on_message
        Called with the number of messages gone through in the running file, for progress.

    Raises
    ------
    InputError
        If a path is no recording, or its attachments cannot be used.
    """
    chain = _Chain()
    for path in recordings_of(recordings):
        chain.add(path, on_message)
    chain.report.bytes_equal &= not chain.report.broken
    return chain.report


@dataclass(slots=True)
class _Chain:
    """Runs recordings one after the other and gathers their outputs."""

    report: Report = field(default_factory=Report)
    owed: list[EncodedMessage] = field(default_factory=list)  # outputs that the file before was cut too early to hold

    def add(self, path: Path, on_message: Callable[[int], None]) -> None:
        """Run one recording and compare."""
        gone_through = 0

        def count(_recording: Recording, part: Attached | EncodedMessage) -> None:
            nonlocal gone_through
            gone_through += isinstance(part, EncodedMessage)
            on_message(gone_through)

        run = run_recording(path, Event(), count)
        recording = run.recording
        settings, setup = recording.settings(), Setup.of(recording)
        self._check_link(recording, settings)
        self.report.unreadable += [f"{recording.path}: {problem}" for problem in recording.problems]
        published = [output for output in run.outputs if output.schema != Carried.schema_name()]
        self.report.messages += [(output.topic, output.payload) for output in published]

        inherited, own, replayed = run.inherited, run.own, run.outputs
        if settings.get("checkpoints") == SOME_CHECKPOINTS:  # it was begun while the file before was being written
            self._note(recording, "holds the wheels that had come over from the file before it when the monitor ended")
        elif self.report.files and inherited:
            self.report.compare(inherited, self.owed)
            self.owed = []
        elif self.owed:
            self._note(recording, f"begins after {len(self.owed)} outputs that were lost with the file before it")
            self.owed = []
        if not recording.finished:
            self._note(recording, "was not closed in order")
            replayed, lost = replayed[: len(own)], replayed[len(own) :]
            self.owed += lost
        self.report.compare(own, replayed)

        self._search_again(recording, setup.wheels)
        if not any(message.schema == Diagnosis.schema_name() for message in recording.messages):
            self._note(recording, f"holds no closed window ({counted(run.inputs, 'message')} of samples)")
        self.report.files.append(recording.path)

    def _search_again(self, recording: Recording, wheels: WheelSet) -> None:
        """Repeat the discrepancy searches whose reports are recorded, and compare by content."""
        for message in recording.messages:
            if message.schema == Discrepancy.schema_name():
                report = Discrepancy.parse(message.payload, f"{recording.path}: {message.topic}")
                again, _ = search(job_of(report, self._inputs_of(report, recording.path), wheels))
                self.report.compare([message], [message._replace(payload=again.to_json())])

    def _inputs_of(self, report: Discrepancy, path: Path) -> Iterator[EncodedMessage]:
        """Return the messages of samples in the files so far that may hold some of what a report is about."""
        for file in (*self.report.files, path):
            span = time_span(file)
            if span is not None and span[1] >= report.start_ns:
                yield from recorded_inputs(file)

    def _check_link(self, recording: Recording, settings: dict[str, Any]) -> None:
        """Check that a recording names what it goes on from, and that this is as it was then."""
        named = settings.get("predecessor")
        if not isinstance(named, dict):
            if self.report.files:
                self._note(recording, f"names no predecessor, {self.report.files[-1].name} comes before it")
            return
        name, sha256 = str(named.get("name", "")), named.get("sha256", "")
        if not self.report.files:
            self._note(recording, f"goes on from {name}, which is not replayed")
        elif (before := self.report.files[-1]).name != name:
            self.report.broken.append(f"{recording.path}: goes on from {name}, but {before.name} comes before it")
        elif sha256 is None:
            self._note(recording, f"was begun while {name} was written, and does not hold its hash")
        elif sha256 != file_sha256(before):
            self.report.broken.append(f"{before}: is not the file that {recording.path.name} goes on from")

    def _note(self, recording: Recording, text: str) -> None:
        self.report.notes.append(f"{recording.path}: {text}")
