"""Base of the noise effects: how they change simulated noise, and how they are recognised in a residual.

Noise effects add no regression column. Each has a likelihood of its own for the residual that is left after the base
law, its jumps and the mean effects are removed; it is compared with white Gaussian noise of the same residual.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from rwa_monitor.physics.effects.base import Channels, Effect, Family
from rwa_monitor.samples import BoolArray, FloatArray


@dataclass(frozen=True, slots=True)
class NoiseFit:
    """A noise effect fitted to a residual by maximum likelihood.

    Attributes
    ----------
    values
        The parameters, by name.
    std
        Their standard deviations from the curvature of the likelihood; NaN where it has none.
    log_likelihood_gain
        log L of this noise less log L of white Gaussian noise, each at its maximum; natural logarithm, ≥ 0.
    parameters
        Free parameters beyond those of white noise.
    samples
        How many residuals entered.
    """

    values: dict[str, float]
    std: dict[str, float]
    log_likelihood_gain: float
    parameters: int
    samples: int

    @property
    def penalised_gain(self) -> float:
        """2·gain less log n for each parameter (BIC); above zero where the effect is worth its parameters."""
        return 2.0 * self.log_likelihood_gain - self.parameters * float(np.log(max(self.samples, 1)))


class NoiseEffect(Effect):
    """An effect that changes the noise of the friction torque, or of the speed that it is derived from."""

    family: ClassVar[Family] = "noise"

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
        raise NotImplementedError

    def read_speed(self, speed_rad_s: FloatArray) -> FloatArray:
        """Return what the tachometer reads of a true speed [rad/s]; unchanged by most effects.

        A simulator that derives friction from the measured speed uses this *instead of* `apply` for an effect that
        changes it.
        """
        return speed_rad_s

    @classmethod
    def fit(cls, residual_Nm: FloatArray, channels: Channels, good: BoolArray) -> NoiseFit:
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
        NoiseFit
            At the maximum of the likelihood; a gain of zero where the record cannot show the effect.
        """
        raise NotImplementedError

    @classmethod
    def nothing_found(cls, samples: int = 0) -> NoiseFit:
        """Return the fit of a record that cannot show the effect: typical values, no gain."""
        return NoiseFit(
            values={parameter.name: parameter.typical for parameter in cls.parameters},
            std={parameter.name: float("nan") for parameter in cls.parameters},
            log_likelihood_gain=0.0,
            parameters=len(cls.parameters),
            samples=samples,
        )


def usable_residuals(residual_Nm: FloatArray, channels: Channels, good: BoolArray) -> BoolArray:
    """Return the slots whose residual and speed count, bool (n,)."""
    return good & channels.good & np.isfinite(residual_Nm) & np.isfinite(channels.speed_rad_s)


def curvature_std(log_likelihood: Callable[[float], float], at: float, step: float) -> float:
    """Return the standard deviation that the curvature of a log-likelihood gives a parameter; NaN where it has none."""
    second = (log_likelihood(at + step) - 2.0 * log_likelihood(at) + log_likelihood(at - step)) / step**2
    return float(1.0 / np.sqrt(-second)) if second < 0 else float("nan")
