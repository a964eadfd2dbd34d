"""The segmentation against brute-force dynamic programming."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rwa_monitor.discrepancy.segmentation import segment
from rwa_monitor.kernels.segmentation import fpop

Array = np.ndarray[Any, np.dtype[np.float64]]


def brute_force(z: Array, penalty: float) -> list[int]:
    """Optimal partitioning over all last jumps, O(n²) (Jackson et al. 2005)."""
    n = z.size
    s, q = np.concatenate([[0.0], np.cumsum(z)]), np.concatenate([[0.0], np.cumsum(z * z)])
    best, last = np.full(n + 1, np.inf), np.zeros(n + 1, int)
    best[0] = -penalty
    for t in range(1, n + 1):
        tau = np.arange(t)
        cost = best[:t] + penalty + (q[t] - q[tau]) - (s[t] - s[tau]) ** 2 / (t - tau)
        last[t], best[t] = int(cost.argmin()), float(cost.min())
    found, t = [], n
    while t > 0:
        t = int(last[t])
        found.append(t)
    return found[::-1][1:]


def cost(z: Array, jumps: Any, penalty: float) -> float:
    pieces = np.split(z, jumps)
    return float(sum(np.sum((piece - piece.mean()) ** 2) for piece in pieces)) + penalty * len(jumps)


def stairs(rng: np.random.Generator, n: int, jumps: int, size: float) -> tuple[Array, list[int]]:
    places = sorted(int(k) for k in rng.choice(np.arange(30, n - 30, 60), jumps, replace=False))
    z = rng.normal(size=n)
    for k in places:
        z[k:] += rng.choice([-1.0, 1.0]) * size
    return z, places


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 150), penalty=st.floats(0.5, 20.0))
def test_short_sequences_are_segmented_as_by_brute_force(seed: int, n: int, penalty: float) -> None:
    rng = np.random.default_rng(seed)
    z = rng.normal(size=n) + np.cumsum((rng.random(n) < 0.05) * rng.normal(0, 3, n))
    assert segment(z, penalty).tolist() == brute_force(z, penalty)


def test_constant_values_have_no_jump() -> None:
    assert segment(np.full(500, 3.25), 1.0).size == 0


def test_the_input_is_left_as_it_was() -> None:
    z = np.random.default_rng(0).normal(size=5000)
    kept = z.copy()
    segment(z, 10.0)
    assert np.array_equal(z, kept)


@pytest.mark.parametrize("seed", range(5))
def test_blocks_and_refinement_find_the_jumps_of_the_exact_search(seed: int) -> None:
    # Jumps of 3 σ, 60 slots or more apart, far above the penalty: both searches must find each, and the refined
    # place must be the exact one, as both maximise the same contrast.
    rng = np.random.default_rng(seed)
    z, places = stairs(rng, 4000, 12, 3.0)
    penalty = 3 * np.log(z.size)
    exact = fpop(z, np.ones(z.size), penalty)
    assert segment(z, penalty).tolist() == exact.tolist()
    assert exact.size == len(places)


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
