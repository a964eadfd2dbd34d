"""Reads recordings: MCAP files, of which only bytes that pass their checksum are used.

The mcap package's own readers check no CRC by default, never check those of attachments, and give nothing of a
truncated file. This reader iterates over the records itself (one byte opcode, eight bytes length, content), keeps the
intact ones, and reports the others.

A file may be malicious: a few bytes that unpack to gigabytes, a million false chunk headers. The sizes that it states,
and the total work on it, are compared with limits before anything is copied or unpacked; a file that exceeds a limit is
refused.
"""

import json
import os
import struct
import zlib
from collections.abc import Callable, Iterator, Sequence
from errno import EIO
from functools import partial
from hashlib import file_digest
from pathlib import Path
from typing import Any, BinaryIO, Final, Literal, TypeVar

from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Schema
from mcap.writer import MCAP0_MAGIC
from pydantic import ConfigDict

from rwa_monitor.errors import InputError
from rwa_monitor.messages import MAX_MESSAGE_BYTES, EncodedMessage, Message, SamplesMessage
from rwa_monitor.monitor.checkpoint import MAX_CHECKPOINT_BYTES
from rwa_monitor.telemetry.files import (
    MAX_CHUNK_BYTES,
    MESSAGE,
    MESSAGE_HEAD,
    PIECE_BYTES,
    RECORD_HEAD,
    decode_utf8,
    display_name,
    opened,
    records_in,
    stream_of,
    unpacked,
)
from rwa_monitor.words import counted

Parsed = TypeVar("Parsed", bound=Message)
RECORDING_SUFFIX: Final = ".mcap"
MAX_FILE_BYTES: Final = 2**30  # a monitor's are rotated at 32 MiB, or at twice the size of what they begin with
# Limit where the file is not kept in memory: it may hold a checkpoint of each of up to 4,096 wheels, each 1.7 MB where
# a window of 80,000 slots is nearly full.
MAX_FLEET_FILE_BYTES: Final = 24 * 2**30
MAX_WORK_BYTES: Final = 3 * 2**30  # copied and unpacked, for all records of a file and for false chunk headers
# The limit for a larger file that is not kept in memory, per byte of it; telemetry that hardly changes is compressed to
# a twentieth.
MAX_WORK_SHARE: Final = 64
MAX_RECORDS: Final = 10_000_000  # of a file
_CHUNK_HEAD: Final = struct.Struct("<BQQQQI")  # opcode, length, first and last time, unpacked size and its checksum
_FOOTER: Final = struct.Struct("<BQQQI8s")  # opcode, length, offsets of summary and summary offsets, checksum, magic
_ZSTD_NAME: Final = b"\x04\x00\x00\x00zstd"
CHANNELS_ATTACHMENT: Final = "channels.json"
SETTINGS_ATTACHMENT: Final = "settings.json"
CHECKPOINT_PREFIX: Final = "checkpoint/"  # of the attachments' names
# Of which wheels a recording holds the state ("checkpoints" in its settings): of some while the wheels are moved from
# the previous recording, which holds the state of the others.
Held = Literal["all", "some"]


class _Settings(Message):
    """The settings that the recorder attaches: an object with any fields."""

    model_config = ConfigDict(extra="allow")


class Recording:
    """A recording, whose content is read piece by piece: a large one takes little memory.

    Parameters
    ----------
    path
        The file.
    limit
        Largest size that is accepted [bytes].
    work_share
        Bytes that may be copied and unpacked for each byte of the file.

    Attributes
    ----------
    finished
        Whether it was closed properly; a recording without an end can still be intact up to its last flush.
    problems
        One line for each part that could not be read.
    share
        Share of the file that has been read, 0 … 1; `finished` and `problems` are valid when all of it has.
    attachments, messages
        The content that the caller of `parts` keeps: attachments by name, the last one where a name occurs twice, and
        messages in file order.
    """

    def __init__(self, path: Path, limit: int = MAX_FLEET_FILE_BYTES, work_share: int = MAX_WORK_SHARE) -> None:
        self.path = path
        self.finished = False
        self.problems: list[str] = []
        self.attachments: dict[str, bytes] = {}
        self.messages: list[EncodedMessage] = []
        self.share = 0.0
        self._limit = limit
        self._work_share = work_share
        self._file: BinaryIO
        self._size = 0
        self._found: list[Attachment | EncodedMessage] = []  # in the current record
        self._schemas: dict[int, str] = {}
        self._channels: dict[int, tuple[str, str]] = {}  # topic and schema
        self._lost_messages = 0
        self._work_bytes = 0
        self._records = 0

    def text(self, name: str) -> str:
        """Return an attached text; raises InputError where it is missing or no UTF-8."""
        if name not in self.attachments:
            raise InputError(str(self.path), "is missing: this is no recording of rwa-monitor run", name)
        return decode_utf8(self.attachments[name], self.path)

    def settings(self) -> dict[str, Any]:
        """Return the settings attached by the recorder; raises InputError where there are none."""
        text = self.text(SETTINGS_ATTACHMENT)
        return _Settings.parse(text.encode(), f"{self.path}: {SETTINGS_ATTACHMENT}").model_extra or {}

    def parsed(self, kind: type[Parsed]) -> list[Parsed]:
        """Return the messages of a kind, in order; raises InputError where one cannot be read."""
        return [
            kind.parse(message.payload, f"{self.path}: {message.topic}")
            for message in self.messages
            if message.schema == kind.schema_name()
        ]

    def parts(self) -> Iterator[Attachment | EncodedMessage]:
        """Yield attachments and messages in the order of the file, once; damaged parts are skipped.

        Raises
        ------
        InputError
            If the file cannot be opened, does not begin as an MCAP file, or exceeds a limit.
        """
        path = self.path
        with opened(path, PIECE_BYTES) as self._file:
            self._size = os.fstat(self._file.fileno()).st_size
            if self._size > self._limit:
                raise InputError(display_name(path), f"is larger than the limit of {self._limit:,} bytes")
            if self._file.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
                raise InputError(str(path), "is no MCAP file")
            self._most_work_bytes = max(MAX_WORK_BYTES, self._work_share * self._size)
            yield from self._parts()

    def _read(self, start: int, stop: int) -> bytes:
        """Return the bytes between two positions; fewer where the file ends before."""
        self._file.seek(start)
        data = self._file.read(stop - start)
        if start + len(data) < min(stop, self._size):
            raise OSError(EIO, "it became shorter while it was read")
        return data

    def _find(self, wanted: bytes, start: int) -> int:
        """Return the first position of some bytes from `start` on, -1 where there is none."""
        while start + len(wanted) <= self._size:
            if (found := self._read(start, start + PIECE_BYTES).find(wanted)) >= 0:
                return start + found
            start += PIECE_BYTES - len(wanted) + 1  # the bytes may lie across the border of two pieces
        return -1

    def _parts(self) -> Iterator[Attachment | EncodedMessage]:
        position, size = len(MCAP0_MAGIC), self._size
        while position < size and not self.finished:
            stop = self._record_end(position)
            if stop is None or not _is_sound(partial(self._take_record, position, stop)):
                self._found.clear()
                stop = self._next_chunk(position + 1)
                self.problems.append(f"bytes {position} to {stop} of {size} cannot be read")
            found, self._found = self._found, []
            position, self.share = stop, stop / size
            yield from found
        if self._lost_messages:
            lost = counted(self._lost_messages, "message")
            self.problems.append(f"{lost} of channels whose description cannot be read")

    def _record_end(self, position: int) -> int | None:
        """Return where the record at `position` ends, None where there can be no record."""
        if position + RECORD_HEAD.size > self._size:
            return None
        length = int.from_bytes(self._read(position + 1, position + RECORD_HEAD.size), "little")
        stop = position + RECORD_HEAD.size + length
        return stop if length <= MAX_CHECKPOINT_BYTES and stop <= self._size else None

    def _take_record(self, position: int, stop: int) -> None:
        """Process one record; raises InputError if the file exceeds a limit, others if the record is damaged."""
        self._begin_work(stop - position)
        record = self._read(position, stop)
        opcode, content = record[0], record[RECORD_HEAD.size :]
        if opcode == Opcode.CHUNK:
            self._take_records(self._unpack(content))
        elif opcode == Opcode.ATTACHMENT:
            self._take_attachment(content)
        elif opcode == Opcode.DATA_END and self._is_end(stop):
            self.finished = True
        elif not _is_ignored(opcode, content):
            raise ValueError("no record of a recording")

    def _unpack(self, content: bytes) -> bytes:
        """Return the data of a chunk; raises as `_take_record`."""
        chunk = Chunk.read(stream_of(content))
        if not chunk.uncompressed_crc:
            raise ValueError("no checksum")
        self._begin_work(min(chunk.uncompressed_size, MAX_CHUNK_BYTES))  # more is not unpacked
        return unpacked(chunk)

    def _take_records(self, data: bytes) -> None:
        """Process the records of a chunk; raises as `_take_record`."""
        for opcode, record in records_in(data):
            self._records += 1
            if self._records > MAX_RECORDS:
                raise InputError(display_name(self.path), f"has more than {MAX_RECORDS:,} records")
            if opcode == MESSAGE:
                self._take_message(record)
            elif opcode == Opcode.SCHEMA:
                schema = Schema.read(stream_of(record))
                self._schemas[schema.id] = schema.name
            elif opcode == Opcode.CHANNEL:
                channel = Channel.read(stream_of(record))
                self._channels[channel.id] = (channel.topic, self._schemas.get(channel.schema_id, ""))

    def _take_message(self, record: bytes) -> None:
        channel, _, log_time, publish_time = MESSAGE_HEAD.unpack_from(record)
        if channel not in self._channels:
            self._lost_messages += 1
            return
        topic, schema = self._channels[channel]
        self._found.append(EncodedMessage(topic, schema, record[MESSAGE_HEAD.size :], log_time, publish_time))

    def _begin_work(self, size: int) -> None:
        """Add to the work done on the file; raises InputError where it is too much."""
        self._work_bytes += size
        if self._work_bytes > self._most_work_bytes:
            reason = f"asks for more than {self._most_work_bytes:,} bytes to be copied and unpacked"
            raise InputError(display_name(self.path), reason)

    def _take_attachment(self, content: bytes) -> None:
        """Process an attachment; raises as `_take_record`."""
        if zlib.crc32(content[:-4]) != int.from_bytes(content[-4:], "little"):
            raise ValueError("another checksum")
        attachment = Attachment.read(stream_of(content))
        if attachment.name == CHANNELS_ATTACHMENT:
            if len(attachment.data) > MAX_MESSAGE_BYTES:
                raise ValueError("more channels than any recording has")
            for key, (topic, schema) in json.loads(attachment.data).items():
                self._channels.setdefault(int(key), (str(topic), str(schema)))
        self._found.append(attachment)

    def _is_end(self, stop: int) -> bool:
        """Return whether the data ends at `stop`: there the footer says that the summary begins, which is not read."""
        footer = self._read(max(0, self._size - _FOOTER.size), self._size)
        if len(footer) < _FOOTER.size:
            return False
        _, _, summary, _, _, magic = _FOOTER.unpack(footer)
        return bool(summary == stop and magic == MCAP0_MAGIC)

    def _next_chunk(self, position: int) -> int:
        """Return where the next intact chunk begins, the file's end where there is none."""
        while (found := self._find(_ZSTD_NAME, position + _CHUNK_HEAD.size)) >= 0:
            start = found - _CHUNK_HEAD.size
            stop = self._record_end(start)
            if stop is not None and self._is_chunk(start, stop):
                return start
            position = start + 1
        return self._size

    def _is_chunk(self, start: int, stop: int) -> bool:
        """Return whether there is an intact chunk between two positions; checks its header before copying it."""
        opcode, _, _, _, size, _ = _CHUNK_HEAD.unpack(self._read(start, start + _CHUNK_HEAD.size))
        data = start + _CHUNK_HEAD.size + len(_ZSTD_NAME) + 8
        length = int.from_bytes(self._read(data - 8, data), "little")
        if opcode != Opcode.CHUNK or size > MAX_CHUNK_BYTES or data + length != stop:
            return False
        self._begin_work(stop - start)
        return _is_sound(partial(self._unpack, self._read(start + RECORD_HEAD.size, stop)))


def _is_sound(parse: Callable[[], object]) -> bool:
    """Return whether something can be parsed; raises InputError where a limit is exceeded, OSError where one is."""
    try:
        parse()
    except (InputError, OSError):
        raise
    # With damaged bytes the parsers may raise anything.
    except Exception:  # noqa: BLE001
        return False
    return True


def _is_ignored(opcode: int, content: bytes) -> bool:
    """Return whether this is an intact record of a kind that is ignored, as it has no checksum of its own.

    Its lengths must agree: a chunk with a flipped bit in its opcode must not be mistaken for one, and lost unreported.
    """
    if opcode == Opcode.HEADER:  # two texts, each after its length
        profile = int.from_bytes(content[:4], "little")
        library = int.from_bytes(content[4 + profile : 8 + profile], "little")
        return len(content) == 8 + profile + library
    if opcode == Opcode.MESSAGE_INDEX:  # a channel, then an array after its length
        return len(content) == 6 + int.from_bytes(content[2:6], "little")
    return False


# ---- files and folders of recordings ---------------------------------------------------------------------------------


def read_recording(path: Path) -> Recording:
    """Read all intact parts of a recording into memory; raises InputError as `Recording.parts`."""
    recording = Recording(path, MAX_FILE_BYTES, 0)  # with the limits for files that are kept in memory
    for part in recording.parts():
        if isinstance(part, EncodedMessage):
            recording.messages.append(part)
        else:
            recording.attachments[part.name] = part.data
    return recording


def recordings_of(paths: Path | Sequence[Path]) -> list[Path]:
    """Return the recordings among files and in folders, those of a folder in the order of their names.

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
    """Read the recordings among files and in folders, each after its predecessor.

    Raises
    ------
    InputError
        As `recordings_of` and `read_recording`.
    """
    # Names are numbered, so that their order is the order of the chain; replay checks the links.
    for path in recordings_of(paths):
        yield read_recording(path)


def recorded_inputs(recordings: Path | Sequence[Path]) -> Iterator[EncodedMessage]:
    """Yield the messages of samples in recordings.

    Raises
    ------
    InputError
        As `recordings_of` and `Recording.parts`.
    """
    for path in recordings_of(recordings):
        for part in Recording(path).parts():
            if isinstance(part, EncodedMessage) and part.schema == SamplesMessage.schema_name():
                yield part


def file_sha256(path: Path) -> str:
    """Return the hash of a file's content."""
    with path.open("rb") as file:
        return file_digest(file, "sha256").hexdigest()


# ---- times from the headers of chunks --------------------------------------------------------------------------------


def time_span(path: Path) -> tuple[int, int] | None:
    """Return the first and the last time [ns, the wheels' clocks] in a recording, None where it has none.

    They are read from the headers of chunks, which have no checksum: for display and preselection only. Messages before
    the first sample have no time (0) and do not count.

    Raises
    ------
    InputError
        If the file cannot be read.
    """
    first_ns: int | None = None
    last_ns, position = 0, len(MCAP0_MAGIC)
    with opened(path) as file:
        for _ in range(MAX_RECORDS):
            file.seek(position)
            head = file.read(_CHUNK_HEAD.size)
            if len(head) < _CHUNK_HEAD.size or head[0] == Opcode.DATA_END:
                break
            opcode, length, start_ns, end_ns, _, _ = _CHUNK_HEAD.unpack(head)
            if opcode == Opcode.CHUNK and end_ns:
                first_ns, last_ns = first_ns or start_ns or end_ns, max(last_ns, end_ns)
            position += RECORD_HEAD.size + length
    return None if first_ns is None else (first_ns, last_ns)
