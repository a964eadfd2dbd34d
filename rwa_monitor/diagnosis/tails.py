"""How heavy the tails of a window's noise are: from the histogram of neighbour differences.

Light tails or heavy ones decide how large the largest outlier of a window is by chance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numba
import numpy as np
from scipy import special

from rwa_monitor.diagnosis.noise import BIN_EDGES, BIN_WIDTHS
from rwa_monitor.samples import IntArray

FEWEST: Final = 200  # counted statistics below which nothing is said of tails
OUTLIERS: Final = 0.2  # outliers by chance in a window that are bearable; each looks like two jumps

_CHI_MEDIAN: Final = float(2.0 * special.erfinv(0.5) ** 2)  # median of χ²₁
_LATTICE: Final = 0.5  # of the median that the variance lets expect
_BIN_MIDDLES: Final = BIN_EDGES + 0.5 * BIN_WIDTHS

# Differences of two Student-t variables: 99.5 % quantile of the square over its median, against the degrees of
# freedom (numerical convolution), and the t's scale over the difference's robust standard deviation of one sample.
_TAIL_RATIO: Final = np.array(
    [17.32, 18.53, 19.25, 20.07, 22.06, 23.92, 27.94, 32.25, 41.24, 50.24, 67.07, 104.8, 183.0]
)
_TAIL_SCALE: Final = np.array([1, 0.977, 0.966, 0.955, 0.933, 0.917, 0.890, 0.869, 0.838, 0.817, 0.789, 0.752, 0.711])
_TAIL_INVERSE_FREEDOM: Final = 1.0 / np.array([np.inf, 30, 20, 15, 10, 8, 6, 5, 4, 3.5, 3, 2.5, 2.1])
_GAUSSIAN_RATIO: Final = float(_TAIL_RATIO[0])
_LIGHT_TAIL: Final = 1.05  # a ratio this close to the Gaussian's is one: its standard error is 1.5 % in a long window


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


def estimate_tails(quantiles: tuple[float, int, int], variance: float, samples: int) -> Tails:
    """Estimate the tails from the histogram of the statistic at scale 1 (half the squared neighbour difference).

    Parameters
    ----------
    quantiles
        What `quantile_bins` returns of it.
    variance
        The robust variance of a sample.
    samples
        Used samples of the window.
    """
    if not are_heavy(quantiles, variance):
        return Tails(np.inf, math.sqrt(variance) * gaussian_outlier(samples))
    _, middle, end = quantiles
    median, far = float(_BIN_MIDDLES[middle]), float(_BIN_MIDDLES[end])
    freedom = 1.0 / float(np.interp(far / median, _TAIL_RATIO, _TAIL_INVERSE_FREEDOM))
    # Statistic = difference²/2; its median over that of χ²₁ is the robust variance of a Gaussian sample.
    robust_std = math.sqrt(median / _CHI_MEDIAN)
    scale = robust_std * float(np.interp(far / median, _TAIL_RATIO, _TAIL_SCALE))
    return Tails(freedom, float(-scale * special.stdtrit(freedom, 0.5 * _chance(samples))))


@lru_cache(maxsize=256)
def gaussian_outlier(samples: int) -> float:
    """Return the size, in standard deviations, that OUTLIERS of so many Gaussian samples exceed by chance."""
    return float(-special.ndtri(0.5 * _chance(samples)))


def _chance(samples: int) -> float:
    """Return the probability with which one of so many samples is an outlier."""
    return max(OUTLIERS / max(samples, 2), 1e-9)


@numba.njit(cache=True, error_model="numpy", nogil=True)
def are_heavy(quantiles: tuple[float, int, int], variance: float) -> bool:
    """Say whether tails are heavier than a Gaussian's; parameters as those of `estimate_tails`."""
    total, middle, end = quantiles
    if total < FEWEST:
        return False
    median, far = _BIN_MIDDLES[middle], _BIN_MIDDLES[end]
    if median < _LATTICE * variance * _CHI_MEDIAN:
        return False  # neighbours are mostly equal: a coarse lattice, whose quantiles say nothing about tails
    # The 99.5 % quantile has a relative standard error of about 0.225/√(0.005 n).
    return bool(far > _GAUSSIAN_RATIO * (_LIGHT_TAIL + 3 * 0.225 / math.sqrt(0.005 * total)) * median)


@numba.njit(cache=True, error_model="numpy", nogil=True)
def quantile_bins(counts: IntArray) -> tuple[float, int, int]:
    """Return how many are counted, int (BINS,), and the bins up to which at least 50 % and 99.5 % of them are."""
    total = float(counts.sum())
    seen, middle, end = 0, 0, 0
    for place in range(counts.size):
        seen += counts[place]
        middle += seen < 0.5 * total
        if seen >= 0.995 * total:
            end = place
            break
    return total, middle, end
