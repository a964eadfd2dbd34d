"""Writes recordings: MCAP files from which every decision of the monitor can be replayed.

A recording carries the wheel, the model, all settings, the name and hash of its predecessor, and a checkpoint of every
wheel at its beginning, as attachments. Its messages are, in this order: inputs as they came, before they are processed
(those that were refused on the topic {key}/refused), then what the monitor said of them.

Log times are the wheels' own clock, so that two runs on the same inputs write the same messages: the time of the latest
sample of the message, or that of the message before where this would go back (several wheels, a clock that stepped).
The publish time is the wall clock of the machine that records. Chunks are small, and what is in them is brought to the
disk at least every second and at each closed window.

A disk that fails degrades the recording, never the diagnosis: the error is kept for `status`, and a new file is begun
when the disk works again. It starts with checkpoints, so what is missing between the files is known.
"""

from __future__ import annotations

import fcntl
import os
import shutil
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from hashlib import sha256
from itertools import chain
from pathlib import Path
from types import MappingProxyType
from typing import IO, Any, Final, Self, cast

from mcap.writer import CompressionType, Writer

from rwa_monitor.errors import InputError
from rwa_monitor.formats.files import make_folder
from rwa_monitor.live.recording import CHANNELS_ATTACHMENT, RECORDING_SUFFIX, file_sha256
from rwa_monitor.messages import MAX_MESSAGE_BYTES, MESSAGES, dump_json
from rwa_monitor.version import SOFTWARE

PROFILE: Final = "rwa-monitor"
RECORDING_VERSION: Final = 1
CHUNK_BYTES: Final = 64 * 2**10
MAX_FILE_BYTES: Final = 32 * 2**20  # then the next file is begun; rebuilding from one takes some seconds
MAX_FILE_AGE_S: Final = 24 * 3600.0
MIN_FREE_BYTES: Final = 64 * 2**20  # left on the disk for others
SCHEMAS_BYTES: Final = 32 * 2**10  # in every file
FEW_CHANNELS: Final = 64  # so many are listed whole each time that one is new
FLUSH_PERIOD_S: Final = 1.0
RETRY_PERIOD_S: Final = 1.0  # after the disk failed; twice as long after each failure that follows
MAX_RETRY_PERIOD_S: Final = 32.0
MAX_REFUSED_TOPICS: Final = 1_000  # refused messages on more keys than that go on one topic
REFUSED: Final = "refused"
REFUSED_SCHEMA: Final = "rwa.Refused"
LOCK_NAME: Final = ".rwa-monitor.lock"
PART_SUFFIX: Final = ".part"  # of a recording whose beginning is not on the disk yet

# Of each wheel, "<spacecraft>/<wheel>" and its content. They are made one by one while they are written: those of fifty
# wheels have 140 MB when their windows are nearly full.
Checkpoints = Iterable[tuple[str, bytes]]
RecordedOutput = tuple[str, str, bytes, int | None]  # topic, schema, payload and time


class _Sink:
    """The file under an MCAP writer: gathers what is written and passes it on in one piece when flushed.

    A process that is killed then leaves whole records behind, and the hash of the file is known when it is closed.
    """

    GATHERED_BYTES: Final = 2**20

    def __init__(self, path: Path) -> None:
        self.file = path.open("xb", buffering=0)
        self.digest = sha256()
        self.size = 0
        self._gathered = bytearray()

    def write(self, data: bytes) -> int:
        self._gathered += data
        self.size += len(data)
        if len(self._gathered) > self.GATHERED_BYTES:
            self.flush()
        return len(data)

    def tell(self) -> int:
        return self.size

    def flush(self) -> None:
        written = 0
        data, self._gathered = bytes(self._gathered), bytearray()
        while written < len(data):
            written += self.file.write(data[written:])
        self.digest.update(data)

    def sync(self) -> None:
        self.flush()
        os.fdatasync(self.file.fileno())

    def close(self) -> None:
        self.file.close()


@dataclass(frozen=True, slots=True)
class Predecessor:
    """The recording before this one."""

    name: str
    sha256: str


class RecordingWriter:
    """Writes one recording.

    Parameters
    ----------
    path
        A new file. It has this name once what it begins with is on the disk: a recording of that name is always usable.
    attachments
        Names and content, written at the beginning, each before the next is asked for.
    wall_ns
        The wall clock [ns], for publish times.
    inherited
        Messages that the file begins with: topic, schema, payload and time, as for `write`.

    Raises
    ------
    OSError
        If the file cannot be written; so do all methods.
    """

    def __init__(
        self,
        path: Path,
        attachments: Iterable[tuple[str, bytes]],
        wall_ns: Callable[[], int],
        inherited: Iterable[RecordedOutput] = (),
    ) -> None:
        self.path = path
        self.wall_ns = wall_ns
        self._log_time = 0
        self._channels: dict[str, int] = {}
        self._described: dict[str, tuple[str, str]] = {}
        self._described_whole = 0  # how many there were when all of them were written down last
        self._sequence: dict[int, int] = {}
        part = path.with_name(path.name + PART_SUFFIX)
        self._sink = _Sink(part)
        try:
            self._begin(attachments)
            for topic, schema, payload, time_ns in inherited:
                self.write(topic, schema, payload, time_ns)
            self.sync()
            part.rename(path)
        except OSError:
            self.abandon()
            part.unlink()
            raise
        self.size_at_begin = self.size

    def _begin(self, attachments: Iterable[tuple[str, bytes]]) -> None:
        self._writer = Writer(cast(IO[bytes], self._sink), chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)
        self._writer.start(profile=PROFILE, library=SOFTWARE)
        self._schemas = {
            message.schema_name(): self._writer.register_schema(
                message.schema_name(), "jsonschema", dump_json(message.json_schema())
            )
            for message in MESSAGES
        }
        for name, data in attachments:
            self._attach(name, data)

    @property
    def size(self) -> int:
        """Bytes written so far."""
        return self._sink.size

    @property
    def sha256(self) -> str:
        """Hash of what is in the file; final once it is closed."""
        return self._sink.digest.hexdigest()

    def register(self, topics: Iterable[tuple[str, str]]) -> None:
        """Register topics with the names of their schemas, and write the list down apart from the chunks."""
        new = [(topic, schema) for topic, schema in topics if topic not in self._channels]
        for topic, schema in new:
            if schema not in self._schemas:  # of what is recorded only, without a published schema
                self._schemas[schema] = self._writer.register_schema(schema, "", b"")
            channel = self._writer.register_channel(topic, "json", self._schemas[schema])
            self._channels[topic] = channel
            self._described[str(channel)] = (topic, schema)
        if new:
            self._describe([str(self._channels[topic]) for topic, _ in new])

    def _describe(self, new: list[str]) -> None:
        """Write down which channel is what: all of them, so that one list that is whole tells all.

        Of a fleet only what is new, but for when their number has doubled: else the lists would fill the file.
        """
        count = len(self._described)
        whole = count <= FEW_CHANNELS or count >= 2 * self._described_whole
        if whole:
            self._described_whole = count
        told = self._described if whole else {channel: self._described[channel] for channel in new}
        self._attach(CHANNELS_ATTACHMENT, dump_json(told))

    def write(self, topic: str, schema: str, payload: bytes, time_ns: int | None) -> None:
        """Add a message; `time_ns` is its time on the wheel's clock, None where it has none."""
        self.register([(topic, schema)])
        self._log_time = max(self._log_time, time_ns or 0)
        channel = self._channels[topic]
        sequence = self._sequence.get(channel, 0)
        self._sequence[channel] = (sequence + 1) % 2**32
        self._writer.add_message(channel, self._log_time, payload, self.wall_ns(), sequence)

    def sync(self) -> None:
        """Bring everything to the disk."""
        self._writer.flush()  # type: ignore[no-untyped-call]
        self._sink.sync()

    def close(self) -> None:
        """Write the file's end and close it."""
        try:
            self._writer.finish()  # type: ignore[no-untyped-call]
            self._sink.sync()
        finally:
            self._sink.close()

    def abandon(self) -> None:
        """Close the file as it is, without its end."""
        with suppress(OSError):
            self._sink.close()

    def _attach(self, name: str, data: bytes) -> None:
        media_type = "application/toml" if name.endswith(".toml") else "application/json"
        self._writer.add_attachment(0, self._log_time, name, media_type, data)


class Recorder:
    """Keeps the recordings of a folder: rotates, looks after the disk, never raises once it has begun.

    Parameters
    ----------
    folder
        Made if it does not exist.
    wheel_toml, model_json, settings
        Attached to every file; `settings` gets the version, the software and the predecessor added.
    own_wheels
        Further attachments by name: the constants of single wheels.
    predecessor
        The last recording in the folder, None in an empty one.
    wall_ns
        The wall clock [ns].
    max_file_bytes
        Then the next file is begun.
    max_total_bytes
        Of all recordings in the folder; the oldest are deleted to keep it. None keeps all.

    Attributes
    ----------
    error
        Why nothing is being recorded, "" when all is well.

    Raises
    ------
    InputError
        If the folder cannot be made, or another monitor records in it.
    """

    def __init__(
        self,
        folder: Path,
        *,
        wheel_toml: str,
        model_json: str,
        settings: dict[str, Any],
        predecessor: Predecessor | None,
        wall_ns: Callable[[], int],
        max_file_bytes: int = MAX_FILE_BYTES,
        max_total_bytes: int | None = None,
        own_wheels: Mapping[str, bytes] = MappingProxyType({}),
    ) -> None:
        self.folder = folder
        self.error = ""
        self._attachments = {"wheel.toml": wheel_toml.encode(), **own_wheels, "model.json": model_json.encode()}
        self._settings = settings
        self._predecessor = predecessor
        self._wall_ns = wall_ns
        self._max_file_bytes = max_file_bytes
        self._max_total_bytes = max_total_bytes
        self._writer: RecordingWriter | None = None
        self._begun_s = 0.0
        self._synced_s = 0.0
        self._retry_s = float("-inf")
        self._retry_period_s = RETRY_PERIOD_S
        self._refused_topics: set[str] = set()

    @property
    def path(self) -> Path | None:
        """The file that is being written."""
        return None if self._writer is None else self._writer.path

    def begin(self, checkpoints: Checkpoints, now_s: float, inherited: Sequence[RecordedOutput] = ()) -> None:
        """Begin a new file.

        Parameters
        ----------
        checkpoints
            Of all wheels.
        now_s
            A clock that only goes forward [s].
        inherited
            Outputs for inputs of its predecessor, which did not get to the disk there.
        """
        number = 1
        if self._predecessor is not None:
            number = _number_of(self._predecessor.name) + 1
        settings = {
            **self._settings,
            "recording_version": RECORDING_VERSION,
            "software": SOFTWARE,
            "predecessor": None
            if self._predecessor is None
            else {"name": self._predecessor.name, "sha256": self._predecessor.sha256},
            "inherited": dict(Counter(topic for topic, _, _, _ in inherited)),
        }
        attachments = chain(
            [*self._attachments.items(), ("settings.json", dump_json(settings))],
            ((f"checkpoint/{name}.json", data) for name, data in checkpoints),
        )
        try:
            for part in self.folder.glob(f"*{RECORDING_SUFFIX}{PART_SUFFIX}"):
                part.unlink()  # of a run that was killed while it began a file
            path = self.folder / f"rwa-{number:06d}{RECORDING_SUFFIX}"
            while path.exists():
                number += 1
                path = self.folder / f"rwa-{number:06d}{RECORDING_SUFFIX}"
            self._writer = RecordingWriter(path, self._with_room_for(attachments), self._wall_ns, inherited)
        except OSError as error:
            self._fail(error, now_s)
            return
        self.error = ""
        self._retry_period_s = RETRY_PERIOD_S
        self._begun_s = self._synced_s = now_s
        self._predecessor = None

    def input(self, key: str, schema: str, payload: bytes, time_ns: int) -> None:
        """Record a message that is about to be processed."""
        self._write(key, schema, payload, time_ns)

    def refused(self, key: str, payload: bytes) -> None:
        """Record a message that was refused, as it came (the first 8 MiB of it)."""
        if key not in self._refused_topics and len(self._refused_topics) >= MAX_REFUSED_TOPICS:
            key = "rwa"
        self._refused_topics.add(key)
        self._write(f"{key}/{REFUSED}", REFUSED_SCHEMA, payload[:MAX_MESSAGE_BYTES], None)

    def output(self, key: str, schema: str, payload: bytes, time_ns: int | None) -> None:
        """Record what the monitor says."""
        self._write(key, schema, payload, time_ns)

    def sync(self, now_s: float) -> None:
        """Bring everything to the disk now."""
        if self._writer is None:
            return
        try:
            self._writer.sync()
            self._check_free(0)
            self._synced_s = now_s
        except OSError as error:
            self._fail(error, now_s)

    def tend(self, now_s: float, checkpoints: Callable[[], Checkpoints]) -> None:
        """Do what is due: flush, rotate, try again after a failure. Call it often, between two inputs."""
        if self._writer is None:
            if now_s >= self._retry_s:
                self.begin(checkpoints(), now_s)
            return
        # Checkpoints of many wheels may be larger than a file should be; then they are at most half of it.
        written, begin = self._writer.size, self._writer.size_at_begin
        full = written > max(self._max_file_bytes, 2 * begin) or now_s - self._begun_s > MAX_FILE_AGE_S
        if now_s - self._synced_s >= FLUSH_PERIOD_S:
            self.sync(now_s)
        if full and not self.error:
            self.close(now_s)
            self.begin(checkpoints(), now_s)

    def close(self, now_s: float) -> None:
        """Write the end of the file."""
        if self._writer is None:
            return
        writer = self._writer
        try:
            writer.close()
        except OSError as error:
            self._fail(error, now_s)
            return
        self._writer = None
        self._predecessor = Predecessor(writer.path.name, writer.sha256)

    def abandon(self) -> None:
        """Close the file as it is, without its end, as a crash would leave it."""
        if self._writer is not None:
            self._writer.abandon()
            self._predecessor = predecessor_of(self._writer.path)
            self._writer = None

    def _write(self, topic: str, schema: str, payload: bytes, time_ns: int | None) -> None:
        if self._writer is None:
            return
        try:
            self._writer.write(topic, schema, payload, time_ns)
        except OSError as error:
            self._fail(error, self._synced_s)

    def _with_room_for(self, attachments: Iterable[tuple[str, bytes]]) -> Iterator[tuple[str, bytes]]:
        """Pass on what a new file begins with, and see to it that there is room for such a file."""
        size = room = 0
        for name, data in attachments:
            size += len(data)
            needed = max(self._max_file_bytes, 2 * (size + SCHEMAS_BYTES)) + _Sink.GATHERED_BYTES
            if needed > room:
                self._make_room(needed)
                room = needed
            self._check_free(len(data))
            yield name, data

    def _check_free(self, needed: int) -> None:
        free = shutil.disk_usage(self.folder).free
        if free < MIN_FREE_BYTES + needed:
            raise OSError(f"only {free} bytes are free, {MIN_FREE_BYTES + needed} are kept for others")

    def _make_room(self, needed: int) -> None:
        """Delete the oldest recordings where those to come would make the folder larger than it may be."""
        if self._max_total_bytes is None:
            return
        recordings = sorted(self.folder.glob(f"rwa-*{RECORDING_SUFFIX}"))
        sizes = [path.stat().st_size for path in recordings]
        # The last one stays in any case: what comes goes on from it.
        for path, size in zip(recordings[:-1], sizes[:-1], strict=True):
            if sum(sizes) + needed <= self._max_total_bytes:
                return
            path.unlink()
            sizes.remove(size)

    def _fail(self, error: OSError, now_s: float) -> None:
        self.error = f"nothing is recorded: {error.strerror or error}"
        self._retry_s = now_s + self._retry_period_s
        self._retry_period_s = min(2.0 * self._retry_period_s, MAX_RETRY_PERIOD_S)
        self.abandon()


def last_recording(folder: Path) -> Path | None:
    """Return the last recording of a folder, None where there is none."""
    if not folder.is_dir():
        return None
    return max((path for path in folder.iterdir() if path.suffix == RECORDING_SUFFIX), default=None)


def predecessor_of(path: Path) -> Predecessor:
    """Return name and hash of a recording; an empty hash where it cannot be read."""
    try:
        return Predecessor(path.name, file_sha256(path))
    except OSError:
        return Predecessor(path.name, "")


def _number_of(name: str) -> int:
    digits = "".join(character for character in Path(name).stem if character.isdigit())
    return int(digits or "0")


class FolderLock:
    """Keeps two monitors from recording in one folder; held until closed, or until the process ends.

    Raises
    ------
    InputError
        If the folder cannot be made or written, or another monitor holds it.
    """

    def __init__(self, folder: Path) -> None:
        make_folder(folder, "--record")
        try:
            self._file = (folder / LOCK_NAME).open("ab")
        except OSError as error:
            raise InputError(str(folder), f"cannot be written: {error.strerror}", "--record") from error
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            self._file.close()
            raise InputError(str(folder), "another monitor records in it", "--record") from error

    def __enter__(self) -> Self:
        """Enter; the folder is locked already."""
        return self

    def __exit__(self, *_error: object) -> None:
        """Let go of the folder."""
        self._file.close()
