"""Densities of measured values under learned bands, as compiled loops: plain functions over numbers and arrays."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numba import njit

from rwa_monitor.samples import FloatArray

# Share of anomalies that have another size than those learned. A wheel that is a third of the way to the learned
# anomaly, or far beyond it, is anomalous too.
OTHER_SIZE: Final = 0.05
GAUSSIAN_WIDTH: Final = 1e-3  # of its softness, below which a band is a Gaussian
LEVEL_NUMBERS: Final = 8  # low, high, softness of the nominal and of the anomalous band (NaN: none), stray, reach


@njit(cache=True, error_model="numpy", nogil=True)
def _below(x: float) -> float:
    """Return the standard normal distribution function."""
    return 0.5 * math.erfc(-x * math.sqrt(0.5))


@njit(cache=True, error_model="numpy", nogil=True)
def band_density(value: float, std: float, low: float, high: float, soft: float) -> float:
    """Return the density of measuring `value`, with standard deviation `std`, in a band; see `model.Band`."""
    sigma, width, distance = math.hypot(soft, std), high - low, abs(value - 0.5 * (low + high))
    # A band narrower than its softness is a Gaussian; the difference below would lose all digits.
    if width < GAUSSIAN_WIDTH * soft:
        return math.exp(-0.5 * (distance / sigma) ** 2) / (sigma * math.sqrt(2.0 * math.pi))
    # The tail with both arguments of one sign, so that the difference keeps its digits on either side.
    return (_below((0.5 * width - distance) / sigma) - _below((-0.5 * width - distance) / sigma)) / width


@njit(cache=True, error_model="numpy", nogil=True)
def band_densities(value: FloatArray, std: FloatArray, low: float, high: float, soft: float) -> FloatArray:
    """Return `band_density` of each value, float64 (n,)."""
    density = np.empty(value.size)
    for i in range(value.size):
        density[i] = band_density(value[i], std[i], low, high, soft)
    return density


@njit(cache=True, error_model="numpy", nogil=True)
def level_densities(value: FloatArray, std: FloatArray, numbers: FloatArray) -> FloatArray:
    """Return the densities of measured values under nominal and anomalous, and their sum in the learned bands alone.

    Parameters
    ----------
    value, std
        float64 (n,).
    numbers
        float64 (LEVEL_NUMBERS,), see `model.Levels.numbers`.

    Returns
    -------
    float64 (3, n). See `likelihood.log_densities`.
    """
    low, high, soft, anomalous_low, anomalous_high, anomalous_soft, stray_share, own_reach = numbers
    densities = np.empty((3, value.size))
    for i in range(value.size):
        reach = math.hypot(own_reach, std[i])
        distance = abs(value[i] - 0.5 * (low + high))
        stray = 0.5 / reach / (1.0 + distance / reach) ** 2
        excess = value[i] - (high + 2.0 * soft)
        other = _below(excess / math.hypot(soft, std[i])) / reach / (1.0 + max(excess, 0.0) / reach) ** 2
        nominal = band_density(value[i], std[i], low, high, soft)
        learned, inside = other, nominal
        if not math.isnan(anomalous_low):
            learned = band_density(value[i], std[i], anomalous_low, anomalous_high, anomalous_soft)
            inside = nominal + learned
        densities[0, i] = (1.0 - stray_share) * nominal + stray_share * stray
        densities[1, i] = (1.0 - stray_share - OTHER_SIZE) * learned + OTHER_SIZE * other + stray_share * stray
        densities[2, i] = inside
    return densities
