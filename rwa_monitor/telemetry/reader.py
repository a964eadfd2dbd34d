"""Telemetry from files, as the monitor core takes it, and the one interface through which every format is read.

A table is one batch of one wheel, a recording many batches of many wheels. A reader takes a path and a `Decoding`, for
telemetry that does not name its channels, and returns a `TelemetryFile`; `rwa_monitor.monitor.telemetry_files` chooses
the reader.

A telemetry map gives which parameter of a packet, or field of a topic, is which channel of which wheel, in what unit.

```toml
[[wheel]]                                   # space packets
spacecraft = "sat-1"
wheel = "wheel_1"
apid = 417
time = ["TIME_COARSE", "TIME_FINE"]         # summed, each in its own unit
[wheel.channels]
speed_rad_s = "WHEEL_SPEED"
motor_current_A = { parameter = "MOTOR_CURRENT", unit = "mA", valid = "MOTOR_CURRENT_VALID" }
```

```toml
[[wheel]]                                   # topics of a ROS 2 bag
spacecraft = "sat-1"
wheel = "wheel_1"
hold_s = 0.2                                # how old a value of another topic than that of the speed may be
[wheel.channels]
speed_rad_s = { topic = "/joint_states", field = "velocity", joint = "wheel_1" }
motor_current_A = { topic = "/wheel_1/current", field = "data", time = "log" }
```

Units are checked: a known unit of the channel's quantity is converted, any other is refused.
"""

import hashlib
import json
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from fractions import Fraction
from math import pi
from pathlib import Path
from typing import Annotated, Any, Final, Literal, NamedTuple, Self, TypeVar

import numpy as np
from pydantic import BeforeValidator, Field, ValidationError, model_validator

from rwa_monitor.diagnosis.model import Model
from rwa_monitor.errors import InputError
from rwa_monitor.messages import MAX_WHEELS, SamplesMessage, key_of, split_key
from rwa_monitor.samples import MAX_TIME_NS, NANOSECONDS_PER_SECOND, ChannelName, Samples, Timeliness, concatenate
from rwa_monitor.telemetry.files import PathLike, display_name, read_text
from rwa_monitor.wheel.file_content import MAX_CONTENT_BYTES, Strict, parse_toml
from rwa_monitor.wheel.wheel import Wheel

MAX_XTCE_BYTES: Final = 4_000_000  # the telemetry of a whole satellite has some thousand parameters


class SampleBatch(NamedTuple):
    """Samples that came together; publisher, batch number and data as in their message, where they came in one."""

    samples: Samples
    publisher: str = ""
    batch: int | None = None
    data: Timeliness | None = None


class WheelTelemetry(NamedTuple):
    """All telemetry of one wheel in one file.

    Attributes
    ----------
    source
        The file, for messages.
    spacecraft, wheel
        From the bus key or the map; "" and None for a table, which names none.
    batches
        In the order in which they came.
    constants
        The wheel file that a recording contains for this wheel; None for every other format.
    """

    source: str
    spacecraft: str
    wheel: str | None
    batches: Sequence[SampleBatch]
    constants: Wheel | None = None


class TelemetryFile(NamedTuple):
    """A file of telemetry.

    Attributes
    ----------
    telemetry
        One entry for each wheel in it.
    model
        The model that a recording contains; None for every other format.
    problems
        What could not be read, a sentence each.
    notes
        What was left out on purpose, a sentence each.
    """

    telemetry: Sequence[WheelTelemetry]
    model: Model | None = None
    problems: Sequence[str] = ()
    notes: Sequence[str] = ()


class TextFile(NamedTuple):
    """A text and the file it came from, for messages."""

    source: str
    text: str


class Decoding(NamedTuple):
    """Definitions for telemetry that does not name its channels; texts, so that workers can be sent them.

    Attributes
    ----------
    map
        Which parameter or topic is which channel of which wheel (`telemetry_map`).
    xtce
        XTCE definition of space packets.
    motor_off
        Whether a table of time and speed alone suffices: with the motor off friction is the inertia's torque.
    pulses_per_turn
        Of a table of pulses; None where not known.
    """

    map: TextFile | None = None
    xtce: TextFile | None = None
    motor_off: bool = False
    pulses_per_turn: int | None = None

    def of_wheel(self, wheel: Wheel | None) -> Self:
        """Return the decoding with what the wheel file states on it."""
        if wheel is None:
            return self
        return self._replace(motor_off=bool(wheel.friction.motor_off), pulses_per_turn=wheel.pulses_per_turn)

    def sha256(self) -> str | None:
        """Return a hash of both texts; None where there is none."""
        texts = [file.text if file else None for file in (self.map, self.xtce)]
        return hashlib.sha256(json.dumps(texts).encode()).hexdigest() if any(texts) else None


# A format: reads a file whole, or refuses it with an InputError that names file, place and reason.
Reader = Callable[[Path, Decoding], TelemetryFile]


def read_decoding(map_file: PathLike | None, xtce_file: PathLike | None) -> Decoding:
    """Read a map and an XTCE definition, where given; raise InputError where one cannot be read."""

    def text_of(path: PathLike | None, limit: int) -> TextFile | None:
        return None if path is None else TextFile(display_name(path), read_text(path, limit))

    return Decoding(text_of(map_file, MAX_CONTENT_BYTES), text_of(xtce_file, MAX_XTCE_BYTES))


def only_wheel(content: TelemetryFile, source: str) -> WheelTelemetry:
    """Return the telemetry of a file that must hold one wheel; raise InputError where it holds several."""
    if len(content.telemetry) != 1:
        wheels = ", ".join(f"{entry.spacecraft}/{entry.wheel}" for entry in content.telemetry)
        raise InputError(source, f"holds {len(content.telemetry)} wheels ({wheels}); one is wanted")
    return content.telemetry[0]


def joined(telemetry: WheelTelemetry) -> Samples:
    """Return all samples of a wheel as one table, in order of time; of several with the same time the first."""
    samples = concatenate([batch.samples for batch in telemetry.batches])
    if (np.diff(samples.time_ns) > 0).all():
        return samples
    return samples[np.unique(samples.time_ns, return_index=True)[1]]


# ---- telemetry maps --------------------------------------------------------------------------------------------------


MAX_APID: Final = 2_046  # 11 bits; 2,047 are idle packets (CCSDS 133.0-B-2, 4.1.3.3.4.4)

Name = Annotated[str, Field(min_length=1, max_length=500)]

# Unit → factor to the unit of the channel's name; written without spaces, dots and stars (`_plain`).
_TORQUE: Final = {"Nm": 1.0, "mNm": 1e-3, "uNm": 1e-6}
UNITS: Final[dict[str, dict[str, float]]] = {
    "speed_rad_s": {
        "rad/s": 1.0,
        "rads-1": 1.0,
        "deg/s": pi / 180,
        "rpm": 2 * pi / 60,
        "RPM": 2 * pi / 60,
        "1/min": 2 * pi / 60,
        "Hz": 2 * pi,
    },
    "friction_torque_Nm": _TORQUE,
    "motor_torque_Nm": _TORQUE,
    "motor_current_A": {"A": 1.0, "mA": 1e-3},
    "motor_voltage_V": {"V": 1.0, "mV": 1e-3},
    "bearing_temperature_degC": dict.fromkeys(("degC", "C", "Celsius", "K", "Kelvin"), 1.0),
}
OFFSETS: Final = {"K": -273.15, "Kelvin": -273.15}  # added after the factor is applied
# Unit of a channel's values where none is given: that in its name.
SI_UNITS: Final = {name: next(iter(units)) for name, units in UNITS.items()}
# Unit of time → nanoseconds; the words are those of XTCE's Encoding.
TIME_UNITS: Final[dict[str, Fraction]] = {
    unit: Fraction(size)
    for units, size in (
        (("d", "days"), 86_400 * 10**9),
        (("s", "sec", "seconds"), 10**9),
        (("ms", "milliseconds"), 10**6),
        (("us", "microseconds"), 10**3),
        (("ns", "nanoseconds"), 1),
        (("ps", "picoSeconds"), Fraction(1, 1000)),
    )
    for unit in units
}


class PacketChannel(Strict):
    """A channel as a parameter of a packet.

    Attributes
    ----------
    parameter
        Its name in the XTCE definition.
    unit
        Of its calibrated value; None for that of the definition.
    valid
        Name of a parameter that is 0 where the value was not measured.
    """

    parameter: Name
    unit: Name | None = None
    valid: Name | None = None


class TopicChannel(Strict):
    """A channel as a field of the messages on a topic.

    Attributes
    ----------
    topic
        Its name.
    field
        Path of the field: "data", "twist.angular.z".
    joint
        Where the field is an array: the entry that stands where `name` holds this, as in sensor_msgs/JointState.
    unit
        Of the value; the unit in the channel's name by default, as ROS uses SI units (REP 103).
    time
        What the sample's time is: the stamp in the message's header, or when the message was logged or published.
    """

    topic: Name
    field: Annotated[str, Field(max_length=500, pattern=r"^[a-z][A-Za-z0-9_]*(\.[a-z][A-Za-z0-9_]*)*$")]
    joint: Name | None = None
    unit: Name | None = None
    time: Literal["header", "log", "publish"] = "header"


class WheelMap(Strict):
    """A wheel of a map, whatever carries its telemetry."""

    spacecraft: Name
    wheel: Name
    channels: Mapping[ChannelName, PacketChannel | TopicChannel]

    @property
    def key(self) -> str:
        """The key of the samples on the bus."""
        return key_of(SamplesMessage, self.spacecraft, self.wheel)

    @model_validator(mode="after")
    def _complete(self) -> Self:
        try:
            split_key(self.key)
        except InputError as error:
            raise ValueError(f"{error.source} {error.reason}") from error
        if "speed_rad_s" not in self.channels:
            raise ValueError("channels.speed_rad_s is missing")
        return self


def _in_full(channel: Any) -> Any:
    """Expand a parameter's bare name to a channel without other keys."""
    return {"parameter": channel} if isinstance(channel, str) else channel


class PacketWheel(WheelMap):
    """A wheel in space packets."""

    apid: Annotated[int, Field(ge=0, le=MAX_APID)]
    time: Annotated[list[Name], Field(min_length=1, max_length=8)]
    channels: Mapping[ChannelName, Annotated[PacketChannel, BeforeValidator(_in_full)]]


class TopicWheel(WheelMap):
    """A wheel in the topics of a ROS 2 bag."""

    hold_s: Annotated[float, Field(gt=0, le=3600)] | None = None
    channels: Mapping[ChannelName, TopicChannel]

    @model_validator(mode="after")
    def _hold_where_needed(self) -> Self:
        if self.hold_s is None and len({channel.topic for channel in self.channels.values()}) > 1:
            raise ValueError("more than one topic: hold_s must give how old a value beside a speed may be")
        return self


OneWheel = TypeVar("OneWheel", bound=WheelMap)
Size = TypeVar("Size", float, Fraction)


def wheels_of(file: TextFile, kind: type[OneWheel]) -> list[OneWheel]:
    """Return the wheels of a map of space packets or of topics; raise InputError naming the key that is wrong."""
    tables = parse_toml(file.text, file.source, "a telemetry map")
    blocks = tables.pop("wheel", None)
    if tables:
        raise InputError(file.source, "is not known in a telemetry map; it has [[wheel]] blocks", next(iter(tables)))
    if not isinstance(blocks, list) or not 0 < len(blocks) <= MAX_WHEELS:
        raise InputError(file.source, f"a telemetry map has 1 to {MAX_WHEELS:,} blocks [[wheel]]", "wheel")
    wheels: list[OneWheel] = []
    for number, block in enumerate(blocks, start=1):
        try:
            wheel = kind.model_validate(block, strict=False)
        except ValidationError as error:
            raise InputError.of_validation(file.source, error, f"wheel {number}", f"wheel {number}: ", kind) from error
        wheels.append(wheel)
    keys = [wheel.key for wheel in wheels]
    for key in keys:
        if keys.count(key) > 1:
            raise InputError(file.source, "is there twice", key)
    return wheels


def telemetry_file(
    source: str,
    found: Iterable[tuple[WheelMap, Samples]],
    problems: Sequence[str],
    notes: Sequence[str],
    nothing: str,
) -> TelemetryFile:
    """Return a file's telemetry of the wheels of a map.

    Parameters
    ----------
    source
        The file, for messages.
    found
        Each wheel with its samples, in the order in which they came.
    problems, notes
        What could not be read, and what was left out on purpose.
    nothing
        Reason of the error where no wheel has a sample; the first problem or note is appended in brackets.

    Raises
    ------
    InputError
        If no wheel has a sample.
    """
    telemetry, notes = [], list(notes)
    for wheel, samples in found:
        if len(samples):
            telemetry.append(WheelTelemetry(source, wheel.spacecraft, wheel.wheel, [SampleBatch(samples)]))
        # `diagnose` counts them, and `reader.joined` puts them in order.
        if late := int(np.count_nonzero(np.diff(samples.time_ns) <= 0)):
            notes.append(f"{late} samples of {wheel.wheel} come after one of the same time or a later one")
    if not telemetry:
        why = [*problems, *notes]
        raise InputError(source, f"{nothing}{f' ({why[0]})' if why else ''}")
    return TelemetryFile(telemetry, problems=problems, notes=notes)


def check_time(time_ns: int) -> None:
    """Raise ValueError where the bus does not take such a time; the message is reported with the unusable ones."""
    if not 0 <= time_ns <= MAX_TIME_NS:
        latest_s = MAX_TIME_NS / NANOSECONDS_PER_SECOND
        raise ValueError(f"a time of {time_ns / NANOSECONDS_PER_SECOND:.3g} s; the bus takes 0 to {latest_s:.0e} s")


def conversion(units: Mapping[str, Size], unit: str | None, quantity: str, source: str, place: str) -> Size:
    """Return the factor from a unit to that used here: by a channel's `UNITS`, or by `TIME_UNITS`.

    Raises
    ------
    InputError
        If the unit is missing, or not one of this quantity.
    """
    found = units.get(_plain(unit)) if unit is not None else None
    if found is None:
        what = "has no unit" if unit is None else f"is in {unit!r}, which is no unit of {quantity}"
        raise InputError(source, f"{what}; known are {', '.join(units)}", place)
    return found


def channel_conversion(channel: str, unit: str | None, source: str, place: str) -> tuple[float, float]:
    """Return factor and offset from a unit to that of a channel's name; raise InputError as `conversion`."""
    factor = conversion(UNITS[channel], unit, channel, source, place)
    return factor, OFFSETS.get(_plain(unit or ""), 0.0)


def _plain(unit: str) -> str:
    """Return a unit without separators between its parts, and with µ and ° spelt in ASCII."""
    return re.sub(r"[\s·*._]", "", unit).replace("µ", "u").replace("μ", "u").replace("°", "deg")
