"""Noise that is not white and Gaussian: autocorrelated, heavy-tailed, or with a spread that depends on the speed."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np
from scipy import special

from rwa_monitor.samples import BoolArray, FloatArray
from rwa_monitor.wheel.effects.base import Channels, LikelihoodFit, NoiseEffect, Parameter, most_likely, most_likely_one


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
    formula = r"n_k = \varphi\, n_{k-1} + \sqrt{1 - \varphi^2}\, e_k"
    separate_by = "The autocorrelation over several lags, on a stretch of constant speed."
    parameters = (Parameter("ar_coefficient", "-", 0.0, 0.99, 0.5),)

    def apply(self, noise_Nm: FloatArray, channels: Channels, rng: np.random.Generator) -> FloatArray:
        return autoregress(noise_Nm, self.values["ar_coefficient"])

    @classmethod
    def fitted(
        cls, residual_Nm: FloatArray, channels: Channels, usable: BoolArray, variance_inflation: float
    ) -> LikelihoodFit:
        """Fit φ by the conditional likelihood of each sample given the previous one, where both are usable."""
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
    """Return x_k = φ x_{k-1} + √(1-φ²) e_k, float64 (n,), with the variance of e, started in its stationary law."""
    from scipy import signal

    first, fresh = innovation[:1], [math.sqrt(1.0 - coefficient * coefficient)]
    return np.append(first, signal.lfilter(fresh, [1.0, -coefficient], innovation[1:], zi=coefficient * first)[0])


SCALE_ROUNDS: Final = 25  # of the EM iteration for the scale; it gains a digit every few rounds
GAUSSIAN_FROM: Final = 100.0  # [-] degrees of freedom from which the law is practically Gaussian


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


BINS: Final = 200  # of |ω|, or of another covariate: the likelihood needs only count and mean square in each


class SpeedDependentNoise(NoiseEffect):
    """Noise whose standard deviation depends on the speed.

    Imbalance, bearing geometry and structural resonances shake the wheel and its sensors: the noise grows with the
    speed, or in a band where a harmonic meets a resonance. Forces on the mounting grow with ω² (Masterson); what is
    modelled here is another quantity, the spread of a sampled torque residual, made of sensor noise, tachometer jitter
    (a share of the speed) and aliased ripple. A line in |ω| is the simplest growth over a constant floor; where the
    spread grows with ω², c is the slope of the line that fits best and depends on the range of speeds in the record.

    What shows it
    -------------
    The variance of the residual follows |ω|, its mean does not.

    See Also
    --------
    torque_ripple, cage_instability, heavy_tailed_noise

    References
    ----------
    R. A. Masterson, D. W. Miller, R. L. Grogan, Development and validation of reaction wheel disturbance models:
    empirical model, Journal of Sound and Vibration 249(3), 2002 (harmonic disturbances with amplitudes ∝ ω², and
    resonances). That the spread grows linearly, and its size in telemetry, are working assumptions.
    """

    name = "speed_dependent_noise"
    title = "Noise that depends on the speed"
    formula = (
        r"\sigma(\omega) = \sigma_0 \left(1 + c |\omega|\right) \left(1 + b\, e^{-\left(|\omega| - \omega_b\right)^2 "
        r"/ 2 w^2}\right)"
    )
    separate_by = "Dwells at several speeds, sampled fast enough to see ripple as ripple."
    parameters = (
        Parameter("strength_s_rad", "s/rad", 0.0, np.inf, 3.0e-3, default=0.0),
        Parameter("band_strength", "-", 0.0, 100.0, 0.0, default=0.0),
        Parameter("band_speed_rad_s", "rad/s", 0.0, 2000.0, 100.0, default=100.0),
        Parameter("band_width_rad_s", "rad/s", 1e-3, 500.0, 10.0, default=10.0),
    )

    def apply(self, noise_Nm: FloatArray, channels: Channels, rng: np.random.Generator) -> FloatArray:
        return noise_Nm * spread_factor(np.abs(channels.speed_rad_s), self.values)

    @classmethod
    def fitted(
        cls, residual_Nm: FloatArray, channels: Channels, usable: BoolArray, variance_inflation: float
    ) -> LikelihoodFit:
        """Fit growth alone and a band alone; return the one that is better by BIC.

        The gain of a band is divided by the variance inflation: a band is searched at a hundred places, and noise
        whose variance clusters mimics one. Growth is one number over the whole range, for which the acceptance
        threshold suffices.
        """
        speed = np.abs(channels.speed_rad_s[usable])
        if speed.max() == speed.min():
            return cls.nothing_found(speed.size)
        binned = _Binned(speed, residual_Nm[usable])
        band = _fit_band(binned)
        band = replace(band, log_likelihood_gain=band.log_likelihood_gain / variance_inflation)
        return max(_fit_growth(binned), band, key=lambda fit: fit.penalised_gain)


def spread_factor(speed_rad_s: FloatArray, values: Mapping[str, float]) -> FloatArray:
    """Return σ(ω)/σ₀ for |ω|, float64 (n,)."""
    offset = (speed_rad_s - values["band_speed_rad_s"]) / values["band_width_rad_s"]
    band = 1.0 + values["band_strength"] * np.exp(-0.5 * offset**2)
    return (1.0 + values["strength_s_rad"] * speed_rad_s) * band


class _Binned:
    """Count and mean square of a residual in bins of |ω|, and the gain of a variance law over white noise."""

    def __init__(self, speed_rad_s: FloatArray, residual: FloatArray) -> None:
        edges = np.linspace(speed_rad_s.min(), speed_rad_s.max(), BINS + 1)
        at = np.clip(np.searchsorted(edges, speed_rad_s, side="right") - 1, 0, BINS - 1)
        count = np.bincount(at, minlength=BINS).astype(np.float64)
        filled = count > 0
        self.speed = (np.bincount(at, speed_rad_s, BINS)[filled]) / count[filled]
        self.mean_square = np.bincount(at, (residual / residual.std()) ** 2, BINS)[filled] / count[filled]
        self.count = count[filled]
        self.samples = int(count.sum())
        self.low, self.high = float(edges[0]), float(edges[-1])

    def gain(self, values: Mapping[str, float]) -> float:
        """Return the gain of log-likelihood with the best σ₀."""
        factor2 = spread_factor(self.speed, values) ** 2
        white = float(np.sum(self.count * self.mean_square)) / self.samples
        scaled = float(np.sum(self.count * self.mean_square / factor2)) / self.samples
        return float(0.5 * self.samples * (np.log(white) - np.log(scaled)) - 0.5 * np.sum(self.count * np.log(factor2)))


# The noise grows with the speed, or it is raised in a band: a fit of one does not estimate the other.
OF_GROWTH: Final = frozenset({"strength_s_rad"})
OF_BAND: Final = frozenset({"band_strength", "band_speed_rad_s", "band_width_rad_s"})
_NOTHING: Final = dict(SpeedDependentNoise().values)
_UNKNOWN: Final = dict.fromkeys(_NOTHING, float("nan"))


def _fit_growth(binned: _Binned) -> LikelihoodFit:
    """Fit σ₀ (1 + c|ω|), with c between 1e-3 and 1e3 times one over the largest speed."""

    def gain(growth: float) -> float:
        return binned.gain({**_NOTHING, "strength_s_rad": growth})

    scale = 1.0 / binned.high
    growth, std, most = most_likely_one(gain, 1e-3 * scale, 1e3 * scale, 1e-5)
    errors = {**_UNKNOWN, "strength_s_rad": std}
    return LikelihoodFit({**_NOTHING, "strength_s_rad": growth}, errors, most, 1, binned.samples, OF_BAND)


def _fit_band(binned: _Binned) -> LikelihoodFit:
    """Fit a band: a coarse scan over its speed and width, then a local search."""
    span = binned.high - binned.low

    def values(x: FloatArray) -> dict[str, float]:
        # In logarithms of strength and width, so that both stay positive.
        strength, width = float(np.exp(x[0])), span * float(np.exp(x[2]))
        place = {"band_speed_rad_s": binned.low + span * float(x[1]), "band_width_rad_s": width}
        return {**_NOTHING, "band_strength": strength, **place}

    starts = [np.array([0.0, at, np.log(width)]) for at in np.linspace(0.02, 0.98, 33) for width in (0.02, 0.06, 0.15)]
    bounds = [(-5.0, 3.0), (0.0, 1.0), (float(np.log(0.005)), float(np.log(0.3)))]
    best, std, gain = most_likely(lambda x: binned.gain(values(x)), starts, bounds)
    found = values(best)
    std *= [found["band_strength"], span, found["band_width_rad_s"]]
    names = ("band_strength", "band_speed_rad_s", "band_width_rad_s")
    errors = {**_UNKNOWN, **dict(zip(names, std.tolist(), strict=True))}
    return LikelihoodFit(found, errors, gain, 3, binned.samples, OF_GROWTH)
