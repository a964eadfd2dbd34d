"""Space packets: what a definition and a map make of them, to what they resolve, and everything that is wrong."""

import math
import re
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from spacepackets.ccsds.spacepacket import PacketType, SequenceFlags, SpacePacketHeader

from rwa_monitor.errors import InputError
from rwa_monitor.samples import CHANNELS, Samples
from rwa_monitor.telemetry.ccsds_packets import PacketDecoder, read_packets
from rwa_monitor.telemetry.reader import Decoding, TextFile, joined, only_wheel
from tests.program import refused
from tests.telemetry import packets as made
from tests.telemetry.packet_writer import FIELDS, FIRST_APID, XTCE_FILE, example_decoding, packets_of, write_packets


def decoder(decoding: Decoding | None = None) -> PacketDecoder:
    return PacketDecoder(decoding or made.decoding(), "test")


def fed(packets: Iterable[bytes]) -> PacketDecoder:
    under_test = decoder()
    for packet in packets:
        under_test.take(packet)
    return under_test


def times_of(packets: Iterable[bytes]) -> list[int]:
    """Return the times of the example's packets [ns]."""
    return fed(packets).wheels[0].samples().time_ns.tolist()


# ---- what is read ----------------------------------------------------------------------------------------------------


def test_samples_come_back_within_what_a_packet_resolves(tmp_path: Path) -> None:
    written = made.samples(300)
    path = tmp_path / "day.ccsds"
    found = read_packets(path, write_packets(written, path))
    assert (list(found.problems), list(found.notes)) == ([], [])
    entry = only_wheel(found, "test")
    assert (entry.spacecraft, entry.wheel) == ("simulated", "wheel_1")
    read = joined(entry)
    assert np.abs(read.time_ns - written.time_ns).max() <= 30  # half of 2⁻²⁴ s is 29.8 ns
    for entry in FIELDS:
        one, two = getattr(written, entry.channel), getattr(read, entry.channel)
        np.testing.assert_array_equal(np.isnan(one), np.isnan(two))
        step = 2.0**-23 * np.nanmax(np.abs(one)) if entry.kind == ">f4" else entry.resolution
        assert np.nanmax(np.abs(one - two)) <= 0.51 * step, entry.channel


def test_the_time_of_a_packet_is_exact_to_the_nanosecond_after_a_century() -> None:
    times = np.array([0, 125_000_000, 3_999_999_999 * 10**9 + 875_000_000])
    samples = Samples(time_ns=times, speed_rad_s=np.ones(3))
    assert times_of(packets_of(samples, FIRST_APID)) == times.tolist()


def test_a_time_that_the_bus_does_not_take_is_bad() -> None:
    samples = Samples(time_ns=np.array([4_000_000_001 * 10**9]), speed_rad_s=np.ones(1))
    under_test = decoder()
    assert under_test.take(next(packets_of(samples, FIRST_APID))) == []
    assert (under_test.counts.bad, under_test.counts.decoded) == (1, 0)


def test_a_definition_of_another_house_days_rpm_kelvin_and_splines(tmp_path: Path) -> None:
    packets = [made.cds_packet(number, 3000.0 + number, 2000) for number in range(8)]
    found = read_packets(made.write(tmp_path / "x.bin", packets), made.with_map(made.CDS_MAP, made.CDS_XTCE))
    read = joined(only_wheel(found, "test"))
    noon = datetime(2026, 1, 2, 12, tzinfo=UTC) - datetime(1958, 1, 1, tzinfo=UTC)
    assert read.time_ns.tolist() == [int(noon.total_seconds()) * 10**9 + number * 125_000_000 for number in range(8)]
    np.testing.assert_allclose(read.speed_rad_s, [(3000 + number) * 2 * math.pi / 60 for number in range(8)], rtol=1e-9)
    np.testing.assert_allclose(read.bearing_temperature_degC, 300 - 273.15)  # 2000 of 4000 between 200 and 400 K
    assert read.friction_torque_Nm is None


def test_several_wheels_in_one_file_and_one_packet(tmp_path: Path) -> None:
    keys = {f"rwa/sat/w{number}/samples": CHANNELS for number in range(3)}
    decoding = example_decoding(keys)
    # A fourth wheel looks at the packets of the first.
    again = decoding.map.text.split("[[wheel]]")[1].replace('"w0"', '"w3"')
    decoding = Decoding(TextFile("m", decoding.map.text + "[[wheel]]" + again), decoding.xtce)
    streams = [list(packets_of(made.samples(10, seed), FIRST_APID + seed)) for seed in range(3)]
    mixed = [packet for row in zip(*streams, strict=True) for packet in row]
    found = read_packets(made.write(tmp_path / "x.ccsds", mixed), decoding)
    assert [(entry.wheel, len(joined(entry))) for entry in found.telemetry] == [(f"w{n}", 10) for n in range(4)]
    first, fourth = joined(found.telemetry[0]), joined(found.telemetry[3])
    np.testing.assert_array_equal(first.speed_rad_s, fourth.speed_rad_s)


# ---- what is counted -------------------------------------------------------------------------------------------------


def other(apid: int, count: int = 0, kind: PacketType = PacketType.TM, content: bytes = b"\x00" * 8) -> bytes:
    return bytes(SpacePacketHeader(kind, apid, count, len(content) - 1).pack()) + content


def test_every_packet_is_counted_as_what_it_is() -> None:
    good = made.packets(6)
    segment = bytearray(good[4])
    segment[2] &= 0x3F  # a continuation
    segment[2] |= SequenceFlags.CONTINUATION_SEGMENT << 6
    stream = [
        good[0],
        other(99),
        other(FIRST_APID, kind=PacketType.TC),
        other(2_047),  # fill
        good[1],
        good[3],  # 2 is missing
        bytes(segment),
        other(FIRST_APID, 5),  # too short for the definition
        good[3],  # from before
        b"\x00" * 6,
        b"\xff" + good[5][1:],  # version 7
        good[5][:-1],
        good[5] + b"\x00",
    ]
    under_test = decoder()
    given = sum(len(under_test.take(packet)) for packet in stream)
    counts = under_test.counts
    assert (counts.packets, counts.decoded, given) == (13, 4, 4)
    assert (counts.unknown, counts.idle, counts.bad, counts.other) == (2, 1, 6, 0)
    assert counts.unknown_apids == {99, FIRST_APID}
    assert (counts.gaps, counts.missing) == (2, 1)
    assert counts.first_bad == f"packet 7: APID {FIRST_APID}: a segment of a packet, which are not put together here"
    assert counts.packets == counts.decoded + counts.bad + counts.unknown + counts.idle + counts.other


def test_a_sequence_count_that_wraps_is_no_gap() -> None:
    counts = fed(packets_of(made.samples(4), FIRST_APID, first_count=2**14 - 2)).counts
    assert (counts.gaps, counts.missing) == (0, 0)


def test_a_packet_of_another_kind_is_left_to_others() -> None:
    """One APID with two kinds of packets, of which the map names one."""
    under_test = decoder(made.with_map(made.CDS_MAP, made.CDS_XTCE))
    assert len(under_test.take(made.cds_packet(0, 100.0, 5))) == 1
    assert under_test.take(other(made.CDS_APID, 1, content=b"\x07")) == []
    assert (under_test.counts.decoded, under_test.counts.other, under_test.counts.bad) == (1, 1, 0)


@pytest.mark.parametrize("cut", [1, 6, 7, 40])
def test_a_cut_file_gives_what_is_whole_and_the_rest_is_reported(tmp_path: Path, cut: int) -> None:
    data = b"".join(made.packets(5))[:-cut]
    path = tmp_path / "cut.ccsds"
    path.write_bytes(data)
    found = read_packets(path, made.decoding())
    whole = len(data) // len(made.packets(1)[0])
    assert len(joined(only_wheel(found, "test"))) == whole
    stop = whole * len(made.packets(1)[0])
    assert list(found.problems) == [f"bytes {stop} to {len(data)} of {len(data)} are no whole packet"]


def test_what_is_bad_in_a_file_is_a_problem_and_what_is_unknown_a_note(tmp_path: Path) -> None:
    good = made.packets(4)
    found = read_packets(
        made.write(tmp_path / "x.ccsds", [good[0], other(FIRST_APID, 1), other(7), good[3]]), made.decoding()
    )
    assert len(found.problems) == 1
    assert "1 of 4 packets cannot be read, the first: packet 2: APID 416: " in found.problems[0]
    notes = " ".join(found.notes)
    assert "1 packet of APIDs that the map does not name (7)" in notes
    assert "the sequence count breaks 1 time; missing: 1 packet" in notes


def test_packets_that_come_late_or_again_are_reported_and_put_in_order(tmp_path: Path) -> None:
    good = made.packets(8)
    order = [0, 1, 4, 2, 3, 3, 5, 7, 6]
    found = read_packets(made.write(tmp_path / "x.ccsds", [good[at] for at in order]), made.decoding())
    assert any("3 samples of wheel_1 come after one of the same time or a later one" in note for note in found.notes)
    entry = only_wheel(found, "test")
    straight = times_of(good)
    assert entry.batches[0].samples.time_ns.tolist() == [straight[at] for at in order]  # as they came
    assert joined(entry).time_ns.tolist() == straight


def test_a_file_without_a_packet_of_the_map_is_refused(tmp_path: Path) -> None:
    for content in ([other(7)], [other(FIRST_APID)], [b"\x00" * 5], [b"time_s,speed_rad_s\n0,1\n"]):
        with pytest.raises(InputError, match="holds no packet that the map can use, of APID 416"):
            read_packets(made.write(tmp_path / "x.ccsds", content), made.decoding())


# ---- maps and definitions that are refused ---------------------------------------------------------------------------

MAP = """[[wheel]]
spacecraft = "sat"
wheel = "w"
apid = 416
time = ["TIME_COARSE", "TIME_FINE"]
[wheel.channels]
speed_rad_s = "WHEEL_SPEED"
"""
BAD_MAPS = {
    "no TOML": ("[[wheel", "is no valid TOML"),
    "empty": ("", "1 to 4,096 blocks"),
    "no APID": (MAP.replace("apid = 416\n", ""), "apid: wheel 1: Field required"),
    "unknown key": (MAP.replace("apid", "vcid = 1\napid"), "vcid: wheel 1: no key has this name"),
    "APID of fill": (MAP.replace("416", "2047"), "apid"),
    "no time": (MAP.replace('["TIME_COARSE", "TIME_FINE"]', "[]"), "time"),
    "no speed": (MAP.replace("speed_rad_s", "motor_current_A"), "channels.speed_rad_s is missing"),
    "name with a slash": (MAP.replace('"w"', '"a/b"'), "names of letters, digits"),
    "twice": (MAP + MAP, "rwa/sat/w/samples: is there twice"),
    "no such parameter": (MAP.replace("WHEEL_SPEED", "SPEED"), "speed_rad_s: SPEED: there is no parameter SPEED"),
    "time without a unit": (MAP.replace("TIME_FINE", "SEQ_COUNT"), "time: SEQ_COUNT: has no unit"),
    "unit of another quantity": (MAP.replace("WHEEL_SPEED", "MOTOR_CURRENT"), "is in 'mA', which is no unit of speed"),
    "unknown unit": (MAP.replace('"WHEEL_SPEED"', '{ parameter = "WHEEL_SPEED", unit = "furlong" }'), "'furlong'"),
    "no flag": (MAP.replace('"WHEEL_SPEED"', '{ parameter = "WHEEL_SPEED", valid = "MOTOR_VOLTAGE" }'), "is wanted"),
    "a flag for a number": (MAP.replace("WHEEL_SPEED", "WHEEL_SPEED_VALID"), "is a BooleanParameterType"),
}  # fmt: skip


@pytest.mark.parametrize(("text", "reason"), BAD_MAPS.values(), ids=BAD_MAPS)
def test_a_bad_map_is_refused_with_its_place(text: str, reason: str) -> None:
    with pytest.raises(InputError, match=rf"m\.toml: .*{re.escape(reason)}"):
        decoder(made.with_map(text))


def test_the_map_may_state_another_unit_than_the_definition() -> None:
    text = MAP.replace('"WHEEL_SPEED"', '{ parameter = "WHEEL_SPEED", unit = "rpm" }')
    packet = next(packets_of(Samples(np.array([0]), np.array([60.0])), FIRST_APID))
    (wheel,) = decoder(made.with_map(text)).take(packet)
    assert wheel.samples().speed_rad_s == pytest.approx([2 * math.pi])


BAD_XTCE = {
    "no XML": ("<xtce:SpaceSystem ", "<xtce:SpaceSystem <"),
    "cut": ("</xtce:SpaceSystem>", ""),
    "no namespace": ('xmlns:xtce="http://www.omg.org/spec/XTCE/20180204"', 'xmlns:xtce="urn:nothing"'),
    "a type that is none": ("xtce:BooleanParameterType", "xtce:BooleanType"),
    "a type that is not there": ('parameterTypeRef="Speed"', 'parameterTypeRef="Velocity"'),
    "a parameter that is not there": ('Entry parameterRef="SPARE"', 'Entry parameterRef="S"'),
    "no bits": ('sizeInBits="11"', 'sizeInBits="eleven"'),
    "no root": ('name="CCSDSPacket"', 'name="Packet"'),
    "no containers": ("ContainerSet>", "ContainersSet>"),
    "two of a name": ('name="WheelTelemetry"', 'name="CCSDSPacket"'),
    "in itself": ('ParameterRefEntry parameterRef="VERSION"', 'ContainerRefEntry containerRef="CCSDSPacket"'),
    "a high power": ('coefficient="1e-5" exponent="1"', 'coefficient="1e-5" exponent="1000000000"'),
    "a document type": ("<xtce:SpaceSystem ", '<!DOCTYPE x [<!ENTITY a "a">]><xtce:SpaceSystem '),
    "a file in it": ("<xtce:SpaceSystem ", '<!DOCTYPE x [<!ENTITY a SYSTEM "file:///etc/passwd">]><xtce:SpaceSystem '),
}  # fmt: skip


@pytest.mark.parametrize(("old", "new"), BAD_XTCE.values(), ids=BAD_XTCE)
def test_a_bad_definition_is_refused_in_one_line(old: str, new: str) -> None:
    assert refused(lambda: decoder(made.with_xtce(old, new))).startswith("x.xml: ")


def test_containers_that_hold_each_other_twice_are_refused_before_a_packet_is_read() -> None:
    """Thirty containers, each with the next twice: a billion entries in thirty lines."""
    nested = "".join(
        f'<xtce:SequenceContainer name="C{n}"><xtce:EntryList>'
        + f'<xtce:ContainerRefEntry containerRef="C{n + 1}"/>' * 2
        + "</xtce:EntryList></xtce:SequenceContainer>"
        for n in range(30)
    )
    last = '<xtce:SequenceContainer name="C30"><xtce:EntryList/></xtce:SequenceContainer></xtce:ContainerSet>'
    with pytest.raises(InputError, match="hold more than 10,000 entries"):
        decoder(made.with_xtce("</xtce:ContainerSet>", nested + last))


def test_without_a_map_or_a_definition_what_is_missing_is_reported() -> None:
    for decoding in (Decoding(), Decoding(made.decoding().map), Decoding(None, made.decoding().xtce)):
        with pytest.raises(InputError, match="--xtce gives their definition, and --map which parameter is which"):
            decoder(decoding)


def test_the_example_is_valid_by_the_schema_of_xtce() -> None:
    """The schema is the one that comes with the parser: nothing is fetched."""
    from space_packet_parser import validate_xtce

    result = validate_xtce(XTCE_FILE, level="all", allow_schema_download=False)
    assert result.valid, str(result)
