"""Torque constant and inertia as channels show them in which there is no friction.

In current and speed an error of K_T and one of J are one column, up to a factor on all friction. The motor's voltage
and the drive's power show K_T, the momentum that the body takes up shows J, each by a law of its own. To the search
that is a Gaussian statement on the strength of the effect that is such an error: a model pays for what it contradicts.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from rwa_monitor.discrepancy.plausible import FEWEST_STRETCHES, LEAST_SLOTS, STRETCHES, first_slope
from rwa_monitor.samples import FloatArray, Samples
from rwa_monitor.wheel.effects.base import Quantity
from rwa_monitor.wheel.effects.catalogue import mean_effects
from rwa_monitor.wheel.wheel import Wheel

# Relative errors of the sensors' gains, which no motion shows: voltage dividers 0.5 %, power meters 1 %, the body's
# inertia 1 % (working assumptions).
GAIN_STD: Final = {"motor_voltage_V": 0.005, "drive_power_W": 0.01, "body_momentum_Nms": 0.01}
FURTHEST: Final = 0.5  # from the wheel file, as a part: further off is another unit, or momentum with the wheel's own


@dataclass(frozen=True, slots=True)
class ShownConstant:
    """How far a constant of the wheel file is off, as a channel shows it.

    Attributes
    ----------
    quantity
        Which constant.
    unit, stated
        Of the constant, and what it is in the wheel file with its effects.
    channel, shown, std
        The channel that shows it, what it is there, and the standard deviation of that by noise alone.
    """

    quantity: Quantity
    unit: str
    stated: float
    channel: str
    shown: float
    std: float

    @property
    def is_used(self) -> bool:
        """Return whether it is near enough to the wheel file to be that constant."""
        return abs(self.shown / self.stated - 1.0) < FURTHEST

    @property
    def whole_std(self) -> float:
        """Return the standard deviation with the error of the sensor's gain."""
        return float(np.hypot(self.std, GAIN_STD[self.channel] * self.shown))

    @property
    def strength(self) -> tuple[float, float]:
        """Return the strength of the effect that it measures, and its standard deviation."""
        if self.quantity == "inertia":
            return self.shown - self.stated, self.whole_std
        return 1.0 - self.shown / self.stated, self.whole_std / self.stated

    def in_words(self) -> str:
        """Return it in words."""
        words = (
            f"{self.channel} shows a {self.quantity} of {self.shown:.4g} ± {self.whole_std:.1g} {self.unit},"
            f" {self.shown / self.stated:.4g} times that of the wheel file"
        )
        return words if self.is_used else f"{words}: not used; is it in another unit, or of body and wheel together?"


def shown_constants(samples: Samples, wheel: Wheel) -> tuple[ShownConstant, ...]:
    """Return the constants that the channels of a recording show.

    Parameters
    ----------
    samples
        A recording.
    wheel
        Its constants as stated; what it lacks is not compared.
    """
    found = []
    for quantity, unit, stated, channel, rows, target in _laws(samples, wheel):
        known = np.isfinite(rows).all(axis=1) & np.isfinite(target)
        if np.count_nonzero(known) >= FEWEST_STRETCHES:
            shown, std = first_slope(rows[known], target[known])
            found.append(ShownConstant(quantity, unit, stated, channel, shown, std))
    return tuple(found)


def combined(per_record: Iterable[tuple[ShownConstant, ...]]) -> tuple[ShownConstant, ...]:
    """Return what several recordings show by each channel: means by their noise; the gain's error is common to all."""
    of_channel: dict[str, list[ShownConstant]] = {}
    for constants in per_record:
        for one in constants:
            if one.is_used:
                of_channel.setdefault(one.channel, []).append(one)
    together = []
    for several in of_channel.values():
        least = np.finfo(np.float64).eps  # a simulation may have no noise
        weights = np.array([max(one.std, least * abs(one.shown)) ** -2.0 for one in several])
        shown, std = float(weights @ [one.shown for one in several] / weights.sum()), float(weights.sum() ** -0.5)
        together.append(replace(several[0], shown=shown, std=std))
    return tuple(together)


Law = tuple[Quantity, str, float, str, FloatArray, FloatArray]


def _laws(samples: Samples, wheel: Wheel) -> Iterator[Law]:
    """Yield quantity, unit, stated constant, channel, rows with the constant's column first, and what they explain."""
    width = max(len(samples) // STRETCHES, LEAST_SLOTS)
    cuts = np.arange(0, len(samples), width)
    if cuts.size < FEWEST_STRETCHES:
        return
    speed, current, ratio = samples.speed_rad_s, samples.motor_current_A, wheel.gear_ratio or 1.0

    def means(*columns: FloatArray) -> FloatArray:
        sums = np.stack([np.add.reduceat(column, cuts) for column in columns], axis=1)
        return np.asarray(sums / np.diff(cuts, append=len(samples))[:, None])

    one, voltage, power = np.ones(len(samples)), samples.motor_voltage_V, samples.drive_power_W
    known = {effect.error_of: next(iter(effect.values.values())) for effect in mean_effects(wheel)}
    constant = wheel.back_emf_constant_V_s_rad or wheel.torque_constant_Nm_A  # one number in SI units
    if current is not None and constant is not None:
        stated = constant * (1.0 - known.get("torque constant", 0.0))
        of_motor: tuple[Quantity, str, float] = "torque constant", "N m/A", stated
        if voltage is not None:  # V = R·I + K_E·ω + V_0
            yield *of_motor, "motor_voltage_V", means(ratio * speed, current, one), means(voltage)[:, 0]
        if power is not None:  # P = P_0 + R·I² + K_T·I·ω
            yield *of_motor, "drive_power_W", means(ratio * current * speed, current**2, one), means(power)[:, 0]
    momentum = samples.body_momentum_Nms
    if momentum is not None and wheel.inertia_kg_m2 is not None:  # Δh = -J·Δω + T·Δt, the torque T of all else drifts
        time = (samples.time_ns - samples.time_ns[0])[cuts] * 1e-9
        step = np.diff(time)
        rows = np.stack([np.diff(speed[cuts]), step, step * time[1:]], axis=1)
        stated = wheel.inertia_kg_m2 + known.get("inertia", 0.0)
        yield "inertia", "kg m²", stated, "body_momentum_Nms", rows, -np.diff(momentum[cuts])
