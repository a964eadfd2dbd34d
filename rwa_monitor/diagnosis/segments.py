"""Levels between candidates: their likelihood, the slope they share, and where exactly a level changes.

Everything here comes from range sums; no sample is read again.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numba import njit

from rwa_monitor.diagnosis.noise import mean_variance_factor
from rwa_monitor.diagnosis.results import Candidates, NoiseEstimate
from rwa_monitor.diagnosis.running_sums import (
    MOMENTS,
    RunningSums,
    SumArrays,
    moments_between,
    prefix_moments,
)
from rwa_monitor.samples import BoolArray, FloatArray, IntArray

MIN_REACH: Final = 4  # a position is refined by at least this many slots [slots]
MAX_REACH: Final = 32  # and at most by this many [slots]
PREFERENCE: Final = 1e-6  # log-likelihood that a slot nearer to the detected position is worth: decides ties in gaps
# Friction drifts a little in the course of a window (temperature, speed): levels that should be equal are not quite.
LEVEL_SCATTER: Final = 0.15  # in standard deviations of a sample's noise
WEAK_STATISTIC: Final = 9.0  # below three standard deviations the contrast's sign is open


class Level(NamedTuple):
    """The window at given positions of the candidates: all that scores need.

    Attributes
    ----------
    at
        int64 (m,), the positions [slots].
    pairs
        Moments between all pairs of nodes, see `pair_moments`.
    slope, information
        The slope that the segments between accepted candidates share, and its information.
    spread
        Width of the prior of a level.
    jump, jump_variance
        See `jumps_of`.
    """

    at: IntArray
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


@njit(cache=True, error_model="numpy", nogil=True)
def pair_moments(nodes: IntArray, sums: SumArrays) -> FloatArray:
    """Return the moments between all pairs of `nodes`: float64 (6, m + 2, m + 2), zero on and below the diagonal.

    Parameters
    ----------
    nodes
        int64 (m + 2,), the window's begin, the candidates' slots, the window's end; strictly increasing.
    sums
        Running sums of the window.
    """
    table = np.zeros((MOMENTS, nodes.size, nodes.size))
    prefix = [prefix_moments(slot, sums) for slot in nodes]
    for i in range(nodes.size):
        for j in range(i + 1, nodes.size):
            n, x, z, xx, xz, zz = moments_between(prefix[i], prefix[j], sums.centre)
            table[0, i, j], table[1, i, j], table[2, i, j] = n, x, z
            table[3, i, j], table[4, i, j], table[5, i, j] = xx, xz, zz
    return table


@njit(cache=True, error_model="numpy", nogil=True)
def measure_level(
    index: IntArray, nodes: IntArray, sums: SumArrays, slots: int, variance: float, prior_mean: float, prior_std: float
) -> Level:
    """Measure slope, levels and jumps.

    Parameters
    ----------
    index
        int64 (m,), positions of all candidates.
    nodes
        Those accepted, see `nodes_of`.
    sums, slots
        The window's running sums, and its length.
    variance, prior_mean, prior_std
        Of the noise; mean and standard deviation of the slope's Gaussian prior.
    """
    places = np.empty(index.size + 2, dtype=np.int64)
    places[0], places[1:-1], places[-1] = 0, index, slots
    pairs = pair_moments(places, sums)
    slope, information = shared_slope(pairs, nodes, variance, prior_mean, prior_std)
    spread = level_range(levels_of(pairs, nodes, slope), variance)
    jump, jump_variance = jumps_of(pairs, nodes, slope, information, variance)
    return Level(index, pairs, slope, information, spread, jump, jump_variance)


@njit(cache=True, error_model="numpy", nogil=True)
def nodes_of(accepted: IntArray, count: int) -> IntArray:
    """Return the nodes of the segments between the accepted of `count` candidates: these, and both ends of the window.

    int64 (accepted + 2,); candidate j is node j + 1.
    """
    nodes = np.empty(accepted.size + 2, dtype=np.int64)
    nodes[0], nodes[1:-1], nodes[-1] = 0, accepted + 1, count + 1
    return nodes


@njit(cache=True, error_model="numpy", nogil=True)
def chain_of(pairs: FloatArray, nodes: IntArray) -> FloatArray:
    """Pick from the moments of all pairs those of the segments between consecutive `nodes`: float64 (6, segments)."""
    chain = np.empty((pairs.shape[0], nodes.size - 1))
    for i in range(nodes.size - 1):
        chain[:, i] = pairs[:, nodes[i], nodes[i + 1]]
    return chain


@njit(cache=True, error_model="numpy", nogil=True)
def shared_slope(
    pairs: FloatArray, nodes: IntArray, variance: float, prior_mean: float, prior_std: float
) -> tuple[float, float]:
    """Return the slope that the segments between consecutive `nodes` share beside their own levels.

    With its information (inverse variance); `prior_mean` and `prior_std` are those of its Gaussian prior.
    """
    weight = variance / prior_std**2
    sxx, sxz = weight, weight * prior_mean
    for i in range(nodes.size - 1):
        n, x, z, xx, xz, _ = pairs[:, nodes[i], nodes[i + 1]]
        n = max(n, 1.0)
        sxx += xx - x * x / n
        sxz += xz - x * z / n
    return sxz / sxx, sxx / variance


@njit(cache=True, error_model="numpy", nogil=True)
def levels_of(pairs: FloatArray, nodes: IntArray, slope: float) -> FloatArray:
    """Return the level of each segment between consecutive `nodes`, the slope given; NaN where no sample is used."""
    levels = np.full(nodes.size - 1, np.nan)
    for i in range(levels.size):
        n, x, z = pairs[0, nodes[i], nodes[i + 1]], pairs[1, nodes[i], nodes[i + 1]], pairs[2, nodes[i], nodes[i + 1]]
        if n > 0.0:
            levels[i] = (z - slope * x) / n
    return levels


@njit(cache=True, error_model="numpy", nogil=True)
def jumps_of(
    pairs: FloatArray, nodes: IntArray, slope: float, information: float, variance: float
) -> tuple[FloatArray, FloatArray]:
    """Return size and variance of the jump at each candidate, between the accepted candidates beside it, (m,) each.

    The variance holds that of both means, of the slope they share, and of levels that are not quite constant
    (`LEVEL_SCATTER`). Beside a segment without samples the size is 0 and its variance infinite. `nodes` holds the
    accepted candidates, and both ends of the window.
    """
    count = pairs.shape[1] - 2
    jump, spread = np.zeros(count), np.full(count, np.inf)
    scatter = LEVEL_SCATTER**2 * variance
    place = 1  # of the first accepted node at or after the candidate
    for at in range(1, count + 1):
        if nodes[place] < at:
            place += 1
        before, after = nodes[place - 1], nodes[place + 1] if nodes[place] == at else nodes[place]
        left, right = pairs[0, before, at], pairs[0, at, after]
        if left == 0.0 or right == 0.0:
            continue
        speed = pairs[1, at, after] / right - pairs[1, before, at] / left
        friction = pairs[2, at, after] / right - pairs[2, before, at] / left
        jump[at - 1] = friction - slope * speed
        spread[at - 1] = variance * (1.0 / left + 1.0 / right) + speed * speed / information + 2.0 * scatter
    return jump, spread


def level_scatter(variance: float) -> float:
    """Return the variance of levels about what the friction model says, which no number of samples averages out."""
    return LEVEL_SCATTER**2 * variance


@njit(cache=True, error_model="numpy", nogil=True)
def _squared_error(moments: tuple[float, float, float, float, float, float], slope: float) -> float:
    """Return Σ (z - level - slope x)² of a segment about its own level, at a given slope."""
    n, x, z, xx, xz, zz = moments
    y = z - slope * x
    yy = zz - 2.0 * slope * xz + slope * slope * xx
    return max(yy - y * y / max(n, 1.0), 0.0)


@njit(cache=True, error_model="numpy", nogil=True)
def fit_table(pairs: FloatArray, slope: float, variance: float, level_range: float) -> FloatArray:
    """Return the log-likelihood of one level between all pairs of nodes, (m + 2, m + 2).

    The level is integrated out over a flat prior of width `level_range`, which charges each level
    log(range · √(n / 2π variance)): a jump must gain more than its own parameter costs.
    """
    table = np.zeros(pairs.shape[1:])
    for i in range(pairs.shape[1]):
        for j in range(i + 1, pairs.shape[1]):
            n, x, z, xx, xz, zz = pairs[:, i, j]
            if n > 0.0:
                charge = np.log(level_range) - 0.5 * np.log(2.0 * np.pi * variance / n)
                table[i, j] = -_squared_error((n, x, z, xx, xz, zz), slope) / (2.0 * variance) - max(charge, 0.0)
    return table


@njit(cache=True, error_model="numpy", nogil=True)
def level_range(levels: FloatArray, variance: float) -> float:
    """Return the width of the prior of a level: the range seen, at least ten standard deviations of the noise."""
    lowest, highest = np.inf, -np.inf
    for level in levels:
        if np.isfinite(level):
            lowest, highest = min(lowest, level), max(highest, level)
    return max(float(highest - lowest), 10.0 * float(np.sqrt(variance)))


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
    return _refine(np.concatenate(([0], index, [sums.slots])), reach, slope, variance, sums.arrays)


@njit(cache=True, error_model="numpy", nogil=True)
def _refine(nodes: IntArray, reach: IntArray, slope: float, variance: float, sums: SumArrays) -> IntArray:
    """See `refine`; `nodes` are the positions with both ends of the window."""
    refined = nodes[1:-1].copy()
    prefix = [prefix_moments(slot, sums) for slot in nodes]
    for i in range(refined.size):
        left, at, right = nodes[i], nodes[i + 1], nodes[i + 2]
        low = max(left + (at - left) // 2, at - reach[i])  # exclusive unless it is the position itself
        high = min(at + (right - at) // 2, at + reach[i])
        best = -np.inf
        for trial in range(min(low + 1, at), high + 1):
            here = prefix_moments(trial, sums)
            error = _squared_error(moments_between(prefix[i], here, sums.centre), slope)
            error += _squared_error(moments_between(here, prefix[i + 2], sums.centre), slope)
            score = -error / (2.0 * variance) - PREFERENCE * abs(trial - at)
            if score > best:
                best, refined[i] = score, trial
    return refined


@njit(cache=True, error_model="numpy", nogil=True)
def typical_jump(jump: FloatArray) -> float:
    """Return the median size of jumps, those that are finite; 0 without any."""
    sizes = np.abs(jump[np.isfinite(jump)])
    return float(np.median(sizes)) if sizes.size > 0 else 0.0


def reach_of(candidates: Candidates) -> IntArray:
    """Return how far each candidate's position may be off [slots]: half the window that found it."""
    return np.minimum(np.maximum(candidates.scale // 2, MIN_REACH), MAX_REACH)


def possible_signs(candidates: Candidates, pairs: FloatArray, nodes: IntArray, slope: float) -> BoolArray:
    """Return whether the level may fall, may rise at each candidate, bool (m, 2).

    The contrast that found a candidate and the levels between accepted candidates, of which `nodes` tell, usually
    agree; where they do not, or the contrast is weak, both directions stay open.
    """
    return np.asarray(_possible_signs(candidates.statistic, candidates.jump, levels_of(pairs, nodes, slope), nodes))


@njit(cache=True, error_model="numpy", nogil=True)
def _possible_signs(statistic: FloatArray, jump: FloatArray, levels: FloatArray, nodes: IntArray) -> BoolArray:
    """See `possible_signs`; `levels` are those of the segments between consecutive `nodes`."""
    signs = np.empty((jump.size, 2), dtype=np.bool_)
    before, segment = levels[0], 0
    for k in range(jump.size):
        after = before
        if nodes[segment + 1] == k + 1:  # accepted; without samples a segment has the level of the one before it
            segment += 1
            after = levels[segment] if np.isfinite(levels[segment]) else before
        weak = statistic[k] < WEAK_STATISTIC or not np.isfinite(jump[k])
        signs[k, 0] = jump[k] < 0.0 or after - before < 0.0 or weak
        signs[k, 1] = jump[k] > 0.0 or after - before > 0.0 or weak
        before = after
    return signs
