"""A scenario: what happens to a simulated wheel. Read from TOML like the wheel; the wheel file is of the wheel itself.

```toml
[scenario]
duration_s = 10000.0
friction_given = true            # false: only speed and current, friction is left to be derived

[speed]
kind = "orbit"                   # one_direction, crossings, rich, constant, from_rest

[anomalies.fss_2]
factor = 1.4
onset_s = 3000.0                 # nominal before
growth_s = 2000.0                # from 1 to the factor over this time; 0: at once

[[effect]]                       # beyond those of the wheel: what the wheel's model does not know
name = "stribeck"
parameters = { strength_Nm = 5.0e-4, stribeck_speed_rad_s = 8.0 }

[[fault]]
kind = "gap"
start_s = 1000.0
duration_s = 12.0
```
"""

from __future__ import annotations

from typing import Annotated, ClassVar, Final

import numpy as np
from pydantic import Field, field_validator

from rwa_monitor.errors import InputError
from rwa_monitor.samples import CHANNELS, FloatArray
from rwa_monitor.simulation.motion import SpeedProfile
from rwa_monitor.simulation.sensors import Fault, FrictionNoise, Sensors
from rwa_monitor.wheel.file_content import Strict, TomlFile
from rwa_monitor.wheel.torque_balance import inertia_of, torque_constant_of
from rwa_monitor.wheel.wheel import EffectBlock, Wheel

MAX_SLOTS: Final = 100_000_000  # of one simulated record: 10 GB of channels and truth; more is a wrong unit

NoNegative = Annotated[float, Field(ge=0)]


class Anomaly(Strict):
    """A component of the friction grows by a factor.

    Attributes
    ----------
    factor
        On base dry friction, viscous coefficient or the friction of a switching system, by the anomaly's name.
    onset_s
        Nominal before this time from the beginning of the record [s].
    growth_s
        The factor grows linearly from 1 to its value over this time after the onset [s].
    """

    factor: Annotated[float, Field(ge=0, le=100)]
    onset_s: NoNegative = 0.0
    growth_s: NoNegative = 0.0

    def factor_at(self, time_s: FloatArray) -> FloatArray:
        """Return the factor at times from the beginning of the record [s], float64 (n,)."""
        return 1.0 + (self.factor - 1.0) * self.share_at(time_s)

    def share_at(self, time_s: FloatArray) -> FloatArray:
        """Return how far the anomaly has grown at those times, 0 … 1, float64 (n,)."""
        if self.growth_s == 0.0:
            return np.where(time_s >= self.onset_s, 1.0, 0.0)
        return np.clip((time_s - self.onset_s) / self.growth_s, 0.0, 1.0)


class Base(Strict):
    """Where this wheel's healthy friction lies beside its wheel file's historical averages, as factors on them."""

    dry: Annotated[float, Field(gt=0)] = 1.0
    viscous: NoNegative = 1.0


class Scenario(TomlFile):
    """What happens to a simulated wheel; see the module's example.

    Attributes
    ----------
    duration_s
        Length of the record [s].
    start_ns
        Time of the first sample [ns].
    friction_given
        True: the record has `friction_torque_Nm`, the true friction plus noise, and a current that agrees with it.
        False: only speed and current; what friction there is must be derived from them.
    channels
        Channels of the record, by the names of the sample table; None: all that the wheel's constants allow, without
        motor torque, which repeats the current.
    speed, base, anomalies, noise, sensors, effect, fault
        See their classes. `effect` comes on top of the wheel's own effects.
    """

    head: ClassVar[str] = "scenario"
    tables: ClassVar[tuple[str, ...]] = ("speed", "base", "anomalies", "noise", "sensors", "effect", "fault")
    what: ClassVar[str] = "scenario"

    duration_s: Annotated[float, Field(gt=0)] = 10_000.0
    start_ns: Annotated[int, Field(ge=0, lt=2**62)] = 0
    friction_given: bool = True
    channels: tuple[str, ...] | None = None

    speed: SpeedProfile = SpeedProfile()
    base: Base = Base()
    anomalies: dict[str, Anomaly] = Field(default_factory=dict)
    noise: FrictionNoise = FrictionNoise()
    sensors: Sensors = Sensors()
    effect: Annotated[tuple[EffectBlock, ...], Field(max_length=32)] = ()
    fault: Annotated[tuple[Fault, ...], Field(max_length=1000)] = ()

    @field_validator("channels")
    @classmethod
    def _known_channels(cls, channels: tuple[str, ...] | None) -> tuple[str, ...] | None:
        for name in channels or ():
            if name not in CHANNELS:
                raise ValueError(f"{name!r} is none of {', '.join(CHANNELS)}")
        return channels

    def slots(self, wheel: Wheel) -> int:
        """Return the length of the record [slots].

        Raises
        ------
        InputError
            If the record has fewer than 2 or more than 100,000,000 slots.
        """
        count = round(self.duration_s / wheel.sample_period_s)
        if not 2 <= count <= MAX_SLOTS:
            raise InputError(
                "scenario", f"is {count} slots of the wheel; 2 to {MAX_SLOTS} can be simulated", "duration_s"
            )
        return count

    def check(self, wheel: Wheel) -> None:
        """Raise InputError, naming the key, where this scenario asks for what the wheel does not have."""
        for name in self.anomalies:
            if name not in wheel.anomalies:
                raise InputError("scenario", f"this wheel has {', '.join(wheel.anomalies)}", f"anomalies.{name}")
        if wheel.nominal is None:
            raise InputError(f"wheel {wheel.name}", "is missing; friction cannot be simulated without it", "nominal")
        if not self.friction_given:
            inertia_of(wheel)
            torque_constant_of(wheel)
        for fault in self.fault:
            if fault.kind != "gap" and fault.channel not in CHANNELS:
                raise InputError("scenario", f"{fault.channel!r} is none of {', '.join(CHANNELS)}", "fault.channel")
