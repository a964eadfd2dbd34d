"""Hypotheses of the search without a name in the catalogue: where one wins it is reported as unexplained.

They compete with the catalogue's effects, so that those must do better. A step of the drag at a speed has no physics
here; two have:

Friction heats the bearing, and the lubricant thins: the slope of the drag over the speed then follows the power of the
friction through a thermal lag of some ten minutes. Without a temperature channel that is no effect of the catalogue,
and its slopes, which are others in each stretch of time, pass for jumps of the viscous friction.

A reversal throws grease back into the track; the balls push it aside again within some hundred turns (channelling).
Several effects of the catalogue together pass for that decay: jumps of the viscous friction, an asymmetry, a lubricant
that lags.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import ClassVar, Final

import numpy as np
from scipy.signal import lfilter

from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import Channels, MeanEffect, Memory, Parameter, Shape
from rwa_monitor.wheel.effects.drag_laws import ViscosityTemperature
from rwa_monitor.wheel.effects.torque_ripple import angle_range_turns, angle_turned

FASTEST_S: Final = 60.0  # time constants of a bearing in its housing: minutes (its rings) to hours (the wheel's case)
SLOWEST_S: Final = 7200.0
LONGEST_LAG_SHARE: Final = 0.5  # of the record: a slower one is a drift
PALMGREN: Final = 2.0 / 3.0  # exponent of the speed where ball bearings churn; else 1 (`sublinear_viscous`)
SCALE_RAD_S: Final = 100.0  # unit of the speed, so that all strengths are torques
FEWEST_REVERSALS: Final = 3  # of one or two the decay is a relaxation like any other
SHORTEST_RAD: Final = 60.0  # some ten turns: what decays sooner is a bristle or a film of lubricant
LONGEST_WAY_SHARE: Final = 0.5  # of the median angle from one reversal to the next: what lasts longer is a level
STEPS_BETWEEN: Final = (0.02, 0.98)  # quantiles of the speed


def _shown_lag(channels: Channels) -> tuple[float, float]:
    return FASTEST_S, LONGEST_LAG_SHARE * channels.duration_s


def _shown_angle(channels: Channels) -> tuple[float, float]:
    travelled = angles_between_reversals(channels)
    return SHORTEST_RAD, LONGEST_WAY_SHARE * float(np.median(travelled)) if travelled.size else SHORTEST_RAD


def _shown_speed(channels: Channels) -> tuple[float, float]:
    """With samples on both its sides."""
    low, high = np.quantile(channels.used_speed_rad_s, STEPS_BETWEEN)
    return float(low), float(high)


class UnnamedEffect(MeanEffect):
    """A hypothesis without a page in the catalogue, which no wheel file can hold.

    `name` only sets it apart from others; `signature` is what a report shows.
    """

    title = ""
    formula = ""
    description = ""
    source = ""
    separate_by = ""
    named_with_channel: ClassVar[str] = ""  # the effect of the catalogue that it is, if a channel more were measured

    @classmethod
    def may_show(cls, problem: Problem) -> bool:
        """Return whether these records may show it at all."""
        del problem
        return True

    @classmethod
    def in_words(cls, shape: Shape) -> str:
        """Return what a report shows of it."""
        del shape
        return cls.signature


class HeatOfMotion(UnnamedEffect):
    """A viscous drag that falls with the heat that the motion made, after a first-order thermal lag.

    The power of the friction has a dry part, in proportion to |ω|, and a viscous one, to ω²; each heats. Viscosity is
    exponential in the temperature, to second order here. The record need not begin cold.
    """

    name = "heat_of_the_motion"
    signature = "a viscous drag that follows viscous self-heating"
    separate_by = "The bearing's temperature."
    named_with_channel = ViscosityTemperature.name
    parameters = (
        *(Parameter(f"thinning_{i}_Nm", "N m", -np.inf, 0.0, -1e-4, linear=True) for i in range(4)),
        *(Parameter(f"curvature_{i}_Nm", "N m", 0.0, np.inf, 0.0, linear=True) for i in range(2)),
        Parameter("start_Nm", "N m", -np.inf, np.inf, 0.0, linear=True),
        Parameter("time_constant_s", "s", FASTEST_S, SLOWEST_S, 1000.0, shown=_shown_lag),
    )

    @classmethod
    def may_show(cls, problem: Problem) -> bool:
        """Return whether viscous self-heating may hide: no temperature, speeds that differ, and time to warm up."""
        channels = [record.channels for record in problem.records]
        unknown = all(one.bearing_temperature_degC is None for one in channels)
        lasting = LONGEST_LAG_SHARE * max(one.duration_s for one in channels) > FASTEST_S
        return unknown and not problem.at_one_speed and lasting

    @classmethod
    def in_words(cls, shape: Shape) -> str:
        """Return what it is, with its lag and the channel that would name it."""
        return (
            f"{cls.signature} with a lag of about {shape['time_constant_s']:.2g} s, as {cls.named_with_channel} would:"
            " record the bearing's temperature"
        )

    @classmethod
    def columns(cls, channels: Channels, shape: Shape, memory: Memory = None) -> tuple[FloatArray, Memory]:
        """Return each drag times the heat of each power, times its square, and times what is left of the start's."""
        del memory
        known = np.isfinite(channels.speed_rad_s)
        latest = np.maximum.accumulate(np.where(known, np.arange(len(channels)), 0))
        speed = np.abs(np.nan_to_num(channels.speed_rad_s[latest])) / SCALE_RAD_S
        kept = float(np.exp(-channels.sample_period_s / shape["time_constant_s"]))
        dry, viscous = (lfilter([0.0, 1.0 - kept], [1.0, -kept], power) for power in (speed, speed**2))
        start = kept ** np.arange(len(channels), dtype=np.float64)
        newton, churning = channels.direction * speed, channels.direction * speed**PALMGREN
        thinning = (newton * dry, newton * viscous, churning * dry, churning * viscous)
        return np.stack([*thinning, newton * viscous**2, churning * viscous**2, newton * start], axis=1), None


class DecayAfterReversal(UnnamedEffect):
    """A drag, dry and viscous, that falls exponentially with the angle turned since the speed last changed sign."""

    name = "decay_after_reversal"
    signature = "a drag that decays with the angle turned since each reversal"
    separate_by = "Reversals after rests of different length, each followed by long runs at two speeds."
    parameters = (
        Parameter("strength_dry_Nm", "N m", 0.0, np.inf, 1e-4, linear=True),
        Parameter("strength_viscous_Nm", "N m", 0.0, np.inf, 0.0, linear=True),
        Parameter("angle_rad", "rad", SHORTEST_RAD, 1e6, 5e3, shown=_shown_angle),
    )

    @classmethod
    def may_show(cls, problem: Problem) -> bool:
        """Return whether reversals are many enough, and far enough from each other, to show such a decay."""
        travelled = [angles_between_reversals(record.channels) for record in problem.records]
        far = np.concatenate(travelled) * LONGEST_WAY_SHARE > SHORTEST_RAD
        return int(np.count_nonzero(far)) >= FEWEST_REVERSALS

    @classmethod
    def in_words(cls, shape: Shape) -> str:
        """Return what it is, with the turns that it lasts."""
        return f"{cls.signature}, over about {shape['angle_rad'] / (2.0 * np.pi):.2g} turns, as of grease that channels"

    @classmethod
    def columns(cls, channels: Channels, shape: Shape, memory: Memory = None) -> tuple[FloatArray, Memory]:
        """Return what is left of the drag, along the rotation and in proportion to the speed."""
        del memory
        angle = angle_since_reversal(np.nan_to_num(channels.speed_rad_s), channels.sample_period_s)
        left = np.exp(-angle / shape["angle_rad"])
        return np.stack([channels.direction * left, channels.speed_rad_s / SCALE_RAD_S * left], axis=1), None


def angles_between_reversals(channels: Channels) -> FloatArray:
    """Return the angle turned between each change of sign of the speed and the next [rad]; noise at zero left out."""
    angle = angle_since_reversal(np.nan_to_num(channels.speed_rad_s), channels.sample_period_s)
    known = angle[np.isfinite(angle)]
    ends = known[np.append(np.flatnonzero(np.diff(known) < 0), known.size - 1)] if known.size else known
    return np.asarray(ends[ends > SHORTEST_RAD], dtype=np.float64)


def angle_since_reversal(speed_rad_s: FloatArray, period_s: float) -> FloatArray:
    """Return the angle turned since the speed last changed sign [rad], infinite before the first change, (n,)."""
    steps, moving = np.abs(speed_rad_s) * period_s, np.flatnonzero(speed_rad_s)
    reversals = moving[1:][np.diff(np.sign(speed_rad_s[moving])) != 0.0].tolist()
    angle = np.full(speed_rad_s.size, np.inf)
    for begin, end in pairwise([*reversals, speed_rad_s.size]):
        np.cumsum(steps[begin:end], out=angle[begin:end])
    return angle


class StepInSpeed(UnnamedEffect):
    """A drag that is another above a certain speed."""

    name = "step_in_speed"
    threshold = "speed_rad_s"
    signature = "a drag that depends on |speed|"
    parameters = (
        Parameter("height_Nm", "N m", -np.inf, np.inf, 0.0, linear=True),
        Parameter("speed_rad_s", "rad/s", 0.0, np.inf, 1.0, shown=_shown_speed),
    )

    @classmethod
    def columns(cls, channels: Channels, shape: Shape, memory: Memory = None) -> tuple[FloatArray, Memory]:
        """Return s above the speed of the step, zero below."""
        del memory
        return (channels.direction * (np.abs(channels.speed_rad_s) > shape["speed_rad_s"]))[:, None], None


UNNAMED: Final[tuple[type[UnnamedEffect], ...]] = (HeatOfMotion, DecayAfterReversal, StepInSpeed)


# ---- free curves: candidates of the search with no physics in them, beside the formulas of the catalogue -------------
# Piecewise linear over a quantity, periodic in time, a step at a speed. What such a one still gains is not explained.


KNOTS: Final = 14  # of a free curve: a feature as wide as a tenth of the range is not missed
KNOTS_OF_TIME: Final = 7  # of the curve over time: jumps are dearer than knots, many of one sign are a drift

Quantity = Callable[[Channels], FloatArray | None]


class FreeCurve(UnnamedEffect):
    """A piecewise linear curve over the ranks of a quantity."""

    quantity: ClassVar[Quantity]  # that the curve is a function of, None where it is not known
    flips: ClassVar[bool]

    @classmethod
    def columns(cls, channels: Channels, shape: Shape, memory: Memory = None) -> tuple[FloatArray, Memory]:
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


def _curve(name: str, signature: str, quantity: Quantity, *, flips: bool, knots: int = KNOTS) -> type[FreeCurve]:
    """Return a free curve over a quantity; `flips`: with the direction of rotation, as friction does."""
    heights = [Parameter(f"height_{i}_Nm", "N m", -np.inf, np.inf, 0.0, linear=True) for i in range(knots)]
    fields = {"name": name, "signature": signature, "quantity": staticmethod(quantity), "flips": flips}
    return type(name, (FreeCurve,), {**fields, "parameters": tuple(heights)})


def _angle(channels: Channels) -> FloatArray:
    """Return the angle [rad]: as it is where it is less than a turn, else within a turn."""
    angle, _ = angle_turned(channels)
    return angle if angle_range_turns(channels) < 1.0 else np.mod(angle, 2.0 * np.pi)


def _acceleration(channels: Channels) -> FloatArray | None:
    """Return dω/dt [rad/s²]; None while the motor is off, where friction is -J dω/dt itself."""
    torque = channels.motor_torque_Nm
    return channels.acceleration_rad_s2 if torque is None or np.nan_to_num(torque).any() else None


CURVES: Final = (
    _curve("curve_speed", "a drag that depends on |speed|", lambda c: np.abs(c.speed_rad_s), flips=True),
    _curve(
        "curve_speed_even",
        "a torque that depends on |speed| and does not flip with the direction",
        lambda c: np.abs(c.speed_rad_s),
        flips=False,
    ),
    _curve("curve_acceleration", "a torque that depends on dω/dt", _acceleration, flips=False),
    _curve(
        "curve_acceleration_size",
        "a drag that depends on the size of dω/dt",
        lambda c: None if (rate := _acceleration(c)) is None else np.abs(rate),
        flips=True,
    ),
    _curve("curve_time", "a drag that drifts with time", lambda c: c.time_s, flips=True, knots=KNOTS_OF_TIME),
    _curve("curve_temperature", "a drag that depends on temperature", lambda c: c.bearing_temperature_degC, flips=True),
    _curve("curve_bus_voltage", "a torque that depends on the bus voltage", lambda c: c.bus_voltage_V, flips=False),
    _curve("curve_angle", "a torque that depends on the angle", _angle, flips=False),
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
    def columns(cls, channels: Channels, shape: Shape, memory: Memory = None) -> tuple[FloatArray, Memory]:
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
