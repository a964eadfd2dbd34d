"""How heavy the tails of a window's noise are: from the histogram of neighbour differences.

Light tails or heavy ones decide how large the largest outlier of a window is by chance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from scipy import special

from rwa_monitor.kernels.outliers import CHI_MEDIAN, GAUSSIAN_RATIO, are_heavy

OUTLIERS: Final = 0.2  # outliers by chance in a window that are bearable; each looks like two jumps

# Differences of two Student-t variables: 99.5 % quantile of the square over its median, against the degrees of
# freedom (numerical convolution), and the t's scale over the difference's robust standard deviation of one sample.
_TAIL_RATIO: Final = np.array(
    [GAUSSIAN_RATIO, 18.53, 19.25, 20.07, 22.06, 23.92, 27.94, 32.25, 41.24, 50.24, 67.07, 104.8, 183.0]
)
_TAIL_SCALE: Final = np.array([1, 0.977, 0.966, 0.955, 0.933, 0.917, 0.890, 0.869, 0.838, 0.817, 0.789, 0.752, 0.711])
_TAIL_INVERSE_FREEDOM: Final = 1.0 / np.array([np.inf, 30, 20, 15, 10, 8, 6, 5, 4, 3.5, 3, 2.5, 2.1])


@dataclass(frozen=True, slots=True)
class Tails:
    """How heavy the noise's tails are.

    Attributes
    ----------
    degrees_of_freedom
        Of a Student t with the same tails; infinite for Gaussian noise.
    largest_outlier
        Size that OUTLIERS samples of a window exceed by chance, normalised.
    """

    degrees_of_freedom: float
    largest_outlier: float


def estimate_tails(quantiles: tuple[float, float, float], variance: float, samples: int) -> Tails:
    """Estimate the tails from the histogram of the statistic at scale 1 (half the squared neighbour difference).

    Parameters
    ----------
    quantiles
        What `quantiles_of` returns of it.
    variance
        The robust variance of a sample.
    samples
        Used samples of the window.
    """
    if not are_heavy(quantiles, variance):
        return Tails(np.inf, math.sqrt(variance) * gaussian_outlier(samples))
    _, median, far = quantiles
    freedom = 1.0 / float(np.interp(far / median, _TAIL_RATIO, _TAIL_INVERSE_FREEDOM))
    # Statistic = difference²/2; its median over that of χ²₁ is the robust variance of a Gaussian sample.
    robust_std = math.sqrt(median / CHI_MEDIAN)
    scale = robust_std * float(np.interp(far / median, _TAIL_RATIO, _TAIL_SCALE))
    return Tails(freedom, float(-scale * special.stdtrit(freedom, 0.5 * _chance(samples))))


@lru_cache(maxsize=256)
def gaussian_outlier(samples: int) -> float:
    """Return the size, in standard deviations, that OUTLIERS of so many Gaussian samples exceed by chance."""
    return float(-special.ndtri(0.5 * _chance(samples)))


def _chance(samples: int) -> float:
    """Return the probability with which one of so many samples is an outlier."""
    return max(OUTLIERS / max(samples, 2), 1e-9)
