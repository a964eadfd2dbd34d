"""Helpers of the tests of ROS 2 bags: a bag written with the library's own writer, types as ROS 2 describes them."""

from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType
from mcap_ros2.writer import Writer

from rwa_monitor.samples import NANOSECONDS_PER_SECOND, FloatArray, Samples
from rwa_monitor.telemetry.reader import Decoding, TextFile

HEADER = """================================================================================
MSG: std_msgs/Header
# Standard metadata for higher-level stamped data types.
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
JOINT_STATE = (
    "# The state of a set of torque controlled joints.\n"
    "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n" + HEADER
)
TEMPERATURE = "std_msgs/Header header\nfloat64 temperature # [°C]\nfloat64 variance\n" + HEADER
FLOAT64 = "float64 data\n"
TYPES = {
    "sensor_msgs/msg/JointState": JOINT_STATE,
    "sensor_msgs/msg/Temperature": TEMPERATURE,
    "std_msgs/msg/Float64": FLOAT64,
}

# Topics of one number: topic, channel, and the factor to the unit in which the bag has it.
FLOATS = (
    ("/wheel_1/friction", "friction_torque_Nm", 1.0),
    ("/wheel_1/current", "motor_current_A", 1e3),
    ("/wheel_1/voltage", "motor_voltage_V", 1.0),
)

MAP = """
[[wheel]]
spacecraft = "sat"
wheel = "wheel_1"
hold_s = 0.2
[wheel.channels]
speed_rad_s = { topic = "/joint_states", field = "velocity", joint = "wheel_1" }
motor_torque_Nm = { topic = "/joint_states", field = "effort", joint = "wheel_1" }
friction_torque_Nm = { topic = "/wheel_1/friction", field = "data", time = "log" }
motor_current_A = { topic = "/wheel_1/current", field = "data", time = "publish", unit = "mA" }
motor_voltage_V = { topic = "/wheel_1/voltage", field = "data", time = "log" }
bearing_temperature_degC = { topic = "/wheel_1/temperature", field = "temperature" }
"""
SHORT_MAP = """
[[wheel]]
spacecraft = "sat"
wheel = "wheel_1"
[wheel.channels]
speed_rad_s = { topic = "/joint_states", field = "velocity", joint = "wheel_1" }
"""


def map_of(samples: Samples) -> str:
    """Return the map of the channels present in the samples."""
    there = {name for name, _ in samples.channels()}
    return "\n".join(line for line in MAP.splitlines() if " = {" not in line or line.split(" = ")[0] in there)


def decoding(text: str = MAP) -> Decoding:
    return Decoding(TextFile("map.toml", text))


def write_bag(
    samples: Samples, path: Path, compression: CompressionType = CompressionType.ZSTD, chunk_size: int = 2**20
) -> Path:
    """Write samples as a robot's computer would: states of two joints, the other channels on topics of their own."""
    with path.open("wb") as file, Writer(file, chunk_size, compression) as writer:
        schemas = {name: writer.register_msgdef(name, text) for name, text in TYPES.items()}

        def put(topic: str, kind: str, message: dict[str, Any], time_ns: int) -> None:
            writer.write_message(topic, schemas[kind], message, log_time=time_ns, publish_time=time_ns)

        for at, time_ns in enumerate(samples.time_ns.tolist()):
            stamp = {"sec": time_ns // NANOSECONDS_PER_SECOND, "nanosec": time_ns % NANOSECONDS_PER_SECOND}
            header = {"stamp": stamp, "frame_id": ""}
            torque = samples.motor_torque_Nm
            state = {
                "header": header,
                "name": ["wheel_0", "wheel_1"],
                "position": [],
                "velocity": [-1.0, float(samples.speed_rad_s[at])],
                "effort": [] if torque is None else [0.0, float(torque[at])],
            }
            for topic, name, factor in FLOATS:
                if (channel := getattr(samples, name)) is not None:
                    put(topic, "std_msgs/msg/Float64", {"data": float(channel[at]) * factor}, time_ns)
            if (heat := samples.bearing_temperature_degC) is not None:
                temperature = {"header": header, "temperature": float(heat[at]), "variance": 0.0}
                put("/wheel_1/temperature", "sensor_msgs/msg/Temperature", temperature, time_ns)
            put("/joint_states", "sensor_msgs/msg/JointState", state, time_ns + 1_000_000)
    return path


def write_topic(path: Path, topic: str, kind: str, messages: list[tuple[int, dict[str, Any]]], text: str = "") -> Path:
    """Write a bag of one topic: log time and message of each."""
    with path.open("wb") as file, Writer(file) as writer:
        schema = writer.register_msgdef(kind, text or TYPES[kind])
        for time_ns, message in messages:
            writer.write_message(topic, schema, message, log_time=time_ns)
    return path


def states(
    times: list[float], speeds: FloatArray | list[float], names: tuple[str, ...] = ("wheel_1",)
) -> list[tuple[int, dict[str, Any]]]:
    """Return states of joints that all have one speed."""
    found = []
    for time_s, speed in zip(times, np.asarray(speeds).tolist(), strict=True):
        time_ns = round(time_s * NANOSECONDS_PER_SECOND)
        stamp = {"sec": time_ns // NANOSECONDS_PER_SECOND, "nanosec": time_ns % NANOSECONDS_PER_SECOND}
        velocity = [float(speed)] * len(names)
        found.append((time_ns, {"header": {"stamp": stamp}, "name": list(names), "velocity": velocity}))
    return found
