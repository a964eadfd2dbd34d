"""CCSDS space packets (133.0-B-2) as samples, by an XTCE definition, from a file or one by one.

A packet is six bytes of header, which state its length, and a content that an XTCE definition (CCSDS 660.1-G)
describes: parameters, their bits, calibrators and units. A telemetry map assigns them to channels of wheels.

A packet that cannot be valid is counted and left out: another version, another length than its header states, a
content that the definition does not describe. Bit errors are not detected here, but in the frames that carry packets.
"""

from __future__ import annotations

import struct
import warnings
from array import array
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass, field
from fractions import Fraction
from functools import lru_cache
from io import BytesIO, StringIO
from pathlib import Path
from typing import Any, Final

import numpy as np

from rwa_monitor.errors import InputError, needs_extra
from rwa_monitor.samples import Samples
from rwa_monitor.telemetry import reader
from rwa_monitor.telemetry.files import MAX_DEPTH, display_name, first_line, read_bytes
from rwa_monitor.telemetry.reader import Decoding, PacketWheel, TelemetryFile, TextFile
from rwa_monitor.telemetry.table import MAX_ROWS, MAX_TABLE_BYTES
from rwa_monitor.words import counted, first_few

HEADER: Final = struct.Struct(">HHH")  # version, kind and APID; sequence flags and count; bytes behind it, less one
UNSEGMENTED: Final = 0b11
SEQUENCE_MODULUS: Final = 2**14


@dataclass(slots=True)
class PacketCounts:
    """Counts of packets by outcome: packets = decoded + bad + unknown + idle + other.

    Attributes
    ----------
    packets
        All packets taken.
    decoded
        Packets with a sample of one wheel or more.
    bad
        Packets that cannot be valid, or cannot be read by the definition.
    unknown
        Packets of an application process (APID) that the map does not name, or telecommands.
    idle
        Fill packets, APID 2047.
    other
        Packets of a known APID, but of another kind: without the parameters that the map names.
    gaps, missing
        Where the sequence count does not increase by one, and how many packets are missing where it goes forward.
    unknown_apids
        APIDs of the unknown packets.
    first_bad
        Reason for the first bad packet.
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


class PacketDecoder:
    """Turns packets into samples, one by one, and counts those that it cannot use.

    Parameters
    ----------
    decoding
        XTCE definition and telemetry map.
    source
        What the packets come from, for messages.

    Attributes
    ----------
    wheels
        Those of the map, in its order, with their samples.
    counts
        Counts of the packets so far.

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
        self.wheels = [
            WheelPackets(wheel, self._definition, decoding.map.source, decoding.xtce.source)
            for wheel in reader.wheels_of(decoding.map, PacketWheel)
        ]
        self.counts = PacketCounts()
        self._by_apid: defaultdict[int, list[WheelPackets]] = defaultdict(list)
        self._last_count: dict[int, int] = {}
        for wheel in self.wheels:
            self._by_apid[wheel.map.apid].append(wheel)

    def take(self, packet: bytes) -> list[WheelPackets]:
        """Take one packet; return the wheels that have a sample in it, none where it is counted otherwise."""
        counts = self.counts
        counts.packets += 1
        reason = _no_packet(packet)
        if reason is not None:
            return self._bad(reason)
        kind, sequence, _ = HEADER.unpack_from(packet)
        apid = kind & 0x7FF
        telecommand = kind & 0x1000
        if apid > reader.MAX_APID:
            counts.idle += 1
            return []
        if telecommand or apid not in self._by_apid:
            counts.unknown += 1
            counts.unknown_apids.add(apid)
            return []
        self._follow(apid, sequence % SEQUENCE_MODULUS)
        if sequence // SEQUENCE_MODULUS != UNSEGMENTED:
            return self._bad(f"APID {apid}: a segment of a packet, which are not put together here")
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error", UserWarning)  # a length other than the definition's is no packet of it
                parameters: Mapping[str, Any] = self._definition.parse_bytes(packet)
            found = [(wheel, row) for wheel in self._by_apid[apid] if (row := wheel.row(parameters)) is not None]
        # The parser checks little itself: bytes that do not match the definition may raise any exception.
        except Exception as error:  # noqa: BLE001
            return self._bad(f"APID {apid}: {first_line(error)}")
        if found:
            counts.decoded += 1
        else:
            counts.other += 1
        for wheel, row in found:
            wheel.append(*row)
        return [wheel for wheel, _ in found]

    def _bad(self, reason: str) -> list[WheelPackets]:
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
        missing = (count - last - 1) % SEQUENCE_MODULUS
        if missing:
            self.counts.gaps += 1
        if missing < SEQUENCE_MODULUS // 2:  # else the packet is late or repeated, or the counter was reset
            self.counts.missing += missing


# ---- one packet ------------------------------------------------------------------------------------------------------


def _no_packet(packet: bytes) -> str | None:
    """Return why bytes are not a space packet; None where they are one."""
    if len(packet) <= HEADER.size:
        return f"{len(packet)} bytes; a packet has seven or more"
    if packet[0] >> 5:
        return f"version {packet[0] >> 5} of the packet protocol; there is only 0"
    if (stated := _stated_bytes(packet)) != len(packet):
        return f"{len(packet)} bytes, and its header states {stated}"
    return None


def _stated_bytes(data: bytes, position: int = 0) -> int:
    """Return the length of the packet that begins somewhere, by its header."""
    return HEADER.size + int(HEADER.unpack_from(data, position)[2]) + 1


# ---- a wheel of the map ----------------------------------------------------------------------------------------------

_TIMES: Final = ("AbsoluteTimeParameterType", "RelativeTimeParameterType")
_NUMBERS: Final = ("IntegerParameterType", "FloatParameterType", *_TIMES)
_FLAGS: Final = ("BooleanParameterType", "IntegerParameterType")


class WheelPackets:
    """A wheel of a map: its parameters in a packet, their units, and the samples since the last `samples`.

    Parameters
    ----------
    wheel
        Of the map.
    definition
        Of the packets.
    source, xtce
        Names of map and definition, for messages.

    Raises
    ------
    InputError
        If they do not fit.
    """

    def __init__(self, wheel: PacketWheel, definition: Any, source: str, xtce: str) -> None:
        self.map = wheel
        where = f"{wheel.spacecraft}/{wheel.wheel}"

        def unit_of(name: str, place: str, allowed: tuple[str, ...] = _NUMBERS) -> str | None:
            """Return the unit in the definition; None where it is a product of units, whose powers the parser loses."""
            if name not in definition.parameters:
                raise InputError(source, f"there is no parameter {name} in {xtce}", place)
            kind = definition.parameters[name].parameter_type
            if type(kind).__name__ not in allowed:
                raise InputError(source, f"{name} is a {type(kind).__name__} in {xtce}; {allowed[0]} is wanted", place)
            return kind.unit if isinstance(kind.unit, str) else None

        self._time: list[tuple[str, Fraction]] = []  # parameter and the nanoseconds of its unit
        for name in wheel.time:
            place = f"{where}: time: {name}"
            self._time.append((name, reader.conversion(reader.TIME_UNITS, unit_of(name, place), "time", source, place)))
        # A channel is its calibrated parameter × factor + offset, NaN where `valid` is 0.
        self._channels: list[tuple[str, str | None, float, float]] = []
        for channel, spec in wheel.channels.items():
            place = f"{where}: {channel}: {spec.parameter}"
            unit = spec.unit or unit_of(spec.parameter, place)
            factor, offset = reader.channel_conversion(channel, unit, source, place)
            if spec.valid is not None:
                unit_of(spec.valid, place, _FLAGS)
            self._channels.append((spec.parameter, spec.valid, factor, offset))
        self._wanted = {*wheel.time, *(spec.parameter for spec in wheel.channels.values())}
        self._clear()

    def _clear(self) -> None:
        self._times, self._values = array("q"), array("d")

    def __len__(self) -> int:
        """Count the samples."""
        return len(self._times)

    def row(self, parameters: Mapping[str, Any]) -> tuple[int, list[float]] | None:
        """Return time and values in a packet; None where a parameter of the map is missing.

        Raises
        ------
        ValueError
            If a value is not a number, or the time is outside the range of the bus.
        """
        if not self._wanted <= parameters.keys():
            return None
        time_ns = round(sum((Fraction(parameters[name]) * unit for name, unit in self._time), Fraction()))
        reader.check_time(time_ns)
        return time_ns, [
            float(parameters[name]) * factor + offset if valid is None or parameters[valid] else float("nan")
            for name, valid, factor, offset in self._channels
        ]

    def append(self, time_ns: int, values: Sequence[float]) -> None:
        """Add a sample."""
        self._times.append(time_ns)
        self._values.extend(values)

    def samples(self) -> Samples:
        """Return the samples since the last call, in the order in which they came."""
        columns = np.array(self._values).reshape(-1, len(self._channels)).T
        channels = {str(name): column for name, column in zip(self.map.channels, columns, strict=True)}
        found = Samples(time_ns=np.array(self._times), **channels)
        self._clear()
        return found


# ---- a file ----------------------------------------------------------------------------------------------------------


def read_packets(path: Path, decoding: Decoding) -> TelemetryFile:
    """Read a file of space packets, one after the other, as a ground station or an EGSE stores them.

    Raises
    ------
    InputError
        If map or definition cannot be used, or no packet gives a sample.
    """
    source = display_name(path)
    decoder = PacketDecoder(decoding, source)
    data = read_bytes(path, MAX_TABLE_BYTES)
    stop = 0
    for packet in split_packets(data):
        stop += len(packet)
        decoder.take(packet)
        if decoder.counts.packets > MAX_ROWS:
            raise InputError(source, f"has more than {MAX_ROWS:,} packets: split it, and use --carry")
    counts = decoder.counts
    problems = []
    if counts.bad:
        problems.append(f"{counts.bad} of {counts.packets} packets cannot be read, the first: {counts.first_bad}")
    if stop < len(data):
        problems.append(f"bytes {stop} to {len(data)} of {len(data)} are no whole packet")
    apids = first_few([str(apid) for apid in sorted({wheel.map.apid for wheel in decoder.wheels})])
    return reader.telemetry_file(
        source,
        ((wheel.map, wheel.samples()) for wheel in decoder.wheels),
        problems,
        packet_notes(counts),
        f"holds no packet that the map can use, of APID {apids}",
    )


def split_packets(data: bytes) -> Iterator[bytes]:
    """Yield packet after packet by the lengths in their headers; stop where none can begin or the last is truncated."""
    position = 0
    while len(data) - position > HEADER.size and not data[position] >> 5:
        length = _stated_bytes(data, position)
        if position + length > len(data):
            return
        yield data[position : position + length]
        position += length


def packet_notes(counts: PacketCounts) -> list[str]:
    """Report which packets were left out, and how many are missing, a sentence each."""
    notes: list[str] = []
    if counts.unknown:
        apids = first_few([str(apid) for apid in sorted(counts.unknown_apids)])
        notes.append(f"{counted(counts.unknown, 'packet')} of APIDs that the map does not name ({apids})")
    if counts.other:
        notes.append(f"{counted(counts.other, 'packet')} of a known APID without the parameters of the map")
    if counts.gaps:
        missing = counted(counts.missing, "packet")
        notes.append(f"the sequence count breaks {counted(counts.gaps, 'time')}; missing: {missing}")
    return notes


# ---- XTCE definitions, read by `space_packet_parser`; what could make it run without end is refused first ------------


MAX_ENTRIES: Final = 10_000  # of a packet, with all nested containers
MAX_EXPONENT: Final = 16  # of a polynomial calibrator


@lru_cache(maxsize=8)
def definition_of(file: TextFile) -> Any:
    """Return an XTCE definition, a `space_packet_parser.XtcePacketDefinition`.

    Raises
    ------
    InputError
        If it is none, has a document type (which could name other files and grow without end), or could make the
        parser run without end.
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
    """Raise ValueError where containers hold themselves or too much: 30 that hold the next twice make 10⁹ entries."""
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
    """Raise ValueError where the root container is missing, or a calibrator's exponent is too large."""
    if definition.root_container_name not in definition.containers:
        raise ValueError(f"there is no container {definition.root_container_name}, where parsing begins")
    for kind in definition.parameter_types.values():
        context = getattr(kind.encoding, "context_calibrators", None) or ()
        calibrators = (getattr(kind.encoding, "default_calibrator", None), *(entry.calibrator for entry in context))
        for calibrator in calibrators:
            for term in getattr(calibrator, "coefficients", ()):
                if not 0 <= term.exponent <= MAX_EXPONENT:
                    raise ValueError(f"{kind.name}: a calibrator with exponent {term.exponent}")
