"""Helpers of the tests of space packets: packets made with spacepackets and struct, and another definition."""

import struct
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
from spacepackets.ccsds.spacepacket import SpacePacketHeader
from spacepackets.ccsds.time import CdsShortTimestamp

from rwa_monitor.samples import CHANNELS, Samples
from rwa_monitor.telemetry.reader import Decoding, TextFile
from tests.telemetry.packet_writer import FIRST_APID, example_decoding, packets_of

KEY = "rwa/sat/wheel_1/samples"
CDS_APID = 33


def samples(count: int, seed: int = 1) -> Samples:
    """Return any telemetry that the example's packet holds, with some values that were not measured."""
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.integers(1_000, 2_000_000_000, count))
    scale = {"speed_rad_s": 300.0, "motor_current_A": 0.5, "motor_voltage_V": 8.0, "bearing_temperature_degC": 20.0}
    channels = {name: scale.get(name, 5e-3) * rng.standard_normal(count) for name in CHANNELS}
    for values in channels.values():
        values[rng.random(count) < 0.1] = np.nan
    return Samples(time_ns=times, **channels)


def decoding() -> Decoding:
    return example_decoding({KEY: CHANNELS})


def packets(count: int = 20) -> list[bytes]:
    return list(packets_of(samples(count), FIRST_APID))


def with_map(text: str, xtce: str | None = None) -> Decoding:
    definition = decoding().xtce
    return Decoding(TextFile("m.toml", text), definition if xtce is None else TextFile("x.xml", xtce))


def with_xtce(old: str, new: str) -> Decoding:
    """Return the example with its definition changed in one place."""
    plain = decoding()
    assert old in plain.xtce.text
    return Decoding(plain.map, TextFile("x.xml", plain.xtce.text.replace(old, new, 1)))


# Second definition, by another vendor: PUS-like time (CDS: days since 1958, milliseconds of the day), rpm, ADC counts.
CDS_XTCE = (Path(__file__).parent / "other_house.xtce.xml").read_text(encoding="utf-8")
CDS_MAP = f"""
[[wheel]]
spacecraft = "other"
wheel = "w"
apid = {CDS_APID}
time = ["DAYS", "MS"]
[wheel.channels]
speed_rad_s = "SPEED"
bearing_temperature_degC = "HOUSING"
"""


def cds_packet(number: int, rpm: float, housing: int) -> bytes:
    """Return a packet of the second definition; `number` counts steps of 125 ms from noon of 2026-01-02."""
    stamp = CdsShortTimestamp.from_datetime(datetime(2026, 1, 2, 12, tzinfo=UTC) + number * timedelta(milliseconds=125))
    content = bytes(stamp.pack()) + struct.pack(">f", rpm) + struct.pack(">H", housing << 4 | 3) + b"abcd\x01"
    head = SpacePacketHeader.tm(CDS_APID, number % 2**14, len(content) - 1, sec_header_flag=True)
    return bytes(head.pack()) + content


def write(path: Path, content: list[bytes]) -> Path:
    path.write_bytes(b"".join(content))
    return path
