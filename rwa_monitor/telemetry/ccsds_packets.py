"""CCSDS space packets (133.0-B-2) as samples, by an XTCE definition, from a file or one by one; samples as packets.

A packet is six bytes of header, which count its length, and a content that an XTCE definition (CCSDS 660.1-G)
describes: parameters, their bits, calibrators and units. A telemetry map assigns them to channels of wheels.

A packet that cannot be valid is counted and left out: another version, another length than its header states, a
content that the definition does not describe. Nothing in a packet shows a flipped bit; the frames below it do.
"""

from __future__ import annotations

import warnings
from array import array
from collections.abc import Iterator, Mapping, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass, field
from fractions import Fraction
from functools import lru_cache
from io import BytesIO, StringIO
from pathlib import Path
from typing import Any, Final

import numpy as np
import tomli_w

from rwa_monitor.errors import InputError, needs_extra
from rwa_monitor.messages import split_key
from rwa_monitor.samples import NANOSECONDS_PER_SECOND, FloatArray, Samples
from rwa_monitor.telemetry.columns import MAX_ROWS
from rwa_monitor.telemetry.files import atomic_write, beside, display_name, first_line, read_bytes, write_text
from rwa_monitor.telemetry.reader import Decoding, TelemetryFile, TextFile
from rwa_monitor.telemetry.telemetry_map import (
    TIME_UNITS,
    UNITS,
    PacketWheel,
    check_time,
    conversion,
    telemetry_file,
    wheels_of,
)
from rwa_monitor.words import counted

MAX_PACKET_FILE_BYTES: Final = 1_000_000_000
HEADER_BYTES: Final = 6
IDLE_APID: Final = 2_047
UNSEGMENTED: Final = 0b11
SEQUENCE_MODULUS: Final = 2**14


@dataclass(slots=True)
class PacketCounts:
    """What became of packets: packets = decoded + bad + unknown + idle + other.

    Attributes
    ----------
    packets
        All that came.
    decoded
        Gave a sample to one wheel or more.
    bad
        Cannot be valid, or cannot be read by the definition.
    unknown
        Of an application process (APID) that the map does not name, or telecommands.
    idle
        Fill, APID 2047.
    other
        Of a known APID, but of another kind: without the parameters that the map names.
    gaps, missing
        Where the sequence count does not go on by one, and how many packets lie in between where it goes forward.
    unknown_apids
        Their numbers.
    first_bad
        What was wrong with the first bad one.
    """

    packets: int = 0
    decoded: int = 0
    bad: int = 0
    unknown: int = 0
    idle: int = 0
    other: int = 0
    gaps: int = 0
    missing: int = 0
    unknown_apids: set[int] = field(default_factory=set)
    first_bad: str | None = None


@dataclass(frozen=True, slots=True)
class PacketSample:
    """One sample of one wheel: its place in `PacketDecoder.wheels`, its time and a value for each of its channels."""

    wheel: int
    time_ns: int
    values: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class _Channel:
    """A channel and how to get it: calibrated value × factor + offset, NaN where `valid` is 0."""

    name: str
    parameter: str
    factor: float
    offset: float
    valid: str | None


@dataclass(frozen=True, slots=True)
class _Wheel:
    time: tuple[tuple[str, Fraction], ...]  # parameter and the nanoseconds of its unit
    channels: tuple[_Channel, ...]


class PacketDecoder:
    """Turns packets into samples, one by one, and counts what it cannot use.

    Parameters
    ----------
    decoding
        XTCE definition and telemetry map.
    source
        What the packets come from, for messages.

    Attributes
    ----------
    wheels
        Those of the map, in its order.
    counts
        What became of the packets so far.

    Raises
    ------
    InputError
        If map or definition is missing or wrong, or they do not fit: a parameter that does not exist, is no number, or
        has a unit of another quantity.
    """

    def __init__(self, decoding: Decoding, source: str) -> None:
        if decoding.map is None or decoding.xtce is None:
            raise InputError(
                source, "holds space packets: --xtce gives their definition, and --map which parameter is which channel"
            )
        self._definition = definition_of(decoding.xtce)
        self.wheels = wheels_of(decoding.map, PacketWheel)
        self.counts = PacketCounts()
        self._by_apid: dict[int, list[tuple[int, _Wheel]]] = {}
        self._last_count: dict[int, int] = {}
        for number, wheel in enumerate(self.wheels):
            found = _resolved(wheel, self._definition, decoding.map.source, decoding.xtce.source)
            self._by_apid.setdefault(wheel.apid, []).append((number, found))

    def take(self, packet: bytes) -> list[PacketSample]:
        """Return the samples of one packet; none where it is counted as something else."""
        counts = self.counts
        counts.packets += 1
        reason = _no_packet(packet)
        if reason is not None:
            return self._bad(reason)
        apid = int.from_bytes(packet[:2], "big") & 0x7FF
        telecommand = packet[0] & 0x10
        if apid == IDLE_APID:
            counts.idle += 1
            return []
        if telecommand or apid not in self._by_apid:
            counts.unknown += 1
            counts.unknown_apids.add(apid)
            return []
        self._follow(apid, int.from_bytes(packet[2:4], "big") % SEQUENCE_MODULUS)
        if packet[2] >> 6 != UNSEGMENTED:
            return self._bad(f"APID {apid}: a segment of a packet, which are not put together here")
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error", UserWarning)  # a length other than the definition's is no packet of it
                parameters: Mapping[str, Any] = self._definition.parse_bytes(packet)
            samples = [
                sample for number, wheel in self._by_apid[apid] if (sample := _sample(parameters, number, wheel))
            ]
        # The parser checks little itself: it raises whatever comes of bytes that are not as in the definition.
        except Exception as error:  # noqa: BLE001
            return self._bad(f"APID {apid}: {first_line(error)}")
        if samples:
            counts.decoded += 1
        else:
            counts.other += 1
        return samples

    def _bad(self, reason: str) -> list[PacketSample]:
        self.counts.bad += 1
        if self.counts.first_bad is None:
            self.counts.first_bad = f"packet {self.counts.packets}: {reason}"
        return []

    def _follow(self, apid: int, count: int) -> None:
        """Compare a packet's sequence count with that of the one before."""
        last = self._last_count.get(apid)
        self._last_count[apid] = count
        if last is None:
            return
        step = (count - last) % SEQUENCE_MODULUS
        if step != 1:
            self.counts.gaps += 1
            # Half the circle: further is a packet that comes late, again, or from a counter that began anew.
            self.counts.missing += step - 1 if 1 < step <= SEQUENCE_MODULUS // 2 else 0


# ---- one packet ------------------------------------------------------------------------------------------------------


def _no_packet(packet: bytes) -> str | None:
    """Return why bytes are no space packet; None where they are one."""
    if len(packet) <= HEADER_BYTES:
        return f"{len(packet)} bytes; a packet has seven or more"
    if packet[0] >> 5:
        return f"version {packet[0] >> 5} of the packet protocol; there is only 0"
    stated = HEADER_BYTES + int.from_bytes(packet[4:6], "big") + 1
    if stated != len(packet):
        return f"{len(packet)} bytes, and its header states {stated}"
    return None


def _sample(parameters: Mapping[str, Any], number: int, wheel: _Wheel) -> PacketSample | None:
    """Return a wheel's sample; None where the packet has other parameters. Raises ValueError where one is no number."""
    wanted = (*(name for name, _ in wheel.time), *(channel.parameter for channel in wheel.channels))
    if any(name not in parameters for name in wanted):
        return None
    time_ns = round(sum((Fraction(parameters[name]) * unit for name, unit in wheel.time), Fraction()))
    check_time(time_ns)
    return PacketSample(number, time_ns, tuple(_value(parameters, channel) for channel in wheel.channels))


def _value(parameters: Mapping[str, Any], channel: _Channel) -> float:
    if channel.valid is not None and not parameters[channel.valid]:
        return float("nan")
    return float(parameters[channel.parameter]) * channel.factor + channel.offset


# ---- the map against the definition ----------------------------------------------------------------------------------


def _resolved(wheel: PacketWheel, definition: Any, source: str, xtce: str) -> _Wheel:
    """Find the parameters of a wheel of the map `source` in the definition `xtce`, with factors for their units."""

    def type_of(name: str, allowed: tuple[str, ...], place: str) -> Any:
        if name not in definition.parameters:
            raise InputError(source, f"there is no parameter {name} in {xtce}", place)
        kind = definition.parameters[name].parameter_type
        if type(kind).__name__ not in allowed:
            raise InputError(source, f"{name} is a {type(kind).__name__} in {xtce}; {allowed[0]} is wanted", place)
        return kind

    where = f"{wheel.spacecraft}/{wheel.wheel}"
    time: list[tuple[str, Fraction]] = []
    for name in wheel.time:
        place = f"{where}: time: {name}"
        time.append((name, conversion(TIME_UNITS, _unit(type_of(name, _NUMBERS, place)), "time", source, place)))
    channels: list[_Channel] = []
    for channel, spec in wheel.channels.items():
        place = f"{where}: {channel}: {spec.parameter}"
        unit = _unit(type_of(spec.parameter, _NUMBERS, place))
        factor, offset = conversion(UNITS[channel], spec.unit or unit, channel, source, place)
        if spec.valid is not None:
            type_of(spec.valid, _FLAGS, place)
        channels.append(_Channel(channel, spec.parameter, factor, offset, spec.valid))
    return _Wheel(tuple(time), tuple(channels))


_TIMES: Final = ("AbsoluteTimeParameterType", "RelativeTimeParameterType")
_NUMBERS: Final = ("IntegerParameterType", "FloatParameterType", *_TIMES)
_FLAGS: Final = ("BooleanParameterType", "IntegerParameterType")


def _unit(kind: Any) -> str | None:
    """Return the unit that the definition gives; none where it is in parts, of which the parser loses the powers."""
    return kind.unit if isinstance(kind.unit, str) else None


# ---- a file ----------------------------------------------------------------------------------------------------------


def read_packets(path: Path, decoding: Decoding) -> TelemetryFile:
    """Read a file of space packets, one after the other, as a ground station or an EGSE keeps them.

    Raises
    ------
    InputError
        If map or definition cannot be used, or no packet gives a sample.
    """
    source = display_name(path)
    decoder = PacketDecoder(decoding, source)
    data = read_bytes(path, MAX_PACKET_FILE_BYTES)
    columns = [SampleColumns(wheel) for wheel in decoder.wheels]
    stop = 0
    for packet in split_packets(data):
        stop += len(packet)
        for sample in decoder.take(packet):
            columns[sample.wheel].append(sample)
        if decoder.counts.packets > MAX_ROWS:
            raise InputError(source, f"has more than {MAX_ROWS:,} packets: split it, and use --carry")
    counts = decoder.counts
    problems = []
    if counts.bad:
        problems.append(f"{counts.bad} of {counts.packets} packets cannot be read, the first: {counts.first_bad}")
    if stop < len(data):
        problems.append(f"bytes {stop} to {len(data)} of {len(data)} are no whole packet")
    apids = ", ".join(str(apid) for apid in sorted({wheel.apid for wheel in decoder.wheels})[:8])
    return telemetry_file(
        source,
        zip(decoder.wheels, (entry.samples() for entry in columns), strict=True),
        problems,
        packet_notes(counts),
        f"holds no packet that the map can use, of APID {apids}",
    )


def split_packets(data: bytes) -> Iterator[bytes]:
    """Yield packet after packet, as their headers count; ends where none can begin or the last is cut."""
    position = 0
    while len(data) - position > HEADER_BYTES and not data[position] >> 5:
        length = HEADER_BYTES + int.from_bytes(data[position + 4 : position + 6], "big") + 1
        if position + length > len(data):
            return
        yield data[position : position + length]
        position += length


class SampleColumns:
    """Gathers the samples of one wheel of a map."""

    def __init__(self, wheel: PacketWheel) -> None:
        self._times = array("q")
        self._values = {str(name): array("d") for name in wheel.channels}

    def __len__(self) -> int:
        """Count the samples."""
        return len(self._times)

    def append(self, sample: PacketSample) -> None:
        """Add a sample of this wheel."""
        self._times.append(sample.time_ns)
        for column, value in zip(self._values.values(), sample.values, strict=True):
            column.append(value)

    def samples(self) -> Samples:
        """Return all of them, in the order in which they came."""
        channels = {name: np.array(column) for name, column in self._values.items()}
        return Samples(time_ns=np.array(self._times), **channels)


def packet_notes(counts: PacketCounts) -> list[str]:
    """Report what was left out of packets, and what is missing between them, a sentence each."""
    notes: list[str] = []
    if counts.unknown:
        apids = ", ".join(str(apid) for apid in sorted(counts.unknown_apids)[:8])
        more = ", …" if len(counts.unknown_apids) > 8 else ""
        notes.append(f"{counted(counts.unknown, 'packet')} of APIDs that the map does not name ({apids}{more})")
    if counts.other:
        notes.append(f"{counted(counts.other, 'packet')} of a known APID without the parameters of the map")
    if counts.gaps:
        missing = counted(counts.missing, "packet")
        notes.append(f"the sequence count breaks {counted(counts.gaps, 'time')}; missing: {missing}")
    return notes


# ---- XTCE definitions, read by `space_packet_parser`; what would take it without end is refused first ----------------


MAX_ENTRIES: Final = 10_000  # of a packet, with all containers in containers
MAX_DEPTH: Final = 50  # of containers in containers
MAX_EXPONENT: Final = 16  # of a polynomial calibrator


@lru_cache(maxsize=8)
def definition_of(file: TextFile) -> Any:
    """Return an XTCE definition, a `space_packet_parser.XtcePacketDefinition`.

    Raises
    ------
    InputError
        If it is none, is not plain (a document type could name other files and grow without end), or could make the
        parser work without end.
    """
    with needs_extra("ccsds"):
        from lxml import etree
        from space_packet_parser import XtcePacketDefinition
    plain = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False)
    try:
        root = etree.fromstring(file.text.encode("utf-8"), plain)
        if root.getroottree().docinfo.doctype:
            raise ValueError("it has a document type (<!DOCTYPE …>), which none needs")
        _check_containers(root)
        with redirect_stdout(StringIO()), warnings.catch_warnings():
            warnings.simplefilter("error", UserWarning)  # no XTCE namespace
            definition = XtcePacketDefinition.from_xtce(BytesIO(etree.tostring(root)))
        _check_definition(definition)
    except Exception as error:  # the parser checks little itself
        raise InputError(file.source, f"is no XTCE definition that can be used: {first_line(error)}") from error
    return definition


def _check_containers(root: Any) -> None:
    """Raise ValueError where containers hold each other or too much: thirty that hold the next twice are a billion."""
    entries = {
        container.get("name"): [entry.get("containerRef") for entry in container.iterfind("{*}EntryList/*")]
        for container in root.iterfind("{*}TelemetryMetaData/{*}ContainerSet/{*}SequenceContainer")
    }
    sizes: dict[str | None, int] = {}

    def size(name: str | None, above: tuple[str | None, ...]) -> int:
        if name in above or len(above) > MAX_DEPTH:
            raise ValueError(f"container {name} holds itself, or others more than {MAX_DEPTH} deep")
        if name not in sizes:
            sizes[name] = 1 + sum(size(inner, (*above, name)) if inner else 1 for inner in entries.get(name, []))
        return sizes[name]

    if sum(size(name, ()) for name in entries) > MAX_ENTRIES:
        raise ValueError(f"its containers hold more than {MAX_ENTRIES:,} entries")


def _check_definition(definition: Any) -> None:
    """Raise ValueError where parsing has no beginning, or a calibrator a power that takes long to reckon."""
    if definition.root_container_name not in definition.containers:
        raise ValueError(f"there is no container {definition.root_container_name}, where parsing begins")
    for kind in definition.parameter_types.values():
        context = getattr(kind.encoding, "context_calibrators", None) or ()
        calibrators = (getattr(kind.encoding, "default_calibrator", None), *(entry.calibrator for entry in context))
        for calibrator in calibrators:
            for term in getattr(calibrator, "coefficients", ()):
                if not 0 <= term.exponent <= MAX_EXPONENT:
                    raise ValueError(f"{kind.name}: a calibrator with exponent {term.exponent}")


# ---- test packets, as `wheel_packet.xtce.xml` describes them, and their map ------------------------------------------
# Written with `spacepackets` and numpy, which have nothing in common with the parser that reads them. A packet holds
# one sample; a value that was not measured has its flag at 0. What a packet resolves: time 2⁻²⁴ s (60 ns), speed
# 1e-5 rad/s, torque 1e-9 N m, current 1e-7 A, temperature 0.005 °C, voltage seven digits.


XTCE_FILE: Final = Path(__file__).with_name("wheel_packet.xtce.xml")
XTCE_SUFFIX: Final = ".xtce.xml"
MAP_SUFFIX: Final = ".map.toml"

FIRST_APID: Final = 416  # of the first wheel, in the definition; the next has the next
MAX_EXAMPLE_WHEELS: Final = 64
CUC_FRACTION: Final = 2**24  # units of a second


@dataclass(frozen=True, slots=True)
class _Field:
    """A channel in the packet: raw = (value − offset) / resolution, rounded where its kind is an integer's."""

    channel: str
    parameter: str
    kind: str
    resolution: float = 1.0
    offset: float = 0.0


FIELDS: Final = (
    _Field("speed_rad_s", "WHEEL_SPEED", ">i4", 1e-5),
    _Field("friction_torque_Nm", "FRICTION_TORQUE", ">i4", 1e-9),
    _Field("motor_current_A", "MOTOR_CURRENT", ">i4", 1e-7),
    _Field("motor_torque_Nm", "MOTOR_TORQUE", ">i4", 1e-9),
    _Field("motor_voltage_V", "MOTOR_VOLTAGE", ">f4"),
    _Field("bearing_temperature_degC", "BEARING_TEMPERATURE", ">u2", 0.005, -100.0),
)
_HEAD: Final = [("seconds", ">u4"), ("fraction", "u1", 3), ("flags", "u1")]
_CONTENT: Final = np.dtype([*_HEAD, *((entry.channel, entry.kind) for entry in FIELDS)])


def example_decoding(channels_by_key: Mapping[str, Sequence[str]]) -> Decoding:
    """Return the definition, and a map of wheels with these keys on the bus and channels, their APIDs counting up."""
    blocks: list[dict[str, Any]] = []
    for number, (key, channels) in enumerate(channels_by_key.items()):
        spacecraft, wheel, _ = split_key(key)
        fields = [entry for entry in FIELDS if entry.channel in channels]
        blocks.append(
            {
                "spacecraft": spacecraft,
                "wheel": wheel,
                "apid": FIRST_APID + number,
                "time": ["TIME_COARSE", "TIME_FINE"],
                "channels": {
                    entry.channel: {"parameter": entry.parameter, "valid": f"{entry.parameter}_VALID"}
                    for entry in fields
                },
            }
        )
    text = tomli_w.dumps({"wheel": blocks})
    return Decoding(TextFile("the example's map", text), TextFile(XTCE_FILE.name, XTCE_FILE.read_text("utf-8")))


def write_packets(samples: Samples, path: Path) -> None:
    """Write samples as packets, the definition and the map beside them (FILE.xtce.xml, FILE.map.toml).

    Raises
    ------
    InputError
        If the file cannot be written, or a packet cannot hold a value.
    """
    names = [name for name, _ in samples.channels()]
    decoding = example_decoding({"rwa/simulated/wheel_1/samples": names})
    assert decoding.map is not None
    assert decoding.xtce is not None
    with atomic_write(path) as part, part.open("wb") as file:
        for packet in packets_of(samples, FIRST_APID):
            file.write(packet)
    write_text(beside(path, MAP_SUFFIX), decoding.map.text)
    write_text(beside(path, XTCE_SUFFIX), decoding.xtce.text)


def packets_of(samples: Samples, apid: int, first_count: int = 0) -> Iterator[bytes]:
    """Yield a packet for each sample; the sequence count goes on from `first_count`.

    Raises
    ------
    InputError
        If a packet cannot hold a value or a time.
    """
    with needs_extra("ccsds"):
        from spacepackets.ccsds.spacepacket import SpacePacketHeader
    seconds, rest_ns = np.divmod(samples.time_ns, NANOSECONDS_PER_SECOND)
    fraction = np.rint(rest_ns * (CUC_FRACTION / NANOSECONDS_PER_SECOND)).astype(np.int64)
    seconds, fraction = seconds + fraction // CUC_FRACTION, fraction % CUC_FRACTION
    if len(samples) and not 0 <= int(seconds.min()) <= int(seconds.max()) < 2**32:
        raise InputError("time_ns", "lies outside of what four octets of seconds can hold, 0 to 136 years")
    content = np.zeros(len(samples), dtype=_CONTENT)
    content["seconds"], content["fraction"] = seconds, fraction[:, None] >> (16, 8, 0) & 0xFF
    for bit, entry in enumerate(FIELDS):
        values = getattr(samples, entry.channel)
        if values is not None:
            known = np.isfinite(values)
            content["flags"] |= np.where(known, 0x80 >> bit, 0).astype(np.uint8)
            content[entry.channel][known] = _raw(entry, values)[known]
    for number, packed in enumerate(content):
        header = SpacePacketHeader.tm(
            apid, (first_count + number) % SEQUENCE_MODULUS, _CONTENT.itemsize - 1, sec_header_flag=True
        )
        yield bytes(header.pack()) + packed.tobytes()


def _raw(entry: _Field, values: FloatArray) -> FloatArray:
    """Return what stands in the packets for the values of a channel, NaN where one is not known."""
    if entry.kind == ">f4":
        return values
    scaled = np.rint((values - entry.offset) / entry.resolution)
    bounds = np.iinfo(entry.kind)
    beyond = (scaled < bounds.min) | (scaled > bounds.max)
    if beyond.any():
        at = int(np.argmax(beyond))
        raise InputError(entry.channel, f"{values[at]} is more than the example's packet can hold", f"sample {at + 1}")
    return np.asarray(scaled)
