"""Base of the noise effects: how they change simulated noise, and how they are recognised in a residual.

Noise effects add no regression column. Each has a likelihood of its own for the residual that is left after the base
law, its jumps and the mean effects are removed; it is compared with white Gaussian noise of the same residual.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np

from rwa_monitor.samples import BoolArray, FloatArray
from rwa_monitor.wheel.effects.base import Channels, Effect, Family
from rwa_monitor.wheel.effects.likelihood import LikelihoodFit, no_gain


class NoiseEffect(Effect, ABC):
    """An effect that changes the noise of the friction torque, or of the speed that it is derived from."""

    family: ClassVar[Family] = "noise"

    @abstractmethod
    def apply(self, noise_Nm: FloatArray, channels: Channels, rng: np.random.Generator) -> FloatArray:
        """Return the noise of a simulated friction torque with this effect in it.

        Parameters
        ----------
        noise_Nm
            float64 (n,), the noise so far, white to begin with.
        channels
            The true motion.
        rng
            Source of all randomness.
        """

    def read_speed(self, speed_rad_s: FloatArray) -> FloatArray:
        """Return what the tachometer reads of a true speed [rad/s]; unchanged by most effects.

        A simulator that derives friction from the measured speed uses this *instead of* `apply` for an effect that
        changes it.
        """
        return speed_rad_s

    @classmethod
    @abstractmethod
    def fit(cls, residual_Nm: FloatArray, channels: Channels, good: BoolArray) -> LikelihoodFit:
        """Fit the effect to a residual.

        Parameters
        ----------
        residual_Nm
            float64 (n,), what base law, jumps and mean effects leave, on consecutive slots.
        channels
            The measured motion.
        good
            bool (n,), slots whose residual counts.

        Returns
        -------
        LikelihoodFit
            At the maximum of the likelihood; a gain of zero where the record cannot show the effect.
        """

    @classmethod
    def nothing_found(cls, samples: int = 0) -> LikelihoodFit:
        """Return the fit of a record that cannot show the effect: typical values, no gain."""
        return no_gain(cls, samples)


def usable_residuals(residual_Nm: FloatArray, channels: Channels, good: BoolArray) -> BoolArray:
    """Return the slots whose residual and speed count, bool (n,)."""
    return good & channels.good & np.isfinite(residual_Nm) & np.isfinite(channels.speed_rad_s)
