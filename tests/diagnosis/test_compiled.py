"""The kernels of the stages after detection against the same in plain numpy, over the samples themselves."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy import special

from rwa_monitor.changepoints.estimation import Blocks, estimate, residual_blocks
from rwa_monitor.changepoints.noise import mean_variance_factor
from rwa_monitor.changepoints.stage_results import Evidence, NoiseEstimate
from rwa_monitor.diagnosis.adequacy import FEWEST_BLOCKS, LARGEST_BLOCK, PERSISTENCE_LAGS, persistence
from rwa_monitor.diagnosis.model import built_in_model
from rwa_monitor.kernels.laws import OTHER_SIZE, densities
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


def test_pair_moments_are_the_sums_between_all_pairs(record):
    sums, nodes = sums_of(*record), np.concatenate([[0], INDEX, [SLOTS]])
    pairs = pair_moments(nodes, sums.arrays)
    first, last = np.triu_indices(nodes.size, k=1)
    assert pairs[:, first, last].tobytes() == sums.between(nodes[first], nodes[last]).table.tobytes()
    assert not pairs[:, last, first].any()


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


def test_persistence_is_that_of_plain_loops():
    rng = np.random.default_rng(72)
    count, intervals = 300, 4
    interval = np.sort(rng.integers(0, intervals, count))
    residual, usable = rng.standard_normal(count) * 0.1, rng.random(count) > 0.2
    n = np.where(usable, 16.0, 1.0)
    blocks = Blocks(16, n, np.zeros(count), residual, residual, interval, usable, intervals)
    assert usable.sum() > FEWEST_BLOCKS
    value = residual * np.sqrt(n)
    scale = np.median(np.abs(value[usable])) / special.ndtri(0.75)
    value = np.clip(value / scale, -LARGEST_BLOCK, LARGEST_BLOCK)
    products, pairs = np.zeros((2, len(PERSISTENCE_LAGS), intervals))
    for row, lag in enumerate(PERSISTENCE_LAGS):
        for b in range(count - lag):
            if usable[b] and usable[b + lag] and interval[b] == interval[b + lag]:
                products[row, interval[b]] += value[b] * value[b + lag] + 1.0 / usable[interval == interval[b]].sum()
                pairs[row, interval[b]] += 1.0
    worst = np.argmax(np.square(products).sum(axis=0))
    products, pairs = np.delete(products, worst, axis=1).sum(axis=1), np.delete(pairs, worst, axis=1).sum(axis=1)
    significance, size = persistence(blocks, 0.0)
    assert significance == pytest.approx((products**2 / pairs).sum(), rel=1e-9)
    assert size == pytest.approx(scale * np.sqrt(np.abs(products / pairs).max() / 16), rel=1e-9)


def test_level_densities_are_those_of_the_formula():
    rng = np.random.default_rng(73)
    for anomaly in built_in_model().anomalies:
        for levels in anomaly.levels:
            if levels is None:
                continue
            value, std = rng.uniform(-1.0, 6.0, 50), rng.uniform(1e-4, 0.5, 50)
            reach = np.hypot(levels.reach, std)
            stray = 0.5 / reach / (1.0 + np.abs(value - levels.nominal.middle) / reach) ** 2
            excess = value - levels.nominal_high
            other = special.ndtr(excess / np.hypot(levels.nominal.soft, std)) / reach
            other /= (1.0 + np.maximum(excess, 0.0) / reach) ** 2
            bands = [band for band in (levels.nominal, levels.anomalous) if band is not None]
            inside = [_softened(band.low, band.high, band.soft, value, std) for band in bands]
            learned = inside[1] if levels.anomalous else other
            level = np.zeros(50, dtype=np.int64)
            nominal, anomalous, alone = densities(level, value, std, np.zeros(1), levels.numbers[None])[:, :, 0]
            assert nominal == pytest.approx((1 - levels.stray) * inside[0] + levels.stray * stray, rel=1e-9)
            expected = (1 - levels.stray - OTHER_SIZE) * learned + OTHER_SIZE * other + levels.stray * stray
            assert anomalous == pytest.approx(expected, rel=1e-9)
            assert alone == pytest.approx(np.maximum(1 - sum(inside) / (nominal + anomalous), 0.0), abs=1e-9)


def _softened(low: float, high: float, soft: float, value: np.ndarray, std: np.ndarray) -> np.ndarray:
    """Density of a uniform value on [low, high] with Gaussian noise."""
    sigma, middle = np.hypot(soft, std), 0.5 * (low + high)
    if high - low < 1e-3 * soft:
        return np.exp(-0.5 * ((value - middle) / sigma) ** 2) / (sigma * np.sqrt(2 * np.pi))
    distance, half = np.abs(value - middle), 0.5 * (high - low)
    return (special.ndtr((half - distance) / sigma) - special.ndtr((-half - distance) / sigma)) / (high - low)


def test_variance_of_a_mean_is_the_double_sum_over_its_samples():
    covariance = np.array([1.0, 0.6, 0.0, -0.2, 0.1, 0.0])
    long_run = 1.0 + 2.0 * covariance[1:].sum()
    counts = np.array([1.0, 2.0, 3.0, 4.0, 7.0, 40.0])
    factors = mean_variance_factor(NoiseEstimate(1.0, covariance, long_run), counts)
    for n, factor in zip(counts.astype(int).tolist(), factors, strict=True):
        apart = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
        of_pairs = np.where(apart < covariance.size, covariance[np.minimum(apart, covariance.size - 1)], 0.0)
        assert factor == pytest.approx(of_pairs.sum() / n, rel=1e-12)
