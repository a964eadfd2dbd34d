"""Stage 2: friction of the intervals between changepoints, by least squares (paper, section IV-B).

z = level of the interval + f_v x + noise, one level for each interval, one slope for all. The matrix HᵀH of this
problem is an arrow (diagonal in the levels, one row for the slope), so the slope comes from the sums of all intervals
about their own means, and the levels follow: O(m) from the running sums, without a matrix (errata 6).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rwa_monitor.diagnosis.noise import mean_variance_factor
from rwa_monitor.diagnosis.results import Estimate, Evidence, NoiseEstimate
from rwa_monitor.diagnosis.running_sums import Moments, RunningSums
from rwa_monitor.physics.wheel import Wheel
from rwa_monitor.samples import BoolArray, FloatArray, IntArray


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
    first = np.concatenate((np.zeros(1, dtype=np.int64), index))
    end = np.concatenate((index, np.full(1, slots, dtype=np.int64)))
    most = (end - first) // 4
    start = first.copy()
    stop = end.copy()
    start[1:] += np.minimum(exclude, most[1:])
    stop[:-1] -= np.minimum(exclude, most[:-1])
    return start, stop


def interval_moments(sums: RunningSums, slots: int, index: IntArray, exclude: IntArray) -> Moments:
    """Return the moments of the m + 1 intervals; one whose kept part has no used sample gets all its slots."""
    start, stop = interval_bounds(slots, index, exclude)
    moments = sums.between(start, stop)
    if (moments.n > 0).all():
        return moments
    nothing = np.zeros_like(index)
    whole_start, whole_stop = interval_bounds(slots, index, nothing)
    empty = moments.n == 0
    return sums.between(np.where(empty, whole_start, start), np.where(empty, whole_stop, stop))


def default_exclusion(scale: IntArray) -> IntArray:
    """Return Δk_error = w/2 slots of the detecting scale (errata 6)."""
    return scale // 2


def contrast_variance(noise: NoiseEstimate, left: FloatArray, right: FloatArray) -> FloatArray:
    """Return the variance of the difference of two means over `left` and `right` neighbouring samples."""
    variance = noise.std**2
    return variance * (mean_variance_factor(noise, left) / left + mean_variance_factor(noise, right) / right)


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
    margin = np.broadcast_to(np.asarray(exclude, dtype=np.int64), index.shape)
    moments = interval_moments(evidence.sums, evidence.slots, index, margin)
    noise = evidence.noise
    variance = noise.std**2

    seen = moments.n > 0
    n = np.where(seen, moments.n, 1.0)
    x_mean, z_mean = moments.x / n, moments.z / n
    sxx = np.maximum(moments.xx - moments.x * x_mean, 0.0)
    sxz = moments.xz - moments.x * z_mean
    szz = np.maximum(moments.zz - moments.z * z_mean, 0.0)
    slope, slope_std = _slope(moments, sxx, sxz, noise, prior)

    level = z_mean - slope * x_mean
    with np.errstate(invalid="ignore"):  # 0 · inf: an interval at zero speed does not feel an unknown slope
        shared = np.nan_to_num(x_mean**2 * slope_std**2, nan=0.0, posinf=np.inf)
    level_variance = np.where(seen, variance * mean_variance_factor(noise, n) / n + shared, np.inf)
    level = _fill_unseen(level, seen)

    left, right = n[:-1], n[1:]
    jump = np.where(seen[1:] & seen[:-1], level[1:] - level[:-1], 0.0)
    # The fall of log-likelihood, -ΔSSE/2σ² for white noise, with the variance that the shorter interval's mean has.
    colour = mean_variance_factor(noise, np.minimum(left, right))
    cost = -0.5 * jump**2 * left * right / (left + right) / (variance * colour)

    squared_error = float((szz - 2.0 * slope * sxz + slope**2 * sxx)[seen].sum())
    total = float(moments.n.sum())
    rmse = float(np.sqrt(max(squared_error, 0.0) / total)) if total else 0.0
    return Estimate(
        index=index,
        level=level,
        level_std=np.sqrt(level_variance),
        viscous=slope,
        viscous_std=slope_std,
        rejection_cost=cost,
        rmse=rmse,
        excess_rmse=rmse - noise.std if total else 0.0,
    )


def estimate_slope(
    evidence: Evidence, index: IntArray, exclude: IntArray | int = 0, prior: SlopePrior | None = None
) -> tuple[float, float]:
    """Return the shared slope and its standard deviation alone; parameters as those of `estimate`."""
    margin = np.broadcast_to(np.asarray(exclude, dtype=np.int64), index.shape)
    moments = interval_moments(evidence.sums, evidence.slots, index, margin)
    share = 1.0 / np.maximum(moments.n, 1.0)
    sxx = np.maximum(moments.xx - moments.x**2 * share, 0.0)
    sxz = moments.xz - moments.x * moments.z * share
    return _slope(moments, sxx, sxz, evidence.noise, prior)


def _slope(
    moments: Moments, sxx: FloatArray, sxz: FloatArray, noise: NoiseEstimate, prior: SlopePrior | None
) -> tuple[float, float]:
    """Return the slope and its standard deviation from the intervals' sums about their means and the prior."""
    variance = noise.std**2 * noise.long_run_factor
    information, covariance = float(sxx.sum()), float(sxz.sum())
    # Below this, S_xx is the rounding of Σx²: the speed is constant in every interval.
    if information <= 1e-11 * float(moments.xx.sum()):
        information, covariance = 0.0, 0.0
    if prior is not None:
        weight = variance / prior.std**2
        information, covariance = information + weight, covariance + weight * prior.mean
    if information == 0.0:
        return 0.0, np.inf
    return covariance / information, float(np.sqrt(variance / information))


def _fill_unseen(level: FloatArray, seen: BoolArray) -> FloatArray:
    """Give intervals without samples the level of the last seen one before them, or the first one after."""
    places = np.flatnonzero(seen)
    if places.size == 0:
        return np.zeros_like(level)
    last = np.searchsorted(places, np.arange(level.size), side="right") - 1
    return level[places[np.maximum(last, 0)]]


def jump_std(evidence: Evidence, estimate_: Estimate, exclude: IntArray | int = 0) -> FloatArray:
    """Return the standard deviation of each jump, float64 (m,): the slope's share is common to both levels.

    Parameters
    ----------
    evidence, estimate_, exclude
        The window, its estimate, and the exclusion it was made with.
    """
    margin = np.broadcast_to(np.asarray(exclude, dtype=np.int64), estimate_.index.shape)
    moments = interval_moments(evidence.sums, evidence.slots, estimate_.index, margin)
    n = np.maximum(moments.n, 1.0)
    x_mean = moments.x / n
    own = contrast_variance(evidence.noise, n[:-1], n[1:])
    step = np.square(np.diff(x_mean))
    with np.errstate(invalid="ignore"):
        shared = np.nan_to_num(step * estimate_.viscous_std**2, nan=0.0, posinf=np.inf)
    blind = (moments.n[:-1] == 0) | (moments.n[1:] == 0)
    return np.where(blind, np.inf, np.sqrt(own + shared))
