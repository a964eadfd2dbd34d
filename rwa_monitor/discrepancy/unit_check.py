"""Whether speed and torque show the wheel file's inertia and viscous friction: in another unit they show another.

Over a stretch of time the torque's impulse is J·Δω and what friction took: the slope of the impulses over Δω, beside
those of dry and viscous friction, is the inertia that the two channels show. Impulses of many slots know little of the
noise of single ones, and of where between two of them a torque acts. Where friction is given its slope over the speed
tells the same, but a bearing may have changed: a question, and no refusal.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from rwa_monitor.errors import InputError
from rwa_monitor.samples import FloatArray

FEWEST_STRETCHES: Final = 20
STRETCHES: Final = 200  # of a record
LEAST_SLOTS: Final = 8  # of a stretch
SAME_WITHIN: Final = (
    0.05  # of a ratio of units: ten for 9.55 is an inertia with its point misplaced, asked about as well
)
STANDARD_ERRORS: Final = 3.0
KNOWN_WITHIN: Final = 0.1  # of what is shown, STANDARD_ERRORS of it: what is known less well asks nothing
RPM: Final = 30.0 / np.pi  # revolutions a minute in one rad/s
DEGREES: Final = 180.0 / np.pi  # in a radian
# Inertia shown over that of the wheel file, by what the column of the speed holds.
SPEED_UNITS: Final = (
    (1.0 / RPM, "in rpm"),
    (RPM, "converted twice from rpm"),
    (1.0 / DEGREES, "in degrees per second"),
    (2.0 * np.pi, "in revolutions per second"),
)
MILLI: Final = 1e3


@dataclass(frozen=True, slots=True)
class Shown:
    """A coefficient that the channels show, and its standard deviation: an inertia [kg m²], or a slope [N m s/rad]."""

    value: float
    std: float

    def is_about(self, expected: float) -> bool:
        """Say whether it is what is expected, within its error; no, where it is hardly known."""
        within = STANDARD_ERRORS * self.std
        known = within < KNOWN_WITHIN * abs(self.value)
        return known and abs(self.value - expected) < max(SAME_WITHIN * expected, within)


def shown_inertia(speed_rad_s: FloatArray, torque_Nm: FloatArray, sample_period_s: float) -> Shown | None:
    """Return the inertia that speed and motor torque show; None where too little of both is known.

    Parameters
    ----------
    speed_rad_s, torque_Nm
        float64 (n,), on the slot grid, NaN where missing [rad/s, N m].
    sample_period_s
        Width of a slot [s].
    """
    width = max(speed_rad_s.size // STRETCHES, LEAST_SLOTS)
    cuts = np.arange(0, speed_rad_s.size, width)

    def impulses(values: FloatArray) -> FloatArray:
        halves = sample_period_s * 0.5 * (values[1:] + values[:-1])
        sums = np.concatenate([[0.0], np.cumsum(np.nan_to_num(halves))])
        missing = np.concatenate([[0], np.cumsum(np.isnan(halves))])
        return np.where(np.diff(missing[cuts]) > 0, np.nan, np.diff(sums[cuts]))

    duration = np.full(cuts.size - 1, width * sample_period_s)
    design = np.column_stack([np.diff(speed_rad_s[cuts]), impulses(np.sign(speed_rad_s)), impulses(speed_rad_s)])
    design = np.column_stack([design, duration])
    target = impulses(torque_Nm)
    known = np.isfinite(target) & np.isfinite(design).all(axis=1)
    if np.count_nonzero(known) < FEWEST_STRETCHES:
        return None
    design, target = design[known], target[known]
    value, std = first_slope(design, target)
    return Shown(value, std)


def check_inertia(shown: Shown, inertia_kg_m2: float, source: str, torque_channel: str) -> None:
    """Refuse channels that show the wheel file's inertia in other units.

    Parameters
    ----------
    shown
        What speed and torque show.
    inertia_kg_m2
        Of the wheel file.
    source, torque_channel
        Names for messages: the record, and the channel that the torque came from.

    Raises
    ------
    InputError
        Asks about the unit by name.
    """
    units = [("speed_rad_s", unit, ratio) for ratio, unit in SPEED_UNITS]
    units.append((torque_channel, "in mA" if torque_channel.endswith("_A") else "in mN m", MILLI))
    for channel, unit, ratio in units:
        if shown.is_about(ratio * inertia_kg_m2):
            raise InputError(source, f"{in_words(shown, inertia_kg_m2)}; is it {unit}?", channel)


def in_words(shown: Shown, inertia_kg_m2: float) -> str:
    """Return what speed and torque show beside the wheel file's inertia [kg m²]."""
    return (
        f"speed and torque show an inertia of {shown.value:.4g} ± {shown.std:.1g} kg m²,"
        f" {shown.value / inertia_kg_m2:.4g} times inertia_kg_m2 of the wheel file"
    )


def slope_in_question(viscous: Shown, nominal_Nm_s_rad: float) -> str | None:
    """Ask about the unit of the speed where friction rises with it as nominal friction would in that unit; else None.

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
    scale = np.maximum(np.sqrt(np.mean(design**2, axis=0)), np.finfo(np.float64).tiny)
    inner = design / scale
    inverse = np.linalg.pinv(inner.T @ inner, rcond=1e-12, hermitian=True)
    slopes = inverse @ inner.T @ target
    left = target - inner @ slopes
    variance = float(left @ left) / (target.size - scale.size)
    return float(slopes[0] / scale[0]), float(np.sqrt(variance * inverse[0, 0]) / scale[0])
