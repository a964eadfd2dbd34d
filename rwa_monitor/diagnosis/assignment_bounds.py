"""Upper bounds of what can follow a partial assignment: by them `assignment_search` drops what cannot be the best.

Two kinds, and the search takes the lower one. The *free* bound lets every jump take the best law and the best size that
any system could have there. The *priced* bound is a Lagrangian relaxation (Fisher 1981, "The Lagrangian relaxation
method for solving integer programming problems", Management Science 27): the levels and each system are planned on
their own, and at each candidate the levels pay a price for their jump, which a system that jumps there earns. Whatever
the prices, the separate optima add up to at least the best of all plans that agree; with good prices it is hardly more.
Good ones are those under which the jumps of a good complete path earn what they cost.

Compiled, plain functions over arrays; they never cut off the best, so rounding matters to nobody (see `SLACK`).
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numba import njit

from rwa_monitor.samples import BoolArray, FloatArray, IntArray

REJECT: Final = 0  # the first two actions of every action table
NO_SYSTEM: Final = 1
# Steps of a system at a candidate: down or up (step % 2), after no, a downward or an upward jump without a candidate.
STEPS: Final = 6
SKIPPED: Final = (0, -1, 1)
LEAST_WORTH: Final = -5.0  # of the size of a path's own jump, so that an odd one does not make all others free


class Scores(NamedTuple):
    """All that the score of a path depends on, as `assignment_search.Problem` and `Sizes` explain it.

    priors: of a rejected candidate, of a jump that no system made, of two systems jumping at once.
    """

    fit: FloatArray
    jump: FloatArray
    stay: FloatArray
    turn: FloatArray
    missed: FloatArray
    configurations: IntArray
    signs: BoolArray
    actions: IntArray
    priors: FloatArray
    sized: bool
    size: FloatArray
    size_variance: FloatArray
    law_mean: FloatArray
    law_variance: FloatArray
    log_range: float
    unattributed_variance: float


class Bounds(NamedTuple):
    """Upper bounds of what can follow: the lower of `rest`, and of `rest_fit` with the `own` of all systems.

    Attributes
    ----------
    rest
        (m + 1, m + 1): with the last changepoint at node i and candidates up to k decided, the best fits and laws.
    rest_fit
        The same without laws, less the prices of the jumps.
    own
        (S, Q, m + 1, m + 1): the best that a system may still do by its laws, with the prices that its jumps earn; its
        sojourn begun at node i and not ended up to candidate k.
    """

    rest: FloatArray
    rest_fit: FloatArray
    own: FloatArray


class Worth(NamedTuple):
    """The most that a jump at each node can be worth.

    Attributes
    ----------
    single
        (S, Q, 2, m + 1): by its size, down or up from a configuration; -inf where there is no such jump.
    double, alone
        (m + 1,): by its size, of one that two systems make at once, and of one that no system makes. Log densities over
        the flat one that the fits assume.
    with_law
        (m + 1,): of any, by its size and the best law.
    """

    single: FloatArray
    double: FloatArray
    alone: FloatArray
    with_law: FloatArray


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def size_term(scores: Scores, k: int, mean: float, variance: float) -> float:
    """Return log of the density of the jump's size at candidate k over the flat one that the fits assume."""
    if not scores.sized:
        return 0.0
    total = variance + scores.size_variance[k - 1]
    return float(scores.log_range - 0.5 * np.log(2.0 * np.pi * total) - 0.5 * (scores.size[k - 1] - mean) ** 2 / total)


@njit(cache=True, error_model="numpy", nogil=True)
def free_bounds(scores: Scores) -> tuple[Bounds, Worth]:
    """Return the bounds without prices, and what jumps are worth; that every law term is ≤ 0 is used."""
    single, double, alone = _worth(scores)
    with_law, size_only = _best_jump(scores, single, double, alone)
    worth = Worth(single, double, alone, with_law)
    own = _best_chains(scores, np.zeros_like(single))
    return Bounds(_best_rest(scores.fit, with_law), _best_rest(scores.fit, size_only), own), worth


@njit(cache=True, error_model="numpy", nogil=True)
def priced_bounds(scores: Scores, rest: FloatArray, worth: Worth, start: IntArray, taken: IntArray) -> Bounds:
    """Return the bounds with prices from a complete path.

    Parameters
    ----------
    scores, rest, worth
        The scores, and their free bounds.
    start, taken
        int64 (S,) and (m,), the path, see `assignment_search.Path`.
    """
    price = _prices(scores, worth, start, taken)
    earned = np.full_like(worth.single, -np.inf)
    paid = np.zeros(price.size)
    for k in range(1, price.size):
        paid[k] = max(-price[k], scores.priors[1] + worth.alone[k])
        # Two that jump at once earn twice, and share one size: each is taken to be worth half of it at least.
        least = 0.5 * (worth.double[k] + scores.priors[2] - price[k])
        for s in range(earned.shape[0]):
            for q in range(earned.shape[1]):
                for direction in range(2):
                    size = worth.single[s, q, direction, k]
                    if size > -np.inf:
                        # Against the level's sign a system jumps only together with another one.
                        size = max(size, least) if scores.signs[k - 1, direction] else least
                        earned[s, q, direction, k] = size + price[k]
    return Bounds(rest, _best_rest(scores.fit, paid), _best_chains(scores, earned))


@njit(cache=True, error_model="numpy", nogil=True)
def _worth(scores: Scores) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return what sizes are worth at most: single, double and alone of `Worth`."""
    systems, configurations, nodes = scores.stay.shape
    single = np.full((systems, configurations, 2, nodes), -np.inf)
    double, alone = np.zeros(nodes), np.zeros(nodes)
    smallest = np.inf  # variance of a friction that moves at all
    for s in range(systems):
        for q in range(scores.configurations[s]):
            if scores.law_variance[s, q] > 0.0:
                smallest = min(smallest, scores.law_variance[s, q])
    for k in range(1, nodes):
        alone[k] = size_term(scores, k, 0.0, scores.unattributed_variance)
        # Both of two may return to rest only where the level may fall; otherwise one of them takes up friction.
        least = 0.0 if scores.signs[k - 1, 0] or smallest == np.inf else smallest
        double[k] = _highest(scores, k, least)
        for s in range(systems):
            for q in range(scores.configurations[s]):
                for direction in range(2):
                    after = q + 2 * direction - 1
                    if not 0 <= after < scores.configurations[s]:
                        continue
                    if scores.law_variance[s, q] == 0.0:  # from rest the friction before is known
                        change = scores.law_mean[s, after] - scores.law_mean[s, q]
                        single[s, q, direction, k] = size_term(scores, k, change, scores.law_variance[s, after])
                    else:
                        single[s, q, direction, k] = _highest(scores, k, scores.law_variance[s, after])
    return single, double, alone


@njit(cache=True, error_model="numpy", nogil=True)
def _highest(scores: Scores, k: int, variance: float) -> float:
    """Return what `size_term` is at most for any mean and at least this variance."""
    return size_term(scores, k, scores.size[k - 1], variance)


@njit(cache=True, error_model="numpy", nogil=True)
def _best_jump(
    scores: Scores, single: FloatArray, double: FloatArray, alone: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the most that a jump at each node can be worth by law and size, and by size alone, (m + 1,) each."""
    systems, _, nodes = scores.stay.shape
    with_law, size_only = np.full(nodes, scores.priors[1]), np.zeros(nodes)
    for k in range(1, nodes):
        with_law[k] += alone[k]
        size_only[k] = max(0.0, alone[k])
        first, second = -np.inf, -np.inf  # the best laws of any two systems
        for s in range(systems):
            skips = scores.missed[s, :, :, :k, k].max()
            plain = -np.inf
            for q in range(scores.configurations[s]):
                law = max(scores.jump[s, q, :k, k].max(), skips)
                for direction in range(2):
                    size = single[s, q, direction, k]
                    if size == -np.inf:
                        continue
                    plain = max(plain, law + scores.turn[s, q, direction])
                    with_law[k] = max(with_law[k], law + scores.turn[s, q, direction] + size)
                    size_only[k] = max(size_only[k], size)
            if plain > first:
                first, second = plain, first
            else:
                second = max(second, plain)
        with_law[k] = max(with_law[k], first + second + scores.priors[2] + double[k])
        if systems > 1:
            size_only[k] = max(size_only[k], double[k])
    return with_law, size_only


@njit(cache=True, error_model="numpy", nogil=True)
def _best_rest(fit: FloatArray, gain: FloatArray) -> FloatArray:
    """Return the best sum of fits, and gains of accepted nodes, from node i to the end over candidates after k.

    float64 (m + 1, m + 1) for fits of m + 2 nodes and gains of m + 1.
    """
    nodes = fit.shape[0] - 1
    rest = np.full((nodes, nodes), -np.inf)
    from_node = np.full(nodes, -np.inf)
    for i in range(nodes - 1, -1, -1):
        best = fit[i, nodes]
        rest[i, nodes - 1] = best
        for k in range(nodes - 2, i - 1, -1):
            best = max(best, fit[i, k + 1] + gain[k + 1] + from_node[k + 1])
            rest[i, k] = best
        from_node[i] = best
    return rest


@njit(cache=True, error_model="numpy", nogil=True)
def _best_chains(scores: Scores, earned: FloatArray) -> FloatArray:
    """Return the best sum of log-probabilities of all that a system may still do, free to jump anywhere, see `Bounds`.

    earned: (S, Q, 2, m + 1), what a jump from a configuration down or up adds at each node.
    """
    jump, stay, turn, missed = scores.jump, scores.stay, scores.turn, scores.missed
    systems, configurations, nodes = stay.shape
    own = np.full((systems, configurations, nodes, nodes), -np.inf)
    for s in range(systems):
        for k in range(nodes - 1, -1, -1):
            for q in range(configurations):
                for i in range(k + 1):
                    best = stay[s, q, i]
                    if k < nodes - 1:
                        best = own[s, q, i, k + 1]
                        for step in range(STEPS):
                            direction, skipped = step % 2, step // 2
                            before = q + SKIPPED[skipped]
                            after = before + 2 * direction - 1
                            if min(before, after) < 0 or max(before, after) >= configurations:
                                continue
                            law = jump[s, q, i, k + 1] if skipped == 0 else missed[s, q, skipped - 1, i, k + 1]
                            law += turn[s, before, direction] + earned[s, before, direction, k + 1]
                            best = max(best, law + own[s, after, k + 1, k + 1])
                    own[s, q, i, k] = best
    return own


@njit(cache=True, error_model="numpy", nogil=True)
def _prices(scores: Scores, worth: Worth, start: IntArray, taken: IntArray) -> FloatArray:
    """Return prices (m + 1,) under which the path's jumps cost their systems nothing on balance.

    At a candidate that the path rejects no jump earns more than it costs.
    """
    price = -worth.with_law
    configuration, since = start.copy(), np.zeros_like(start)
    for node in range(1, price.size):
        action = taken[node - 1]
        if action == REJECT:
            continue
        if action == NO_SYSTEM:
            price[node] = -scores.priors[1]
            continue
        cost, systems = 0.0, 0
        for place in (0, 2):
            s, step = scores.actions[action, place], scores.actions[action, place + 1]
            if s < 0:
                continue
            direction, skipped = step % 2, step // 2
            q, before = configuration[s], configuration[s] + SKIPPED[skipped]
            law = (
                scores.jump[s, q, since[s], node] if skipped == 0 else scores.missed[s, q, skipped - 1, since[s], node]
            )
            cost -= law + scores.turn[s, before, direction] + max(worth.single[s, before, direction, node], LEAST_WORTH)
            systems += 1
            configuration[s], since[s] = before + 2 * direction - 1, node
        price[node] = cost / systems
    return price
