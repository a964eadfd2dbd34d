"""Coloured noise: the noise of neighbouring samples is related."""

from __future__ import annotations

import math

import numpy as np

from rwa_monitor.samples import BoolArray, FloatArray
from rwa_monitor.wheel.effects.base import Channels, LikelihoodFit, NoiseEffect, Parameter


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
        return LikelihoodFit(
            values={"ar_coefficient": phi},
            std={"ar_coefficient": float(np.sqrt((1 - phi**2) / count))},
            log_likelihood_gain=float(-0.5 * count * np.log1p(-(phi**2))),
            parameters=1,
            samples=count,
        )


def autoregress(innovation: FloatArray, coefficient: float) -> FloatArray:
    """Return x_k = φ x_{k-1} + √(1-φ²) e_k, float64 (n,), with the variance of e, begun in its stationary law."""
    from scipy import signal

    first, fresh = innovation[:1], [math.sqrt(1.0 - coefficient * coefficient)]
    return np.append(first, signal.lfilter(fresh, [1.0, -coefficient], innovation[1:], zi=coefficient * first)[0])
