"""Compiled loops over whole paths of the assignment search: found, traced back, weighed, told, compared."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from rwa_monitor.diagnosis.assignment_bounds import (
    NO_SYSTEM,
    REJECT,
    SKIPPED,
    Bounds,
    Scores,
    free_bounds,
    priced_bounds,
)
from rwa_monitor.diagnosis.assignment_kernel import Int32Array, expand
from rwa_monitor.diagnosis.friction_kernel import Cases, evidence_of_cases
from rwa_monitor.diagnosis.results import REJECTED, UNATTRIBUTED, FlatStory
from rwa_monitor.diagnosis.segments import chain_of
from rwa_monitor.samples import FloatArray, IntArray


class Knowns(NamedTuple):
    """What is known before a window, as `weigh` takes it.

    Attributes
    ----------
    slots
        Length of the window.
    table, cases
        See `friction_model.prior_tables`.
    variance, scatter
        See `friction_model.solve`.
    """

    slots: int
    table: FloatArray
    cases: Cases
    variance: float
    scatter: float


@njit(cache=True, error_model="numpy", nogil=True)
def find_paths(
    scores: Scores, paths: int, margin: float, budget: int, quick_budget: int, kept: int
) -> tuple[FloatArray, IntArray, IntArray, int, bool]:
    """Search twice: with a narrow beam for a good path and the prices of its jumps, then for the best of all.

    Parameters
    ----------
    scores
        The scores.
    paths, margin, budget
        As for `assignment_search.search`; the margin with what rounding may take from it.
    quick_budget, kept
        Width of the narrow beam, and entries kept per state by the other.

    Returns
    -------
    score, start, taken, states, pruned
        float64 (paths,), best first, and the paths as from `trace`; entries expanded; whether the budget cut off what
        may have held a better path. Where values are wild, and scores differ by millions, the full search may drop
        every path within its budget; then the path of the narrow beam.
    """
    above, worth = free_bounds(scores)
    # One entry per state, one path; written as a literal it would be a kind of its own, and all compiled twice.
    one = min(kept, 1)
    quick, start, taken, states, _ = _search_once(scores, above, -np.inf, min(quick_budget, budget), one, one)
    above = priced_bounds(scores, above.rest, worth, start[0], taken[0])
    full, starts, all_taken, more, lost = _search_once(scores, above, quick[0] - margin, budget, kept, paths)
    if full.size == 0:
        return quick, start, taken, states + more, True
    return full, starts, all_taken, states + more, lost > full[0]


@njit(cache=True, error_model="numpy", nogil=True)
def _search_once(
    scores: Scores, bounds: Bounds, cutoff: float, budget: int, kept: int, paths: int
) -> tuple[FloatArray, IntArray, IntArray, int, float]:
    """Return score, start, taken and states as `find_paths`, and the highest bound of what the budget cut."""
    parent, action, last, score, states, lost = expand(scores, bounds, cutoff, budget, kept)
    best = np.argsort(-score, kind="mergesort")[:paths]
    start, taken = trace(parent, action, last[best], scores.signs.shape[0], scores.configurations)
    return score[best], start, taken, states, lost


@njit(cache=True, error_model="numpy", nogil=True)
def trace(
    parent: Int32Array, action: Int32Array, leaves: Int32Array, candidates: int, configurations: IntArray
) -> tuple[IntArray, IntArray]:
    """Trace paths back from their leaves in the tree.

    Returns
    -------
    start, taken
        int64 (paths, S) and (paths, candidates): configurations at the window's begin, and the actions.
    """
    start = np.empty((leaves.size, configurations.size), dtype=np.int64)
    taken = np.empty((leaves.size, candidates), dtype=np.int64)
    for path in range(leaves.size):
        node = leaves[path]
        for k in range(candidates - 1, -1, -1):
            taken[path, k] = action[node]
            node = parent[node]
        number = action[node]  # of the start; the last system counts fastest
        for s in range(configurations.size - 1, -1, -1):
            start[path, s] = number % configurations[s]
            number //= configurations[s]
    return start, taken


@njit(cache=True, error_model="numpy", nogil=True)
def add_up_laws(scores: Scores, start: IntArray, taken: IntArray) -> float:
    """Return the part of a path's score that comes from laws and priors of rare events: no fits, no sizes.

    Whoever weighs paths by a likelihood of their own, which holds levels and friction, must not count these twice. The
    path as from `trace`.
    """
    configuration, since, total = start.copy(), np.zeros_like(start), 0.0
    for node in range(1, taken.size + 1):
        action = taken[node - 1]
        if action in (REJECT, NO_SYSTEM):
            total += scores.priors[0] if action == REJECT else scores.priors[1]
            continue
        for place in (0, 2):
            s, step = scores.actions[action, place], scores.actions[action, place + 1]
            if s < 0:
                continue
            direction, skipped = step % 2, step // 2
            q, before = configuration[s], configuration[s] + SKIPPED[skipped]
            if skipped == 0:
                total += scores.jump[s, q, since[s], node]
            else:
                total += scores.missed[s, q, skipped - 1, since[s], node]
            total += scores.turn[s, before, direction]
            configuration[s], since[s] = before + 2 * direction - 1, node
        total += scores.priors[2] if scores.actions[action, 2] >= 0 else 0.0
    staying = 0.0
    for s in range(start.size):
        staying += scores.stay[s, configuration[s], since[s]]
    return total + staying


@njit(cache=True, error_model="numpy", nogil=True)
def tell(
    actions: IntArray, index: IntArray, start: IntArray, taken: IntArray
) -> tuple[FlatStory, IntArray, IntArray, IntArray]:
    """Turn a path into sojourns, and into systems and directions per candidate.

    Parameters
    ----------
    actions, index
        Table of actions, and the candidates' slots.
    start, taken
        The path, as from `trace`.

    Returns
    -------
    story, nodes, system, direction
        Who jumped when; int64 (segments + 1,), the accepted candidates as nodes, and both ends of the window; int64
        (m, 2), who jumped at each candidate and which way: REJECTED or UNATTRIBUTED alone, REJECTED in second place.
    """
    systems, candidates = start.size, taken.size
    system = np.full((candidates, 2), REJECTED)
    direction = np.zeros((candidates, 2), dtype=np.int64)
    sojourns = np.ones(systems, dtype=np.int64)
    accepted, alone = 0, 0
    for k in range(candidates):
        if taken[k] == REJECT:
            continue
        accepted += 1
        if taken[k] == NO_SYSTEM:
            system[k, 0] = UNATTRIBUTED
            alone += 1
            continue
        for place in range(2):
            who, step = actions[taken[k], 2 * place], actions[taken[k], 2 * place + 1]
            if who >= 0:
                system[k, place], direction[k, place] = who, 2 * (step % 2) - 1
                sojourns[who] += 1 if step // 2 == 0 else 2
    nodes, unattributed = np.zeros(accepted + 2, dtype=np.int64), np.empty(alone, dtype=np.int64)
    nodes[accepted + 1] = candidates + 1
    configurations, starts = np.empty(sojourns.sum(), dtype=np.int64), np.zeros(sojourns.sum(), dtype=np.int64)
    at = np.cumsum(sojourns) - sojourns  # where each system's present sojourn stands
    for s in range(systems):
        configurations[at[s]] = start[s]
    accepted, alone = 0, 0
    for k in range(candidates):
        if taken[k] == REJECT:
            continue
        accepted += 1
        nodes[accepted] = k + 1
        if taken[k] == NO_SYSTEM:
            unattributed[alone] = index[k]
            alone += 1
            continue
        for place in range(2):
            who, skipped = system[k, place], SKIPPED[actions[taken[k], 2 * place + 1] // 2]
            if who < 0:
                continue
            if skipped != 0:  # where it happened is not known; the level says: right after the sojourn began
                at[who] += 1
                starts[at[who]] = starts[at[who] - 1] + 1
                configurations[at[who]] = configurations[at[who] - 1] + skipped
            at[who] += 1
            starts[at[who]] = index[k]
            configurations[at[who]] = configurations[at[who] - 1] + direction[k, place]
    return FlatStory(configurations, starts, sojourns, unattributed), nodes, system, direction


@njit(cache=True, error_model="numpy", nogil=True)
def weigh(
    scores: Scores, start: IntArray, taken: IntArray, index: IntArray, pairs: FloatArray, knowns: Knowns
) -> tuple[FlatStory, IntArray, IntArray, IntArray, FloatArray, float, float]:
    """Weigh a path by its full likelihood.

    Parameters
    ----------
    scores, start, taken
        The scores, and the path as from `trace`.
    index, pairs
        The candidates' slots, and the moments between all pairs of nodes, see `segments.pair_moments`.
    knowns
        What is known before the window.

    Returns
    -------
    story, system, direction, borders, moments, log_evidence, score
        The first three as from `tell`; slots at which its segments begin and end, and their moments; the samples'
        log-likelihood, and the same with the laws'.
    """
    story, nodes, system, direction = tell(scores.actions, index, start, taken)
    borders, moments = np.empty_like(nodes), chain_of(pairs, nodes)
    for i in range(nodes.size):
        borders[i] = 0 if i == 0 else knowns.slots if i == nodes.size - 1 else index[nodes[i] - 1]
    log_evidence = evidence_of_cases(
        story, borders, knowns.table, moments, knowns.cases, knowns.variance, knowns.scatter
    )
    return story, system, direction, borders, moments, log_evidence, add_up_laws(scores, start, taken) + log_evidence


@njit(cache=True, error_model="numpy", nogil=True)
def add_agreement(
    index: IntArray,
    apart: int,
    system: IntArray,
    direction: IntArray,
    other_system: IntArray,
    other_direction: IntArray,
    weight: float,
    sure: FloatArray,
) -> None:
    """Add the weight of another path to each attribution that it shares with the best.

    Parameters
    ----------
    index, apart
        The candidates' slots, and how far apart the same jump may lie in the two paths.
    system, direction, other_system, other_direction
        int64 (m, 2), of the best path and of the other one, see `tell`.
    weight
        Of the other path.
    sure
        float64 (m, 2), what is added to.
    """
    for k in range(index.size):
        for place in range(2):
            # Two that jump at once are listed in the order of their systems, so places correspond.
            who, way = system[k, place], direction[k, place]
            same = other_system[k, place] == who and other_direction[k, place] == way
            if not same and who != REJECTED:
                for near in range(index.size):
                    if abs(index[near] - index[k]) <= apart:
                        for beside in range(2):
                            same |= other_system[near, beside] == who and other_direction[near, beside] == way
            if same:
                sure[k, place] += weight
