"""ROS 2 bags: what a map makes of topics, times of messages, and everything that is wrong with a bag."""

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zstandard
from mcap.writer import CompressionType, Writer

from rwa_monitor.errors import InputError
from rwa_monitor.samples import Samples
from rwa_monitor.telemetry.files import MAX_CHUNK_BYTES
from rwa_monitor.telemetry.reader import Decoding, TelemetryFile, joined, only_wheel
from rwa_monitor.telemetry.ros2_bag import read_bag
from tests import program
from tests.monitor.recordings import chunk, record
from tests.monitor.support import telemetry
from tests.telemetry import bags

NEXT = "=" * 80 + "\nMSG: "
HEAD = bags.SHORT_MAP.rsplit("speed_rad_s", 1)[0]
TIMES = [0.0, 0.125, 0.25, 0.375]
SPEEDS = [1.0, 2.0, 3.0, 4.0]


def read(path: Path, text: str = bags.SHORT_MAP) -> Samples:
    content = read_bag(path, bags.decoding(text))
    assert list(content.problems) == []
    return joined(only_wheel(content, "test"))


def refused(path: Path, text: str = bags.SHORT_MAP) -> str:
    return program.refused(lambda: read_bag(path, bags.decoding(text)))


def of_states(folder: Path, messages: list[tuple[int, dict[str, Any]]]) -> Path:
    return bags.write_topic(folder / "b.mcap", "/joint_states", "sensor_msgs/msg/JointState", messages)


def number_of(content: TelemetryFile) -> int:
    return len(joined(only_wheel(content, "test")))


def damaged(data: bytes, place: int) -> bytes:
    return data[:place] + bytes([data[place] ^ 1]) + data[place + 1 :]


# ---- what is read ----------------------------------------------------------------------------------------------------


def test_a_joint_is_found_by_its_name_and_without_a_value_is_no_sample_or_not_measured(tmp_path: Path) -> None:
    messages = bags.states([*TIMES, 0.5], [*SPEEDS, 5.0], ("a", "wheel_1", "b"))
    messages[1][1]["name"] = ["wheel_9"]
    messages[2][1]["velocity"] = []
    messages[3][1].update(name=["wheel_1", "b", "a"], velocity=[40.0, 5.0, 6.0])
    found = read(of_states(tmp_path, messages))
    assert found.time_ns.tolist() == [0, 250_000_000, 375_000_000, 500_000_000]
    np.testing.assert_array_equal(found.speed_rad_s, [1.0, np.nan, 40.0, 5.0])


def test_a_field_in_a_field_and_a_unit_of_the_map(tmp_path: Path) -> None:
    text = f"geometry_msgs/Vector3 angular\n{NEXT}geometry_msgs/Vector3\nfloat64 x\nfloat32 y\nint16 z\n"
    messages = [(10**9, {"angular": {"x": 1.0, "y": 60.0, "z": 7}})]
    path = bags.write_topic(tmp_path / "b.mcap", "/t", "geometry_msgs/msg/Twist", messages, text)
    for axis, value in (("y", 60.0), ("z", 7.0)):
        wanted = f'{HEAD}speed_rad_s = {{ topic = "/t", field = "angular.{axis}", time = "log", unit = "rpm" }}\n'
        assert read(path, wanted).speed_rad_s == pytest.approx(np.array([value * 2 * np.pi / 60]))


def test_a_value_of_another_topic_is_held_as_long_as_the_map_states_and_no_longer(tmp_path: Path) -> None:
    samples = telemetry(40)
    late_ns = samples.time_ns[::10] + 60_000_000  # when currents come: 60 ms after the speed of each tenth sample
    with (tmp_path / "c.mcap").open("wb") as file, bags.Writer(file) as writer:
        state = writer.register_msgdef("sensor_msgs/msg/JointState", bags.JOINT_STATE)
        number = writer.register_msgdef("std_msgs/msg/Float64", bags.FLOAT64)
        for time_ns, message in bags.states((samples.time_ns / 1e9).tolist(), samples.speed_rad_s):
            writer.write_message("/joint_states", state, message, log_time=time_ns)
        for at, time_ns in enumerate(late_ns.tolist()):
            writer.write_message("/current", number, {"data": float(at)}, log_time=time_ns)
    text = bags.SHORT_MAP.replace('wheel = "wheel_1"\n', 'wheel = "wheel_1"\nhold_s = 0.3\n')
    text += 'motor_current_A = { topic = "/current", field = "data", time = "log" }\n'
    found = read(tmp_path / "c.mcap", text)
    expected = np.full(40, np.nan)
    for first in range(0, 40, 10):  # 65, 190 ms after it: the next is 315 ms
        expected[first + 1 : first + 3] = first / 10
    np.testing.assert_array_equal(found.motor_current_A, expected)


def test_a_bag_that_was_not_closed_gives_what_is_whole(tmp_path: Path) -> None:
    samples = telemetry(2_000)
    path = bags.write_bag(samples, tmp_path / "b.mcap", CompressionType.NONE)
    whole = path.read_bytes()
    path.write_bytes(whole[: whole.index(struct.pack("<BQ", 15, 4))])  # before the end of the data
    content = read_bag(path, bags.decoding(bags.map_of(samples)))
    assert number_of(content) == 2_000
    assert "the bag was not closed, or is damaged" in content.problems[0]


def test_a_damaged_chunk_is_left_out_and_reported(tmp_path: Path) -> None:
    samples = telemetry(4_000)
    path = bags.write_bag(samples, tmp_path / "b.mcap", CompressionType.NONE, chunk_size=100_000)
    whole = path.read_bytes()
    path.write_bytes(damaged(whole, len(whole) // 3))
    content = read_bag(path, bags.decoding(bags.map_of(samples)))
    assert any("another checksum" in problem for problem in content.problems)
    assert 3_000 < number_of(content) < 4_000
    path.write_bytes(damaged(whole, 1_000))  # in the first chunk, which describes the topics
    assert "there is no topic /joint_states" in refused(path, bags.map_of(samples))


# ---- what is refused -------------------------------------------------------------------------------------------------


def test_without_a_map_it_is_reported_that_one_is_needed(tmp_path: Path) -> None:
    path = Raw().write(tmp_path / "b.mcap")
    with pytest.raises(InputError, match="is a ROS 2 bag: --map gives which topics are which channels"):
        read_bag(path, Decoding())


BAD_MAPS = {
    "no such topic": (bags.SHORT_MAP.replace("/joint_states", "/joints"), "no topic /joints; there are /joint_states"),
    "no such field": (bags.SHORT_MAP.replace("velocity", "speed"), "there is no field speed"),
    "a text": (bags.SHORT_MAP.replace('"velocity"', '"name"'), "name is no number"),
    "a list": (bags.SHORT_MAP.replace(', joint = "wheel_1"', ""), "velocity is no number"),
    "no such joint": (bags.SHORT_MAP.replace('joint = "wheel_1"', 'joint = "w"'), "holds no sample of a wheel"),
    "unit of another quantity": (bags.SHORT_MAP.replace("joint =", 'unit = "V", joint ='), "is no unit of speed_rad_s"),
    "a private name": (bags.SHORT_MAP.replace('"velocity"', '"__class__"'), "field"),
    "a time that is none": (bags.SHORT_MAP.replace("joint =", 'time = "now", joint ='), "time"),
    "two topics, no hold": (
        bags.SHORT_MAP + 'motor_current_A = { topic = "/x", field = "data" }\n',
        "hold_s must give how old",
    ),
    "parameters of packets": (bags.SHORT_MAP.replace("joint =", 'parameter = "X", joint ='), "parameter: wheel 1:"),
}  # fmt: skip


@pytest.mark.parametrize(("text", "reason"), BAD_MAPS.values(), ids=BAD_MAPS)
def test_a_map_that_does_not_fit_is_refused(tmp_path: Path, text: str, reason: str) -> None:
    assert reason in refused(of_states(tmp_path, bags.states(TIMES, SPEEDS)), text)


def test_a_message_without_a_stamp_needs_another_time(tmp_path: Path) -> None:
    path = bags.write_topic(tmp_path / "b.mcap", "/w", "std_msgs/msg/Float64", [(1, {"data": 1.0})])
    text = bags.SHORT_MAP.replace('"/joint_states", field = "velocity", joint = "wheel_1"', '"/w", field = "data"')
    assert "it has no header" in refused(path, text)
    assert read(path, text.replace('"data"', '"data", time = "log"')).time_ns.tolist() == [1]


DATA = b"\x00\x01\x00\x00" + struct.pack("<d", 1.5)
MILLIONS = DATA[:4] + b"\xff" * 4  # of values, as a message states
MORE_VALUES = "more values than bytes"


@dataclass
class Raw:
    """A channel as somebody may write it who does not use ROS's own writer."""

    schema: str = bags.FLOAT64
    encoding: str = "cdr"
    schema_encoding: str = "ros2msg"
    data: bytes = DATA

    def write(self, path: Path) -> Path:
        with path.open("wb") as file:
            writer = Writer(file)
            writer.start(profile="ros2")
            schema = writer.register_schema("x_msgs/msg/X", self.schema_encoding, self.schema.encode())
            channel = writer.register_channel("/x", self.encoding, schema)
            writer.add_message(channel, 5, self.data, 5)
            writer.finish()
        return path


X_MAP = HEAD + 'speed_rad_s = { topic = "/x", field = "data", time = "log" }\n'
NESTED = "\n".join(f"{NEXT}x_msgs/A{n}\nA{n + 1} a\nA{n + 1} b" for n in range(30)) + f"\n{NEXT}x_msgs/A30"
CHAIN = "\n".join(f"{NEXT}x_msgs/A{n}\nA{n + 1}[1] a" for n in range(65)) + f"\n{NEXT}x_msgs/A65"
WRAPPED = f"{NEXT}x_msgs/B\nC c\n{NEXT}x_msgs/C\n"
BAD_CHANNELS = {
    "JSON": (Raw(encoding="json"), "holds json by ros2msg; cdr by ros2msg is wanted"),
    "IDL": (Raw(schema_encoding="ros2idl"), "holds cdr by ros2idl"),
    "no type": (Raw(schema="float64\n"), "x_msgs/msg/X is no message type"),
    "a name that is none": (Raw(schema="float64 1data\n"), "is no message type"),
    "a type that is not there": (Raw(schema="float64 data\nOther o\n"), "x_msgs/Other is not in its definition"),
    "a type in itself": (Raw(schema="X x\nfloat64 data\n"), "deeper than 64 levels"),
    "types in types": (Raw(schema=f"float64 data\nA0[1] a\n{CHAIN}\nfloat64 x\n"), "deeper than 64 levels"),
    "objects of few bytes": (Raw(schema=f"B[] b\nfloat64 data\n{WRAPPED}bool[0] x\n", data=MILLIONS), MORE_VALUES),
    "so many of them": (Raw(schema=f"float64 data\nB[99999999] b\n{WRAPPED}bool[0] x\n"), MORE_VALUES),
    "in each other": (Raw(schema=f"float64 data\nA0 a\n{NESTED}\nbool[0] x\n"), MORE_VALUES),
    "no bytes left": (Raw(schema=f"float64 data\nB[] b\n{WRAPPED}\n", data=DATA + MILLIONS[4:]), MORE_VALUES),
    "a type without a name": (Raw(schema=f"float64 data\n{NEXT[:-1]}\nx_msgs/A\nuint8 x\n"), "is no field"),
    "bracket after bracket": (Raw(schema=f"float64 data\n{'uint8[ ' * 37_000}\n"), "is no field"),
    "a number in another way": (Raw(schema="bool[+1] x\nfloat64 data\n"), "is no field"),
    "a long schema": (Raw(schema="float64 data\n" + "#" * 270_000), "its schema has more than 262,144 bytes"),
    "cut data": (Raw(data=b"\x00\x01\x00\x00" + b"1234"), "holds no sample"),
    "no data": (Raw(data=b""), "holds no sample"),
    "a long promise": (Raw("float64[] x\nfloat64 data\n", data=b"\0\1\0\0" + b"\xff" * 4), "holds no sample"),
    "wide text": (Raw(schema="wstring w\nfloat64 data\n"), "wstring is not in its definition"),
    "another CDR": (Raw(data=b"\0\3\0\0" + DATA[4:]), "it is no plain CDR"),
}  # fmt: skip


@pytest.mark.parametrize(("raw", "reason"), BAD_CHANNELS.values(), ids=BAD_CHANNELS)
def test_a_topic_that_cannot_be_decoded_is_refused(tmp_path: Path, raw: Raw, reason: str) -> None:
    assert reason in refused(raw.write(tmp_path / "b.mcap"), X_MAP)


def test_constants_and_types_in_types_as_ros_has_them_are_read(tmp_path: Path) -> None:
    shallow = "\n".join(f"{NEXT}x_msgs/A{n}\nA{n + 1}[] a" for n in range(6)) + f"\n{NEXT}x_msgs/A6\nuint8[<=3] x\n"
    constants = f"uint8 OK=0\nint32 A1_B2 = -3 # why\nint32 {'A' * 50}a=1\nstring S='a=b'\n"
    schema = f"{constants}string<=3[2] s\nbyte[ 3 ] b\nE e\nfloat64 data\nA0[] a\n{shallow}{NEXT}x_msgs/msg/E\n"
    text = struct.pack("<I2s2xI3s", 2, b"a\0", 3, b"bc\0")
    begin = text + bytes(3) + bytes(1)  # the empty type is a byte
    raw = Raw(
        schema=schema.replace("[ 3 ]", "[3]"), data=DATA[:4] + begin + bytes(-len(begin) % 8) + DATA[4:] + bytes(4)
    )
    assert read(raw.write(tmp_path / "b.mcap"), X_MAP).speed_rad_s.tolist() == [1.5]


@pytest.mark.parametrize("order", ["<", ">"])
def test_every_number_is_read_in_both_orders_of_bytes(tmp_path: Path, order: str) -> None:
    kinds = {"int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I", "float32": "f"}
    kinds |= {"int64": "q", "uint64": "Q", "float64": "d", "bool": "?", "byte": "B", "char": "B"}
    for kind, code in kinds.items():
        size = struct.calcsize(f"{order}{code}")
        data = struct.pack(">H2x", order == "<") + bytes(size) + struct.pack(f"{order}{code}", 1)
        raw = Raw(schema=f"uint8 before\n{kind} data\n", data=data)
        assert read(raw.write(tmp_path / "b.mcap"), X_MAP).speed_rad_s.tolist() == [1.0], kind


# ---- chunks that lie -------------------------------------------------------------------------------------------------


def lz4_of(data: bytes) -> bytes:
    from lz4 import frame

    return bytes(frame.compress(data))


BOMBS: dict[str, Any] = {
    "zstd that says too much": (lambda n: (zstandard.compress(bytes(n)), MAX_CHUNK_BYTES + 1, b"zstd"), "unpacks to"),
    "zstd that says little": (lambda n: (zstandard.compress(bytes(n)), 100, b"zstd"), "its frame states"),
    "lz4 that says little": (lambda n: (lz4_of(bytes(n)), 100, b"lz4"), "to another size"),
    "another compression": (lambda n: (bytes(10), 10, b"rar"), "'rar' is not known"),
    "no compression, another size": (lambda n: (bytes(10), 9, b""), "to another size"),
}


@pytest.mark.parametrize(("made", "reason"), BOMBS.values(), ids=BOMBS)
def test_a_chunk_that_unpacks_to_more_than_it_states_is_left_out(tmp_path: Path, made: Any, reason: str) -> None:
    content = read_bag(with_record(tmp_path, chunk(*made(200_000_000))), bags.decoding(X_MAP))
    assert reason in content.problems[0]
    assert number_of(content) == 1


def with_record(folder: Path, content: bytes) -> Path:
    """Put a record before those of a sound bag."""
    plain = Raw().write(folder / "plain.mcap").read_bytes()
    first = 8 + 9 + int.from_bytes(plain[9:17], "little")  # behind the header
    path = folder / "b.mcap"
    path.write_bytes(plain[:first] + content + plain[first:])
    return path


def with_chunk(folder: Path, content: bytes) -> Path:
    return with_record(folder, chunk(zstandard.compress(content), len(content)))


def prefixed(*texts: bytes) -> bytes:
    return b"".join(struct.pack("<I", len(text)) + text for text in texts)


def a_channel(number: int, topic: bytes = b"/x") -> bytes:
    return record(4, struct.pack("<HH", number, 1) + prefixed(topic, b"cdr") + bytes(4))


def a_schema(number: int, text: bytes = b"float64 data") -> bytes:
    return record(3, struct.pack("<H", number) + prefixed(b"x_msgs/msg/X", b"ros2msg", text))


IDS = range(1, 201)
OTHERS = a_channel(7, b"/y") + 2_000 * record(5, struct.pack("<HIQQ", 7, 0, 0, 0))
SCHEMAS = b"".join(a_schema(n, bytes(1_000)) for n in IDS[:20])
MANY = {
    "records": ("MAX_RECORDS", 1_000, bytes(9 * 2_000), "more than 1,000 records"),
    "messages of other topics": ("MAX_RECORDS", 1_000, OTHERS, "more than 1,000 records"),
    "channels": ("MAX_COLUMNS", 100, a_schema(1) + b"".join(map(a_channel, IDS)), "more than 100 channels of the map"),
    "schemas": ("MAX_CHUNK_BYTES", 10_000, SCHEMAS, "more than 10,000 bytes of schemas"),
}


@pytest.mark.parametrize(("limit", "value", "content", "reason"), MANY.values(), ids=MANY)
def test_more_than_a_bag_has_in_a_few_bytes_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, limit: str, value: int, content: bytes, reason: str
) -> None:
    monkeypatch.setattr(f"rwa_monitor.telemetry.ros2_bag.{limit}", value)
    assert reason in refused(with_chunk(tmp_path, content), X_MAP)


def test_a_schema_that_comes_again_is_kept_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rwa_monitor.telemetry.ros2_bag.MAX_CHUNK_BYTES", 10_000)
    again = b"".join(a_schema(9, bytes(1_000)) for _ in range(20))
    assert read(with_chunk(tmp_path, again), X_MAP).speed_rad_s.tolist() == [1.5]
