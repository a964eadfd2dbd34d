"""Levels between candidates: their likelihood, the slope they share, and where exactly a level changes.

Everything here comes from range sums; no sample is read again.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from rwa_monitor.diagnosis.estimation import SlopePrior
from rwa_monitor.diagnosis.noise import mean_variance_factor
from rwa_monitor.diagnosis.results import Candidates, Moments, NoiseEstimate, RangeSums
from rwa_monitor.samples import BoolArray, FloatArray, IntArray

MIN_REACH: Final = 4  # a position is refined by at least this many slots [slots]
MAX_REACH: Final = 32  # and at most by this many [slots]
PREFERENCE: Final = 1e-6  # log-likelihood that a slot nearer to the detected position is worth: decides ties in gaps
# Friction drifts a little in the course of a window (temperature, speed): levels that should be equal are not quite.
LEVEL_SCATTER: Final = 0.15  # in standard deviations of a sample's noise
WEAK_STATISTIC: Final = 9.0  # below three standard deviations the contrast's sign is open


def effective_variance(noise: NoiseEstimate) -> float:
    """Return the variance by which squared errors are scaled: that of a mean of n samples, times n, at its largest n.

    White noise gives σ²; AR(1) its long-run variance; noise from differencing, whose long means are much quieter than
    its short ones, the variance of the short ones, so that no short run of noise passes for a level.
    """
    longest = 2 * noise.autocovariance.size
    factor = mean_variance_factor(noise, np.arange(1.0, longest + 1.0)) if noise.autocovariance[0] > 0 else np.ones(1)
    return float(noise.std**2 * max(1.0, noise.long_run_factor, float(factor.max())))


def pair_moments(sums: RangeSums, index: IntArray, slots: int) -> Moments:
    """Return the moments between all pairs of nodes: arrays (m + 2, m + 2), zero on and below the diagonal."""
    nodes = np.concatenate([[0], index, [slots]]).astype(np.int64)
    first, last = np.triu_indices(nodes.size, k=1)
    found = sums.between(nodes[first], nodes[last])

    def spread(values: FloatArray) -> FloatArray:
        table = np.zeros((nodes.size, nodes.size))
        table[first, last] = values
        return table

    return Moments(*(spread(np.asarray(v)) for v in (found.n, found.x, found.z, found.xx, found.xz, found.zz)))


def chain_of(moments: Moments, nodes: IntArray) -> Moments:
    """Pick from the moments of all pairs those of the segments between consecutive `nodes`."""
    at = (nodes[:-1], nodes[1:])
    return Moments(*(v[at] for v in (moments.n, moments.x, moments.z, moments.xx, moments.xz, moments.zz)))


def shared_slope(segments: Moments, variance: float, prior: SlopePrior) -> tuple[float, float]:
    """Return the slope that the segments share beside their own levels, and its information (inverse variance)."""
    n = np.maximum(segments.n, 1.0)
    weight = variance / prior.std**2
    sxx = float(np.sum(segments.xx - segments.x**2 / n)) + weight
    sxz = float(np.sum(segments.xz - segments.x * segments.z / n)) + weight * prior.mean
    return sxz / sxx, sxx / variance


def levels_of(segments: Moments, slope: float) -> FloatArray:
    """Return the level of each segment at a given slope; NaN where it has no used sample."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray((segments.z - slope * segments.x) / segments.n)


def jumps_of(
    moments: Moments, accepted: IntArray, slope: float, information: float, variance: float
) -> tuple[FloatArray, FloatArray]:
    """Return size and variance of the jump at each candidate, between the accepted candidates beside it, (m,) each.

    The variance holds that of both means, of the slope they share, and of levels that are not quite constant
    (`LEVEL_SCATTER`). Beside a segment without samples the size is 0 and its variance infinite.
    """
    count = moments.n.shape[0] - 2
    at = np.arange(1, count + 1)
    nodes = np.concatenate([[0], accepted + 1, [count + 1]])
    place = np.searchsorted(nodes, at, side="left")
    before = nodes[place - 1]
    after = nodes[np.searchsorted(nodes, at, side="right")]
    n = np.stack([moments.n[before, at], moments.n[at, after]])
    seen = np.maximum(n, 1.0)
    x = np.stack([moments.x[before, at], moments.x[at, after]]) / seen
    z = np.stack([moments.z[before, at], moments.z[at, after]]) / seen
    jump = (z[1] - z[0]) - slope * (x[1] - x[0])
    spread = variance * (1.0 / seen).sum(axis=0) + (x[1] - x[0]) ** 2 / information
    blind = (n == 0).any(axis=0)
    return np.where(blind, 0.0, jump), np.where(blind, np.inf, spread + 2.0 * level_scatter(variance))


def level_scatter(variance: float) -> float:
    """Return the variance of levels about what the friction model says, which no number of samples averages out."""
    return LEVEL_SCATTER**2 * variance


def squared_error(segments: Moments, slope: float) -> FloatArray:
    """Return Σ (z - level - slope x)² of each segment about its own level, at a given slope."""
    y = segments.z - slope * segments.x
    yy = segments.zz - 2.0 * slope * segments.xz + slope**2 * segments.xx
    return np.maximum(yy - y**2 / np.maximum(segments.n, 1.0), 0.0)


def fit_table(moments: Moments, slope: float, variance: float, level_range: float) -> FloatArray:
    """Return the log-likelihood of one level between all pairs of nodes, (m + 2, m + 2).

    The level is integrated out over a flat prior of width `level_range`, which charges each level
    log(range · √(n / 2π variance)): a jump must gain more than its own parameter costs.
    """
    charge = np.log(level_range) - 0.5 * np.log(2.0 * np.pi * variance / np.maximum(moments.n, 1.0))
    return -squared_error(moments, slope) / (2.0 * variance) - np.where(moments.n > 0, np.maximum(charge, 0.0), 0.0)


def level_range(levels: FloatArray, variance: float) -> float:
    """Return the width of the prior of a level: the range seen, at least ten standard deviations of the noise."""
    seen = levels[np.isfinite(levels)]
    spread = float(np.ptp(seen)) if seen.size else 0.0
    return max(spread, 10.0 * float(np.sqrt(variance)))


def refine(sums: RangeSums, index: IntArray, reach: IntArray, slots: int, slope: float, variance: float) -> IntArray:
    """Move each changepoint to the slot near it that splits its two neighbouring intervals best.

    Parameters
    ----------
    sums
        Range sums of the window.
    index
        int64 (m,), positions, strictly increasing.
    reach
        int64 (m,), how far each may move; never beyond half way to a neighbour, so that none meet.
    slots
        Length of the window.
    slope, variance
        Shared slope and variance of the noise.
    """
    if index.size == 0:
        return index
    left = np.concatenate([[0], index[:-1]])
    right = np.concatenate([index[1:], [slots]])
    offset = np.arange(-int(reach.max()), int(reach.max()) + 1)
    trial = index[:, None] + offset[None, :]
    low = np.maximum(left + (index - left) // 2, index - reach)[:, None]  # exclusive unless it is the index itself
    high = np.minimum(index + (right - index) // 2, index + reach)[:, None]
    allowed = ((trial > low) & (trial <= high)) | (offset[None, :] == 0)
    safe = np.where(allowed, trial, index[:, None])
    before = sums.between(np.broadcast_to(left[:, None], safe.shape).copy(), safe)
    after = sums.between(safe, np.broadcast_to(right[:, None], safe.shape).copy())
    error = squared_error(before, slope) + squared_error(after, slope)
    score = np.where(allowed, -error / (2.0 * variance) - PREFERENCE * np.abs(offset), -np.inf)
    return np.asarray(safe[np.arange(index.size), np.argmax(score, axis=1)], dtype=np.int64)


def reach_of(candidates: Candidates) -> IntArray:
    """Return how far each candidate's position may be off [slots]: half the window that found it."""
    return np.clip(candidates.scale // 2, MIN_REACH, MAX_REACH).astype(np.int64)


def possible_signs(candidates: Candidates, levels: FloatArray) -> BoolArray:
    """Return whether the level may fall, may rise at each candidate, bool (m, 2).

    The contrast that found a candidate and the intervals between neighbouring candidates usually agree; where they do
    not, or the contrast is weak, both directions stay open.
    """
    step = np.diff(levels)
    weak = (candidates.statistic < WEAK_STATISTIC) | ~np.isfinite(candidates.jump)
    falls = (candidates.jump < 0) | (step < 0) | weak
    rises = (candidates.jump > 0) | (step > 0) | weak
    return np.stack([falls, rises], axis=1)
