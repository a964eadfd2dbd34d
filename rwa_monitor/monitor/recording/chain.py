"""The recordings of a folder as a chain: which they are, in which order, and what ties each to its predecessor."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Final

from rwa_monitor.errors import InputError
from rwa_monitor.messages import SamplesMessage
from rwa_monitor.monitor.recording.reader import PassingRecording, RecordedMessage, Recording, read_recording
from rwa_monitor.words import time_text

RECORDING_SUFFIX: Final = ".mcap"


def recordings_of(paths: Path | Sequence[Path]) -> list[Path]:
    """Return the recordings that a file, several files or a folder stand for, in the order of their names.

    Raises
    ------
    InputError
        If a path does not exist, or a folder holds no recording.
    """
    found: list[Path] = []
    for path in [paths] if isinstance(paths, Path) else paths:
        if path.is_dir():
            inside = sorted(entry for entry in path.iterdir() if entry.suffix == RECORDING_SUFFIX and entry.is_file())
            if not inside:
                raise InputError(str(path), f"holds no recording (*{RECORDING_SUFFIX})")
            found += inside
        elif path.is_file():
            found.append(path)
        else:
            raise InputError(str(path), "does not exist")
    return found


def read_chain(paths: Path | Sequence[Path]) -> Iterator[Recording]:
    """Read the recordings that a file, several files or a folder stand for, each after its predecessor.

    Raises
    ------
    InputError
        As `recordings_of` and `read_recording`.
    """
    # The names count up, so that the order of names is the order of the chain; replay checks the links.
    for path in recordings_of(paths):
        yield read_recording(path)


def recorded_inputs(recordings: Path | Sequence[Path], from_ns: int | None) -> Iterator[tuple[int, str, bytes]]:
    """Yield time [ns], topic and payload of the samples in recordings, from a time on.

    Raises
    ------
    InputError
        As `recordings_of` and `PassingRecording.parts`; or if nothing is of `from_ns` or later.
    """
    last_ns: int | None = None
    found = False
    for path in recordings_of(recordings):
        for part in PassingRecording(path).parts():
            if isinstance(part, RecordedMessage) and part.schema == SamplesMessage.schema_name():
                last_ns = part.log_time if last_ns is None else max(last_ns, part.log_time)
                if from_ns is None or part.log_time >= from_ns:
                    found = True
                    yield part.log_time, part.topic, part.data
    if from_ns is not None and last_ns is not None and not found:
        raise InputError(time_text(from_ns), f"the recordings hold nothing so late: they end at {time_text(last_ns)}")


def file_sha256(path: Path) -> str:
    """Return the hash of a file's content."""
    digest = sha256()
    with path.open("rb") as file:
        while block := file.read(2**20):
            digest.update(block)
    return digest.hexdigest()
