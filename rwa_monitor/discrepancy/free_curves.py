"""Free curves: candidates of the search with no physics in them, as rivals of the catalogue's formulas.

Piecewise linear over a quantity, periodic in time, a step at a speed. What such a one still gains is not explained.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import ClassVar, Final

import numpy as np

from rwa_monitor.discrepancy.unnamed import UnnamedEffect
from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import Channels, Memory, Parameter
from rwa_monitor.wheel.effects.torque_ripple import angle_range_turns, angle_turned

KNOTS: Final = 14  # of a free curve: a feature as wide as a tenth of the range is not missed
TURN_RAD: Final = 2.0 * np.pi
KNOTS_OF_TIME: Final = 7  # of the curve over time: what is faster is for jumps


def _heights(knots: int) -> tuple[Parameter, ...]:
    return tuple(Parameter(f"height_{i}_Nm", "N m", -np.inf, np.inf, 0.0, linear=True) for i in range(knots))


class FreeCurve(UnnamedEffect):
    """A piecewise linear curve over the ranks of a quantity."""

    signature: ClassVar[str]
    parameters = _heights(KNOTS)
    flips: ClassVar[bool]  # with the direction of rotation, as friction does

    @classmethod
    @abstractmethod
    def quantity(cls, channels: Channels) -> FloatArray | None:
        """Return the quantity that the curve is a function of, None where it is not known."""

    @classmethod
    def columns(
        cls, channels: Channels, shape: Mapping[str, float], memory: Memory = None
    ) -> tuple[FloatArray, Memory]:
        """Return the hats of the piecewise linear curve, one for each knot."""
        del shape, memory
        quantity = cls.quantity(channels)
        assert quantity is not None
        known = quantity[channels.good & np.isfinite(quantity)]
        count = len(cls.parameters)
        knots = np.unique(np.quantile(known, np.linspace(0, 1, count)))
        columns = np.zeros((quantity.size, count))
        for i in range(knots.size):
            columns[:, i] = np.interp(quantity, knots, np.eye(knots.size)[i])
        return columns * (channels.direction[:, None] if cls.flips else 1.0), None


class OverSpeed(FreeCurve):
    """A drag over |ω|."""

    name = "curve_speed"
    signature = "a drag that depends on |speed|"
    flips = True

    @classmethod
    def quantity(cls, channels: Channels) -> FloatArray:
        """Return |ω| [rad/s]."""
        return np.abs(channels.speed_rad_s)


class OverSpeedEven(OverSpeed):
    """A torque over |ω|, the same way in both directions."""

    name = "curve_speed_even"
    signature = "a torque that depends on |speed| and does not flip with the direction"
    flips = False


class OverAcceleration(FreeCurve):
    """A torque over dω/dt."""

    name = "curve_acceleration"
    signature = "a torque that depends on dω/dt"
    flips = False

    @classmethod
    def quantity(cls, channels: Channels) -> FloatArray:
        """Return dω/dt [rad/s²]."""
        return channels.acceleration_rad_s2


class OverAccelerationSize(FreeCurve):
    """A drag over |dω/dt|."""

    name = "curve_acceleration_size"
    signature = "a drag that depends on the size of dω/dt"
    flips = True

    @classmethod
    def quantity(cls, channels: Channels) -> FloatArray:
        """Return |dω/dt| [rad/s²]."""
        return np.abs(channels.acceleration_rad_s2)


class OverTime(FreeCurve):
    """A drag over time."""

    name = "curve_time"
    signature = "a drag that drifts with time"
    flips = True
    # Jumps are dearer than knots: what many steps of one sign follow is a drift.
    parameters = _heights(KNOTS_OF_TIME)

    @classmethod
    def quantity(cls, channels: Channels) -> FloatArray:
        """Return the time [s]."""
        return channels.time_s


class OverTemperature(FreeCurve):
    """A drag over the temperature of the bearing."""

    name = "curve_temperature"
    signature = "a drag that depends on temperature"
    flips = True

    @classmethod
    def quantity(cls, channels: Channels) -> FloatArray | None:
        """Return the bearing's temperature [°C]; None where it is not measured."""
        return channels.bearing_temperature_degC


class OverAngle(FreeCurve):
    """A torque over the angle: a load, as of a joint or a gimbal."""

    name = "curve_angle"
    signature = "a torque that depends on the angle"
    flips = False

    @classmethod
    def quantity(cls, channels: Channels) -> FloatArray:
        """Return the angle [rad]: as it is where it is less than a turn, else within a turn."""
        angle, _ = angle_turned(channels)
        return angle if angle_range_turns(channels) < 1.0 else np.mod(angle, TURN_RAD)


CURVES: Final = (
    OverSpeed,
    OverSpeedEven,
    OverAcceleration,
    OverAccelerationSize,
    OverTime,
    OverTemperature,
    OverAngle,
)


def _waves(harmonics: int) -> tuple[Parameter, ...]:
    """Return the strengths of cosines and sines, and their frequency.

    It is read off the periodogram, not profiled: a discrete parameter stays where it is when a fit is refined.
    """
    names = [f"{wave}_{k}_Nm" for k in range(1, harmonics + 1) for wave in ("cosine", "sine")]
    strengths = (Parameter(name, "N m", -np.inf, np.inf, 0.0, linear=True) for name in names)
    return *strengths, Parameter("frequency_Hz", "Hz", 0.0, np.inf, 0.01, choices=(0.01,))


class Periodic(UnnamedEffect):
    """A sine of time."""

    name = "periodic"
    signature = "a torque that is periodic in time"
    harmonics: ClassVar[int] = 1
    parameters = _waves(harmonics)
    flips: ClassVar[bool] = False

    @classmethod
    def columns(
        cls, channels: Channels, shape: Mapping[str, float], memory: Memory = None
    ) -> tuple[FloatArray, Memory]:
        """Return cosine and sine of each harmonic."""
        del memory
        phase = 2 * np.pi * shape["frequency_Hz"] * channels.time_s
        waves = [wave(k * phase) for k in range(1, cls.harmonics + 1) for wave in (np.cos, np.sin)]
        return np.stack(waves, axis=1) * (channels.direction[:, None] if cls.flips else 1.0), None


class PeriodicDrag(Periodic):
    """A sine of time that follows the direction of rotation."""

    name = "periodic_drag"
    signature = "a drag that is periodic in time"
    flips: ClassVar[bool] = True


class PeriodicRub(PeriodicDrag):
    """A drag that repeats and lasts a short part of its period."""

    name = "periodic_rub"
    harmonics: ClassVar[int] = 20  # a rub that lasts a twentieth of its period has so many alike
    parameters = _waves(harmonics)
