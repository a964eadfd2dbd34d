"""What the tests of space packets share: packets made with spacepackets and struct, and another definition."""

from __future__ import annotations

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


# A second definition, of another house: PUS-like time (CDS: days since 1958, milliseconds of the day), rpm, ADC counts.
CDS_XTCE = """<?xml version="1.0"?>
<SpaceSystem name="Other" xmlns="http://www.omg.org/spec/XTCE/20180204"><TelemetryMetaData>
<ParameterTypeSet>
 <BinaryParameterType name="Header"><BinaryDataEncoding>
  <SizeInBits><FixedValue>48</FixedValue></SizeInBits>
 </BinaryDataEncoding></BinaryParameterType>
 <IntegerParameterType name="U8"><IntegerDataEncoding sizeInBits="8" encoding="unsigned"/></IntegerParameterType>
 <IntegerParameterType name="U4"><IntegerDataEncoding sizeInBits="4" encoding="unsigned"/></IntegerParameterType>
 <AbsoluteTimeParameterType name="Days"><Encoding units="days">
  <IntegerDataEncoding sizeInBits="16" encoding="unsigned"/>
 </Encoding></AbsoluteTimeParameterType>
 <RelativeTimeParameterType name="Ms"><Encoding units="seconds" scale="0.001">
  <IntegerDataEncoding sizeInBits="32" encoding="unsigned"/>
 </Encoding></RelativeTimeParameterType>
 <FloatParameterType name="Rpm"><UnitSet><Unit>rpm</Unit></UnitSet>
  <FloatDataEncoding sizeInBits="32"/>
 </FloatParameterType>
 <FloatParameterType name="Kelvin"><UnitSet><Unit>K</Unit></UnitSet>
  <IntegerDataEncoding sizeInBits="12" encoding="unsigned"><DefaultCalibrator>
   <SplineCalibrator order="1" extrapolate="true">
    <SplinePoint raw="0" calibrated="200"/><SplinePoint raw="4000" calibrated="400"/>
   </SplineCalibrator>
  </DefaultCalibrator></IntegerDataEncoding>
 </FloatParameterType>
 <StringParameterType name="Text"><StringDataEncoding>
  <SizeInBits><Fixed><FixedValue>32</FixedValue></Fixed></SizeInBits>
 </StringDataEncoding></StringParameterType>
</ParameterTypeSet>
<ParameterSet>
 <Parameter name="HEAD" parameterTypeRef="Header"/><Parameter name="PREAMBLE" parameterTypeRef="U8"/>
 <Parameter name="DAYS" parameterTypeRef="Days"/><Parameter name="MS" parameterTypeRef="Ms"/>
 <Parameter name="SPEED" parameterTypeRef="Rpm"/><Parameter name="HOUSING" parameterTypeRef="Kelvin"/>
 <Parameter name="MODE" parameterTypeRef="U4"/><Parameter name="LABEL" parameterTypeRef="Text"/>
 <Parameter name="BARE" parameterTypeRef="U8"/>
</ParameterSet>
<ContainerSet>
 <SequenceContainer name="CCSDSPacket"><EntryList>
  <ParameterRefEntry parameterRef="HEAD"/><ParameterRefEntry parameterRef="PREAMBLE"/>
 </EntryList></SequenceContainer>
 <SequenceContainer name="Wheel"><EntryList>
  <ParameterRefEntry parameterRef="DAYS"/><ParameterRefEntry parameterRef="MS"/>
  <ParameterRefEntry parameterRef="SPEED"/><ParameterRefEntry parameterRef="HOUSING"/>
  <ParameterRefEntry parameterRef="MODE"/><ParameterRefEntry parameterRef="LABEL"/>
  <ParameterRefEntry parameterRef="BARE"/>
 </EntryList><BaseContainer containerRef="CCSDSPacket"><RestrictionCriteria>
  <Comparison parameterRef="PREAMBLE" value="64"/>
 </RestrictionCriteria></BaseContainer></SequenceContainer>
</ContainerSet>
</TelemetryMetaData></SpaceSystem>
"""
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
