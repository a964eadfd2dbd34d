"""Writes recordings: MCAP files from which every decision of the monitor can be replayed.

A recording has as attachments the wheel files, the model, all settings, the name and hash of its predecessor, and a
checkpoint of every wheel at its beginning. Its messages are, in this order: inputs as they arrived, before they are
processed (refused ones on the topic {key}/refused), then the outputs for them.

Log times are the wheels' own clock, so that two runs on the same inputs write the same messages: the time of the latest
sample of the message, or that of the message before if this is later (several wheels, a clock that stepped). The
publish time is the wall clock of the recording machine. Chunks are small, and are flushed to the disk at least every
second and at each closed window.

When a recording is full the next one is begun, and the wheels are moved to it one after the other while all of them
continue: until a wheel's checkpoint is in the new file, its messages are written to the previous one. So the new file
holds, of each wheel, a checkpoint before its first message, and can be replayed by itself; only while it has the
checkpoints of some wheels ("checkpoints" in settings.json), a monitor that is started needs the previous one, too.
Before a checkpoint is written, all messages that its state depends on are flushed to the disk. When all wheels have
been moved the previous file is closed, and the settings, with its hash, are attached to the new one once more.

A disk failure degrades the recording, never the diagnosis: the error is kept for `status`, and a new file is begun
when the disk works again. It starts with checkpoints, so the gap between the files is known.
"""

from __future__ import annotations

import fcntl
import os
import re
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import KW_ONLY, dataclass, field
from hashlib import sha256
from io import BufferedWriter, FileIO
from itertools import chain
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Final, NamedTuple

from mcap.writer import CompressionType, Writer

from rwa_monitor import messages
from rwa_monitor.errors import InputError
from rwa_monitor.messages import EncodedMessage, dump_json
from rwa_monitor.monitor.recording import (
    CHANNELS_ATTACHMENT,
    CHECKPOINT_PREFIX,
    RECORDING_SUFFIX,
    SETTINGS_ATTACHMENT,
    Held,
    Recording,
    file_sha256,
    read_recording,
    recordings_of,
)
from rwa_monitor.reporting.foxglove import Seen, Translator, layout, schemas
from rwa_monitor.samples import SECONDS_PER_DAY
from rwa_monitor.telemetry.files import PIECE_BYTES, atomic_write, make_folder, refusing
from rwa_monitor.words import SOFTWARE

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer

RECORDING_VERSION: Final = 1
MAX_FILE_BYTES: Final = 32 * 2**20  # then the next file is begun; state recovery from one takes some seconds
MAX_FILE_AGE_S: Final = SECONDS_PER_DAY
MIN_FREE_BYTES: Final = 64 * 2**20  # disk space left for other programs
REFUSED: Final = "refused"
REFUSED_SCHEMA: Final = "rwa.Refused"
LOCK_NAME: Final = ".rwa-monitor.lock"
_NAME: Final = re.compile(rf"rwa-(\d+){re.escape(RECORDING_SUFFIX)}")

# By "<spacecraft>/<wheel>", a function that makes the wheel's checkpoint. Checkpoints are made one by one when they are
# written: those of fifty wheels have 85 MB when their windows are nearly full.
Checkpoints = Mapping[str, Callable[[], bytes]]


class Predecessor(NamedTuple):
    """The recording before this one; `sha256` is None while that one is still being written."""

    name: str
    sha256: str | None


@dataclass(eq=False)
class Recorder:
    """Writes the recordings of a folder: rotates them, limits their size, and never raises once it has begun.

    Parameters
    ----------
    folder
        An existing folder, see `locked`.
    attachments
        Of every file, by name.
    settings
        Attached to every file, with the version, the software and the predecessor added.
    predecessor
        The last recording in the folder, None in an empty one.
    wall_ns
        The wall clock [ns].
    max_file_bytes
        Size after which the next file is begun.
    max_total_bytes
        Of all recordings in the folder; the oldest are deleted to keep it. None keeps all.

    Attributes
    ----------
    error
        Why nothing is being recorded, "" when all is well.
    """

    folder: Path
    _: KW_ONLY
    attachments: Mapping[str, bytes]
    settings: dict[str, Any]
    predecessor: Predecessor | None
    wall_ns: Callable[[], int]
    max_file_bytes: int = MAX_FILE_BYTES
    max_total_bytes: int | None = None
    error: str = field(default="", init=False)
    _writer: RecordingWriter | None = field(default=None, init=False)
    # The previous file, for as long as wheels are left in it; these wheels, and functions that make their checkpoints.
    _previous: RecordingWriter | None = field(default=None, init=False)
    _unmoved: dict[str, Callable[[], bytes]] = field(default_factory=dict, init=False)
    _moved_s: float = field(default=0.0, init=False)
    _begun_s: float = field(default=0.0, init=False)
    _synced_s: float = field(default=0.0, init=False)
    _retry_s: float = field(default=float("-inf"), init=False)
    _refused_topics: set[str] = field(default_factory=set, init=False)

    @property
    def path(self) -> Path | None:
        """The file that is being written."""
        return None if self._writer is None else self._writer.path

    def begin(self, checkpoints: Checkpoints, now_s: float, inherited: Sequence[EncodedMessage] = ()) -> None:
        """Begin a new file, with the state of all wheels before anything else.

        Parameters
        ----------
        checkpoints
            Of all wheels.
        now_s
            A monotonic clock [s].
        inherited
            Outputs for inputs of the predecessor that it does not hold.
        """
        with self._guarded(now_s):
            for part in self.folder.glob(f"*{RECORDING_SUFFIX}{PART_SUFFIX}"):
                part.unlink()  # of a run that was killed while it began a file
            self._writer = self._new_file(self.predecessor, "all", checkpoints, inherited)
            self.error = ""
            self._begun_s = self._synced_s = now_s
            self.predecessor = None

    def _new_file(
        self,
        predecessor: Predecessor | None,
        which: Held,
        checkpoints: Checkpoints,
        inherited: Sequence[EncodedMessage] = (),
    ) -> RecordingWriter:
        numbers = [int(name[1]) for one in self.folder.iterdir() if (name := _NAME.fullmatch(one.name))]
        path = self.folder / f"rwa-{max(numbers, default=0) + 1:06d}{RECORDING_SUFFIX}"

        def attachments() -> Iterator[tuple[str, bytes]]:
            settings = (SETTINGS_ATTACHMENT, self._settings_of(predecessor, which))
            states = ((_attachment_of(name), make()) for name, make in checkpoints.items())
            size = 0
            for name, data in chain(self.attachments.items(), [settings], states):
                size += len(data)
                self._ensure_room(size, len(data))
                yield name, data

        return RecordingWriter(path, attachments(), self.wall_ns, inherited)

    def _settings_of(self, predecessor: Predecessor | None, which: Held) -> bytes:
        """Return the settings that a recording holds."""
        return dump_json(
            {
                **self.settings,
                "recording_version": RECORDING_VERSION,
                "software": SOFTWARE,
                "predecessor": None if predecessor is None else predecessor._asdict(),
                "checkpoints": which,
            }
        )

    def refused(self, key: str, payload: bytes) -> None:
        """Record a message that was refused, as it arrived (the first 8 MiB of it)."""
        # Messages on more keys than a process may have wheels are recorded on one topic.
        if key not in self._refused_topics and len(self._refused_topics) >= messages.MAX_WHEELS:
            key = "rwa"
        self._refused_topics.add(key)
        self.write(EncodedMessage(f"{key}/{REFUSED}", REFUSED_SCHEMA, payload[: messages.MAX_MESSAGE_BYTES]))

    def sync(self, now_s: float) -> None:
        """Flush everything to the disk now."""
        if self._writer is None:
            return
        with self._guarded(now_s):
            if self._previous is not None:
                self._previous.sync()
            self._writer.sync()
            self._check_free(0)
            self._synced_s = now_s

    def maintain(self, now_s: float, checkpoints: Callable[[], Checkpoints]) -> None:
        """Do what is due: flush, rotate, try again after a failure. Call it often, between two inputs.

        Parameters
        ----------
        now_s
            A monotonic clock [s].
        checkpoints
            Returns the functions that make the checkpoints of all wheels.
        """
        if self._writer is None:
            if now_s >= self._retry_s:
                self.begin(checkpoints(), now_s)
            return
        # Checkpoints of many wheels may exceed the file size; the limit is then twice what the file begins with.
        written, begin = self._writer.size, self._writer.size_at_begin
        full = written > max(self.max_file_bytes, 2 * begin) or now_s - self._begun_s > MAX_FILE_AGE_S
        if now_s - self._synced_s >= messages.PERIOD_S:
            self.sync(now_s)
        if self._previous is not None:
            if now_s - self._moved_s >= messages.PERIOD_S:  # between two moves inputs are taken
                self._move(now_s)
        elif full and not self.error:
            self._rotate(checkpoints(), now_s)

    # ---- from one file to the next -------------------------------------------------------------------------------

    def _rotate(self, checkpoints: Checkpoints, now_s: float) -> None:
        """Begin the next file, to which the wheels are moved one after the other."""
        ending = self._writer
        assert ending is not None
        try:
            self._ensure_room(ending.size_at_begin)
            self._writer = self._new_file(Predecessor(ending.path.name, None), "some", {})
        except OSError as error:
            self.close(now_s)  # the previous file is complete in any case
            self._fail(error, now_s)
            return
        self._previous, self._unmoved = ending, dict(reversed(list(checkpoints.items())))
        self._begun_s = now_s
        self._move(now_s)

    def _move(self, now_s: float) -> None:
        """Move some more wheels to the new file, and close the previous one when none is left there."""
        assert self._previous is not None
        assert self._writer is not None
        self._moved_s = now_s
        with self._guarded(now_s):
            # A state must not reach the disk before its inputs and outputs.
            self._previous.sync()
            moved = 0
            # At least one checkpoint: that of a full window of 80,000 slots has 1.7 MB, and takes 6 ms.
            while self._unmoved and moved < PIECE_BYTES:
                name, make = self._unmoved.popitem()
                data = make()
                moved += len(data)
                self._ensure_room(self._writer.size + len(data), len(data), self._writer.size)
                self._writer.attach(_attachment_of(name), data)
            if not self._unmoved:
                self._writer.sync()
                self._end("all")
                self._writer.sync()
                self._writer.size_at_begin = self._writer.size

    def _end(self, which: Held) -> None:
        """Close the previous file, if it is still open, and attach its name and hash to the new one."""
        if self._previous is not None and self._writer is not None:
            self._previous.close()
            ended = Predecessor(self._previous.path.name, self._previous.sha256)
            self._writer.attach(SETTINGS_ATTACHMENT, self._settings_of(ended, which))
            self._previous = None

    def close(self, now_s: float) -> None:
        """Close the file, and the previous one if wheels are left in it: then both are needed to continue."""
        if self._writer is None:
            return
        writer = self._writer
        with self._guarded(now_s):
            self._end("some")
            writer.close()
            self._writer = None
            self._unmoved = {}
            self.predecessor = Predecessor(writer.path.name, writer.sha256)

    def abandon(self) -> None:
        """Close the files as they are, without their end, as a crash would leave them."""
        for writer in filter(None, (self._previous, self._writer)):
            writer.abandon()
        if self._writer is not None:
            self.predecessor = predecessor_of(self._writer.path)
        self._writer, self._previous, self._unmoved = None, None, {}

    def write(self, message: EncodedMessage) -> None:
        """Record a message: an input before it is processed, or an output."""
        writer = self._writer
        if self._unmoved and "/".join(message.topic.split("/")[1:3]) in self._unmoved:
            writer = self._previous
        if writer is None:
            return
        with self._guarded(self._synced_s):
            writer.write(message)

    # ---- the disk ------------------------------------------------------------------------------------------------

    @contextmanager
    def _guarded(self, now_s: float) -> Iterator[None]:
        """Abandon the file if the disk fails in the block, and keep the error."""
        try:
            yield
        except OSError as error:
            self._fail(error, now_s)

    def _ensure_room(self, begin: int, more: int = 0, written: int = 0) -> None:
        """Delete old recordings, and check the free disk space, before a file is written; raises OSError.

        Parameters
        ----------
        begin, written
            Size of what the file begins with, and how much of the file is written already [bytes].
        more
            Size of the next attachment [bytes].
        """
        self._make_room(max(self.max_file_bytes, 2 * begin) + HashedFile.GATHERED_BYTES - written)
        self._check_free(more)

    def _check_free(self, needed: int) -> None:
        if shutil.disk_usage(self.folder).free < MIN_FREE_BYTES + needed:
            raise OSError(f"less than {MIN_FREE_BYTES + needed} bytes are free, which are kept for others")

    def _make_room(self, needed: int) -> None:
        """Delete the oldest recordings until the folder has room for `needed` more bytes."""
        if self.max_total_bytes is None:
            return
        recordings = sorted(self.folder.glob(f"rwa-*{RECORDING_SUFFIX}"))
        sizes = [path.stat().st_size for path in recordings]
        # The new file continues the last one, or the last two: where the last holds some wheels only, or before the
        # first file of this run is complete.
        kept = 1 if self._writer is not None and self._previous is None else 2
        total = sum(sizes)
        for path, size in zip(recordings[:-kept], sizes, strict=False):
            if total + needed <= self.max_total_bytes:
                return
            path.unlink()
            total -= size

    def _fail(self, error: OSError, now_s: float) -> None:
        self.error = f"nothing is recorded: {error.strerror or error}"
        self._retry_s = now_s + messages.PERIOD_S
        self.abandon()


def predecessor_of(path: Path) -> Predecessor:
    """Return name and hash of a recording; an empty hash where it cannot be read."""
    try:
        return Predecessor(path.name, file_sha256(path))
    except OSError:
        return Predecessor(path.name, "")


def _attachment_of(name: str) -> str:
    return f"{CHECKPOINT_PREFIX}{name}.json"


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Keep other monitors from recording in a folder, until the block or the process ends.

    Raises
    ------
    InputError
        If the folder cannot be made or written, or another monitor holds it.
    """
    make_folder(folder, "--record")
    with refusing(folder, "cannot be written", "--record"):
        file = (folder / LOCK_NAME).open("ab")
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise InputError(str(folder), "another monitor records in it", "--record") from error
        yield


# ---- one file, whose attachments are among its messages in the order in which they were written ----------------------


PROFILE: Final = "rwa-monitor"
CHUNK_BYTES: Final = 64 * 2**10
PART_SUFFIX: Final = ".part"  # of a recording whose attachments are not all on the disk yet


class HashedFile(BufferedWriter):
    """A new, buffered file that hashes what is written to it; the hash is final when the file is closed."""

    GATHERED_BYTES: Final = 2**20

    def __init__(self, path: Path) -> None:
        super().__init__(FileIO(path, "x"), self.GATHERED_BYTES)
        self.digest = sha256()

    def write(self, data: ReadableBuffer, /) -> int:
        self.digest.update(data)
        return super().write(data)

    def sync(self) -> None:
        """Flush everything to the disk."""
        self.flush()
        os.fdatasync(self.fileno())


class TopicWriter:
    """An MCAP file to which schemas and channels are added when the first message needs them.

    Parameters
    ----------
    stream
        Where it is written.
    schemas
        JSON Schemas by name; others are registered by their name only.
    profile
        Of the file.
    chunk_bytes
        Size at which a chunk is closed.
    """

    def __init__(
        self, stream: IO[bytes], schemas: Mapping[str, Any], profile: str = "", chunk_bytes: int = CHUNK_BYTES
    ) -> None:
        self.mcap = Writer(stream, chunk_size=chunk_bytes, compression=CompressionType.ZSTD)
        self.mcap.start(profile=profile, library=SOFTWARE)
        self._known = schemas
        self._schemas: dict[str, int] = {"": 0}
        self._channels: dict[tuple[str, str], int] = {}
        self._time_ns = 0  # of attachments

    def channel(self, topic: str, schema: str) -> int:
        """Return the number of a topic's channel."""
        if (topic, schema) not in self._channels:
            if schema not in self._schemas:
                encoding, data = ("jsonschema", dump_json(self._known[schema])) if schema in self._known else ("", b"")
                self._schemas[schema] = self.mcap.register_schema(schema, encoding, data)
            self._channels[topic, schema] = self.mcap.register_channel(topic, "json", self._schemas[schema])
        return self._channels[topic, schema]

    def write(self, message: EncodedMessage) -> None:
        """Add a message."""
        channel = self.channel(message.topic, message.schema)
        self.mcap.add_message(channel, message.time_ns, message.payload, message.publish_ns)

    def attach(self, name: str, data: bytes) -> None:
        """Add an attachment; readers take the last one of several with the same name."""
        media_type = "application/toml" if name.endswith(".toml") else "application/json"
        self.mcap.add_attachment(0, self._time_ns, name, media_type, data)

    def finish(self) -> None:
        """Write the end of the file."""
        self.mcap.finish()  # type: ignore[no-untyped-call]


def message_schemas() -> dict[str, Any]:
    """Return the JSON Schemas of the bus's messages by name."""
    return {message.schema_name(): message.json_schema() for message in messages.MESSAGES}


class RecordingWriter(TopicWriter):
    """Writes one recording.

    Parameters
    ----------
    path
        A new file. It gets this name when its beginning is on the disk: a recording of that name is always usable.
    attachments
        Names and content, written at the beginning, each before the next one is made.
    wall_ns
        The wall clock [ns], for publish times.
    inherited
        Messages that follow the attachments.

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
        inherited: Iterable[EncodedMessage] = (),
    ) -> None:
        self.path = path
        self.wall_ns = wall_ns
        part = path.with_name(path.name + PART_SUFFIX)
        self._file = HashedFile(part)
        try:
            super().__init__(self._file, message_schemas(), PROFILE)
            for name, data in attachments:
                self.attach(name, data)
            for message in inherited:
                self.write(message)
            self.sync()
            part.rename(path)
            _sync_folder(path.parent)
        except OSError:
            self.abandon()
            part.unlink(missing_ok=True)
            raise
        self.size_at_begin = self.size

    @property
    def size(self) -> int:
        """Bytes written so far."""
        return self._file.tell()

    @property
    def sha256(self) -> str:
        """Hash of the file's content; final when the file is closed."""
        return self._file.digest.hexdigest()

    def channel(self, topic: str, schema: str) -> int:
        """Return the number of a topic's channel; a new one is also described in an attachment.

        So the messages of an intact chunk can be read although the chunk with the channel's record is damaged.
        """
        is_new = (topic, schema) not in self._channels
        number = super().channel(topic, schema)
        if is_new:
            self.attach(CHANNELS_ATTACHMENT, dump_json({number: (topic, schema)}))
        return number

    def write(self, message: EncodedMessage) -> None:
        """Add a message, with the time of the one before if its own is earlier or missing."""
        time_ns = max(self._time_ns, message.time_ns)
        super().write(message._replace(time_ns=time_ns, publish_ns=self.wall_ns()))
        self._time_ns = time_ns

    def sync(self) -> None:
        """Flush everything to the disk."""
        self.mcap.flush()  # type: ignore[no-untyped-call]
        self._file.sync()

    def close(self) -> None:
        """Write the file's end and close it."""
        try:
            self.finish()
            self._file.sync()
        finally:
            self._file.close()

    def abandon(self) -> None:
        """Close the file as it is, without its end."""
        with suppress(OSError):
            self._file.close()


def _sync_folder(folder: Path) -> None:
    """Flush a folder's directory entries to the disk: after a power failure a file without its entry is lost."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


# ---- copies of recordings --------------------------------------------------------------------------------------------


RECOVERED_ATTACHMENT: Final = "recovered.json"
LAYOUT_SUFFIX: Final = ".layout.json"


class Written(NamedTuple):
    """How many messages were written, and a line for each part that could not be read."""

    messages: int
    problems: list[str]


@contextmanager
def _new_file(target: Path) -> Iterator[IO[bytes]]:
    """Open a new file for writing, which is there when it is complete; raises InputError if there is one already."""
    if target.exists():
        raise InputError(str(target), "exists already; nothing is overwritten", "--output")
    with atomic_write(target, "--output") as part, part.open("wb") as file:
        yield file


# ---- recovery of a damaged recording: every intact chunk, and no message that fails its checksum ---------------------


def recover(source: Path, target: Path) -> Written:
    """Copy the readable part of `source` into an intact recording `target`.

    Times, topics and bytes of messages and attachments stay as they are, and so does their order; only a piece of the
    file is in memory at a time. An attachment of the new file names its source and what was lost.

    Raises
    ------
    InputError
        If `source` is no MCAP file at all, or `target` exists or cannot be written.
    """
    recording, saved = Recording(source), 0
    with _new_file(target) as file:
        writer = TopicWriter(file, message_schemas(), PROFILE)
        for part in recording.parts():
            if isinstance(part, EncodedMessage):
                writer.write(part)
                saved += 1
            elif part.name != CHANNELS_ATTACHMENT:
                writer.attach(part.name, part.data)
        lost = list(recording.problems)
        if not recording.finished and not lost:
            lost.append("the file was not closed in order: what came after its last flush is lost")
        lost = [f"{source}: {line}" for line in lost]
        writer.attach(RECOVERED_ATTACHMENT, dump_json({"source": source.name, "lost": lost}))
        writer.finish()
        file.flush()
        os.fsync(file.fileno())
    return Written(saved, lost)


# ---- recordings for Foxglove -----------------------------------------------------------------------------------------


def layout_of(target: Path) -> Path:
    """Return the path of the layout that belongs to a file for Foxglove."""
    return target.with_name(target.stem + LAYOUT_SUFFIX)


def write_foxglove(paths: Sequence[Path], target: Path) -> Written:
    """Write recordings (files, or folders of them) as one MCAP file for Foxglove, with a layout in the same folder.

    The recordings are not changed. Refused messages and carried states are left out, as Foxglove cannot show them.

    Raises
    ------
    InputError
        If a path is no recording, holds a message that cannot be parsed, or the target exists or cannot be written.
    """
    files = recordings_of(paths)
    translator, seen = Translator(), Seen()
    written, problems, published = 0, list[str](), {message.schema_name() for message in messages.MESSAGES}
    with _new_file(target) as stream, _new_file(layout_of(target)) as layout_file:
        # Large chunks: the file is read at once, and not while a monitor writes.
        writer = TopicWriter(stream, schemas(), chunk_bytes=HashedFile.GATHERED_BYTES)
        for file in files:
            recording = read_recording(file)
            problems += [f"{file}: {problem}" for problem in recording.problems]
            views = [
                view
                for message in recording.messages
                if message.schema in published
                for view in translator.translate(message.topic, message.payload)
            ]
            for view in sorted(views, key=lambda view: view.time_ns):
                writer.write(view._replace(publish_ns=view.time_ns))
            seen.add(views)
            written += len(views)
        writer.finish()
        layout_file.write(layout(seen))
    return Written(written, problems)
