"""Stage 2: friction of the intervals between changepoints, by least squares (paper, section IV-B).

z = level of the interval + f_v x + noise, one level for each interval, one slope for all. The matrix HᵀH of this
problem is an arrow (diagonal in the levels, one row for the slope), so the slope comes from the sums of all intervals
about their own means, and the levels follow: O(m) from the running sums, without a matrix (errata 6).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from rwa_monitor.diagnosis.noise import mean_variance_factors
from rwa_monitor.diagnosis.results import Estimate, Evidence, NoiseEstimate
from rwa_monitor.diagnosis.running_sums import MOMENTS, Moments, RunningSums, SumArrays, range_moments
from rwa_monitor.physics.wheel import Wheel
from rwa_monitor.samples import FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class SlopePrior:
    """What is known of the viscous coefficient before the window: Gaussian, normalised.

    Attributes
    ----------
    mean, std
        Centre and standard deviation.
    """

    mean: float
    std: float


# A viscous anomaly raises f_v by tens of per cent; the prior must not hide it from a window that can show it.
NOMINAL_SLOPE_SPREAD = 0.3  # [of the nominal coefficient]


def nominal_viscous(wheel: Wheel) -> float | None:
    """Return the nominal viscous coefficient in normalised units (1 in the paper), None where it is not known."""
    if wheel.nominal is None:
        return None
    return wheel.nominal.viscous_Nm_s_rad * wheel.speed_unit_rad_s / wheel.torque_unit_Nm


def nominal_slope_prior(wheel: Wheel) -> SlopePrior | None:
    """Return the prior of f_v that the wheel's nominal values give, None where there are none."""
    nominal = nominal_viscous(wheel)
    if nominal is None:
        return None
    # A wheel may have no viscous friction to speak of; the dry torque at nominal speed then sets the spread.
    return SlopePrior(nominal, NOMINAL_SLOPE_SPREAD * max(nominal, 0.1))


@njit(cache=True, error_model="numpy", nogil=True)
def interval_bounds(slots: int, index: IntArray, exclude: IntArray) -> tuple[IntArray, IntArray]:
    """Return first slot and end of the m + 1 intervals, without the slots around each changepoint.

    Parameters
    ----------
    slots
        Length of the window.
    index
        int64 (m,), changepoints, ascending.
    exclude
        int64 (m,), slots left out on each side of each changepoint (Δk_error of the paper). At least half of every
        interval stays: an interval gives at most a quarter of its slots at each end.

    Returns
    -------
    start, stop
        int64 (m + 1,).
    """
    start, stop = np.empty(index.size + 1, dtype=np.int64), np.empty(index.size + 1, dtype=np.int64)
    for i in range(start.size):
        start[i] = index[i - 1] if i > 0 else 0
        stop[i] = index[i] if i < index.size else slots
        most = (stop[i] - start[i]) // 4
        if i > 0:
            start[i] += min(exclude[i - 1], most)
        if i < index.size:
            stop[i] -= min(exclude[i], most)
    return start, stop


def interval_moments(sums: RunningSums, slots: int, index: IntArray, exclude: IntArray) -> Moments:
    """Return the moments of the m + 1 intervals; one whose kept part has no used sample gets all its slots."""
    return Moments(_interval_moments(slots, index, exclude, sums.arrays))


@njit(cache=True, error_model="numpy", nogil=True)
def _interval_moments(slots: int, index: IntArray, exclude: IntArray, sums: SumArrays) -> FloatArray:
    """See `interval_moments`; float64 (6, m + 1)."""
    start, stop = interval_bounds(slots, index, exclude)
    table = np.empty((MOMENTS, start.size))
    range_moments(start, stop, slots, sums, table)
    for i in range(start.size):
        if table[0, i] == 0.0:
            first = index[i - 1 : i] if i > 0 else np.zeros(1, dtype=np.int64)
            last = index[i : i + 1] if i < index.size else np.full(1, slots)
            range_moments(first, last, slots, sums, table[:, i : i + 1])
    return table


@njit(cache=True, error_model="numpy", nogil=True)
def default_exclusion(scale: IntArray) -> IntArray:
    """Return Δk_error = w/2 slots of the detecting scale (errata 6)."""
    return scale // 2


def estimate(
    evidence: Evidence, index: IntArray, exclude: IntArray | int = 0, prior: SlopePrior | None = None
) -> Estimate:
    """Estimate the level of each interval, the shared slope and what it would cost to drop each changepoint.

    Parameters
    ----------
    evidence
        The window.
    index
        int64 (m,), changepoints, strictly ascending, within 1 … slots - 1.
    exclude
        Slots left out on each side of each changepoint, int64 (m,) or one number for all; see `default_exclusion`.
    prior
        What is known of the slope. Needed where the window cannot show it (constant speed).

    Returns
    -------
    Estimate. An interval without any used sample takes the level of its left neighbour (the first: the right one's),
    with infinite standard deviation. Where neither the data nor a prior say anything about the slope, it is 0 with
    infinite standard deviation, and the levels' standard deviations are infinite wherever the speed is not zero.
    """
    index = np.asarray(index, dtype=np.int64)
    margin = np.full(index.size, exclude, dtype=np.int64)
    moments = interval_moments(evidence.sums, evidence.slots, index, margin)
    noise = evidence.noise
    slope, slope_std = _slope(moments, noise, prior)
    level, level_std, cost, squared_error = _levels(
        moments.table, slope, slope_std, noise.std**2, noise.autocovariance, noise.long_run_factor
    )
    total = float(moments.n.sum())
    rmse = float(np.sqrt(max(squared_error, 0.0) / total)) if total else 0.0
    return Estimate(
        index=index,
        level=level,
        level_std=level_std,
        viscous=slope,
        viscous_std=slope_std,
        rejection_cost=cost,
        rmse=rmse,
        excess_rmse=rmse - noise.std if total else 0.0,
    )


@njit(cache=True, error_model="numpy", nogil=True)
def _levels(
    moments: FloatArray,
    slope: float,
    slope_std: float,
    variance: float,
    autocovariance: FloatArray,
    long_run_factor: float,
) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Return level and standard deviation of each interval, the rejection costs, and the sum of squared residuals.

    Parameters
    ----------
    moments
        float64 (6, intervals).
    slope, slope_std
        Of all intervals.
    variance, autocovariance, long_run_factor
        See `NoiseEstimate`.
    """
    count = moments.shape[1]
    level, level_std = np.full(count, np.nan), np.full(count, np.inf)
    factor = mean_variance_factors(moments[0], autocovariance, long_run_factor)
    squared_error = 0.0
    for i in range(count):
        n, x, z, xx, xz, zz = moments[:, i]
        if n == 0.0:
            continue
        x_mean, z_mean = x / n, z / n
        sxx, sxz, szz = max(xx - x * x_mean, 0.0), xz - x * z_mean, max(zz - z * z_mean, 0.0)
        squared_error += szz - 2.0 * slope * sxz + slope * slope * sxx
        level[i] = z_mean - slope * x_mean
        # An interval at zero speed does not feel the slope, however unknown.
        shared = x_mean * x_mean * slope_std * slope_std if x_mean != 0.0 else 0.0
        level_std[i] = np.sqrt(variance * factor[i] / n + shared)
    cost = np.zeros(count - 1)
    shorter = np.maximum(np.minimum(moments[0, :-1], moments[0, 1:]), 1.0)
    colour = mean_variance_factors(shorter, autocovariance, long_run_factor)
    for i in range(count - 1):
        left, right = moments[0, i], moments[0, i + 1]
        if left > 0.0 and right > 0.0:
            # The fall of log-likelihood, -ΔSSE/2σ² for white noise, with the variance of the shorter interval's mean.
            jump = level[i + 1] - level[i]
            cost[i] = -0.5 * jump * jump * left * right / (left + right) / (variance * colour[i])
    _fill_unseen(level)
    return level, level_std, cost, squared_error


@njit(cache=True, error_model="numpy", nogil=True)
def _fill_unseen(level: FloatArray) -> None:
    """Give intervals without samples, NaN, the level of the last seen one before them, or of the first after."""
    known = 0.0
    for i in range(level.size - 1, -1, -1):
        if not np.isnan(level[i]):
            known = level[i]
    for i in range(level.size):
        if np.isnan(level[i]):
            level[i] = known
        known = level[i]


def _slope(moments: Moments, noise: NoiseEstimate, prior: SlopePrior | None) -> tuple[float, float]:
    """Return the slope and its standard deviation from the intervals' sums about their means and the prior."""
    mean, std = (np.nan, np.nan) if prior is None else (prior.mean, prior.std)
    slope, slope_std = _slope_of(moments.table, noise.std**2 * noise.long_run_factor, mean, std)
    return slope, slope_std


@njit(cache=True, error_model="numpy", nogil=True)
def slope_within(
    slots: int,
    index: IntArray,
    exclude: IntArray,
    sums: SumArrays,
    variance: float,
    prior_mean: float,
    prior_std: float,
) -> tuple[float, float]:
    """Return the shared slope and its standard deviation from the slots so far, see `estimate`; for compiled code.

    Parameters
    ----------
    slots, index, exclude, sums
        Slots in the sums, changepoints, and slots left out on each side of each, int64 (m,).
    variance
        Of the noise, in the long run.
    prior_mean, prior_std
        What is known of the slope; NaN where nothing is.
    """
    moments = _interval_moments(slots, index, exclude, sums)
    return _slope_of(moments, variance, prior_mean, prior_std)


@njit(cache=True, error_model="numpy", nogil=True)
def _slope_of(moments: FloatArray, variance: float, prior_mean: float, prior_std: float) -> tuple[float, float]:
    """Return the slope and its standard deviation of the intervals; parameters as those of `slope_within`."""
    information, covariance = _pooled(moments)
    if not np.isnan(prior_std):
        weight = variance / prior_std**2
        information, covariance = information + weight, covariance + weight * prior_mean
    if information == 0.0:
        return 0.0, np.inf
    return covariance / information, np.sqrt(variance / information)


@njit(cache=True, error_model="numpy", nogil=True)
def _pooled(moments: FloatArray) -> tuple[float, float]:
    """Return S_xx and S_xz of all intervals about their own means; both 0 where speed is constant in each."""
    sxx = sxz = xx = 0.0
    for i in range(moments.shape[1]):
        share = 1.0 / max(moments[0, i], 1.0)
        sxx += max(moments[3, i] - moments[1, i] * moments[1, i] * share, 0.0)
        sxz += moments[4, i] - moments[1, i] * moments[2, i] * share
        xx += moments[3, i]
    # Below this, S_xx is the rounding of Σx².
    return (sxx, sxz) if sxx > 1e-11 * xx else (0.0, 0.0)


def jump_std(evidence: Evidence, estimate_: Estimate, exclude: IntArray | int = 0) -> FloatArray:
    """Return the standard deviation of each jump, float64 (m,): the slope's share is common to both levels.

    Parameters
    ----------
    evidence, estimate_, exclude
        The window, its estimate, and the exclusion it was made with.
    """
    margin = np.full(estimate_.index.size, exclude, dtype=np.int64)
    moments = interval_moments(evidence.sums, evidence.slots, estimate_.index, margin)
    noise = evidence.noise
    return np.asarray(
        _jump_std(moments.table, estimate_.viscous_std, noise.std**2, noise.autocovariance, noise.long_run_factor)
    )


@njit(cache=True, error_model="numpy", nogil=True)
def _jump_std(
    moments: FloatArray, slope_std: float, variance: float, autocovariance: FloatArray, long_run_factor: float
) -> FloatArray:
    """See `jump_std`; parameters as those of `_levels`."""
    std = np.full(moments.shape[1] - 1, np.inf)
    n = np.maximum(moments[0], 1.0)
    factor = mean_variance_factors(n, autocovariance, long_run_factor)
    for i in range(std.size):
        if moments[0, i] > 0.0 and moments[0, i + 1] > 0.0:
            own = variance * (factor[i] / n[i] + factor[i + 1] / n[i + 1])
            step = moments[1, i + 1] / n[i + 1] - moments[1, i] / n[i]
            shared = step * step * slope_std**2 if step != 0.0 else 0.0  # however unknown the slope
            std[i] = np.sqrt(own + shared)
    return std
