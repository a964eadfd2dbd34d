"""ROS 2 bags in MCAP: messages of any type (CDR by ros2msg), of which a telemetry map names topics and fields.

A wheel has a sample for each value of its speed. The value of another topic is held for `hold_s` at most, then NaN.
Messages carry no units: they are SI, as ROS requires (REP 103), unless the map gives another.

A bag is read record by record, and the sizes that it states are checked against limits before anything is unpacked.
Only the topics of the map are decoded, by the definition of their type, and no message into many more values than it
has bytes.
"""

from __future__ import annotations

import os
import re
import struct
from array import array
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any, Final, Literal, NamedTuple

import numpy as np
import zstandard
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Schema
from mcap.writer import MCAP0_MAGIC
from numpy.typing import NDArray

from rwa_monitor.errors import MAX_PART, InputError
from rwa_monitor.samples import NANOSECONDS_PER_SECOND, FloatArray, IntArray, Samples
from rwa_monitor.telemetry import reader
from rwa_monitor.telemetry.files import (
    MAX_CHUNK_BYTES,
    MAX_DEPTH,
    MESSAGE,
    MESSAGE_HEAD,
    RECORD_HEAD,
    display_name,
    first_line,
    opened,
    records_in,
    stream_of,
    unpacked,
)
from rwa_monitor.telemetry.reader import Decoding, TelemetryFile, TopicChannel, TopicWheel
from rwa_monitor.telemetry.table import MAX_COLUMNS, MAX_ROWS
from rwa_monitor.words import counted, first_few

MAX_WORK_BYTES: Final = 16 * 2**30  # unpacked from a file; a bag with images is large
MAX_RECORDS: Final = 100_000_000  # of a bag; 28 hours of a thousand messages a second
# Of a topic of the map, and of its schema; the state of a thousand joints has some 50 kB.
MAX_MESSAGE_BYTES: Final = 2**18

_MCAP_ERRORS: Final = (ArithmeticError, McapError, RuntimeError, ValueError, struct.error, zstandard.ZstdError)
_WANTED: Final = frozenset({Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK})


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
    wheels = [(wheel, _series_of(wheel, decoding.map.source)) for wheel in reader.wheels_of(decoding.map, TopicWheel)]
    bag = _Bag(source, [one for _, series in wheels for one in series.values()])
    with opened(path) as file:
        bag.read(file)
    bag.check_topics()
    found = [(wheel, _samples(series, wheel.hold_s)) for wheel, series in wheels]
    return reader.telemetry_file(source, found, bag.problems(), (), "holds no sample of a wheel of the map")


# ---- the wheels of the map -------------------------------------------------------------------------------------------


class _Series:
    """The values of one channel at the times of its messages [ns], in the unit of its name."""

    def __init__(self, channel: str, spec: TopicChannel, place: str, source: str) -> None:
        self.spec = spec
        self.times = array("q")
        self.values = array("d")
        unit = spec.unit or reader.SI_UNITS[channel]
        self._factor, self._offset = reader.channel_conversion(channel, unit, source, place)

    def take(self, message: dict[str, Any], times: dict[str, int]) -> None:
        """Append a message's value, NaN where the joint has none; skip a message without this joint."""
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
        time_ns = self._time_of(message, times)
        reader.check_time(time_ns)
        self.times.append(time_ns)
        self.values.append(float(value) * self._factor + self._offset)

    def at(self, times: IntArray, reach_ns: int) -> FloatArray:
        """Return the last value at some times, NaN where it is older than `reach_ns`."""
        stamps, values = np.array(self.times, dtype=np.int64), np.array(self.values)
        if np.array_equal(stamps, times):  # of the same messages
            return values
        if stamps.size == 0:
            return np.full(times.size, np.nan)
        order = np.argsort(stamps, kind="stable")
        position = np.searchsorted(stamps, times, side="right", sorter=order) - 1
        last = order[position]
        held = (position >= 0) & (times - stamps[last] <= reach_ns)
        return np.where(held, values[last], np.nan)

    def _time_of(self, message: dict[str, Any], times: dict[str, int]) -> int:
        if self.spec.time != "header":
            return times[self.spec.time]
        if "header" not in message:
            raise ValueError('it has no header: set time = "log" or "publish" in the map')
        stamp = _field(message, "header.stamp")
        return int(_field(stamp, "sec")) * NANOSECONDS_PER_SECOND + int(_field(stamp, "nanosec"))


def _series_of(wheel: TopicWheel, source: str) -> dict[str, _Series]:
    """Return the channels of a wheel of the map, without values."""
    return {
        str(channel): _Series(channel, spec, f"{wheel.spacecraft}/{wheel.wheel}: {channel}: {spec.topic}", source)
        for channel, spec in wheel.channels.items()
    }


def _samples(series: dict[str, _Series], hold_s: float | None) -> Samples:
    """Return all channels at the times of the speed; values older than `hold_s` are NaN."""
    times = np.array(series["speed_rad_s"].times, dtype=np.int64)
    # Without `hold_s` all channels are of one topic, and only a value of the same time is used.
    reach_ns = 0 if hold_s is None else round(hold_s * NANOSECONDS_PER_SECOND)
    return Samples(time_ns=times, **{name: one.at(times, reach_ns) for name, one in series.items()})


def _field(message: Any, path: str) -> Any:
    """Return a field of a message by its path; raises ValueError where there is none."""
    for name in path.split("."):
        if not isinstance(message, dict) or name not in message:
            raise ValueError(f"there is no field {path}")
        message = message[name]
    return message


# ---- the bag ---------------------------------------------------------------------------------------------------------


class _Bag:
    """Reads the records of a bag and passes the messages of the map's topics to their series."""

    def __init__(self, source: str, series: list[_Series]) -> None:
        self._source = source
        self._series: defaultdict[str, list[_Series]] = defaultdict(list)
        for one in series:
            self._series[one.spec.topic].append(one)
        self._schemas: dict[int, Schema] = {}
        # Name and types of each channel of the bag; None: a topic that the map does not name.
        self._topics: dict[int, tuple[str, Types] | None] = {}
        self._names: set[str] = set()
        self._seen: Counter[str] = Counter()
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
                there = first_few(sorted(self._names)) or "no topics at all"
                because = "".join(f"; {problem}" for problem in self.problems()[:1])
                raise InputError(self._source, f"there is no topic {name}; there are {there}{because}")

    def read(self, file: IO[bytes]) -> None:
        """Read all records up to the end of the data, or to the first incomplete one."""
        end, position = file.seek(0, os.SEEK_END), file.seek(len(MCAP0_MAGIC))
        while len(head := file.read(RECORD_HEAD.size)) == RECORD_HEAD.size:
            opcode, length = RECORD_HEAD.unpack(head)
            if opcode == Opcode.DATA_END:  # only a summary follows
                return
            if opcode not in _WANTED and length <= end:
                position = file.seek(length, os.SEEK_CUR)
                continue
            content = file.read(length) if length <= MAX_CHUNK_BYTES else b""
            if len(content) < length:
                break
            try:
                for record in self._unpacked(content) if opcode == Opcode.CHUNK else [(opcode, content)]:
                    self._take(*record)
            except _MCAP_ERRORS as error:
                self._lost.append(f"the record at byte {position} cannot be read: {first_line(error)}")
            position = file.tell()
        self._lost.append(f"what follows byte {position} cannot be read: the bag was not closed, or is damaged")

    def _count(self, what: str, size: int, limit: int) -> None:
        """Add to a count, and raise InputError where it exceeds its limit."""
        self._seen[what] += size
        if self._seen[what] > limit:
            raise InputError(self._source, f"has more than {limit:,} {what}")

    def _unpacked(self, content: bytes) -> Iterator[tuple[int, bytes]]:
        """Return the records in a chunk; raise ValueError where size or checksum are not as the chunk states."""
        chunk = Chunk.read(stream_of(content))
        self._count("bytes to be unpacked", chunk.uncompressed_size, MAX_WORK_BYTES)
        return records_in(unpacked(chunk))

    def _take(self, opcode: int, content: bytes) -> None:
        """Process a record: a message of the map's topics, a schema or a channel; others are skipped unread."""
        self._count("records", 1, MAX_RECORDS)
        if opcode == MESSAGE:
            channel_id, _, log_ns, publish_ns = MESSAGE_HEAD.unpack_from(content)
            if channel_id not in self._topics:
                self._undescribed += 1
            elif (topic := self._topics[channel_id]) is not None:
                self._decode(*topic, content[MESSAGE_HEAD.size :], {"log": log_ns, "publish": publish_ns})
        elif opcode == Opcode.SCHEMA:
            schema = Schema.read(stream_of(content))
            if schema.id not in self._schemas:
                self._count("bytes of schemas", len(content), MAX_CHUNK_BYTES)
                self._schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            channel = Channel.read(stream_of(content))
            if channel.id not in self._topics:
                wanted = channel.topic in self._series
                self._names.add(channel.topic if wanted else channel.topic[:MAX_PART])
                self._topics[channel.id] = (channel.topic, self._types(channel)) if wanted else None

    def _types(self, channel: Channel) -> Types:
        """Return the types of a topic's messages; raise InputError where they cannot be decoded."""
        schema = self._schemas.get(channel.schema_id)
        place = f"topic {channel.topic}"
        if schema is None or (channel.message_encoding, schema.encoding) != ("cdr", "ros2msg"):
            how = f"{channel.message_encoding} by {schema.encoding if schema else 'nothing'}"
            raise InputError(self._source, f"holds {how}; cdr by ros2msg is wanted", place)
        self._count("channels of the map's topics", 1, MAX_COLUMNS)
        try:
            return message_types(schema.name, schema.data)
        except ValueError as error:
            raise InputError(self._source, f"{schema.name} is no message type: {first_line(error)}", place) from error

    def _decode(self, topic: str, types: Types, data: bytes, times: dict[str, int]) -> None:
        self._count("messages of the map's topics", 1, MAX_ROWS)
        try:
            if len(data) > MAX_MESSAGE_BYTES:
                raise ValueError(f"it has {len(data):,} bytes; the limit is {MAX_MESSAGE_BYTES:,}")
            message = decode(data, types)
            for series in self._series[topic]:
                series.take(message, times)
        except (ArithmeticError, TypeError, ValueError, struct.error) as error:  # bytes that are not as in the schema
            self._refused += 1
            self._first_refused = self._first_refused or f"topic {topic}: {first_line(error)}"


# ---- types of messages, and messages by their type -------------------------------------------------------------------

# A field's type; its array brackets, and the length in them if fixed; its name; the equals sign of a constant.
_FIELD: Final = re.compile(r"([\w/]+)(?:<=\d+)?(\[(?:(\d{1,9})|<=\d+)?\])?\s+([a-zA-Z]\w*)\s*(=?).*", re.ASCII)
_NUMBERS: Final = {
    **{name: np.dtype(name) for name in ("bool", "int8", "int16", "int32", "int64", "float32", "float64")},
    **{name: np.dtype(name) for name in ("uint8", "uint16", "uint32", "uint64")},
    **dict.fromkeys(("byte", "char"), np.dtype("uint8")),
}


class _Field(NamedTuple):
    """A field of a type: how many values it has (None: each message states them), and whether they are a list."""

    name: str
    kind: str
    times: int | None
    is_list: bool


Types = dict[str, list[_Field]]  # fields by the name of their type; that of a whole message is ""


def message_types(name: str, data: bytes) -> Types:
    """Return a message type and the types nested in it, as a definition (`ros2msg`) describes them.

    Parameters
    ----------
    name
        Of the type, such as "sensor_msgs/msg/JointState".
    data
        Its definition: a field or a constant a line; the types in it follow, each after "MSG:" and its name.

    Raises
    ------
    ValueError
        If it is no definition, or too long.
    """
    if len(data) > MAX_MESSAGE_BYTES:
        raise ValueError(f"its schema has more than {MAX_MESSAGE_BYTES:,} bytes")
    time = [_Field("sec", "int32", 1, False), _Field("nanosec", "uint32", 1, False)]
    current, fields = _full_name(name), list[_Field]()
    types = {"builtin_interfaces/Time": time, "builtin_interfaces/Duration": time, "": fields, current: fields}
    for whole_line in data.decode("utf-8").splitlines():
        line = whole_line.partition("#")[0].strip()
        if line.startswith("MSG:"):
            current = _full_name(line.removeprefix("MSG:").strip())
            fields = types[current] = []
        elif line.strip("="):  # neither empty nor between two types
            found = _FIELD.fullmatch(line)
            if found is None:
                raise ValueError(f"{line[:40]!r} is no field")
            kind, many, count, field, constant = found.groups()
            if not constant:
                times = int(count) if count else None if many else 1
                fields.append(_Field(field, _full_name(kind, current.partition("/")[0]), times, many is not None))
    return types


def decode(data: bytes, types: Types) -> dict[str, Any]:
    """Return the fields of a message in CDR by their names; raise ValueError where the bytes are not one."""
    if data[:2] not in (b"\0\0", b"\0\1"):
        raise ValueError("it is no plain CDR")
    message: dict[str, Any] = _Cdr(data, types).value("")
    return message


def _full_name(kind: str, package: str = "") -> str:
    """Return the name of a type with its package, without "msg"; numbers and texts have none."""
    if kind in _NUMBERS or kind == "string":
        return kind
    parts = kind.split("/")
    return f"{parts[0] if len(parts) > 1 else package}/{parts[-1]}"


class _Cdr:
    """The bytes of one message, and the position read so far; numbers are aligned to their size."""

    def __init__(self, data: bytes, types: Types) -> None:
        self._data, self._types = data[4:], types
        self._order: Literal["<", ">"] = "<" if data[1] else ">"
        self._at = 0
        self._left = len(data) + MAX_DEPTH  # values still allowed: about one per byte

    def value(self, kind: str, depth: int = 0) -> Any:
        """Read a text, or the fields of a type by their names."""
        self._left -= 1
        if self._left < 0 or depth > MAX_DEPTH:
            raise ValueError(f"it has more values than bytes, or types in types deeper than {MAX_DEPTH} levels")
        if kind == "string":
            return self._numbers("uint8", self._numbers("uint32", 1)[0]).tobytes().rstrip(b"\0").decode()
        fields = self._types.get(kind)
        if fields is None:
            raise ValueError(f"the type {kind} is not in its definition")
        if not fields:  # an empty type takes one byte
            self._at += 1
        return {field.name: self._field(field, depth) for field in fields}

    def _field(self, field: _Field, depth: int) -> Any:
        count = int(self._numbers("uint32", 1)[0]) if field.times is None else field.times
        if field.kind in _NUMBERS:
            values = self._numbers(field.kind, count).tolist()
        else:
            values = [self.value(field.kind, depth + 1) for _ in range(count)]
        return values if field.is_list else values[0]

    def _numbers(self, kind: str, count: int) -> NDArray[Any]:
        """Read `count` numbers of a type; raise ValueError where there are fewer."""
        number = _NUMBERS[kind].newbyteorder(self._order)
        if count:
            self._at += -self._at % number.itemsize
        values = np.frombuffer(self._data[self._at : self._at + count * number.itemsize], number)
        if values.size < count:
            raise ValueError("it ends before its last value")
        self._at += values.nbytes
        return values
