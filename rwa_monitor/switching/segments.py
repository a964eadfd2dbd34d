"""Levels between candidates: their likelihood, the slope they share, and where exactly a level changes.

Everything here comes from range sums; no sample is read again.
"""

from typing import Final, NamedTuple

import numpy as np

from rwa_monitor.changepoints.noise import mean_variance_factor, median_size
from rwa_monitor.changepoints.running_sums import RunningSums
from rwa_monitor.changepoints.stage_results import Candidates, NoiseEstimate
from rwa_monitor.kernels.segments import refine_nodes
from rwa_monitor.samples import BoolArray, FloatArray, IntArray

REACH: Final = (4, 32)  # by how many slots a position is refined at least and at most
LEVEL_SCATTER: Final = 0.15  # of levels that should be equal, in standard deviations of a sample's noise
WEAK_STATISTIC: Final = 9.0  # below three standard deviations the contrast's sign is open


class Level(NamedTuple):
    """The window at given positions of the candidates: all that scores need.

    Attributes
    ----------
    at
        int64 (m,), the positions [slots].
    nodes
        int64, the nodes of the segments between accepted candidates: both ends of the window, j + 1 of candidate j.
    pairs
        float64 (6, m + 2, m + 2), sufficient statistics between all pairs of nodes; zero on and below the diagonal.
    slope, information
        The slope that the segments between accepted candidates share beside their own levels, and its information (the
        inverse of its variance), with a Gaussian prior.
    spread
        Width of the prior of a level.
    jump, jump_variance
        float64 (m,), of the jump at each candidate between the accepted nodes beside it; 0 and inf beside a segment
        without samples.
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
    """Return the variance by which squared errors are scaled: that of a mean of n samples, times n, at its largest n.

    White noise gives σ²; AR(1) its long-run variance; noise from differencing, whose long means are much quieter than
    its short ones, the variance of the short ones, so that no short run of noise passes for a level.
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
        Of the noise; mean and standard deviation of the slope's Gaussian prior.
    """
    nodes = np.concatenate(([0], accepted + 1, [index.size + 1]))
    slots = np.concatenate(([0], index, [sums.slots]))
    between = sums.between(np.repeat(slots, slots.size), np.tile(slots, slots.size)).table
    pairs = between.reshape(6, slots.size, slots.size)
    n, x, z, xx, xz = pairs[:5, nodes[:-1], nodes[1:]]
    n, weight = np.maximum(n, 1.0), variance / (prior_std * prior_std)
    # Added up in order: the last digit must not depend on how many there are.
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

    The variance holds that of both means, of their slope, and of levels that are not quite constant.
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
    """Return the variance of levels about the friction model's, which no number of samples averages out."""
    return LEVEL_SCATTER**2 * variance


def refine(sums: RunningSums, index: IntArray, reach: IntArray, slope: float, variance: float) -> IntArray:
    """Move each changepoint to the slot near it that splits its two neighbouring intervals best.

    Parameters
    ----------
    sums
        Running sums of the window.
    index
        int64 (m,), positions, strictly increasing.
    reach
        int64 (m,), how far each may move; never beyond half way to a neighbour, so that none meet.
    slope, variance
        Shared slope and variance of the noise.
    """
    return refine_nodes(np.concatenate(([0], index, [sums.slots])), reach, slope, variance, sums.arrays)


def typical_jump(jump: FloatArray) -> float:
    """Return the median size of jumps, those that are finite; 0 without any."""
    return median_size(jump[np.isfinite(jump)])


def reach_of(candidates: Candidates) -> IntArray:
    """Return how far each candidate's position may be off [slots]: half the window that found it."""
    return np.clip(candidates.scale // 2, *REACH)


def possible_signs(candidates: Candidates, level: Level) -> BoolArray:
    """Return whether the level may fall, may rise at each candidate, bool (m, 2).

    The contrast that found a candidate and the levels between accepted candidates usually agree; where they do not, or
    the contrast is weak, both directions stay open.
    """
    levels = levels_of(level.pairs, level.nodes, level.slope)
    # Without samples a segment has the level of the one before it.
    seen = np.maximum.accumulate(np.where(np.isfinite(levels), np.arange(levels.size), 0))
    step = np.zeros(len(candidates))
    step[level.nodes[1:-1] - 1] = np.diff(levels[seen])
    weak = (candidates.statistic < WEAK_STATISTIC) | ~np.isfinite(candidates.jump)
    return np.stack([(d * candidates.jump > 0.0) | (d * step > 0.0) | weak for d in (-1.0, 1.0)], axis=1)
