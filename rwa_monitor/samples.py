"""Samples: one wheel's telemetry as a struct of arrays, in SI units; and the slot grid, to which each sample belongs.

Every package of the program passes telemetry on in this form. Time is int64 nanoseconds of the wheel's own clock, all
other channels are float64 with NaN where a value was not measured. A channel that was not measured at all is None.
"""

from base64 import b64decode, b64encode
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Annotated, Any, Final, Literal, Self, TypeVar, get_args

import numpy as np
from numpy.typing import NDArray
from pydantic import PlainSerializer, PlainValidator
from scipy import constants

from rwa_monitor.errors import InputError

NANOSECONDS_PER_SECOND: Final = int(constants.giga)
SECONDS_PER_HOUR: Final = constants.hour
SECONDS_PER_DAY: Final = constants.day
TINY: Final = 1e-300  # smallest divisor
# How samples are sent: as they are measured, stored first and sent in any order, or replayed from a recording.
Timeliness = Literal["live", "stored", "replay"]


def _encoded(array: NDArray[Any]) -> str:
    return b64encode(array.astype(array.dtype.newbyteorder("<"), copy=False).tobytes()).decode("ascii")


def _decoded(kind: str, value: object) -> NDArray[Any]:
    if isinstance(value, np.ndarray):
        return value
    if not isinstance(value, str):
        raise ValueError("must be text in base64")
    return np.frombuffer(b64decode(value, validate=True), dtype=f"<{kind}").astype(kind)


# In JSON, which stores states whose numbers nobody reads: little-endian bytes in base64.
FloatArray = Annotated[NDArray[np.float64], PlainValidator(partial(_decoded, "f8")), PlainSerializer(_encoded)]
IntArray = Annotated[NDArray[np.int64], PlainValidator(partial(_decoded, "i8")), PlainSerializer(_encoded)]
BoolArray = NDArray[np.bool_]
Time = TypeVar("Time", int, IntArray)  # one, or many [ns]


@dataclass(frozen=True, slots=True)
class Samples:
    """Telemetry of one wheel, a struct of arrays of equal length n.

    Attributes
    ----------
    time_ns
        int64 (n,), time of each sample on the wheel's own clock [ns].
    speed_rad_s
        float64 (n,), spin rate [rad/s].
    friction_torque_Nm
        float64 (n,) or None, friction torque [N m], positive when it opposes positive rotation.
    motor_current_A, motor_torque_Nm, motor_voltage_V, bearing_temperature_degC
        float64 (n,) or None, optional channels [A, N m, V, °C].
    angle_rad
        float64 (n,) or None, measured angle of the wheel [rad], within one turn or counted on; of tables only.
    body_momentum_Nms, bus_voltage_V, drive_power_W
        float64 (n,) or None, of tables only: angular momentum along the spin axis of all but this wheel [N m s], supply
        voltage [V], electrical power into the drive, negative where it feeds back [W].

    Raises
    ------
    InputError
        If the arrays differ in length or are not one-dimensional.
    """

    time_ns: IntArray
    speed_rad_s: FloatArray
    friction_torque_Nm: FloatArray | None = None
    motor_current_A: FloatArray | None = None
    motor_torque_Nm: FloatArray | None = None
    motor_voltage_V: FloatArray | None = None
    bearing_temperature_degC: FloatArray | None = None
    angle_rad: FloatArray | None = None
    body_momentum_Nms: FloatArray | None = None
    bus_voltage_V: FloatArray | None = None
    drive_power_W: FloatArray | None = None

    def __post_init__(self) -> None:
        """Convert every channel to its type and check that all have the same length."""
        for name, given in self.channels():
            values = np.ascontiguousarray(given, dtype=np.int64 if name == "time_ns" else np.float64)
            object.__setattr__(self, name, values)
            if values.shape != (self.time_ns.size,):
                raise InputError("samples", f"has shape {values.shape}, time_ns has {self.time_ns.shape}", name)

    def __len__(self) -> int:
        """Count the samples."""
        return self.time_ns.size

    def __getitem__(self, selection: slice | IntArray | BoolArray) -> Self:
        """Select samples by slice, index array or mask; all channels alike."""
        selected: dict[str, Any] = {name: values[selection] for name, values in self.channels()}
        return replace(self, **selected)

    def channels(self) -> Iterator[tuple[str, NDArray[np.int64] | NDArray[np.float64]]]:
        """Yield (name, array) of every channel that is present, time_ns first."""
        for field in fields(self):
            values = getattr(self, field.name)
            if values is not None:
                yield field.name, values


# The measured channels besides time, in the order in which messages list them, and tables, which may hold more.
ChannelName = Literal[
    "speed_rad_s",
    "friction_torque_Nm",
    "motor_current_A",
    "motor_torque_Nm",
    "motor_voltage_V",
    "bearing_temperature_degC",
]
TableChannelName = Literal[ChannelName, "angle_rad", "body_momentum_Nms", "bus_voltage_V", "drive_power_W"]
CHANNELS: Final[tuple[str, ...]] = get_args(ChannelName)
TABLE_CHANNELS: Final[tuple[str, ...]] = get_args(TableChannelName)


def concatenate(parts: list[Samples]) -> Samples:
    """Join samples in the given order; a channel must be present in all parts or in none.

    Raises
    ------
    InputError
        If there is nothing to join, or a channel is present in some parts only.
    """
    if not parts:
        raise InputError("samples", "nothing to join")
    first, *others = [dict(part.channels()) for part in parts]
    for other in others:
        if only_in_one := first.keys() ^ other.keys():
            raise InputError("samples", "is present in some parts and missing in others", min(only_in_one))
    joined: dict[str, Any] = {
        name: np.concatenate([values, *(one[name] for one in others)]) for name, values in first.items()
    }
    return Samples(**joined)


# ---- the slot grid ---------------------------------------------------------------------------------------------------
# slot = round((t - t0) / sample_period), with t0 the time of a wheel's first sample (of its epoch). A window is
# `samples` consecutive slots; the next one begins `hop` slots later. All in integer arithmetic, so that live and batch
# agree to the last bit.

# Times for which the arithmetic below does not overflow 64 bits: 1954 to 2096, if the clock counts from 1970.
MIN_TIME_NS: Final = -500_000_000_000_000_000
MAX_TIME_NS: Final = 4_000_000_000_000_000_000
MIN_PERIOD_NS: Final = 1_000  # 1 MHz: no wheel's electronics sample faster, so the unit must be wrong


@dataclass(frozen=True, slots=True)
class SlotGrid:
    """A regular grid of slots that begins at `origin_ns`.

    Attributes
    ----------
    origin_ns
        Time of slot 0 [ns], the time of the epoch's first sample.
    period_ns
        Length of a slot [ns].
    """

    origin_ns: int
    period_ns: int

    def slot_of(self, time_ns: Time) -> Time:
        """Return the slot of each time, int64 (n,), or of one; the nearest, the later when exactly between two."""
        return (2 * (time_ns - self.origin_ns) + self.period_ns) // (2 * self.period_ns)

    def time_of(self, slot: int) -> int:
        """Return the time of a slot [ns]."""
        return self.origin_ns + slot * self.period_ns


def period_ns(sample_period_s: float) -> int:
    """Return a sample period in whole nanoseconds."""
    return int(np.rint(sample_period_s * NANOSECONDS_PER_SECOND))
