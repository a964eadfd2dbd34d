"""Test packets: simulated telemetry as the space packets that `wheel_packet.xtce.xml` describes, and their map.

Written with `spacepackets` and `struct`, which know nothing of the parser that reads them. A packet holds one sample; a
value that was not measured has its flag at 0. What a packet resolves: time 2⁻²⁴ s (60 ns), speed 1e-5 rad/s, torque
1e-9 N m, current 1e-7 A, temperature 0.005 °C, voltage seven digits.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import tomli_w

from rwa_monitor.errors import InputError, RwaMonitorError
from rwa_monitor.messages import split_key
from rwa_monitor.samples import NANOSECONDS_PER_SECOND, FloatArray, Samples
from rwa_monitor.telemetry.files import atomic_write, beside, write_text
from rwa_monitor.telemetry.reader import Decoding, TextFile

XTCE_FILE: Final = Path(__file__).with_name("wheel_packet.xtce.xml")
XTCE_SUFFIX: Final = ".xtce.xml"
MAP_SUFFIX: Final = ".map.toml"

FIRST_APID: Final = 416  # of the first wheel, in the definition; the next has the next
MAX_EXAMPLE_WHEELS: Final = 64
CUC_FRACTION: Final = 2**24  # units of a second
_CONTENT: Final = struct.Struct(">I3sBiiiifH")  # time, flags, then the fields in their order


@dataclass(frozen=True, slots=True)
class _Field:
    """A channel in the packet: raw = (value − offset) / resolution, rounded and within bounds; None: a float32."""

    channel: str
    parameter: str
    resolution: float | None = None
    offset: float = 0.0
    low: int = -(2**31)
    high: int = 2**31 - 1


FIELDS: Final = (
    _Field("speed_rad_s", "WHEEL_SPEED", 1e-5),
    _Field("friction_torque_Nm", "FRICTION_TORQUE", 1e-9),
    _Field("motor_current_A", "MOTOR_CURRENT", 1e-7),
    _Field("motor_torque_Nm", "MOTOR_TORQUE", 1e-9),
    _Field("motor_voltage_V", "MOTOR_VOLTAGE"),
    _Field("bearing_temperature_degC", "BEARING_TEMPERATURE", 0.005, -100.0, 0, 2**16 - 1),
)


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
    try:
        from spacepackets.ccsds.spacepacket import SpacePacketHeader
    except ImportError as error:
        raise RwaMonitorError(f"{error.name} is missing: pip install 'rwa-monitor[ccsds]'") from error
    seconds, rest_ns = np.divmod(samples.time_ns, NANOSECONDS_PER_SECOND)
    fraction = np.rint(rest_ns * (CUC_FRACTION / NANOSECONDS_PER_SECOND)).astype(np.int64)
    seconds, fraction = seconds + fraction // CUC_FRACTION, fraction % CUC_FRACTION
    if len(samples) and not 0 <= int(seconds.min()) <= int(seconds.max()) < 2**32:
        raise InputError("time_ns", "lies outside of what four octets of seconds can hold, 0 to 136 years")
    raw: list[list[int] | list[float]] = []
    flags = np.zeros(len(samples), dtype=np.int64)
    for bit, entry in enumerate(FIELDS):
        values = getattr(samples, entry.channel)
        values = np.full(len(samples), np.nan) if values is None else values
        known = np.isfinite(values)
        flags |= np.where(known, 0x80 >> bit, 0)
        raw.append(_raw(entry, values, known))
    rows = zip(seconds.tolist(), fraction.tolist(), flags.tolist(), *raw, strict=True)
    for number, (second, part, flag, *values) in enumerate(rows):
        content = _CONTENT.pack(second, part.to_bytes(3, "big"), flag, *values)
        count = (first_count + number) % 2**14
        yield bytes(SpacePacketHeader.tm(apid, count, len(content) - 1, sec_header_flag=True).pack()) + content


def _raw(entry: _Field, values: FloatArray, known: Any) -> list[int] | list[float]:
    """Return what stands in the packets for the values of a channel; 0 where none is known."""
    if entry.resolution is None:
        floats: list[float] = np.where(known, values, 0.0).astype(np.float32).tolist()
        return floats
    scaled = np.rint((np.where(known, values, entry.offset) - entry.offset) / entry.resolution)
    if len(scaled) and not (entry.low <= scaled.min() and scaled.max() <= entry.high):
        at = int(np.argmax((scaled < entry.low) | (scaled > entry.high)))
        raise InputError(entry.channel, f"{values[at]} is more than the example's packet can hold", f"sample {at + 1}")
    integers: list[int] = scaled.astype(np.int64).tolist()
    return integers
