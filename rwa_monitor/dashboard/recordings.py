"""Recordings for the page: which there are, and one of them as the entries that the feed would have had."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rwa_monitor.dashboard.fleet import Received
from rwa_monitor.dashboard.trace import samples_of, thinned_json
from rwa_monitor.errors import InputError
from rwa_monitor.live.recording import RECORDING_SUFFIX, read_recording
from rwa_monitor.messages import Changepoints, Diagnosis, SamplesMessage, Status, dump_json, split_key

MAX_REPLAY_BYTES: Final = 512 * 2**20
POINTS_PER_WHEEL: Final = 12_000  # of a whole recording, for its picture
SHOWN: Final = frozenset(kind.schema_name() for kind in (Diagnosis, Changepoints, Status))


@dataclass(frozen=True, slots=True)
class RecordingFile:
    """One recording of the folder."""

    name: str
    size_bytes: int
    changed_wall_ns: int


def list_recordings(folder: Path | None) -> list[RecordingFile]:
    """Return the recordings of a folder, the latest first; none where the folder does not exist."""
    if folder is None or not folder.is_dir():
        return []
    found = []
    for path in folder.glob(f"*{RECORDING_SUFFIX}"):
        if path.is_file():
            facts = path.stat()
            found.append(RecordingFile(path.name, facts.st_size, facts.st_mtime_ns))
    return sorted(found, key=lambda entry: entry.name, reverse=True)


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
    samples_schema = SamplesMessage.schema_name()
    counts: dict[str, int] = {}
    for message in recording.messages:
        if message.schema == samples_schema:
            counts[message.topic] = counts.get(message.topic, 0) + len(samples_of(message.data, message.topic))
    entries: list[bytes] = []
    phases: dict[str, int] = dict.fromkeys(counts, 0)
    for message in recording.messages:
        payload = message.data
        if message.schema == samples_schema:
            stride = -(-counts[message.topic] // POINTS_PER_WHEEL)
            samples = samples_of(payload, message.topic)
            picked = samples[phases[message.topic] :: stride]
            phases[message.topic] = (phases[message.topic] - len(samples)) % stride
            if not len(picked):
                continue
            payload = thinned_json(picked)
        elif message.schema not in SHOWN:
            continue
        split_key(message.topic)
        entry = Received(message.topic, payload, message.publish_time).to_json()
        entries.append(b'{"time_ns":' + str(message.log_time).encode() + b"," + entry[1:])
    # Reading stops at what is damaged; the page says so.
    problems = dump_json(recording.problems)
    return b'{"problems":' + problems + b',"entries":[' + b",".join(entries) + b"]}"
