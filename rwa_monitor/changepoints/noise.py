"""The noise of a window, estimated despite its jumps: variance of each scale's contrast, autocovariance.

Two robust estimates, both incremental and in memory of fixed size:

* The wGLR of each scale goes into a histogram. Where nothing jumps it is distributed as v·χ² with one degree of
  freedom, whatever the autocorrelation of the noise, so the histogram's lower part gives v, the variance of this
  scale's contrast (errata 17).
* Differences (e_{k+l} - e_k)² at lags 1 … 64, averaged over short blocks, give the autocovariance: their level at long
  lags is the variance, the deficit at a short lag the covariance there. A block with a jump is an outlier and left out.

The histogram of neighbour differences gives the weight of the tails, and so the largest outlier of a window by chance.
"""

import math
from functools import lru_cache
from typing import Final

import numpy as np
from scipy import special

from rwa_monitor.changepoints.stage_results import NoiseEstimate
from rwa_monitor.kernels.noise import (
    CHI_MEDIAN,
    GAUSSIAN_RATIO,
    JUMPED,
    JUMPED_RATE,
    KEPT,
    KEPT_MEAN,
    LAGS,
    MOST_JUMPED,
    SMALLEST_STD,
    are_heavy,
)
from rwa_monitor.samples import FloatArray, IntArray

NORMAL_MEDIAN: Final = float(special.ndtri(0.75))  # median of |N(0, 1)|
_TRIED: Final = 3 * LAGS // 4  # lags at which the noise may be correlated
_LEAST_VARIANCE: Final = SMALLEST_STD * SMALLEST_STD
_AR_TOLERANCE: Final = 0.15  # of ρ(2) = ρ(1)²: a few standard errors in a long window


def chi_variance(statistic: FloatArray) -> float:
    """Estimate v from the lower part of statistics that are v·χ² with one degree of freedom, except at some jumps.

    As `scale_variances`, from the statistics of a window themselves: float64 (n,), n > 0.
    """
    jumped = 0.0
    variance = 0.0
    ascending = np.sort(statistic)
    for _ in range(4):
        kept = max(1, int(KEPT * (1.0 - jumped) * ascending.size))
        variance = float(np.mean(ascending[:kept])) / KEPT_MEAN
        beyond = float(np.mean(ascending > JUMPED * variance))
        jumped = min(max(0.0, beyond - JUMPED_RATE), MOST_JUMPED)
    return variance


def median_size(values: FloatArray) -> float:
    """Return the median of finite absolute values, 0 of none; `numpy.median` takes longer for checks than for it."""
    values = values[np.isfinite(values)]
    middle = [(values.size - 1) // 2, values.size // 2]
    return 0.5 * float(np.partition(np.abs(values), middle)[middle].sum()) if values.size else 0.0


def estimate_noise(
    levels: FloatArray,
    counts: FloatArray,
    scales: IntArray,
    variances: FloatArray,
    samples: int,
    start_std: float,
) -> NoiseEstimate:
    """Combine the block differences and the scales' variances into an estimate of the window's noise.

    Parameters
    ----------
    levels, counts
        float64 (LAGS,), see `quiet_levels`.
    scales, variances
        (S,), see `scale_variances`.
    samples
        Used samples of the window.
    start_std
        Standard deviation expected before any data, or NaN; used when there are no blocks and no variances.
    """
    if not counts.any():
        known = [value for value in (float(variances[0]), start_std**2) if np.isfinite(value)]
        variance = max(known[0] if known else 0.0, _LEAST_VARIANCE)
        return NoiseEstimate(math.sqrt(variance), np.append(variance, np.zeros(LAGS - 1)), 1.0)
    variance, last = _white_level(levels, counts)
    # Beyond the last significant lag the autocovariance is estimation error: 63 such lags would swamp the factor.
    autocovariance = np.zeros(LAGS)
    autocovariance[0], autocovariance[1 : last + 1] = variance, variance - levels[:last]
    factor = 1.0 + 2.0 * float(autocovariance[1:].sum()) / variance
    # The widest scale with enough independent contrasts bounds the long-run factor on its own. A short window has only
    # narrow scales with few contrasts, which cannot exclude long memory: they give no upper bound.
    for scale, measured in zip(scales[::-1].tolist(), variances[::-1].tolist(), strict=True):
        independent = samples / scale
        if math.isfinite(measured) and scale >= 8 and independent >= (100 if scale > 16 else 20):
            error, ratio = 3.0 * 1.5 * math.sqrt(2.0 / independent), measured / variance
            highest = ratio * (1.0 + error) if independent >= 100 else math.inf
            factor = min(max(factor, ratio * max(1.0 - error, 0.5)), highest)
            break
    return NoiseEstimate(math.sqrt(variance), autocovariance, max(factor, 1e-3))


def _white_level(levels: FloatArray, counts: FloatArray) -> tuple[float, int]:
    """Return the level of the differences at long lags, which is the variance, and the last significant lag."""
    variance, last = float(levels[_TRIED:].sum()) / (LAGS - _TRIED), 0
    tried, weighted = counts[:_TRIED], levels * counts
    for _ in range(2):
        correlation = 1.0 - levels[:_TRIED] / max(variance, _LEAST_VARIANCE)
        spread = 1.0 + 2.0 * float(np.square(correlation[:last]).sum())
        certain = np.abs(correlation) > 4.0 * np.sqrt(spread / tried)
        last = _TRIED - int(certain[::-1].argmax()) if certain.any() else 0
        variance = float(weighted[last:].sum()) / float(counts[last:].sum())
    return max(variance, _LEAST_VARIANCE), last


def mean_variance_factor(noise: NoiseEstimate, count: FloatArray) -> FloatArray:
    """Return n·Var(mean of n neighbouring samples) / variance, float64, the shape of `count`; 1 for white noise.

    1 + 2 Σ (1 - l/n) ρ(l) over the known lags; for n beyond them it tends to the long-run factor.
    """
    n = np.maximum(count, 1.0)
    shorter, missing = np.float64(1.0), noise.long_run_factor - 1.0
    variance, *covariances = noise.autocovariance.tolist()
    for lag, covariance in enumerate(covariances, start=1):
        if covariance != 0.0:
            shorter = shorter + np.maximum(2.0 * (1.0 - lag / n), 0.0) * (covariance / variance)
            missing -= 2.0 * (covariance / variance)
    # The part of the long-run factor that the known lags do not explain comes in as n exceeds their number.
    return np.asarray(np.maximum(shorter + missing * n / (n + noise.autocovariance.size), 1e-3))


def ar_coefficient(noise: NoiseEstimate) -> float:
    """Return φ where ρ(1) and ρ(2) agree with AR(1) noise of positive φ, else 0."""
    if noise.autocovariance.size < 3 or not noise.autocovariance[0] > 0.0:
        return 0.0
    variance, first, second = noise.autocovariance[:3].tolist()
    phi = first / variance
    return phi if phi > 0.0 and abs(second / variance - phi**2) < _AR_TOLERANCE else 0.0


# ---- outliers --------------------------------------------------------------------------------------------------------


FALSE_POSITIVE: Final = 1e-9  # probability that a sample is reported as a jump at once and is none (paper, section V-A)
OUTLIERS: Final = 0.2  # outliers by chance tolerated per window, on average; each mimics two jumps

# Differences of two Student-t variables: 99.5 % quantile of the square over its median, against the degrees of
# freedom (numerical convolution), and the t's scale over the difference's robust standard deviation of one sample.
TAIL_RATIO: Final = np.array(
    [GAUSSIAN_RATIO, 18.53, 19.25, 20.07, 22.06, 23.92, 27.94, 32.25, 41.24, 50.24, 67.07, 104.8, 183.0]
)
_TAIL_SCALE: Final = np.array([1, 0.977, 0.966, 0.955, 0.933, 0.917, 0.890, 0.869, 0.838, 0.817, 0.789, 0.752, 0.711])
_TAIL_INVERSE_FREEDOM: Final = 1.0 / np.array([np.inf, 30, 20, 15, 10, 8, 6, 5, 4, 3.5, 3, 2.5, 2.1])


def largest_outlier(quantiles: tuple[float, float, float], variance: float, chance: float) -> float:
    """Return the size that a sample exceeds with a given probability, normalised, given the weight of the tails.

    Parameters
    ----------
    quantiles
        What `quantiles_of` returns of the histogram at scale 1, of half the squared neighbour difference.
    variance
        The robust variance of a sample.
    chance
        The probability: of a window, that of `outlier_chance`.
    """
    if not are_heavy(quantiles, variance):
        return math.sqrt(variance) * gaussian_outlier(chance)
    _, median, far = quantiles
    freedom = 1.0 / float(np.interp(far / median, TAIL_RATIO, _TAIL_INVERSE_FREEDOM))
    # Statistic = difference²/2; its median over that of χ²₁ is the robust variance of a Gaussian sample.
    robust_std = math.sqrt(median / CHI_MEDIAN)
    scale = robust_std * float(np.interp(far / median, TAIL_RATIO, _TAIL_SCALE))
    return float(-scale * special.stdtrit(freedom, 0.5 * chance))


@lru_cache(maxsize=256)
def gaussian_outlier(chance: float) -> float:
    """Return the size, in standard deviations, that a Gaussian sample exceeds with a given probability."""
    return float(-special.ndtri(0.5 * chance))


def outlier_chance(samples: int) -> float:
    """Return the probability per sample that makes OUTLIERS outliers expected in all; at least FALSE_POSITIVE."""
    return max(OUTLIERS / max(samples, 2), FALSE_POSITIVE)
