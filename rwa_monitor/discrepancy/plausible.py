"""Checks of a table of samples before it becomes a record: limits, end stops, units; constants that it determines."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any, Final

import numpy as np

from rwa_monitor.errors import InputError
from rwa_monitor.samples import TINY, BoolArray, FloatArray, IntArray, Samples
from rwa_monitor.wheel.effects.base import Quantity
from rwa_monitor.wheel.effects.catalogue import mean_effects
from rwa_monitor.wheel.effects.tachometer import quantisation_step
from rwa_monitor.wheel.torque_balance import FRICTION_CHANNELS, inertia_of
from rwa_monitor.wheel.wheel import Wheel

# Times nominal friction: mN m read as N m are a factor of a thousand; no bearing reaches a hundred and still turns.
WRONG_UNIT_FACTOR: Final = 100.0
FEWEST_AT_END: Final = 20  # samples: fewer have no influence
FEWEST_SEGMENTS: Final = 20  # segments
UNUSUAL_FACTOR: Final = 5.0  # times nominal friction: a degraded wheel, or another wheel


def check_plausible(samples: Samples, wheel: Wheel, source: str) -> None:
    """Refuse tables in wrong units: values beyond the wheel's limits, or a voltage that contradicts the speed."""
    if len(samples) == 0:
        raise InputError(source, "holds no samples")
    limits = wheel.limits
    for name, limit in (("speed_rad_s", limits.max_speed_rad_s), ("motor_current_A", limits.max_current_A)):
        values = getattr(samples, name)
        if values is None or limit is None or not np.isfinite(values).any():
            continue
        largest = float(np.nanmax(np.abs(values)))
        if largest > limit:
            raise InputError(source, f"reaches {largest:.6g}, the wheel's limit is {limit:.6g}; wrong unit?", name)
    ratio = friction_over_nominal(samples, wheel)
    if ratio is not None and not 1 / WRONG_UNIT_FACTOR < ratio < WRONG_UNIT_FACTOR:
        raise InputError(
            source,
            f"is {ratio:.3g} times the wheel's nominal friction on the median; wrong unit?",
            "friction_torque_Nm",
        )
    resistance, back_emf = wheel.winding_resistance_ohm, wheel.back_emf_constant_V_s_rad
    voltage, current = samples.motor_voltage_V, samples.motor_current_A
    if voltage is not None and current is not None and resistance is not None and back_emf is not None:
        expected = resistance * current + back_emf * (wheel.gear_ratio or 1.0) * samples.speed_rad_s
        both = np.isfinite(expected) & np.isfinite(voltage)
        # Half of the signal: a sensor's error is a few per cent, a wrong unit is a factor.
        if np.linalg.norm((voltage - expected)[both]) > 0.5 * np.linalg.norm(expected[both]) > 0:
            raise InputError(
                source,
                "contradicts R·I + K_E·ω of the wheel file by more than half; is a unit or a constant wrong?",
                "motor_voltage_V",
            )


def friction_over_nominal(samples: Samples, wheel: Wheel) -> float | None:
    """Return the median ratio of measured to nominal friction at the same speed [-]; None where one is not known.

    Samples near rest, at a tenth of the median speed or less, do not count: there friction has no sign.
    """
    if wheel.nominal is None or samples.friction_torque_Nm is None:
        return None
    known = np.isfinite(samples.speed_rad_s) & np.isfinite(samples.friction_torque_Nm)
    speed, friction = np.abs(samples.speed_rad_s[known]), np.abs(samples.friction_torque_Nm[known])
    if not speed.any():
        return None
    moving = speed > 0.1 * np.median(speed)
    nominal = wheel.nominal.dry_torque_Nm + wheel.nominal.viscous_Nm_s_rad * speed
    return float(np.median((friction / nominal)[moving]))


def remarks(samples: Samples, wheel: Wheel) -> list[str]:
    """Return in words what is unusual about a table that is not refused, and how channels at end stops are treated."""
    ratio = friction_over_nominal(samples, wheel)
    words = [
        f"{name} is at its end stop in {np.mean(stopped):.1%} of the samples; "
        + ("left out, with those among them" if np.mean(stopped) <= SATURATED_SHARE else "the channel is not used")
        for name, _, stopped in _saturated(samples)
    ]
    friction = samples.friction_torque_Nm
    if friction is not None and np.nansum(friction * np.sign(samples.speed_rad_s)) < 0.0:
        words.insert(0, "friction drives the rotation on the average; is the sign of speed or torque right?")
    if ratio and UNUSUAL_FACTOR <= max(ratio, 1 / ratio) < WRONG_UNIT_FACTOR:
        median = f"friction is {ratio:.2g} times the wheel's nominal friction on the median"
        return [f"{median}; is it the right wheel file?", *words]
    return words


# ---- channels at the end of their range ------------------------------------------------------------------------------
# A measured value hardly ever repeats to the last digit; at an end stop it does. Channels with few distinct values,
# commanded torques or coarse converters, are left unchanged: there a repeated largest value means nothing.


SATURATED_SHARE: Final = 0.2  # of the values at the ends of their range: more are too many to leave them out
LEAST_SHARE_AT_END: Final = 0.005  # of the known values: extremes that repeat less often are chance
NEIGHBOURS: Final = 33  # samples: two at the end stop are a share of 6 %, where noise is cut at 1.5 standard deviations
DISTINCT_SHARE: Final = 0.5  # of the values between the ends that are distinct: a measurement with noise


def at_end_stop(values: FloatArray, speed: FloatArray | None = None) -> BoolArray:
    """Return which values are the largest or the smallest of all, repeated to the last digit; bool (n,).

    Parameters
    ----------
    values
        float64 (n,), of a channel.
    speed
        float64 (n,) [rad/s]. If given, a channel with no value between its extremes at many speeds is at its end stops
        throughout: friction always depends on the speed. At one speed, friction without noise may well be one value.
    """
    known = np.isfinite(values)
    count = np.count_nonzero(known)
    if count < FEWEST_AT_END:
        return np.zeros(values.size, dtype=bool)
    ends = np.stack([values == end(values[known]) for end in (np.max, np.min)])
    between = values[known & ~ends.any(axis=0)]
    if between.size == 0:
        return known & (speed is not None and np.unique(speed).size > DISTINCT_SHARE * speed.size)
    is_measured = np.unique(between).size >= DISTINCT_SHARE * between.size
    lasting = np.count_nonzero(ends, axis=1) >= max(FEWEST_AT_END, LEAST_SHARE_AT_END * count)
    return np.asarray(np.any(ends[lasting], axis=0) & is_measured)


def without_end_stops(samples: Samples, source: str) -> Samples:
    """Return the samples with NaN for what a channel reads at its end stop; unchanged where none does.

    A channel that is at its end stop in more than `SATURATED_SHARE` of them is left out unless friction needs it.

    Raises
    ------
    InputError
        If friction is at its end stop, or what it is derived from, in more than `SATURATED_SHARE` of the samples.
    """
    for name, values, stopped in _saturated(samples):
        share, kept = float(np.mean(stopped)), None
        if share <= SATURATED_SHARE:
            # Other values with several neighbours at the end stop are off it only by their noise.
            among = np.convolve(stopped, np.ones(NEIGHBOURS), "same") > 1.0
            kept = np.where(stopped | among, np.nan, values)
        elif name == "friction_torque_Nm" or samples.friction_torque_Nm is None:
            words = f"is saturated: {share:.0%} of the values, at many speeds, are its largest or its smallest"
            raise InputError(source, words, name)
        changed: dict[str, Any] = {name: kept}
        samples = replace(samples, **changed)
    return samples


def _saturated(samples: Samples) -> Iterator[tuple[str, FloatArray, BoolArray]]:
    """Yield name, values and the samples at an end stop of each channel that has such."""
    for name in FRICTION_CHANNELS:
        values: FloatArray | None = getattr(samples, name)
        if values is not None:
            stopped = at_end_stop(values, samples.speed_rad_s if name == "friction_torque_Nm" else None)
            if stopped.any():
                yield name, values, stopped


# ---- a motor torque that reads zero ----------------------------------------------------------------------------------
# Drives may report no current below some size. The true torque is then what the motion needs. It is nothing where the
# motor was switched off: there, zero is a measurement.


NEEDED: Final = (0.4, 1.5)  # RMS over the smallest torque that is read; over a zone of even use it is 3^-0.5
GAP_STEPS: Final = 3.0  # steps of the readings, which the smallest exceeds
APART: Final = 3  # slots: central differences that far apart share no reading


def least_reported(torque_Nm: FloatArray, speed_rad_s: FloatArray, wheel: Wheel) -> float | None:
    """Return the smallest motor torque that is reported [N m], where zero readings hide what the motion needs; or None.

    As the wheel file states it, unless the motor is off, whose zero is a measurement; else from torque and speed on
    consecutive slots, float64 (n,).
    """
    if wheel.limits.min_current_A is not None and wheel.torque_per_ampere_Nm_A is not None:
        return None if wheel.friction.motor_off else wheel.limits.min_current_A * wheel.torque_per_ampere_Nm_A
    zero, read = (torque_Nm == 0.0) & (np.abs(speed_rad_s) > 0.0), np.isfinite(torque_Nm) & (torque_Nm != 0.0)
    least = float(np.abs(torque_Nm[read]).min(initial=np.inf))
    step = quantisation_step(torque_Nm[read]) or 0.0
    if np.count_nonzero(zero) < FEWEST_AT_END or not GAP_STEPS * step < least < np.inf:
        return None
    accelerating = inertia_of(wheel) * np.gradient(speed_rad_s, wheel.sample_period_s)
    base, known = np.column_stack([np.sign(speed_rad_s), speed_rad_s]), read & np.isfinite(accelerating)
    law = np.linalg.lstsq(base[known], (torque_Nm - accelerating)[known])[0]
    needed = np.where(zero, base @ law + accelerating, np.nan)
    square = needed[APART:] * needed[:-APART]  # without that of the noise
    square = square[np.isfinite(square)]
    low, high = (share * least for share in NEEDED)
    return least if square.size and low**2 < np.mean(square) < high**2 else None


# ---- the inertia and the viscous friction that the channels imply ----------------------------------------------------
# Over a segment of time the torque's impulse is J·Δω plus the impulse of friction: the regression coefficient of the
# impulses on Δω, given dry and viscous friction, is the inertia that the two channels imply. Impulses over many slots
# depend little on the noise of single slots, and on where between two slots a torque acts. Where friction is given, its
# slope over the speed implies the same, but a bearing may have changed: that raises a question, and is no refusal.


SEGMENTS: Final = 200  # segments of a record
LEAST_SLOTS: Final = 8  # of a segment
SAME_WITHIN: Final = 0.05  # of a ratio of units: 10 for 9.55 is an inertia with its point misplaced, reported as well
STANDARD_ERRORS: Final = 3.0  # 0.3 % of Gaussian estimates lie further off
KNOWN_WITHIN: Final = 0.1  # of a value: if STANDARD_ERRORS standard errors are more, it raises no question
# Implied inertia over that of the wheel file, by what the column of the speed contains.
SPEED_UNITS: Final = (
    (np.pi / 30.0, "in rpm"),
    (30.0 / np.pi, "converted twice from rpm"),
    (np.pi / 180.0, "in degrees per second"),
    (2.0 * np.pi, "in revolutions per second"),
)


@dataclass(frozen=True, slots=True)
class ImpliedValue:
    """A coefficient that the channels imply, and its standard deviation: an inertia [kg m²], or a slope [N m s/rad]."""

    value: float
    std: float

    def is_about(self, expected: float) -> bool:
        """Return whether it agrees with the expected value within its error; False where it is poorly known."""
        within = STANDARD_ERRORS * self.std
        known = within < KNOWN_WITHIN * abs(self.value)
        return known and abs(self.value - expected) < max(SAME_WITHIN * abs(expected), within)


def implied_inertia(speed_rad_s: FloatArray, torque_Nm: FloatArray, sample_period_s: float) -> ImpliedValue | None:
    """Return the inertia that speed and motor torque imply; None where too little of both is known.

    Parameters
    ----------
    speed_rad_s, torque_Nm
        float64 (n,), on the slot grid, NaN where missing [rad/s, N m].
    sample_period_s
        Width of a slot [s].
    """
    cuts = _segments(speed_rad_s.size)

    def impulses(values: FloatArray) -> FloatArray:
        halves = sample_period_s * 0.5 * (values[1:] + values[:-1])
        return np.asarray(np.add.reduceat(halves[: cuts[-1]], cuts[:-1]))

    drag = [impulses(column) for column in (np.sign(speed_rad_s), speed_rad_s)]
    rows = np.column_stack([np.diff(speed_rad_s[cuts]), *drag, np.diff(cuts) * sample_period_s, impulses(torque_Nm)])
    rows = rows[np.isfinite(rows).all(axis=1)]
    return ImpliedValue(*first_slope(rows[:, :-1], rows[:, -1])) if len(rows) >= FEWEST_SEGMENTS else None


def _segments(slots: int) -> IntArray:
    """Return the first slot of each segment, the last of which may be shorter."""
    return np.arange(0, slots, max(slots // SEGMENTS, LEAST_SLOTS))


def check_inertia(
    speed_rad_s: FloatArray, torque_Nm: FloatArray, wheel: Wheel, source: str, torque_channel: str
) -> None:
    """Refuse channels that imply the wheel file's inertia in other units.

    Parameters
    ----------
    speed_rad_s, torque_Nm
        As for `implied_inertia`.
    wheel
        Its inertia and sample period.
    source, torque_channel
        Names for messages: the record, and the channel that the torque came from.

    Raises
    ------
    InputError
        Names the unit in question.
    """
    stated, shown = wheel.inertia_kg_m2, implied_inertia(speed_rad_s, torque_Nm, wheel.sample_period_s)
    if stated is None or shown is None:
        return
    of_torque = (1e3, "in mA" if torque_channel.endswith("_A") else "in mN m"), (-1.0, "of the opposite sign")
    for suspect in (*SPEED_UNITS, *of_torque):
        if shown.is_about(suspect[0] * stated):
            what = (
                f"speed and torque show an inertia of {shown.value:.4g} ± {shown.std:.1g} kg m²,"
                f" {shown.value / stated:.4g} times inertia_kg_m2 of the wheel file; is it {suspect[1]}?"
            )
            raise InputError(source, what, torque_channel if suspect in of_torque else "speed_rad_s")


def ask_speed_unit(viscous: ImpliedValue, nominal_Nm_s_rad: float) -> str | None:
    """Ask about the unit of the speed if friction rises with it as nominal friction would in that unit; else None.

    Parameters
    ----------
    viscous
        Viscous coefficient fitted to the records.
    nominal_Nm_s_rad
        That of the wheel file [N m s/rad].
    """
    for ratio, unit in SPEED_UNITS:
        if viscous.is_about(ratio * nominal_Nm_s_rad):
            return (
                f"friction rises with the speed by {viscous.value:.4g} ± {viscous.std:.1g} N m s/rad,"
                f" {viscous.value / nominal_Nm_s_rad:.4g} times the wheel's nominal viscous friction:"
                f" is speed_rad_s {unit}?"
            )
    return None


def first_slope(design: FloatArray, target: FloatArray) -> tuple[float, float]:
    """Return the least-squares coefficient of the first column of a design, and its standard deviation.

    Parameters
    ----------
    design, target
        float64 (n, p) and (n,), n > p; the noise is taken to be white.
    """
    scale = np.maximum(np.sqrt(np.mean(design**2, axis=0)), TINY)
    inner = design / scale
    inverse = np.linalg.pinv(inner.T @ inner, rcond=1e-12, hermitian=True)
    slopes = inverse @ inner.T @ target
    residual = target - inner @ slopes
    variance = float(residual @ residual) / (target.size - scale.size)
    return float(slopes[0] / scale[0]), float(np.sqrt(variance * inverse[0, 0]) / scale[0])


# ---- torque constant and inertia as other channels determine them ----------------------------------------------------
# In current and speed an error of K_T and one of J have the same column, up to a factor on all friction. The motor's
# voltage and the drive's power determine K_T, the momentum that the body takes up determines J, each by a law of its
# own without friction. The search takes that as a Gaussian prior on the strength of the effect that is such an error:
# a model that contradicts it is penalised.


# Relative errors of the sensors' gains, which no motion reveals: voltage dividers 0.5 %, power meters 1 %, the body's
# inertia 1 % (working assumptions).
GAIN_STD: Final = {"motor_voltage_V": 0.005, "drive_power_W": 0.01, "body_momentum_Nms": 0.01}
FURTHEST: Final = 0.5  # relative, from the wheel file: further off is another unit, or momentum with the wheel's own


@dataclass(frozen=True, slots=True)
class MeasuredConstant:
    """A constant of the wheel file as a channel determines it.

    Attributes
    ----------
    quantity
        Which constant.
    unit, stated
        Of the constant, and its value in the wheel file with its effects.
    channel, measured, std
        The channel that determines it, the value from there, and the standard deviation of that by noise alone.
    """

    quantity: Quantity
    unit: str
    stated: float
    channel: str
    measured: float
    std: float

    @property
    def is_used(self) -> bool:
        """Return whether it is near enough to the wheel file to be that constant."""
        return abs(self.measured / self.stated - 1.0) < FURTHEST

    @property
    def whole_std(self) -> float:
        """Return the standard deviation with the error of the sensor's gain."""
        return float(np.hypot(self.std, GAIN_STD[self.channel] * self.measured))

    @property
    def strength(self) -> tuple[float, float]:
        """Return the strength of the effect that is this error, and its standard deviation."""
        if self.quantity == "inertia":
            return self.measured - self.stated, self.whole_std
        return 1.0 - self.measured / self.stated, self.whole_std / self.stated

    def in_words(self) -> str:
        """Return the constant in words."""
        words = (
            f"{self.channel}: the {self.quantity} is {self.measured:.4g} ± {self.whole_std:.1g} {self.unit}"
            f" ({self.measured / self.stated - 1.0:+.2%} from the wheel file)"
        )
        return words if self.is_used else f"{words}: not used; is it in another unit, or of body and wheel together?"


def measured_constants(samples: Samples, wheel: Wheel) -> tuple[MeasuredConstant, ...]:
    """Return the constants that the channels of a recording determine.

    Parameters
    ----------
    samples
        A recording.
    wheel
        Its constants as stated; what it lacks is not compared.
    """
    found: list[MeasuredConstant] = []
    cuts, speed, current = _segments(len(samples)), samples.speed_rad_s, samples.motor_current_A
    one, ratio = np.ones(len(samples)), wheel.gear_ratio or 1.0

    def means(*columns: FloatArray) -> FloatArray:
        sums = np.add.reduceat(np.stack(columns, axis=1), cuts)
        return np.asarray(sums / np.diff(cuts, append=len(samples))[:, None])

    def add(constant: tuple[Quantity, str, float], channel: str, rows: FloatArray, response: FloatArray) -> None:
        """Add the constant, the coefficient of the first regressor of the response of a channel, if it is known."""
        known = np.isfinite(rows).all(axis=1) & np.isfinite(response)
        if np.count_nonzero(known) >= FEWEST_SEGMENTS:
            found.append(MeasuredConstant(*constant, channel, *first_slope(rows[known], response[known])))

    errors = {effect.error_of: next(iter(effect.values.values())) for effect in mean_effects(wheel)}
    stated = wheel.back_emf_constant_V_s_rad or wheel.torque_constant_Nm_A  # one number in SI units
    voltage, power, momentum = samples.motor_voltage_V, samples.drive_power_W, samples.body_momentum_Nms
    if current is not None and stated is not None:
        of_motor: tuple[Quantity, str, float]
        of_motor = "torque constant", "N m/A", stated * (1.0 - errors.get("torque constant", 0.0))
        if voltage is not None:  # V = R·I + K_E·ω + V_0
            add(of_motor, "motor_voltage_V", means(ratio * speed, current, one), means(voltage)[:, 0])
        if power is not None:  # P = P_0 + R·I² + K_T·I·ω
            add(of_motor, "drive_power_W", means(ratio * current * speed, current**2, one), means(power)[:, 0])
    if momentum is not None and wheel.inertia_kg_m2 is not None:  # Δh = -J·Δω + T·Δt, other torques T drift
        time = (samples.time_ns - samples.time_ns[0])[cuts] * 1e-9
        step = np.diff(time)
        rows = np.stack([np.diff(speed[cuts]), step, step * time[1:]], axis=1)
        stated = wheel.inertia_kg_m2 + errors.get("inertia", 0.0)
        add(("inertia", "kg m²", stated), "body_momentum_Nms", rows, -np.diff(momentum[cuts]))
    return tuple(found)


def combined(per_record: Iterable[tuple[MeasuredConstant, ...]]) -> tuple[MeasuredConstant, ...]:
    """Return the constants that several recordings give, per channel: means by noise; the gain's error is in common."""
    of_channel = defaultdict[str, list[MeasuredConstant]](list)
    for one in chain.from_iterable(per_record):
        if one.is_used:
            of_channel[one.channel].append(one)
    together = []
    for several in of_channel.values():
        least = np.finfo(np.float64).eps  # a simulation may have no noise
        weights = np.array([max(one.std, least * abs(one.measured)) ** -2.0 for one in several])
        shown, std = float(weights @ [one.measured for one in several] / weights.sum()), float(weights.sum() ** -0.5)
        together.append(replace(several[0], measured=shown, std=std))
    return tuple(together)
