"""The noise of a record, estimated from the record itself without being misled by jumps or slow effects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.ndimage import median_filter

from rwa_monitor.samples import BoolArray, FloatArray

ENOUGH: Final = 20_000  # differences at a lag: their median is then known to a per cent
MAX_LAG: Final = 96  # slots: AR(1) with φ = 0.95 has forgotten 99 % by then
LONGEST_QUIET: Final = 8  # lags that do not stand out, between those that belong to lag 0 and others that do
MEDIAN_OF_ABSOLUTE_NORMAL: Final = 0.674489750196082
CLIP_AT: Final = 4.0  # standard deviations; 6e-5 of Gaussian samples lie beyond
OUTLIER_NEIGHBOURHOOD: Final = 7  # slots; what lasts four slots or more is a level, not an outlier


@dataclass(frozen=True, slots=True)
class Noise:
    """Noise of the friction torque.

    Attributes
    ----------
    std
        Standard deviation of one sample [N m].
    autocovariance
        float64 (MAX_LAG + 1,) at lags 0, 1, …, zero from where it cannot be distinguished from zero [N² m²].
    long_run_variance
        Largest variance of a mean of m samples, times m, over all m up to MAX_LAG [N² m²]; std² for white noise.
    """

    std: float
    autocovariance: FloatArray
    long_run_variance: float


def estimate_noise(pieces: Sequence[FloatArray]) -> Noise:
    """Estimate the noise from the robust variogram γ(h) = ½ var(z_{k+h} - z_k) of contiguous pieces.

    Medians of absolute differences: a jump touches h of n differences, a slow effect changes little over a few slots.
    The sill (γ at the longest lags) is the variance, sill - γ(h) the autocovariance (Cressie & Hawkins 1980 on robust
    variograms).

    Parameters
    ----------
    pieces
        float64 (n,) each.
    """
    size, longest = sum(piece.size for piece in pieces), max(piece.size for piece in pieces)
    most, stride = min(MAX_LAG, max(longest // 4, 2)), max(size // ENOUGH, 1)

    def half_variance(lag: int) -> float:
        pairs = [(piece[lag::stride], piece[:-lag:stride]) for piece in pieces if piece.size > lag]
        differences = np.concatenate([after - before for after, before in pairs])
        return float(0.5 * (np.median(np.abs(differences)) / MEDIAN_OF_ABSOLUTE_NORMAL) ** 2)

    gamma = np.array([half_variance(lag) for lag in range(1, most + 1)])
    # Medians do not see tails; differences of neighbours, of which a jump touches one, show how much they add.
    gamma *= tail_factor(np.concatenate([np.diff(piece) for piece in pieces]))
    # Where slow waves are left, differences over long lags exceed the spread of the values themselves.
    spread = float(np.mean(np.concatenate([piece - piece.mean() for piece in pieces]) ** 2))
    sill = min(float(np.median(gamma[-max(most // 4, 1) :])), spread)
    covariance = np.pad(sill - np.append(0.0, gamma), (0, MAX_LAG - most))
    # A robust variance has a relative error of about 1.65·√(2/n); beyond the last lag that stands out all is zero.
    stands_out = np.flatnonzero(np.abs(covariance[: most + 1]) > 4.0 * 1.65 * np.sqrt(2.0 / size) * sill)
    apart = np.diff(stands_out, prepend=0, append=np.inf) > LONGEST_QUIET
    covariance[int(np.append(0, stands_out)[np.argmax(apart)]) + 1 :] = 0.0
    return Noise(max(float(np.sqrt(sill)), 1e-300), covariance, max(long_run_variance(covariance), 1e-300))


def long_run_variance(covariance: FloatArray) -> float:
    """Return the largest variance of a mean of m samples, times m: R₀ + 2 Σ (1 - h/m) R_h, of R at lags from 0 on."""
    h = np.arange(1, covariance.size)
    means = range(1, 4 * max(covariance.size - 1, 1))
    return max(float(covariance[0] + 2 * np.sum(np.clip(1 - h / m, 0, None) * covariance[1:])) for m in means)


def tail_factor(values: FloatArray) -> float:
    """Return the winsorised variance of values over the variance implied by their median; 1 for Gaussian ones."""
    scale = float(np.median(np.abs(values))) / MEDIAN_OF_ABSOLUTE_NORMAL
    if scale <= 0:
        return 1.0
    clipped = np.clip(values / scale, -CLIP_AT, CLIP_AT)
    return float(np.mean(clipped**2))


def clip_outliers(values: FloatArray, std: float) -> tuple[FloatArray, BoolArray]:
    """Pull single samples that stand far off their neighbours back to CLIP_AT standard deviations from them.

    Returns
    -------
    clipped, outliers
        The values, and a mask of those that were pulled back.
    """
    middle = median_filter(values, size=OUTLIER_NEIGHBOURHOOD, mode="nearest")
    clipped = np.clip(values, middle - CLIP_AT * std, middle + CLIP_AT * std)
    return clipped, clipped != values
