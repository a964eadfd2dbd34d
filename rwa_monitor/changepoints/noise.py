"""The noise of a window, measured beside its jumps: variance of each scale's contrast, autocovariance.

Two robust views, both incremental and of fixed size:

* The wGLR of each scale goes into a histogram. Where nothing jumps it is v·χ² with one degree of freedom, whatever the
  colour of the noise, so the histogram's lower part gives v, the variance of this scale's own contrast (errata 17).
* Differences (e_{k+l} - e_k)² at lags 1 … 64, averaged over short blocks, give the autocovariance: their level at long
  lags is the variance, what short lags lack is the covariance. A block with a jump in it stands out and is left out.

How heavy its tails are, `tails` tells from the histogram of neighbour differences.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from rwa_monitor.changepoints.stage_results import NoiseEstimate
from rwa_monitor.kernels.noise import (
    JUMPED,
    JUMPED_RATE,
    KEPT,
    KEPT_MEAN,
    LAGS,
    MOST_JUMPED,
    SMALLEST_STD,
    combine,
    mean_variance_factors,
)
from rwa_monitor.samples import FloatArray, IntArray

_LEAST_COLOUR: Final = 0.1  # correlation of neighbours below which noise counts as white
_AR_TOLERANCE: Final = 0.15  # of ρ(2) = ρ(1)²: a few standard errors in a long window


def chi_variance(statistic: FloatArray) -> float:
    """Return v of statistics that are v·χ² with one degree of freedom but for some jumps: from their lower part.

    As `scale_variances`, for all statistics of a window at hand: float64 (n,), n > 0.
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


def estimate_noise(
    levels: FloatArray,
    counts: FloatArray,
    scales: IntArray,
    variances: FloatArray,
    samples: int,
    start_std: float | None,
) -> NoiseEstimate:
    """Combine the block differences and the scales' variances to the noise of the window.

    Parameters
    ----------
    levels, counts
        float64 (LAGS,), see `quiet_levels`.
    scales, variances
        (S,), see `scale_variances`.
    samples
        Used samples of the window.
    start_std
        Standard deviation expected before any data; used when there are no blocks and no variances.
    """
    if not counts.any():
        known = [value for value in (float(variances[0]), (start_std or np.nan) ** 2) if np.isfinite(value)]
        variance = max(known[0] if known else 0.0, SMALLEST_STD**2)
        return NoiseEstimate(float(np.sqrt(variance)), np.append(variance, np.zeros(LAGS - 1)), 1.0)
    return NoiseEstimate(*combine(levels, counts, scales, variances, samples))


def mean_variance_factor(noise: NoiseEstimate, count: FloatArray) -> FloatArray:
    """Return n·Var(mean of n neighbouring samples) / variance, float64, the shape of `count`; 1 for white noise.

    For long ranges it tends to the long-run factor.
    """
    n = np.asarray(count, dtype=np.float64)
    return mean_variance_factors(n.ravel(), noise.autocovariance, noise.long_run_factor).reshape(n.shape)


def ar_coefficient(noise: NoiseEstimate) -> float:
    """Return φ where the noise looks like AR(1) with a positive φ, else 0."""
    if noise.autocovariance.size < 3 or not noise.autocovariance[0] > 0.0:
        return 0.0
    variance, first, second = noise.autocovariance[:3].tolist()
    phi = first / variance
    return phi if phi > _LEAST_COLOUR and abs(second / variance - phi**2) < _AR_TOLERANCE else 0.0
