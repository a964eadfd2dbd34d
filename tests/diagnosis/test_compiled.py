"""The kernels of the stages after detection against the same in plain numpy, over the samples themselves."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from rwa_monitor.changepoints.estimation import estimate, residual_blocks
from rwa_monitor.changepoints.noise import mean_variance_factor
from rwa_monitor.changepoints.stage_results import Evidence, NoiseEstimate
from rwa_monitor.kernels.segments import LEVEL_SCATTER, PREFERENCE, jumps_of, pair_moments
from rwa_monitor.switching import segments
from tests.switching.assignment_windows import NO_CANDIDATES, NO_STRUCTURE, sums_of

SLOTS, STD, SLOPE = 4_000, 0.05, 0.8
INDEX = np.array([320, 1_003, 1_040, 2_500, 3_900])


@pytest.fixture
def record() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """x, z and used of a window with five jumps, a tenth of its samples masked."""
    rng = np.random.default_rng(71)
    x = 0.6 + 0.3 * np.sin(np.arange(SLOTS) / 300.0)
    level = np.concatenate([[1.0], 1.0 + np.cumsum([0.4, -0.3, 0.5, -0.6, 0.2])])
    z = level[np.searchsorted(INDEX, np.arange(SLOTS), side="right")] + SLOPE * x + STD * rng.standard_normal(SLOTS)
    return x, z, rng.random(SLOTS) > 0.1


def _evidence(x: np.ndarray, z: np.ndarray, used: np.ndarray) -> Evidence:
    noise, count = NoiseEstimate(STD, np.array([STD**2, 0.0]), 1.0), int(used.sum())
    return Evidence(SLOTS, count, count, NO_CANDIDATES, sums_of(x, z, used), noise, 20.0, NO_STRUCTURE)


def _error(values: np.ndarray) -> float:
    return float(((values - values.mean()) ** 2).sum()) if values.size else 0.0


def test_jumps_and_levels_are_those_of_the_samples(record):
    x, z, used = record
    pairs = pair_moments(np.concatenate([[0], INDEX, [SLOTS]]), sums_of(x, z, used).arrays)
    nodes = np.array([0, 1, 3, 6])  # the first and the third candidate are accepted
    borders = np.concatenate([[0], INDEX, [SLOTS]])
    residual = np.where(used, z - SLOPE * x, np.nan)
    levels = segments.levels_of(pairs, nodes, SLOPE)
    plain = [np.nanmean(residual[borders[a] : borders[b]]) for a, b in pairwise(nodes)]
    assert levels == pytest.approx(plain, rel=1e-10)
    jump, variance = jumps_of(pairs, nodes, SLOPE, 1e4, STD**2)
    for k, (before, after) in enumerate([(0, 3), (1, 3), (1, 6), (3, 6), (3, 6)], start=1):
        left, right = slice(borders[before], borders[k]), slice(borders[k], borders[after])
        assert jump[k - 1] == pytest.approx(np.nanmean(residual[right]) - np.nanmean(residual[left]), rel=1e-9)
        apart = x[right][used[right]].mean() - x[left][used[left]].mean()
        own = STD**2 * (1.0 / used[left].sum() + 1.0 / used[right].sum() + 2.0 * LEVEL_SCATTER**2)
        assert variance[k - 1] == pytest.approx(own + apart**2 / 1e4, rel=1e-9)


def test_positions_are_refined_to_the_least_error(record):
    x, z, used = record
    index, reach = INDEX + np.array([7, -9, 5, 20, -3]), np.array([8, 16, 16, 32, 32])
    refined = segments.refine(sums_of(x, z, used), index, reach, SLOPE, STD**2)
    residual, borders = z - SLOPE * x, np.concatenate([[0], index, [SLOTS]])
    for i, at in enumerate(index):
        left, right = borders[i], borders[i + 2]
        low = max(left + (at - left) // 2, at - reach[i])
        high = min(at + (right - at) // 2, at + reach[i])
        trials = [k for k in range(low, high + 1) if k > low or k == at]
        cost = [
            (_error(residual[left:k][used[left:k]]) + _error(residual[k:right][used[k:right]])) / (2.0 * STD**2)
            + PREFERENCE * abs(k - at)
            for k in trials
        ]
        assert refined[i] == trials[int(np.argmin(cost))]


def test_residual_blocks_are_those_of_the_samples(record):
    x, z, used = record
    evidence, size = _evidence(x, z, used), 64
    fit = estimate(evidence, INDEX)
    blocks = residual_blocks(evidence, fit, size)
    residual = z - fit.viscous * x
    inside = {int(k // size) for k in INDEX if k % size}
    for b in range(SLOTS // size):
        there = slice(b * size, (b + 1) * size)
        assert blocks.usable[b] == (b not in inside and used[there].sum() >= size // 2)
        assert blocks.friction[b] == pytest.approx(residual[there][used[there]].mean(), rel=1e-10)
        assert blocks.interval[b] == int((-(-INDEX // size) <= b).sum())
    for i in range(INDEX.size + 1):
        own = blocks.usable & (blocks.interval == i)
        assert np.sum(blocks.n[own] * blocks.residual[own]) == pytest.approx(0.0, abs=1e-9)


def test_variance_of_a_mean_is_the_double_sum_over_its_samples():
    covariance = np.array([1.0, 0.6, 0.0, -0.2, 0.1, 0.0])
    long_run = 1.0 + 2.0 * covariance[1:].sum()
    counts = np.array([1.0, 2.0, 3.0, 4.0, 7.0, 40.0])
    factors = mean_variance_factor(NoiseEstimate(1.0, covariance, long_run), counts)
    for n, factor in zip(counts.astype(int).tolist(), factors, strict=True):
        apart = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
        of_pairs = np.where(apart < covariance.size, covariance[np.minimum(apart, covariance.size - 1)], 0.0)
        assert factor == pytest.approx(of_pairs.sum() / n, rel=1e-12)
