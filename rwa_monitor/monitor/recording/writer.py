"""Writes MCAP files: one recording, whose attachments stand among its messages in the order in which they came."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from hashlib import sha256
from pathlib import Path
from typing import IO, Any, Final, cast

from mcap.writer import CompressionType, Writer

from rwa_monitor.messages import MESSAGES, dump_json
from rwa_monitor.monitor.recording.reader import CHANNELS_ATTACHMENT
from rwa_monitor.version import SOFTWARE

PROFILE: Final = "rwa-monitor"
CHUNK_BYTES: Final = 64 * 2**10
FEW_CHANNELS: Final = 64  # so many are listed whole each time that one is new
PART_SUFFIX: Final = ".part"  # of a recording whose beginning is not on the disk yet

RecordedOutput = tuple[str, str, bytes, int | None]  # topic, schema, payload and time


class Sink:
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


class TopicWriter:
    """An MCAP file in which each message brings its schema and its topic along when they are new.

    Parameters
    ----------
    stream
        Where it is written.
    schemas
        JSON Schemas by name; others are registered by their name only.
    profile
        Of the file.
    chunk_bytes
        Size at which a chunk is ended.
    """

    def __init__(
        self, stream: IO[bytes], schemas: Mapping[str, Any], profile: str = "", chunk_bytes: int = CHUNK_BYTES
    ) -> None:
        self.mcap = Writer(stream, chunk_size=chunk_bytes, compression=CompressionType.ZSTD)
        self.mcap.start(profile=profile, library=SOFTWARE)
        self._known = schemas
        self._schemas: dict[str, int] = {"": 0}
        self._channels: dict[tuple[str, str], int] = {}
        self._sequences: dict[int, int] = {}

    def schema(self, name: str) -> int:
        """Return the number of a schema."""
        if name not in self._schemas:
            encoding, data = ("jsonschema", dump_json(self._known[name])) if name in self._known else ("", b"")
            self._schemas[name] = self.mcap.register_schema(name, encoding, data)
        return self._schemas[name]

    def channel(self, topic: str, schema: str) -> int:
        """Return the number of a topic's channel."""
        if (topic, schema) not in self._channels:
            self._channels[topic, schema] = self.mcap.register_channel(topic, "json", self.schema(schema))
        return self._channels[topic, schema]

    def write(self, topic: str, schema: str, data: bytes, log_time: int, publish_time: int) -> None:
        """Add a message; both times in ns."""
        channel = self.channel(topic, schema)
        sequence = self._sequences.get(channel, 0)
        self._sequences[channel] = (sequence + 1) % 2**32
        self.mcap.add_message(channel, log_time, data, publish_time, sequence)

    def attach(self, name: str, data: bytes, time_ns: int = 0, media_type: str = "application/octet-stream") -> None:
        """Add an attachment."""
        self.mcap.add_attachment(0, time_ns, name, media_type, data)

    def finish(self) -> None:
        """Write the end of the file."""
        self.mcap.finish()  # type: ignore[no-untyped-call]


def message_schemas() -> dict[str, Any]:
    """Return the JSON Schemas of the bus's messages by name."""
    return {message.schema_name(): message.json_schema() for message in MESSAGES}


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
        self._described: dict[str, tuple[str, str]] = {}
        self._described_whole = 0  # how many there were when all of them were written down last
        part = path.with_name(path.name + PART_SUFFIX)
        self._sink = Sink(part)
        try:
            self._begin(attachments)
            for topic, schema, payload, time_ns in inherited:
                self.write(topic, schema, payload, time_ns)
            self.sync()
            part.rename(path)
            _sync_folder(path.parent)
        except OSError:
            self.abandon()
            part.unlink(missing_ok=True)
            raise
        self.size_at_begin = self.size

    def _begin(self, attachments: Iterable[tuple[str, bytes]]) -> None:
        self._writer = TopicWriter(cast(IO[bytes], self._sink), message_schemas(), PROFILE)
        for message in MESSAGES:
            self._writer.schema(message.schema_name())
        for name, data in attachments:
            self.attach(name, data)

    @property
    def size(self) -> int:
        """Bytes written so far."""
        return self._sink.size

    @property
    def sha256(self) -> str:
        """Hash of what is in the file; final once it is closed."""
        return self._sink.digest.hexdigest()

    def write(self, topic: str, schema: str, payload: bytes, time_ns: int | None) -> None:
        """Add a message; `time_ns` is its time on the wheel's clock, None where it has none."""
        channel = str(self._writer.channel(topic, schema))
        if channel not in self._described:
            self._describe(channel, (topic, schema))
        self._log_time = max(self._log_time, time_ns or 0)
        self._writer.write(topic, schema, payload, self._log_time, self.wall_ns())

    def _describe(self, channel: str, topic: tuple[str, str]) -> None:
        """Write down, apart from the chunks, which channel is what: all, so that one list that is whole is enough.

        Of a fleet only what is new, but for when their number has doubled: else the lists would fill the file.
        """
        self._described[channel] = topic
        count = len(self._described)
        whole = count <= FEW_CHANNELS or count >= 2 * self._described_whole
        if whole:
            self._described_whole = count
        self.attach(CHANNELS_ATTACHMENT, dump_json(self._described if whole else {channel: topic}))

    def attach(self, name: str, data: bytes) -> None:
        """Add an attachment; of several with one name the last one counts."""
        media_type = "application/toml" if name.endswith(".toml") else "application/json"
        self._writer.attach(name, data, self._log_time, media_type)

    def sync(self) -> None:
        """Bring everything to the disk."""
        self._writer.mcap.flush()  # type: ignore[no-untyped-call]
        self._sink.sync()

    def close(self) -> None:
        """Write the file's end and close it."""
        try:
            self._writer.finish()
            self._sink.sync()
        finally:
            self._sink.close()

    def abandon(self) -> None:
        """Close the file as it is, without its end."""
        with suppress(OSError):
            self._sink.close()


def _sync_folder(folder: Path) -> None:
    """Bring the names in a folder to the disk: a file whose name is lost when the power goes is lost itself."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
