"""The segmentation against brute force: dynamic programming, and least squares for every set of jumps."""

from collections.abc import Callable
from itertools import chain, combinations
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rwa_monitor.discrepancy.base_fit import segment, segment_correlated
from rwa_monitor.kernels.segmentation import decafs, fpop, optimal_curves
from tests.discrepancy.smooth import remembering

Array = np.ndarray[Any, np.dtype[np.float64]]


def least_cost(n: int, penalty: float, least: Callable[[int, int], float]) -> float:
    """Optimal partitioning over all last jumps, O(n²) (Jackson et al. 2005); `least`: the cost of a piece."""
    best = [-penalty]
    for t in range(1, n + 1):
        best.append(min(best[a] + penalty + least(a, t) for a in range(t)))
    return best[n]


def cost(z: Array, jumps: Any, penalty: float) -> float:
    pieces = np.split(z, jumps)
    return float(sum(np.sum((piece - piece.mean()) ** 2) for piece in pieces)) + penalty * len(jumps)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 150), penalty=st.floats(0.5, 20.0))
def test_short_sequences_are_segmented_as_by_brute_force(seed: int, n: int, penalty: float) -> None:
    rng = np.random.default_rng(seed)
    z = rng.normal(size=n) + np.cumsum((rng.random(n) < 0.05) * rng.normal(0, 3, n))
    s, q = np.append(0.0, np.cumsum(z)).tolist(), np.append(0.0, np.cumsum(z * z)).tolist()
    best = least_cost(n, penalty, lambda a, b: q[b] - q[a] - (s[b] - s[a]) ** 2 / (b - a))
    assert cost(z, segment(z, penalty), penalty) == pytest.approx(best, rel=1e-9, abs=1e-9)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 60), penalty=st.floats(0.5, 20.0), keep=st.floats(0.5, 1.0))
def test_levels_and_relaxing_curves_are_parted_as_by_brute_force(
    seed: int, n: int, penalty: float, keep: float
) -> None:
    rng = np.random.default_rng(seed)
    z = rng.normal(size=n) + np.cumsum((rng.random(n) < 0.1) * rng.normal(0, 4, n))
    x = np.full(n, 1.0) if keep < 1.0 else rng.normal(size=n)  # of each sample, in units of its own place

    def least(a: int, b: int) -> float:
        design = np.stack([np.ones(b - a), x[a:b] * keep ** np.arange(b - a)], axis=1)
        left = [float(np.sum((z[a:b] - d @ np.linalg.lstsq(d, z[a:b])[0]) ** 2)) for d in (design[:, :1], design)]
        return min(left[0], left[1] + penalty)

    found = optimal_curves(np.stack([np.ones(n), x, z, x * x, x * z, z * z]), np.full(n, keep), penalty)
    edges = [0, *found.tolist(), n]
    best = least_cost(n, penalty, least)
    assert sum(map(least, edges, edges[1:])) + penalty * found.size == pytest.approx(best, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_blocks_and_refinement_find_the_jumps_of_the_exact_search(seed: int) -> None:
    # Jumps of 3 σ, 60 slots or more apart, far above the penalty: both searches must find each, and the refined
    # place must be the exact one, as both maximise the same contrast.
    rng = np.random.default_rng(seed)
    steps = np.zeros(4000)
    steps[rng.choice(np.arange(30, 3970, 60), 12, replace=False)] = rng.choice([-3.0, 3.0], 12)
    z, penalty = rng.normal(size=4000) + np.cumsum(steps), 3 * np.log(4000)
    exact = fpop(z, np.ones(z.size), penalty)
    assert segment(z, penalty).tolist() == exact.tolist()
    assert exact.size == 12


@pytest.mark.parametrize("seed", range(5))
def test_blocks_cost_little_more_than_the_exact_search(seed: int) -> None:
    # A smooth trend has no true jumps, so places may differ; a jump that is off by half a block (2 slots) of height h
    # costs at most 2 h², here far below one penalty for all jumps together.
    rng = np.random.default_rng(seed)
    z = rng.normal(size=3000) + 3 * np.sin(np.arange(3000) / 300)
    penalty = 3 * np.log(z.size)
    exact = fpop(z, np.ones(z.size), penalty)
    assert cost(z, segment(z, penalty), penalty) <= cost(z, exact, penalty) + penalty


def test_a_sojourn_shorter_than_a_block_is_found_where_it_is_high_enough() -> None:
    z = np.random.default_rng(3).normal(size=4000)
    z[1234:1237] += 20.0  # 3 slots of 20 σ: 1200 against two penalties of 25
    found = segment(z, 3 * np.log(z.size))
    assert found.tolist() == [1234, 1237]


def least_squares(z: Array, phi: Array, v: Array, jumps: Any) -> float:
    """The least cost over all levels for given jumps, from the dense quadratic form of the levels."""
    n = z.size
    whiten = (np.eye(n) - np.diag(phi[1:], -1)) / np.sqrt(v)[:, None]
    levels = np.eye(len(jumps) + 1)[np.searchsorted(jumps, np.arange(n), side="right")]
    rows, target = whiten @ levels, whiten @ z
    residual = target - rows @ np.linalg.solve(rows.T @ rows, rows.T @ target)
    return float(residual @ residual)


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    n=st.integers(1, 8),
    gap=st.sampled_from([1, 1, 3, 30, 500]),
    penalty=st.floats(0.01, 10.0),
)
def test_correlated_noise_is_segmented_as_by_all_sets_of_jumps(seed: int, n: int, gap: int, penalty: float) -> None:
    rng = np.random.default_rng(seed)
    phi = rng.uniform(-0.98, 0.98, n) ** np.where(rng.random(n) < 0.2, gap, 1)
    v = rng.uniform(0.1, 3.0, n)
    z = rng.normal(size=n) + np.cumsum((rng.random(n) < 0.3) * rng.normal(0, 5, n))
    sets = chain.from_iterable(combinations(range(1, n), count) for count in range(n))
    best = min(least_squares(z, phi, v, jumps) + penalty * len(jumps) for jumps in sets)
    found = segment_correlated(z, phi, v, penalty).tolist()
    assert least_squares(z, phi, v, found) + penalty * len(found) == pytest.approx(best, rel=1e-8, abs=1e-12)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 3000), penalty=st.floats(1.0, 30.0))
def test_without_correlation_it_is_the_plain_segmentation(seed: int, n: int, penalty: float) -> None:
    rng = np.random.default_rng(seed)
    z = rng.normal(size=n) + np.cumsum((rng.random(n) < 0.01) * rng.normal(0, 3, n))
    weight = rng.uniform(0.5, 2.0, n)
    assert decafs(z, np.zeros(n), 1 / weight, penalty).tolist() == fpop(z, weight, penalty).tolist()
    variance = np.full(n, 2.5)
    plain = fpop(z, np.ones(n), 2.5 * penalty)
    assert segment_correlated(z, np.zeros(n), variance, penalty).tolist() == plain.tolist()


@pytest.mark.parametrize("seed", range(3))
def test_a_search_that_must_be_repeated_is_exact(seed: int) -> None:
    # Under a swing and a low penalty, the first cut-off is too low. One jump more or less must not be better.
    n, fresh = 150, 1 - 0.95**2  # the innovations' share of the variance
    phi, v = np.full(n, 0.95), np.append(1 / fresh, np.ones(n - 1))
    z = remembering(n, 0.95, np.random.default_rng(seed)) / np.sqrt(fresh) + 100 * np.sin(np.arange(n) / 20)
    found = segment_correlated(z, phi, v, 2.0).tolist()
    best = least_squares(z, phi, v, found)
    for k in set(range(1, n)) ^ set(found):
        assert least_squares(z, phi, v, sorted([*found, k])) + 2.0 >= best
    for k in found:
        assert least_squares(z, phi, v, [j for j in found if j != k]) - 2.0 >= best
