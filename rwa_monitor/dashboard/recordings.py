"""Recordings for the page: which there are, and one of them as the entries that the feed would have had."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Final

from rwa_monitor.dashboard.fleet import DerivedFriction, Received, VerdictHistory, thinned_json
from rwa_monitor.errors import InputError
from rwa_monitor.history.store import History
from rwa_monitor.messages import REPORTS, Diagnosis, Discrepancy, Message, SamplesMessage, dump_json, split_key
from rwa_monitor.monitor.recording.reader import (
    RECORDING_SUFFIX,
    RecordedMessage,
    Recording,
    read_chain,
    read_recording,
    time_span,
)
from rwa_monitor.monitor.setup import COMMON, WheelSet
from rwa_monitor.wheel.wheel import built_in_wheel

MAX_REPLAY_BYTES: Final = 512 * 2**20
POINTS_PER_WHEEL: Final = 12_000  # of a whole recording, for its picture
SHOWN: Final = {report.schema_name(): report for report in REPORTS}


class RecordingFile(Message):
    """One recording of the folder; the first and last time in it on the wheels' clocks, None where none is known."""

    name: str
    size_bytes: int
    changed_wall_ns: int
    first_ns: int | None = None
    last_ns: int | None = None


def list_recordings(folder: Path | None) -> list[RecordingFile]:
    """Return the recordings of a folder, the latest first; none where the folder does not exist."""
    if folder is None or not folder.is_dir():
        return []
    found = []
    for path in folder.glob(f"*{RECORDING_SUFFIX}"):
        if path.is_file():
            facts = path.stat()
            first_ns, last_ns = _span(path, facts.st_size, facts.st_mtime_ns)
            found.append(
                RecordingFile(
                    name=path.name,
                    size_bytes=facts.st_size,
                    changed_wall_ns=facts.st_mtime_ns,
                    first_ns=first_ns,
                    last_ns=last_ns,
                )
            )
    return sorted(found, key=lambda entry: entry.name, reverse=True)


@lru_cache(maxsize=10_000)
def _span(path: Path, size_bytes: int, changed_wall_ns: int) -> tuple[int | None, int | None]:
    """Return the times of a recording as it is at this size and change; (None, None) where it cannot be read."""
    del size_bytes, changed_wall_ns
    try:
        return time_span(path) or (None, None)
    except InputError:
        return None, None


def replay_json(folder: Path | None, name: str) -> bytes:
    """Return a recording as JSON: problems, and entries {time_ns, key, message}, samples thinned.

    Raises
    ------
    InputError
        If the folder holds no recording of that name, or it cannot be read.
    """
    if folder is None or name not in {entry.name for entry in list_recordings(folder)}:
        raise InputError(name, "is no recording here")
    path = folder / name
    if path.stat().st_size > MAX_REPLAY_BYTES:
        raise InputError(name, f"is larger than {MAX_REPLAY_BYTES} bytes")
    recording = read_recording(path)
    entries = list(_Replay(recording).entries())
    # Reading stops at what is damaged; the page shows it.
    problems = dump_json(recording.problems)
    return b'{"problems":' + problems + b',"entries":[' + b",".join(entries) + b"]}"


def latest_wheels(folder: Path | None) -> WheelSet | None:
    """Return the constants in the latest recording of a folder that has some; None where there is none."""
    for entry in list_recordings(folder):
        with suppress(InputError):  # damaged, or too large: an earlier one serves as well
            recording = read_recording((folder or Path()) / entry.name, MAX_REPLAY_BYTES)
            if COMMON in recording.attachments:
                return WheelSet.of_recording(recording)
    return None


class _Replay:
    """Turns a recording's messages into the entries that a page would have had, samples thinned."""

    def __init__(self, recording: Recording) -> None:
        self.recording = recording
        made_with = COMMON in recording.attachments
        self.wheels = WheelSet.of_recording(recording) if made_with else WheelSet(built_in_wheel())
        self._counts: Counter[str] = Counter()
        for message in recording.messages:
            if message.schema == SamplesMessage.schema_name():
                known = len(SamplesMessage.parse(message.data, message.topic).time_ns)
                self._counts[message.topic] += known
        self._phases: dict[str, int] = dict.fromkeys(self._counts, 0)
        self._derived = {topic: DerivedFriction(self.wheels.of(*split_key(topic)[:2])) for topic in self._counts}
        self._verdicts: dict[str, VerdictHistory] = {}

    def entries(self) -> Iterator[bytes]:
        """Yield the entries {time_ns, key, message} in the recording's order."""
        for message in self.recording.messages:
            if message.schema == SamplesMessage.schema_name():
                payload = self._samples(message)
                if payload is not None:
                    yield _entry(message, message.topic, payload)
            elif message.schema in SHOWN:
                if message.schema == Diagnosis.schema_name():
                    yield self._diagnosis(message)
                else:
                    split_key(message.topic)
                    shown = SHOWN[message.schema].parse(message.data, f"{self.recording.path.name}: {message.topic}")
                    yield _entry(message, message.topic, shown.to_json())

    def _samples(self, message: RecordedMessage) -> bytes | None:
        topic = message.topic
        samples = self._derived[topic].add(SamplesMessage.parse(message.data, topic).samples())
        stride = -(-self._counts[topic] // POINTS_PER_WHEEL)
        picked = samples[self._phases[topic] :: stride]
        self._phases[topic] = (self._phases[topic] - len(samples)) % stride
        return thinned_json(picked) if len(picked) else None

    def _diagnosis(self, message: RecordedMessage) -> bytes:
        window = Diagnosis.parse(message.data, f"{self.recording.path.name}: {message.topic}")
        verdicts = self._verdicts.setdefault(message.topic, VerdictHistory())
        verdicts.extend([window])
        return _entry(message, message.topic, window.to_json(), verdicts.to_json())


def _entry(message: RecordedMessage, key: str, payload: bytes, beside: bytes = b"null") -> bytes:
    entry = Received(key, payload, message.publish_time, beside).to_json()
    return b'{"time_ns":' + str(message.log_time).encode() + b"," + entry[1:]


# ---- into the history ------------------------------------------------------------------------------------------------


BATCH_WINDOWS: Final = 200  # of one transaction


@dataclass(frozen=True, slots=True)
class Imported:
    """What an import did: windows found, those that were new, and what could not be read."""

    windows: int
    new: int
    problems: tuple[str, ...]


def import_recordings(history: History, path: Path) -> Imported:
    """Import a recording, or all of a folder.

    Raises
    ------
    InputError
        If there is no recording there, or one holds a diagnosis that is none.
    HistoryError
        If the database cannot be written; what was imported before stays.
    """
    windows = new = 0
    problems: list[str] = []
    for recording in read_chain(path):
        problems += [f"{recording.path.name}: {problem}" for problem in recording.problems]
        diagnoses = recording.parsed(Diagnosis)
        for found in recording.parsed(Discrepancy):
            history.add_discrepancy(found)
        windows += len(diagnoses)
        for begin in range(0, len(diagnoses), BATCH_WINDOWS):
            new += history.add(*diagnoses[begin : begin + BATCH_WINDOWS])
    return Imported(windows, new, tuple(problems))
