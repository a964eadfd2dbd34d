"""ROS 2 bags in MCAP: messages of any type (CDR by ros2msg), of which a telemetry map names topics and fields.

The wheel's samples come when its speed does. The value of another topic is held for `hold_s` at most, then NaN.
Messages carry no units: they are SI, as ROS demands (REP 103), unless the map gives another.

A bag is read record by record, and what it states of its sizes is compared with limits before anything is unpacked.
Only the topics of the map are decoded, by `mcap_ros2`; what could make that work without end is refused before.
"""

from __future__ import annotations

import os
import re
import struct
import zlib
from array import array
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr
from dataclasses import dataclass, replace
from io import BytesIO, StringIO
from pathlib import Path
from typing import IO, Any, Final, NamedTuple

import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Message, Schema
from mcap.writer import MCAP0_MAGIC

from rwa_monitor.errors import InputError, needs_extra
from rwa_monitor.samples import NANOSECONDS_PER_SECOND, FloatArray, IntArray, Samples
from rwa_monitor.telemetry.columns import MAX_ROWS
from rwa_monitor.telemetry.files import display_name, first_line, unreadable
from rwa_monitor.telemetry.reader import Decoding, TelemetryFile
from rwa_monitor.telemetry.telemetry_map import (
    SI_UNITS,
    UNITS,
    TopicChannel,
    TopicWheel,
    check_time,
    conversion,
    telemetry_file,
    wheels_of,
)
from rwa_monitor.words import counted

MAX_RECORD_BYTES: Final = 64 * 2**20
MAX_SKIPPED_BYTES: Final = 2**40  # of an attachment that is passed over
MAX_CHUNK_BYTES: Final = 64 * 2**20  # unpacked; rosbag2 writes chunks of less than one
MAX_WORK_BYTES: Final = 16 * 2**30  # to be unpacked of a file; a bag with pictures is large
MAX_SCHEMAS_BYTES: Final = 64 * 2**20  # of all that are kept; a bag of hundreds of types has some
MAX_RECORDS: Final = 100_000_000  # of a bag; 28 hours of a thousand messages a second
MAX_CHANNELS: Final = 1_000  # of the topics of the map
MAX_NAME: Final = 200  # characters of another topic's name that are kept, to be listed
MAX_MESSAGE_BYTES: Final = 2**18  # of a topic of the map; the state of a thousand joints has some 50 kB

_MCAP_ERRORS: Final = (ArithmeticError, McapError, RuntimeError, ValueError, struct.error, zstandard.ZstdError)
_HEAD: Final = struct.Struct("<BQ")  # opcode and length of a record
_MESSAGE: Final = int(Opcode.MESSAGE)  # comparing an enumeration costs as much as reading the record
_WANTED: Final = frozenset({Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK})
_CHANNEL_OF: Final = struct.Struct("<H")  # of a message
_MESSAGE_BYTES: Final = 2 + 4 + 8 + 8  # of a message without its content


def read_bag(path: Path, decoding: Decoding) -> TelemetryFile:
    """Read the topics of a map from a ROS 2 bag (one .mcap file of it).

    Raises
    ------
    InputError
        If the map cannot be used, a topic of it is not in the bag or holds something else, or there are no samples.
    """
    source = display_name(path)
    if decoding.map is None:
        raise InputError(source, "is a ROS 2 bag: --map gives which topics are which channels")
    wheels = [_Wheel(wheel, decoding.map.source) for wheel in wheels_of(decoding.map, TopicWheel)]
    bag = _Bag(source, wheels)
    try:
        with path.open("rb") as file:
            bag.read(file)
    except OSError as error:
        raise unreadable(path, error) from error
    bag.check_topics()
    found = [(entry.wheel, entry.samples()) for entry in wheels]
    return telemetry_file(source, found, bag.problems(), (), "holds no sample of a wheel of the map")


# ---- the wheels of the map -------------------------------------------------------------------------------------------


class _Series:
    """The values of one channel at the times of its messages [ns], in the unit of its name."""

    def __init__(self, channel: str, spec: TopicChannel, place: str, source: str) -> None:
        self.spec = spec
        self.times = array("q")
        self.values = array("d")
        self._factor, self._offset = conversion(UNITS[channel], spec.unit or SI_UNITS[channel], channel, source, place)

    def take(self, message: Any, logged: Message) -> None:
        """Take a message's value, NaN where it has none; leave one out that does not hold this joint."""
        at: int | None = None
        if self.spec.joint is not None:
            names = list(_field(message, "name"))
            if self.spec.joint not in names:
                return
            at = names.index(self.spec.joint)
        value = _field(message, self.spec.field)
        if at is not None:
            value = value[at] if at < len(value) else float("nan")  # an array left empty was not measured
        if not isinstance(value, (int, float)):
            raise TypeError(f"{self.spec.field} is no number")
        time_ns = self._time_of(message, logged)
        check_time(time_ns)
        self.times.append(time_ns)
        self.values.append(float(value) * self._factor + self._offset)

    def _time_of(self, message: Any, logged: Message) -> int:
        if self.spec.time != "header":
            return int(logged.log_time if self.spec.time == "log" else logged.publish_time)
        if not hasattr(message, "header"):
            raise ValueError('it has no header: set time = "log" or "publish" in the map')
        stamp = _field(message, "header.stamp")
        return int(stamp.sec) * NANOSECONDS_PER_SECOND + int(stamp.nanosec)


class _Wheel:
    """A wheel of the map, and what the bag holds of it."""

    def __init__(self, wheel: TopicWheel, source: str) -> None:
        self.wheel = wheel
        self.series = {
            str(channel): _Series(channel, spec, f"{wheel.spacecraft}/{wheel.wheel}: {channel}: {spec.topic}", source)
            for channel, spec in wheel.channels.items()
        }

    def samples(self) -> Samples:
        """Return what is known of each channel when the speed is."""
        times = np.array(self.series["speed_rad_s"].times, dtype=np.int64)
        channels = {name: self._at(series, times) for name, series in self.series.items()}
        return Samples(time_ns=times, **channels)

    def _at(self, series: _Series, times: IntArray) -> FloatArray:
        """Return the last value of a series at some times, NaN where it is older than the map allows."""
        stamps, values = np.array(series.times, dtype=np.int64), np.array(series.values)
        if np.array_equal(stamps, times):  # of the same messages
            return values
        hold_s = self.wheel.hold_s
        order = np.argsort(stamps, kind="stable")
        stamps, values = stamps[order], values[order]
        last = np.searchsorted(stamps, times, side="right") - 1
        known = last >= 0
        # Without `hold_s` all is of one topic, and what is not of the same message is not known.
        reach_ns = 0 if hold_s is None else round(hold_s * NANOSECONDS_PER_SECOND)
        known[known] &= times[known] - stamps[last[known]] <= reach_ns
        found = np.full(times.size, np.nan)
        found[known] = values[last[known]]
        return found


def _stream(data: bytes) -> ReadDataStream:
    """Return the stream of one record: no length in it reaches beyond."""
    return ReadDataStream(BytesIO(data))


def _field(message: Any, path: str) -> Any:
    for name in path.split("."):
        message = getattr(message, name)
    return message


# ---- the bag ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Topic:
    """A channel of the bag that the map names."""

    name: str
    decode: Callable[[bytes], Any]
    series: list[_Series]


class _Bag:
    """Goes over the records of a bag and hands the messages of the map's topics to their series."""

    def __init__(self, source: str, wheels: list[_Wheel]) -> None:
        with needs_extra("ros2"):
            from mcap_ros2.decoder import DecoderFactory
        self._source = source
        self._factory = DecoderFactory()
        self._series: dict[str, list[_Series]] = {}
        for wheel in wheels:
            for series in wheel.series.values():
                self._series.setdefault(series.spec.topic, []).append(series)
        self._schemas: dict[int, Schema] = {}
        self._topics: dict[int, _Topic | None] = {}  # None: a topic that the map does not name
        self._names: set[str] = set()
        self._described = 0
        self._schemas_bytes = 0
        self._records_seen = 0
        self._rows = 0
        self._work_bytes = 0
        self._lost: list[str] = []
        self._undescribed = 0
        self._refused = 0
        self._first_refused = ""

    def problems(self) -> list[str]:
        """Report what could not be read."""
        found = list(self._lost)
        if self._undescribed:
            found.append(f"{counted(self._undescribed, 'message')} of topics whose description cannot be read")
        if self._refused:
            found.append(f"{counted(self._refused, 'message')} cannot be used, the first: {self._first_refused}")
        return found

    def check_topics(self) -> None:
        """Raise InputError where the map names a topic that the bag does not have."""
        for name in self._series:
            if name not in self._names:
                there = ", ".join(sorted(self._names)[:8]) or "no topics at all"
                because = "".join(f"; {problem}" for problem in self.problems()[:1])
                raise InputError(self._source, f"there is no topic {name}; there are {there}{because}")

    def read(self, file: IO[bytes]) -> None:
        """Read all that is whole."""
        position = file.seek(len(MCAP0_MAGIC))
        while len(head := file.read(_HEAD.size)) == _HEAD.size:
            opcode, length = _HEAD.unpack(head)
            if opcode == Opcode.DATA_END:  # what follows repeats what came
                return
            if opcode not in _WANTED:
                position = file.seek(length, os.SEEK_CUR) if length < MAX_SKIPPED_BYTES else -1
                continue
            content = file.read(length) if length <= MAX_RECORD_BYTES else b""
            if len(content) < length:
                break
            try:
                messages = self._messages(opcode, content)
            except _MCAP_ERRORS as error:
                self._lost.append(f"the record at byte {position} cannot be read: {first_line(error)}")
                messages = []
            for topic, message in messages:
                self._decode(topic, message)
            position = file.tell()
        self._lost.append(f"what follows byte {position} cannot be read: the bag was not closed, or is damaged")

    def _messages(self, opcode: int, content: bytes) -> list[tuple[_Topic, Message]]:
        """Return the messages in a record, of the map's topics; others are passed over unread."""
        if opcode == Opcode.CHUNK:
            data = self._unpacked(Chunk.read(ReadDataStream(BytesIO(content))))
        else:
            data = _HEAD.pack(opcode, len(content)) + content
        messages: list[tuple[_Topic, Message]] = []
        position = undescribed = 0
        while position < len(data):
            self._records_seen += 1
            if self._records_seen > MAX_RECORDS:
                raise InputError(self._source, f"has more than {MAX_RECORDS:,} records")
            opcode, length = _HEAD.unpack_from(data, position)
            start, position = position + _HEAD.size, position + _HEAD.size + length
            if position > len(data):
                raise ValueError("a record in it reaches beyond its end")
            if opcode == _MESSAGE:
                if length < _MESSAGE_BYTES:
                    raise ValueError("a message in it has no head")
                channel_id = _CHANNEL_OF.unpack_from(data, start)[0]
                if channel_id not in self._topics:
                    undescribed += 1
                elif (topic := self._topics[channel_id]) is not None:
                    messages.append((topic, Message.read(_stream(data[start:position]), length)))
            elif opcode == Opcode.SCHEMA:
                self._keep_schema(Schema.read(_stream(data[start:position])))
            elif opcode == Opcode.CHANNEL:
                self._keep_channel(Channel.read(_stream(data[start:position])))
        self._undescribed += undescribed
        return messages

    def _unpacked(self, chunk: Chunk) -> bytes:
        """Return the content of a chunk; raises ValueError where it is another than the chunk states."""
        self._work_bytes += chunk.uncompressed_size
        if self._work_bytes > MAX_WORK_BYTES:
            raise InputError(self._source, f"asks for more than {MAX_WORK_BYTES:,} bytes to be unpacked")
        data = _unpacked(chunk)
        if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
            raise ValueError("it has another checksum than it states")
        return data

    def _keep_channel(self, channel: Channel) -> None:
        if channel.id not in self._topics:
            wanted = channel.topic in self._series
            self._names.add(channel.topic if wanted else channel.topic[:MAX_NAME])
            self._topics[channel.id] = self._topic(channel) if wanted else None

    def _keep_schema(self, schema: Schema) -> None:
        before = self._schemas.get(schema.id)
        for sign, known in ((1, schema), (-1, before)):
            if known is not None:
                self._schemas_bytes += sign * (len(known.data) + len(known.name) + len(known.encoding))
        if self._schemas_bytes > MAX_SCHEMAS_BYTES:
            raise InputError(self._source, f"has schemas of more than {MAX_SCHEMAS_BYTES:,} bytes")
        self._schemas[schema.id] = schema

    def _topic(self, channel: Channel) -> _Topic:
        """Return how to decode a topic; raises InputError where it cannot be."""
        schema = self._schemas.get(channel.schema_id)
        place = f"topic {channel.topic}"
        if schema is None or (channel.message_encoding, schema.encoding) != ("cdr", "ros2msg"):
            how = f"{channel.message_encoding} by {schema.encoding if schema else 'nothing'}"
            raise InputError(self._source, f"holds {how}; cdr by ros2msg is wanted", place)
        self._described += 1
        if self._described > MAX_CHANNELS:
            raise InputError(self._source, f"has more than {MAX_CHANNELS:,} channels of the map's topics", place)
        definition = checked_definition(schema.name, schema.data, self._source, place)
        try:
            with redirect_stderr(StringIO()):  # the parser prints there what it also raises
                decode = self._factory.decoder_for("cdr", replace(schema, data=definition))
                assert decode is not None
        except Exception as error:  # the parser raises whatever comes of a text that is no definition
            raise InputError(self._source, f"{schema.name} is no message type: {first_line(error)}", place) from error
        return _Topic(channel.topic, decode, self._series[channel.topic])

    def _decode(self, topic: _Topic, record: Message) -> None:
        try:
            if len(record.data) > MAX_MESSAGE_BYTES:
                raise ValueError(f"it has {len(record.data):,} bytes; the limit is {MAX_MESSAGE_BYTES:,}")
            message = topic.decode(record.data)
            for series in topic.series:
                series.take(message, record)
        # The decoder checks little itself: it raises whatever comes of bytes that are not as in the schema.
        except Exception as error:  # noqa: BLE001
            self._refused += 1
            self._first_refused = self._first_refused or f"topic {topic.name}: {first_line(error)}"
        self._rows += 1
        if self._rows > MAX_ROWS:
            raise InputError(self._source, f"has more than {MAX_ROWS:,} messages of the map's topics")


def _unpacked(chunk: Chunk) -> bytes:
    """Return the content of a chunk; raises ValueError where it is more than stated, before it is unpacked."""
    size = chunk.uncompressed_size
    if size > MAX_CHUNK_BYTES:
        raise ValueError(f"it unpacks to {size:,} bytes; the limit is {MAX_CHUNK_BYTES:,}")
    if chunk.compression == "":
        data = chunk.data
    elif chunk.compression == "zstd":
        # The decompressor goes by the frame, not by its caller.
        stated = zstandard.get_frame_parameters(chunk.data).content_size
        if stated not in (size, zstandard.CONTENTSIZE_UNKNOWN):
            raise ValueError(f"its frame states {stated:,} bytes, it itself {size:,}")
        data = zstandard.decompress(chunk.data, size)
    elif chunk.compression == "lz4":
        from lz4.frame import LZ4FrameDecompressor

        data = LZ4FrameDecompressor().decompress(chunk.data, max_length=size + 1)
    else:
        raise ValueError(f"its compression {chunk.compression[:20]!r} is not known")
    if len(data) != size:
        raise ValueError(f"it unpacks to another size than the {size:,} bytes it states")
    return bytes(data)


# ---- what the definition of a type may hold, checked before `mcap_ros2` takes it -------------------------------------
# The decoder does not check its types, and its parser has expressions that some text keeps busy without end. So types
# are checked line by line for what either would take longer over than the bytes are worth: names of constants that the
# parser tries in all ways (24 letters: half a minute, and six times as long with two more), fields that need no bytes,
# more objects than bytes.


MAX_SCHEMA_BYTES: Final = 65_536
MAX_LINES: Final = 2_000  # the parser compares all names of a type with each other; large types have some hundred
MAX_LINE: Final = 1_000  # characters, without what follows a #
MAX_DEPTH: Final = 32  # of types in types
FEW_OBJECTS: Final = 64  # a message may have, however small it is

_COMMENT: Final = re.compile(r"#[^\n]*")
_SEPARATOR: Final = re.compile(r"={3,}")
_NAMED: Final = re.compile(r"MSG:\s+(\S+)")
# Bytes that the decoder takes without looking whether there are any: a list of such types would have no end.
_FIXED_BYTES: Final = re.compile(r"\s*(?:uint8|byte)\s*\[\s*([^\]\s<][^\]]*)\]")
# A field's type: its name, whether there are many, of any number, or how many.
_FIELD_TYPE: Final = re.compile(r"([^\[]*)(\[(?:(\]|<=)|([0-9]{1,9})\])?)?")
# In CDR, at least; a string begins with its length.
_BYTES: Final = {
    **dict.fromkeys(("bool", "byte", "char", "int8", "uint8"), 1),
    **dict.fromkeys(("int16", "uint16"), 2),
    **dict.fromkeys(("int32", "uint32", "float32", "string", "wstring"), 4),
    **dict.fromkeys(("int64", "uint64", "float64"), 8),
}
_LENGTH_BYTES: Final = 4  # of a list of any length
_TIMES: Final = ("builtin_interfaces/Time", "builtin_interfaces/Duration")  # which the decoder has built in
_CONSTANT: Final = re.compile(r"[A-Z][A-Z0-9]*(?:_[A-Z0-9]+)*")  # as ROS has it, in an expression without two ways


def checked_definition(name: str, data: bytes, source: str, place: str) -> bytes:
    """Return the definition of a type without its comments.

    Parameters
    ----------
    name
        Of the type, such as "sensor_msgs/msg/JointState".
    data
        Its definition and those of the types in it (`ros2msg`).
    source, place
        For messages: the bag, and the topic.

    Raises
    ------
    InputError
        If it exceeds a limit, or has what the decoder cannot be trusted with.
    """
    if len(data) > MAX_SCHEMA_BYTES:
        raise InputError(source, f"has a schema of more than {MAX_SCHEMA_BYTES:,} bytes", place)
    try:
        text = _COMMENT.sub("", data.decode("utf-8"))
    except UnicodeDecodeError as error:
        raise InputError(source, f"{name} is no message type: {error}", place) from error
    lines = [line.replace("\t", " ").rstrip() for line in text.splitlines() if line.strip()]
    if len(lines) > MAX_LINES or max(map(len, lines), default=0) > MAX_LINE:
        reason = f"has a schema of more than {MAX_LINES:,} lines, or a line of more than {MAX_LINE:,} characters"
        raise InputError(source, reason, place)
    for line in lines:
        if _FIXED_BYTES.match(line):
            raise InputError(source, "has a field of a fixed number of bytes, which is not read here", place)
        if line.strip() == "MSG:":  # the parser would take the next line for its name
            raise InputError(source, f"{name} is no message type: MSG: names none", place)
        _, _, declared = line.partition(" ")
        if "=" in declared and not _CONSTANT.fullmatch(declared.partition("=")[0].strip()):
            raise InputError(source, f"{name} is no message type: {declared[:40]!r} names no constant", place)
    types = _Types(name, lines)
    try:
        whole = types.size_of(name)
        repeated = [types.size_of(kind) for kind in sorted(types.repeated)]
    except RecursionError as error:
        reason = f"has types in types, deeper than {MAX_DEPTH} levels, or a type that holds itself"
        raise InputError(source, reason, place) from error
    if any(size.objects > size.bytes for size in repeated) or whole.objects > max(whole.bytes, FEW_OBJECTS):
        raise InputError(source, "has a type of more objects than bytes, which is not read here", place)
    return text.encode()


class _Size(NamedTuple):
    """What the decoder makes of a type at least, its lists empty: objects, and the bytes that it takes for them."""

    objects: int
    bytes: int


class _Field(NamedTuple):
    """A field: its type, how often it is there at least, and the bytes that state how often."""

    kind: str
    times: int
    length_bytes: int = 0


class _Types:
    """The types of a definition, and how large they are at least.

    Attributes
    ----------
    repeated
        Types of which there are many in a field.
    """

    def __init__(self, name: str, lines: list[str]) -> None:
        self.repeated: set[str] = set()
        self._fields: dict[str, list[_Field]] = {}
        for kind, within in _sections(name, lines):
            package = kind.split("/")[0]
            fields = [self._field(line, package) for line in within if "=" not in line.partition(" ")[2]]
            # As the parser does: of two types of one name the last one counts, and a name goes with and without "msg".
            self._fields[kind] = self._fields[f"{package}/{kind.split('/')[-1]}"] = fields
        known = {kind: _Size(1, 8) for kind in _TIMES if kind not in self._fields}
        self._sizes = known | {kind: _Size(0, size) for kind, size in _BYTES.items()}

    def _field(self, line: str, package: str) -> _Field:
        found = _FIELD_TYPE.match(line.partition(" ")[0])
        assert found is not None  # it matches anything
        kind, many, of_any_number, count = found.groups()
        kind = kind.partition("<")[0]  # of a string no longer than so
        if kind not in _BYTES and "/" not in kind:
            kind = f"{package}/{kind}"
        if many is None:
            return _Field(kind, 1)
        self.repeated.add(kind)
        return _Field(kind, 0, _LENGTH_BYTES) if of_any_number else _Field(kind, int(count or 0))

    def size_of(self, kind: str, depth: int = 0) -> _Size:
        """Return the size of a type; raises RecursionError where types lie too deep in types."""
        if depth > MAX_DEPTH:
            raise RecursionError
        if kind not in self._sizes:
            fields = self._fields.get(kind, [])
            sizes = [self.size_of(field.kind, depth + 1) for field in fields]
            objects = sum(field.times * size.objects for field, size in zip(fields, sizes, strict=True))
            taken = sum(
                field.length_bytes + field.times * size.bytes for field, size in zip(fields, sizes, strict=True)
            )
            self._sizes[kind] = _Size(1 + objects, taken if fields else 1)  # one without fields has a byte
        return self._sizes[kind]


def _sections(name: str, lines: list[str]) -> Iterator[tuple[str, list[str]]]:
    """Yield each type by its name, with its lines."""
    within: list[str] = []
    for line in [*lines, "==="]:
        if not _SEPARATOR.fullmatch(line):
            within.append(line)
            continue
        if within and (named := _NAMED.fullmatch(within[0].strip())):
            name = named[1]
        yield name, [of for of in within if not _NAMED.fullmatch(of.strip())]
        within = []
