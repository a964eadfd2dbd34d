"""Densities of measured values under learned bands, as compiled loops: plain functions over numbers and arrays."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numba import njit

from rwa_monitor.samples import FloatArray, IntArray

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
    return _density_in(value, math.hypot(soft, std), low, high, soft)


@njit(cache=True, error_model="numpy", nogil=True)
def _density_in(value: float, sigma: float, low: float, high: float, soft: float) -> float:
    """Return `band_density`, the softness and the standard deviation together being `sigma`."""
    width, distance = high - low, abs(value - 0.5 * (low + high))
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


class Spreads(NamedTuple):
    """What a measured value's standard deviation makes of its level's: of the strays, nominal and anomalous band."""

    reach: float
    nominal: float
    anomalous: float


@njit(cache=True, error_model="numpy", nogil=True)
def spreads_of(std: float, numbers: FloatArray) -> Spreads:
    """Return the spreads for a standard deviation; `numbers` as in `level_density`."""
    return Spreads(math.hypot(numbers[7], std), math.hypot(numbers[2], std), math.hypot(numbers[5], std))


@njit(cache=True, error_model="numpy", nogil=True)
def level_density(value: float, spreads: Spreads, numbers: FloatArray) -> tuple[float, float, float]:
    """Return the density of a measured value under nominal and anomalous, and their sum in the learned bands alone.

    Parameters
    ----------
    value, spreads
        What was measured, and what its standard deviation makes of the level's spreads.
    numbers
        float64 (LEVEL_NUMBERS,), see `model.Levels.numbers`.

    Returns
    -------
    nominal, anomalous, inside. See `likelihood.log_densities`.
    """
    low, high, soft = numbers[0], numbers[1], numbers[2]
    anomalous_low, anomalous_high, anomalous_soft = numbers[3], numbers[4], numbers[5]
    stray_share, reach = numbers[6], spreads.reach
    distance = abs(value - 0.5 * (low + high))
    stray = 0.5 / reach / (1.0 + distance / reach) ** 2
    excess = value - (high + 2.0 * soft)
    other = _below(excess / spreads.nominal) / reach / (1.0 + max(excess, 0.0) / reach) ** 2
    nominal = _density_in(value, spreads.nominal, low, high, soft)
    learned, inside = other, nominal
    if not math.isnan(anomalous_low):
        learned = _density_in(value, spreads.anomalous, anomalous_low, anomalous_high, anomalous_soft)
        inside = nominal + learned
    return (
        (1.0 - stray_share) * nominal + stray_share * stray,
        (1.0 - stray_share - OTHER_SIZE) * learned + OTHER_SIZE * other + stray_share * stray,
        inside,
    )


@njit(cache=True, error_model="numpy", nogil=True)
def level_densities(value: FloatArray, std: FloatArray, numbers: FloatArray) -> FloatArray:
    """Return `level_density` of each value, float64 (3, n)."""
    densities = np.empty((3, value.size))
    for i in range(value.size):
        spreads = spreads_of(std[i], numbers)
        densities[0, i], densities[1, i], densities[2, i] = level_density(value[i], spreads, numbers)
    return densities


@njit(cache=True, error_model="numpy", nogil=True)
def sojourn_densities(
    configuration: IntArray, friction: FloatArray, std: FloatArray, shift: FloatArray, numbers: FloatArray
) -> FloatArray:
    """Return the densities of a system's sojourns with a shift added, float64 (2, n, shifts); 1 where nothing is known.

    Parameters
    ----------
    configuration, friction, std
        (n,), of each sojourn.
    shift
        float64 (shifts,).
    numbers
        float64 (configurations, LEVEL_NUMBERS), see `model.AnomalyModel.numbers`.
    """
    densities = np.ones((2, configuration.size, shift.size))
    for i in range(configuration.size):
        q = configuration[i]
        if is_known(q, friction[i], std[i], numbers):
            spreads = spreads_of(std[i], numbers[q])
            for j in range(shift.size):
                nominal, anomalous, _ = level_density(friction[i] + shift[j], spreads, numbers[q])
                densities[0, i, j], densities[1, i, j] = nominal, anomalous
    return densities


@njit(cache=True, error_model="numpy", nogil=True)
def strays(
    configuration: IntArray, value: FloatArray, std: FloatArray, numbers: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """See `likelihood.stray_probabilities`; `numbers` as in `sojourn_densities`."""
    stray, relative = np.empty(value.size), np.empty(value.size)
    known = 0
    for i in range(value.size):
        q = configuration[i]
        if is_known(q, value[i], std[i], numbers):
            nominal, anomalous, inside = level_density(value[i], spreads_of(std[i], numbers[q]), numbers[q])
            everything = 0.5 * (nominal + anomalous)
            stray[known] = max(0.0, 1.0 - 0.5 * inside / everything) if everything > 0.0 else 1.0
            relative[known] = std[i] / numbers[q, -1]
            known += 1
    return stray[:known], relative[:known]


@njit(cache=True, error_model="numpy", nogil=True)
def is_known(q: int, value: float, std: float, numbers: FloatArray) -> bool:
    """Say whether a measured value is finite and its configuration was learned."""
    return bool(math.isfinite(value) and math.isfinite(std) and q < numbers.shape[0] and not math.isnan(numbers[q, 0]))
