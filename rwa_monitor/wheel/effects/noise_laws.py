"""Noise of another law than white and Gaussian: neighbouring samples are related, or the tails are heavy."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from scipy import special

from rwa_monitor.samples import BoolArray, FloatArray
from rwa_monitor.wheel.effects.base import Channels, LikelihoodFit, NoiseEffect, Parameter, most_likely_one


class ColouredNoise(NoiseEffect):
    """First-order autoregressive noise of unchanged variance.

    Filters in the drive electronics, slow disturbances and the estimation of friction itself relate neighbouring
    samples. Means over short stretches then scatter more than white noise would let them, which looks like jumps.

    What shows it
    -------------
    An autocorrelation of the residual that decays geometrically with the lag.

    See Also
    --------
    tachometer_quantisation, heavy_tailed_noise

    References
    ----------
    G. E. P. Box, G. M. Jenkins, Time Series Analysis: Forecasting and Control, 1970 (AR(1)). The range 0.3 to 0.95 is a
    working assumption.
    """

    name = "coloured_noise"
    title = "Coloured noise"
    formula = r"n_k = \varphi\, n_{k-1} + \sqrt{1 - \varphi^2}\, e_k"
    separate_by = "The autocorrelation over several lags, on a stretch of constant speed."
    parameters = (Parameter("ar_coefficient", "-", 0.0, 0.99, 0.5),)

    def apply(self, noise_Nm: FloatArray, channels: Channels, rng: np.random.Generator) -> FloatArray:
        return autoregress(noise_Nm, self.values["ar_coefficient"])

    @classmethod
    def fitted(
        cls, residual_Nm: FloatArray, channels: Channels, usable: BoolArray, variance_inflation: float
    ) -> LikelihoodFit:
        """Fit φ by the conditional likelihood of each sample given its neighbour, where both are good."""
        pairs = usable[1:] & usable[:-1]
        count = int(pairs.sum())
        before, after = residual_Nm[:-1][pairs], residual_Nm[1:][pairs]
        energy = float(np.sqrt(np.sum(before**2) * np.sum(after**2)))
        if energy == 0.0:
            return cls.nothing_found(count)
        phi = float(np.clip(np.sum(before * after) / energy, 0.0, 0.99))
        std = float(np.sqrt((1 - phi**2) / count))
        gain = float(-0.5 * count * np.log1p(-(phi**2)))
        return LikelihoodFit({"ar_coefficient": phi}, {"ar_coefficient": std}, gain, 1, count)


def autoregress(innovation: FloatArray, coefficient: float) -> FloatArray:
    """Return x_k = φ x_{k-1} + √(1-φ²) e_k, float64 (n,), with the variance of e, begun in its stationary law."""
    from scipy import signal

    first, fresh = innovation[:1], [math.sqrt(1.0 - coefficient * coefficient)]
    return np.append(first, signal.lfilter(fresh, [1.0, -coefficient], innovation[1:], zi=coefficient * first)[0])


SCALE_ROUNDS: Final = 25  # of the EM iteration for the scale; it gains a digit every few rounds
GAUSSIAN_FROM: Final = 100.0  # [-] degrees of freedom from which the law is Gaussian for every purpose


class HeavyTailedNoise(NoiseEffect):
    """Student-t noise of unchanged variance.

    Errors in packets, missed tachometer pulses and current peaks give single samples that are far off. The standard
    deviation stays, the tails grow.

    What shows it
    -------------
    A kurtosis of the residual above that of a Gaussian; single samples many standard deviations off.

    See Also
    --------
    speed_dependent_noise, cage_instability

    References
    ----------
    K. L. Lange, R. J. A. Little, J. M. G. Taylor, Robust statistical modeling using the t distribution, JASA 84, 1989.
    3 to 10 degrees of freedom are a working assumption.
    """

    name = "heavy_tailed_noise"
    title = "Heavy-tailed noise"
    formula = r"n_k = \sigma \sqrt{(\nu - 2)/\nu}\; t_k, \qquad t_k \sim \text{Student}(\nu)"
    separate_by = (
        "The spread of the residual at constant speed: heavy tails stay, noise that depends on speed does not."
    )
    parameters = (Parameter("degrees_of_freedom", "-", 2.05, GAUSSIAN_FROM, 4.0),)

    def apply(self, noise_Nm: FloatArray, channels: Channels, rng: np.random.Generator) -> FloatArray:
        nu = self.values["degrees_of_freedom"]
        mixing = rng.chisquare(nu, size=noise_Nm.size)
        return noise_Nm * np.sqrt((nu - 2.0) / mixing)

    @classmethod
    def fitted(
        cls, residual_Nm: FloatArray, channels: Channels, usable: BoolArray, variance_inflation: float
    ) -> LikelihoodFit:
        """Fit ν by the profile likelihood: for each ν the scale that maximises it."""
        count = int(usable.sum())
        spread = float(np.sqrt(np.mean(residual_Nm[usable] ** 2)))
        squares = (residual_Nm[usable] / spread) ** 2
        gaussian = -0.5 * count * (np.log(2.0 * np.pi) + 1.0)

        def gain(nu: float) -> float:
            return student_log_likelihood(squares, nu) - float(gaussian)

        (parameter,) = cls.parameters
        nu, std, most = most_likely_one(gain, parameter.low, parameter.high, 1e-3)
        return LikelihoodFit({parameter.name: nu}, {parameter.name: std}, most, 1, count)


def student_log_likelihood(squares: FloatArray, degrees_of_freedom: float) -> float:
    """Return the log-likelihood of zero-mean Student-t values at the best scale.

    Parameters
    ----------
    squares
        float64 (n,), squared values in units in which their mean is one.
    degrees_of_freedom
        ν > 2.
    """
    nu = degrees_of_freedom
    scale2 = (nu - 2.0) / nu
    for _ in range(SCALE_ROUNDS):
        scale2 = float(np.mean((nu + 1.0) * squares / (nu + squares / scale2)))
    constant = special.gammaln((nu + 1.0) / 2.0) - special.gammaln(nu / 2.0) - 0.5 * np.log(np.pi * nu * scale2)
    return float(squares.size * constant - 0.5 * (nu + 1.0) * np.sum(np.log1p(squares / (nu * scale2))))
