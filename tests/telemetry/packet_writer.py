"""Test packets, as `docs/examples/wheel_packet.xtce.xml` describes them, and their map.

Written with `spacepackets` and numpy, which have nothing in common with the parser that reads them. A packet holds one
sample; a value that was not measured has its flag at 0. What a packet resolves: time 2⁻²⁴ s (60 ns), speed 1e-5 rad/s,
torque 1e-9 N m, current 1e-7 A, temperature 0.005 °C, voltage seven digits.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import tomli_w
from spacepackets.ccsds.spacepacket import SpacePacketHeader

from rwa_monitor.messages import split_key
from rwa_monitor.samples import NANOSECONDS_PER_SECOND, Samples
from rwa_monitor.telemetry.ccsds_packets import SEQUENCE_MODULUS
from rwa_monitor.telemetry.reader import Decoding, TextFile, read_decoding

XTCE_FILE: Final = Path(__file__).parents[2] / "docs" / "examples" / "wheel_packet.xtce.xml"

FIRST_APID: Final = 416  # of the first wheel, in the definition; the next has the next
CUC_FRACTION: Final = 2**24  # units of a second


class _Field(NamedTuple):
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
    blocks = []
    for number, (key, channels) in enumerate(channels_by_key.items()):
        spacecraft, wheel, _ = split_key(key)
        names = {entry.channel: entry.parameter for entry in FIELDS if entry.channel in channels}
        of_wheel = {name: {"parameter": one, "valid": f"{one}_VALID"} for name, one in names.items()}
        head = {"spacecraft": spacecraft, "wheel": wheel, "apid": FIRST_APID + number}
        blocks.append({**head, "time": ["TIME_COARSE", "TIME_FINE"], "channels": of_wheel})
    text = tomli_w.dumps({"wheel": blocks})
    return Decoding(TextFile("the example's map", text), TextFile(XTCE_FILE.name, XTCE_FILE.read_text("utf-8")))


def write_packets(samples: Samples, path: Path) -> Decoding:
    """Write samples as packets, the definition and the map beside them (FILE.xtce.xml, FILE.map.toml); read these."""
    decoding = example_decoding({"rwa/simulated/wheel_1/samples": [name for name, _ in samples.channels()]})
    path.write_bytes(b"".join(packets_of(samples, FIRST_APID)))
    beside = [Path(f"{path}.map.toml"), Path(f"{path}.xtce.xml")]
    for file, text in zip(beside, (decoding.map, decoding.xtce), strict=True):
        file.write_text(text.text)
    return read_decoding(*beside)


def packets_of(samples: Samples, apid: int, first_count: int = 0) -> Iterator[bytes]:
    """Yield a packet for each sample; the sequence count goes on from `first_count`."""
    seconds, rest_ns = np.divmod(samples.time_ns, NANOSECONDS_PER_SECOND)
    fraction = np.rint(rest_ns * (CUC_FRACTION / NANOSECONDS_PER_SECOND)).astype(np.int64)
    seconds, fraction = seconds + fraction // CUC_FRACTION, fraction % CUC_FRACTION
    content = np.zeros(len(samples), dtype=_CONTENT)
    content["seconds"], content["fraction"] = seconds, fraction[:, None] >> (16, 8, 0) & 0xFF
    for bit, entry in enumerate(FIELDS):
        values = getattr(samples, entry.channel)
        if values is not None:
            known = np.isfinite(values)
            content["flags"] |= np.where(known, 0x80 >> bit, 0).astype(np.uint8)
            raw = values if entry.kind == ">f4" else np.rint((values - entry.offset) / entry.resolution)
            content[entry.channel][known] = raw[known]
    for number, packed in enumerate(content):
        header = SpacePacketHeader.tm(
            apid, (first_count + number) % SEQUENCE_MODULUS, _CONTENT.itemsize - 1, sec_header_flag=True
        )
        yield bytes(header.pack()) + packed.tobytes()
