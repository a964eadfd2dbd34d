"""Stage 2: friction of the intervals between changepoints, by least squares (paper, section IV-B).

z = level of the interval + f_v x + noise, one level for each interval, one slope for all. The matrix HᵀH of this
problem is an arrow (diagonal in the levels, one row for the slope), so the slope comes from the sums of all intervals
about their own means, and the levels follow: O(m) from the running sums, without a matrix (errata 6).
"""

import math
from typing import Final, NamedTuple

import numpy as np

from rwa_monitor.changepoints.noise import mean_variance_factor
from rwa_monitor.changepoints.running_sums import RunningSums
from rwa_monitor.changepoints.stage_results import Candidates, Estimate, Evidence, NoiseEstimate
from rwa_monitor.kernels.running_sums import slope_within
from rwa_monitor.samples import BoolArray, FloatArray, IntArray
from rwa_monitor.wheel.wheel import Wheel


class SlopePrior(NamedTuple):
    """Gaussian prior of the viscous coefficient, before the window is seen; normalised.

    Attributes
    ----------
    mean, std
        Centre and standard deviation; NaN where nothing is known.
    """

    mean: float = math.nan
    std: float = math.nan


FLAT_PRIOR: Final = SlopePrior()
# A viscous anomaly raises f_v by tens of per cent; the prior must not mask it where the window identifies f_v.
NOMINAL_SLOPE_SPREAD: Final = 0.3  # [of the nominal coefficient]


def nominal_viscous(wheel: Wheel) -> float | None:
    """Return the nominal viscous coefficient in normalised units (1 in the paper), None where it is not known."""
    if wheel.nominal is None:
        return None
    return wheel.nominal.viscous_Nm_s_rad * wheel.speed_unit_rad_s / wheel.torque_unit_Nm


def nominal_slope_prior(wheel: Wheel, spread: float = NOMINAL_SLOPE_SPREAD) -> SlopePrior:
    """Return the prior of f_v from the wheel's nominal values; `FLAT_PRIOR` where it has none."""
    nominal = nominal_viscous(wheel)
    # A wheel may have next to no viscous friction; a tenth of the nominal dry torque then sets the spread.
    return FLAT_PRIOR if nominal is None else SlopePrior(nominal, spread * max(nominal, 0.1))


def estimate(evidence: Evidence, index: IntArray, prior: SlopePrior = FLAT_PRIOR) -> Estimate:
    """Estimate the level of each interval and the shared slope.

    Parameters
    ----------
    evidence
        The window.
    index
        int64 (m,), changepoints, strictly ascending, within 1 … slots - 1.
    prior
        Prior of the slope. Needed where the window does not identify it (constant speed).

    Returns
    -------
    Estimate. An interval without any used sample takes the level of its left neighbour (the first: the right one's),
    with infinite standard deviation. Where neither the data nor a prior determine the slope, it is 0 with infinite
    standard deviation, and the levels' standard deviations are infinite wherever the mean speed is not zero.
    """
    index = np.asarray(index, dtype=np.int64)
    noise, whole = evidence.noise, np.zeros(index.size, dtype=np.int64)  # no slots are excluded around a changepoint
    variance = noise.std**2 * noise.long_run_factor
    slope, slope_std = slope_within(evidence.slots, index, whole, evidence.sums.arrays, variance, *prior)
    count, x, z, xx, xz, zz = evidence.sums.intervals(index)
    seen, n = count > 0.0, np.maximum(count, 1.0)
    mean_variance = mean_variance_factor(noise, n) / n
    x_mean, z_mean = x / n, z / n
    sxx, sxz = np.maximum(xx - x * x_mean, 0.0), xz - x * z_mean
    errors = np.maximum(zz - z * z_mean, 0.0) - 2.0 * slope * sxz + slope * slope * sxx
    level = z_mean - slope * x_mean
    # At zero mean speed the slope does not affect the level, even if its standard deviation is infinite.
    felt = np.where(x_mean != 0.0, slope_std, 0.0)
    step = np.diff(x_mean)
    shared = step * step * np.where(step != 0.0, slope_std, 0.0) ** 2
    jump_std = np.sqrt(noise.std**2 * (mean_variance[:-1] + mean_variance[1:]) + shared)
    level_std = np.sqrt(noise.std**2 * mean_variance + x_mean * x_mean * felt * felt)
    total = float(count.sum())
    rmse = math.sqrt(max(float(np.cumsum(errors)[-1]), 0.0) / total) if total else 0.0
    levels = filled(seen, level, level_std, jump_std)
    return Estimate(index, *levels, viscous=slope, viscous_std=slope_std, rmse=rmse)


def filled(
    seen: BoolArray, level: FloatArray, level_std: FloatArray, jump_std: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return levels and standard deviations as `Estimate` has them, given which intervals hold a used sample.

    Any other takes the level of the last interval before it that holds one, or else of the first.
    """
    place = np.maximum.accumulate(np.where(seen, np.arange(seen.size), np.argmax(seen)))
    both = seen[:-1] & seen[1:]
    return level[place], np.where(seen, level_std, np.inf), np.where(both, jump_std, np.inf)


# ---- residuals of short blocks, from running sums: no sample is read again -------------------------------------------


class Blocks(NamedTuple):
    """Blocks of equal length, in order; arrays (blocks,).

    Attributes
    ----------
    size
        Slots of a block.
    n
        Used samples of each.
    x
        Their mean speed, normalised.
    friction
        Their mean friction less the viscous part, normalised.
    residual
        The same less the mean of the usable blocks in their interval.
    interval
        Number of the interval between changepoints that the block lies in.
    usable
        Whether it lies in one interval and at least half of its slots are used.
    intervals
        Number of intervals.
    """

    size: int
    n: FloatArray
    x: FloatArray
    friction: FloatArray
    residual: FloatArray
    interval: IntArray
    usable: BoolArray
    intervals: int


def residual_blocks(evidence: Evidence, estimate: Estimate, size: int) -> Blocks:
    """Cut a window into blocks and return each block's residual of the friction model.

    Parameters
    ----------
    evidence, estimate
        The window, and its levels and slope between the accepted changepoints.
    size
        Slots of a block; with a multiple of the running sums' stride no sample is read. An incomplete block at the
        window's end is left out.
    """
    index, count = estimate.index, estimate.index.size + 1
    edges = size * np.arange(evidence.slots // size + 1)
    used, x, z = evidence.sums.between(edges[:-1], edges[1:])[:3]
    n = np.maximum(used, 1.0)
    friction = (z - estimate.viscous * x) / n
    interval = np.searchsorted(index, edges[:-1], side="right")
    usable = (used >= size // 2) & (interval == np.searchsorted(index, edges[1:]))
    # The level is computed from the usable blocks: `estimate.level` also averages the samples of blocks that a jump
    # cuts, which would offset all residuals of an interval alike.
    total, level = (np.bincount(interval, usable * n * values, count) for values in (np.ones(n.size), friction))
    residual = friction - (level / np.maximum(total, 1.0))[interval]
    return Blocks(size, n, x / n, friction, residual, interval, usable, count)


# ---- levels between candidates, while it is not decided which of them are jumps: from range sums alone ---------------


LEVEL_SCATTER: Final = 0.15  # of levels that should be equal, in standard deviations of a sample's noise


class Level(NamedTuple):
    """Statistics of the window for given positions of the candidates: all that the scores of paths need.

    Attributes
    ----------
    at
        int64 (m,), the positions [slots].
    nodes
        int64, the nodes that bound the segments between accepted candidates: 0 and m + 1 for the window's ends, j + 1
        for candidate j.
    pairs
        float64 (6, m + 2, m + 2), sufficient statistics between all pairs of nodes; zero on and below the diagonal.
    slope, information
        Slope common to the segments between accepted candidates, each of which has its own level, and its information
        (inverse variance); both include the Gaussian prior.
    spread
        Width of the prior of a level.
    jump, jump_variance
        float64 (m,), size and variance of the jump at each candidate, measured between the adjacent accepted nodes; 0
        and inf where a side has no samples.
    """

    at: IntArray
    nodes: IntArray
    pairs: FloatArray
    slope: float
    information: float
    spread: float
    jump: FloatArray
    jump_variance: FloatArray


def effective_variance(noise: NoiseEstimate) -> float:
    """Return the variance by which squared errors are scaled: n·Var(mean of n samples), maximised over n.

    White noise gives σ²; AR(1) its long-run variance; noise from differencing, whose long means scatter much less than
    its short ones, that of the short ones, so that no short run of noise is mistaken for a level.
    """
    longest = 2 * noise.autocovariance.size
    factor = mean_variance_factor(noise, np.arange(1.0, longest + 1.0)) if noise.autocovariance[0] > 0 else np.ones(1)
    return float(noise.std**2 * max(1.0, noise.long_run_factor, float(factor.max())))


def measure_level(
    index: IntArray, accepted: IntArray, sums: RunningSums, variance: float, prior_mean: float, prior_std: float
) -> Level:
    """Measure slope, levels and jumps.

    Parameters
    ----------
    index
        int64 (m,), positions of all candidates.
    accepted
        Which of these are jumps.
    sums
        The window's running sums.
    variance, prior_mean, prior_std
        Variance of the noise; mean and standard deviation of the slope's Gaussian prior.
    """
    nodes = np.concatenate(([0], accepted + 1, [index.size + 1]))
    slots = np.concatenate(([0], index, [sums.slots]))
    pairs = sums.between(*np.meshgrid(slots, slots, indexing="ij"))
    n, x, z, xx, xz = pairs[:5, nodes[:-1], nodes[1:]]
    n, weight = np.maximum(n, 1.0), variance / (prior_std * prior_std)
    # `cumsum` adds in order: unlike in a pairwise sum, rounding does not depend on the number of terms.
    sxx = float(np.cumsum([weight, *(xx - x * x / n)])[-1])
    slope = float(np.cumsum([weight * prior_mean, *(xz - x * z / n)])[-1]) / sxx
    levels = levels_of(pairs, nodes, slope)
    seen = levels[np.isfinite(levels)]
    spread = max(float(np.ptp(seen)) if seen.size else 0.0, 10.0 * float(np.sqrt(variance)))
    information = sxx / variance
    return Level(index, nodes, pairs, slope, information, spread, *jumps_of(pairs, nodes, slope, information, variance))


def jumps_of(
    pairs: FloatArray, nodes: IntArray, slope: float, information: float, variance: float
) -> tuple[FloatArray, FloatArray]:
    """Return size and variance of the jump at each candidate, see `Level`.

    The variance is that of both means, plus those of the slope and of levels that are not quite constant.
    """
    at = np.arange(1, pairs.shape[1] - 1)
    left, x_left, z_left = pairs[:3, nodes[np.searchsorted(nodes, at) - 1], at]
    right, x_right, z_right = pairs[:3, at, nodes[np.searchsorted(nodes, at, side="right")]]
    seen, left, right = (left > 0.0) & (right > 0.0), np.maximum(left, 1.0), np.maximum(right, 1.0)
    speed, friction = x_right / right - x_left / left, z_right / right - z_left / left
    spread = variance * (1.0 / left + 1.0 / right) + speed * speed / information + 2.0 * level_scatter(variance)
    return np.where(seen, friction - slope * speed, 0.0), np.where(seen, spread, np.inf)


def levels_of(pairs: FloatArray, nodes: IntArray, slope: float) -> FloatArray:
    """Return the level of each segment between consecutive `nodes`, the slope given; NaN where no sample is used."""
    n, x, z = pairs[:3, nodes[:-1], nodes[1:]]
    return np.where(n > 0.0, (z - slope * x) / np.maximum(n, 1.0), np.nan)


def level_scatter(variance: float) -> float:
    """Return the variance of the true levels about the friction model's, which no number of samples averages out."""
    return LEVEL_SCATTER**2 * variance


def possible_signs(candidates: Candidates, level: Level) -> BoolArray:
    """Return for each candidate whether the level may fall there, and whether it may rise, bool (m, 2).

    The contrast that found a candidate and the levels between accepted candidates usually agree in sign; where they do
    not, both directions are allowed.
    """
    levels = levels_of(level.pairs, level.nodes, level.slope)
    # A segment without samples takes the level of the one before it.
    seen = np.maximum.accumulate(np.where(np.isfinite(levels), np.arange(levels.size), 0))
    step = np.zeros(len(candidates))
    step[level.nodes[1:-1] - 1] = np.diff(levels[seen])
    return np.stack([(d * candidates.jump > 0.0) | (d * step > 0.0) for d in (-1.0, 1.0)], axis=1)
