"""Steps in which the torque that friction comes from was read: the lattice of an analogue-to-digital converter."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from rwa_monitor.samples import FloatArray, Samples
from rwa_monitor.wheel.effects.tachometer_quantisation import quantisation_step
from rwa_monitor.wheel.torque_balance import FRICTION_CHANNELS
from rwa_monitor.wheel.wheel import Wheel

FEWEST_LEVELS: Final = 3  # readings, all different, of which a step can be estimated
MOST_LEVELS: Final = 0.5  # of the samples: where so many readings differ, steps are finer than the noise
RMS_OF_ROUNDING: Final = 12**-0.5  # of a step: the error is uniform over it (Widrow & Kollár, Quantization Noise, 2008)


@dataclass(frozen=True, slots=True)
class Steps:
    """Steps of a channel: its name in words, the step in its own unit, and what that is of torque [N m]."""

    channel: str
    size: float
    unit: str
    torque_Nm: float


def source_of_friction(samples: Samples) -> FloatArray:
    """Return the channel that friction comes from, float64 (n,); NaN where none is there."""
    channels = (getattr(samples, name) for name in FRICTION_CHANNELS)
    return next((values for values in channels if values is not None), np.full(len(samples), np.nan))


def steps_of(samples: Samples, wheel: Wheel) -> Steps | None:
    """Return the steps of the channel that friction comes from; None where its readings lie on no lattice.

    A table written with seven digits is on a lattice too: whether a step is of any consequence is for the caller to
    see.
    """
    values = source_of_friction(samples)
    readings = np.unique(values[np.isfinite(values)])
    if not FEWEST_LEVELS <= readings.size < MOST_LEVELS * values.size:
        return None
    step = quantisation_step(
        readings - readings[0]
    )  # a converter's zero need not be zero: differences are on the lattice
    if step is None:
        return None
    if samples.friction_torque_Nm is not None:
        return Steps("friction", step, "N m", step)
    if samples.motor_torque_Nm is not None:
        return Steps("motor torque", step, "N m", step)
    return Steps("current", step, "A", step * (wheel.torque_per_ampere_Nm_A or 0.0))
