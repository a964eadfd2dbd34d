"""Telemetry of a wheel on the bus, as it is read and as it is written."""

from __future__ import annotations

from itertools import islice
from typing import Annotated, Any, ClassVar, Final, Self

import numpy as np
from pydantic import Field, model_validator
from pydantic_core import from_json

from rwa_monitor.errors import closest
from rwa_monitor.messages.base import MAX_MESSAGE_BYTES, MAX_SAMPLES, Count, Message, TimeNs, dump_json
from rwa_monitor.samples import CHANNELS, FloatArray, Samples

MAX_KEYS_TRIED: Final = 20  # of those that are not known, for what they may have meant

# NaN and Infinity are no JSON, but some writers use them: they are read, and masked, like null.
Readings = Annotated[list[float | None], Field(max_length=MAX_SAMPLES)]


class SamplesMessage(Message):
    """Telemetry of a wheel: arrays of one length, null where a value was not measured.

    `publisher` is a random name per start of a publisher and `batch` counts its messages, so that a gap shows; any
    publisher that writes the arrays is served without them.
    """

    kind: ClassVar[str] = "samples"

    publisher: Annotated[str, Field(max_length=64)] = ""
    batch: Count | None = None
    time_ns: Annotated[list[TimeNs], Field(min_length=1, max_length=MAX_SAMPLES)]
    speed_rad_s: Readings
    friction_torque_Nm: Readings | None = None
    motor_current_A: Readings | None = None
    motor_torque_Nm: Readings | None = None
    motor_voltage_V: Readings | None = None
    bearing_temperature_degC: Readings | None = None

    @classmethod
    def schema_name(cls) -> str:
        return "rwa.Samples"

    @model_validator(mode="after")
    def _equal_lengths(self) -> Self:
        for name in CHANNELS:
            values = getattr(self, name)
            if values is not None and len(values) != len(self.time_ns):
                raise ValueError(f"{name} has {len(values)} values, time_ns has {len(self.time_ns)}")
        return self

    def samples(self) -> Samples:
        """Return the samples as arrays, NaN where a value was not measured."""
        channels = {
            name: np.array(values, dtype=np.float64)  # None becomes NaN
            for name in CHANNELS
            if (values := getattr(self, name)) is not None
        }
        return Samples(time_ns=np.array(self.time_ns, dtype=np.int64), **channels)


def is_json(payload: bytes) -> bool:
    """Return whether a message is JSON of any kind; one that is not was cut off or damaged, or never was."""
    try:
        from_json(payload[:MAX_MESSAGE_BYTES])
    except ValueError:
        return False
    return True


def misspelt(payload: bytes) -> str:
    """Return "friction_torque_nm: did you mean friction_torque_Nm?" of a message that cannot be used, or "".

    Parameters
    ----------
    payload
        As it came. A key that is not known is no fault by itself; where something is missing, it may be what was meant.
    """
    try:
        content = from_json(payload[:MAX_MESSAGE_BYTES])
    except ValueError:
        return ""
    if not isinstance(content, dict):
        return ""
    missing = [name for name in SamplesMessage.model_fields if name not in content]
    for key in islice((key for key in content if key not in SamplesMessage.model_fields), MAX_KEYS_TRIED):
        meant = closest(key, missing)
        if meant is not None:
            return f"{key}: did you mean {meant}?"
    return ""


def samples_json(samples: Samples, publisher: str, batch: int) -> bytes:
    """Write samples as the JSON of a `SamplesMessage`, null where a value is not finite."""
    content: dict[str, Any] = {"publisher": publisher, "batch": batch, "time_ns": samples.time_ns.tolist()}
    for name in CHANNELS:
        values: FloatArray | None = getattr(samples, name)
        if values is not None:
            finite = np.isfinite(values)
            readings: list[float | None] = values.tolist()
            if not finite.all():
                for i in np.flatnonzero(~finite):
                    readings[i] = None
            content[name] = readings
    return dump_json(content)
