"""Section IV-B, friction estimation: Y = H [F f_v]ᵀ + v by least squares, and the cost of rejecting a changepoint.

HᵀH is an arrow matrix: the number of samples n_i of each interval on its diagonal, Σω_k of each interval in the last
row and column, Σω_k² in the corner. So f_v follows from the sums about the intervals' means, and F_i from f_v
(errata 6).
"""

import math
from typing import Final

import numpy as np

from rwa_monitor.changepoints.estimation import filled
from rwa_monitor.changepoints.noise import FALSE_POSITIVE, mean_variance_factor
from rwa_monitor.changepoints.stage_results import Estimate, NoiseEstimate
from rwa_monitor.paper.detection import SCALE, Signal
from rwa_monitor.samples import BoolArray, FloatArray, IntArray

LEAST_SPREAD: Final = 1e-11  # of Σω²: a smaller Σ(ω - ω̄)² is rounding, and f_v is not identifiable


def estimate(signal: Signal, index: IntArray, noise: NoiseEstimate, w: int = SCALE) -> tuple[Estimate, FloatArray]:
    """Estimate the level of each interval and the shared viscous coefficient.

    Parameters
    ----------
    signal, noise
        The window's samples and the estimate of its noise.
    index
        int64 (N_cp,), changepoints, ascending.
    w
        Half-width by which they were found [samples].

    Returns
    -------
    friction
        F̂ and f̂_v with their standard deviations. An interval without a used sample has the level of the one before
        it. Where f_v is not identifiable, it is 0 with infinite standard deviation.
    rejection
        float64 (N_cp,), c_rjct: change of the log-likelihood when the intervals on both sides of a changepoint merge.
    """
    interval = np.searchsorted(index, np.arange(signal.x.size), side="right")
    used = away_from_changepoints(signal.used, interval, index, w // 2)
    x, z, place = signal.x[used], signal.z[used], interval[used]
    count = np.bincount(place, minlength=index.size + 1)
    seen, n = count > 0, np.maximum(count, 1)
    x_mean, z_mean = (np.bincount(place, value, index.size + 1) / n for value in (x, z))
    x_apart, z_apart = x - x_mean[place], z - z_mean[place]
    s_xx = float(x_apart @ x_apart)
    slope, slope_std = 0.0, np.inf
    if s_xx > LEAST_SPREAD * float(x @ x):
        slope, slope_std = float(x_apart @ z_apart) / s_xx, noise.std * np.sqrt(noise.long_run_factor / s_xx)
    level = z_mean - slope * x_mean
    mean_variance = noise.std**2 * mean_variance_factor(noise, n) / n
    level_std = np.sqrt(mean_variance + _times(x_mean, slope_std) ** 2)
    jump_std = np.sqrt(mean_variance[:-1] + mean_variance[1:] + _times(np.diff(x_mean), slope_std) ** 2)
    rmse = math.sqrt(np.mean((z_apart - slope * x_apart) ** 2)) if x.size else 0.0
    levels = filled(seen, level, level_std, jump_std)
    friction = Estimate(index, *levels, viscous=slope, viscous_std=float(slope_std), rmse=rmse)
    return friction, rejection(n, level, noise, seen[:-1] & seen[1:])


def away_from_changepoints(used: BoolArray, interval: IntArray, index: IntArray, error: int) -> BoolArray:
    """Return the used samples outside Δk_error around each changepoint; in an interval without any, all used ones.

    At each end of an interval no more than a quarter of it is excluded.

    Parameters
    ----------
    used, interval
        bool (n,) and int64 (n,), for each sample whether it is used and in which interval it lies.
    index
        int64 (N_cp,), changepoints.
    error
        Δk_error = w/2 [samples], on each side of a changepoint.
    """
    far = used.copy()
    edges = np.concatenate(([0], index, [used.size]))
    for first, at, end in zip(edges[:-2], edges[1:-1], edges[2:], strict=True):
        left = min(error, (at - first) // 4)
        right = min(error, (end - at) // 4)
        far[at - left : at + right] = False
    left_over = np.bincount(interval[far], minlength=index.size + 1)
    return np.where(left_over[interval] > 0, far, used)


def rejection(n: IntArray, level: FloatArray, noise: NoiseEstimate, both: BoolArray) -> FloatArray:
    """Return c_rjct of each changepoint: the change of -SSE/2σ² when its intervals merge, and log P(false positive).

    The sum of squared errors grows by n_i n_{i+1} / (n_i + n_{i+1}) · (F_i - F_{i+1})²; with n_i = (HᵀH)_ii (errata 7:
    sign and logarithm corrected). The logarithm alone where not `both` intervals hold samples.
    """
    left, right = n[:-1], n[1:]
    variance = noise.std**2 * mean_variance_factor(noise, np.minimum(left, right))
    with np.errstate(divide="ignore", invalid="ignore"):  # without noise
        merged = -0.5 * np.diff(level) ** 2 * left * right / (left + right) / variance
    return np.where(both, merged, 0.0) + math.log(FALSE_POSITIVE)


def _times(speed: FloatArray, slope_std: float) -> FloatArray:
    """Return |speed| · slope_std; 0 at zero speed, even if slope_std is infinite."""
    return np.abs(speed) * np.where(speed != 0.0, slope_std, 0.0)
