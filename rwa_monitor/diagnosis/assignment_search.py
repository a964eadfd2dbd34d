"""Dynamic programme over candidates: which are jumps, and which switching system made each (errata 8).

State: the last accepted changepoint, and for each system its configuration and the candidate that began its sojourn.
Paths that agree on it have the same future, so only the best few of each state are kept. The score of a path is

    Σ segments  fit(segment)  +  Σ sojourns  log P(duration), log P(transition)  +  Σ priors of rare events
    +  Σ jumps  log P(size | friction of the system before).

For given fits, laws, signs and sizes a path is dropped only when an upper bound of all that can follow stays more than
`margin` below a complete path that is already known. Past the budget the best by that bound survive, and the result
says that it was pruned.

Without the last sum the search is exact. The sizes bring closure into it: a system that returns to rest undoes what it
added before. A system's friction is a function of its state where it has two configurations, and the search stays
exact; with more it depends on the path too, and is nearly always right because the few best entries of each state are
kept, each with its own friction (the tests count). The loops are in `assignment_kernel`.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Final

import numpy as np

from rwa_monitor.diagnosis.assignment_kernel import NO_SYSTEM, REJECT, STEPS, Tables, best_chains, best_rest, expand
from rwa_monitor.diagnosis.laws import LawTables
from rwa_monitor.samples import BoolArray, FloatArray, IntArray

__all__ = [
    "NO_SYSTEM",
    "REJECT",
    "Bounds",
    "Path",
    "Problem",
    "SearchResult",
    "bounds",
    "log_laws",
    "search",
    "step_of",
]

QUICK_BUDGET: Final = 16  # width of the first pass, which only finds a good complete path
KEPT_PER_STATE: Final = 4
ROUNDING: Final = 1e-6  # bounds and scores add up the same terms in different orders [log-likelihood]


@dataclass(frozen=True, slots=True)
class Sizes:
    """How large the jumps are, and what the friction laws expect; normalised.

    Attributes
    ----------
    jump, variance
        float64 (m,), level after less level before each candidate, and the variance of this measurement.
    law_mean, law_variance
        float64 (S, Q), friction of a new sojourn; both 0 at rest.
    log_range
        Logarithm of the width of the flat prior that the fits assume for each level.
    unattributed_variance
        Of a jump that no system made.
    """

    jump: FloatArray
    variance: FloatArray
    law_mean: FloatArray
    law_variance: FloatArray
    log_range: float
    unattributed_variance: float

    def log_density(self, mean: FloatArray | float, variance: FloatArray | float) -> FloatArray:
        """Return the log density of each jump about `mean`, over the flat prior; shapes as they broadcast with (m,)."""
        total = self.variance + variance
        return np.asarray(self.log_range - 0.5 * np.log(2.0 * np.pi * total) - 0.5 * (self.jump - mean) ** 2 / total)

    def highest_density(self, variance: FloatArray | float) -> FloatArray:
        """Return what `log_density` is at most for any mean and at least this variance."""
        return np.asarray(self.log_range - 0.5 * np.log(2.0 * np.pi * (self.variance + variance)))


@dataclass(frozen=True, slots=True)
class Problem:
    """Everything that the score of a path depends on. Nodes: 0 the window's begin, 1 … m candidates, m + 1 its end.

    Attributes
    ----------
    fit
        (m + 2, m + 2): log-likelihood of one level from node i to node j > i.
    laws
        See `LawTables`.
    configurations
        int64 (S,), number of configurations of each system.
    signs
        bool (m, 2): whether the level may fall, may rise at each candidate.
    reject, unattributed, simultaneous
        Log prior (≤ 0) of a candidate that is no jump, of a jump that no system made, of two systems jumping at once
        beyond what their laws say.
    sizes
        Sizes of the jumps, or None to leave them out.
    """

    fit: FloatArray
    laws: LawTables
    configurations: IntArray
    signs: BoolArray
    reject: float
    unattributed: float
    simultaneous: float
    sizes: Sizes | None = None

    @property
    def actions(self) -> IntArray:
        """What can happen at a candidate: rows (system, step, second system, step), -1 for none.

        Steps are numbered as in `assignment_kernel.STEPS`; `step_of` tells them apart. The first two rows reject the
        candidate, and accept it as a jump that no system made. Where two jump at once, no jump is missed before.
        """
        systems = range(self.configurations.size)
        rows = [(-1, -1, -1, -1), (-1, -1, -1, -1)]
        rows += [(s, step, -1, -1) for s in systems for step in range(STEPS)]
        rows += [(s, step, t, other) for s, t in combinations(systems, 2) for step in (0, 1) for other in (0, 1)]
        return np.array(rows, dtype=np.int64)


def log_laws(problem: Problem, path: Path) -> float:
    """Return the part of a path's score that comes from laws and priors of rare events: no fits, no sizes.

    Whoever weighs paths by a likelihood of their own, which holds levels and friction, must not count these twice.
    """
    laws, actions = problem.laws, problem.actions.tolist()
    configuration, since, total = list(path.start), [0] * len(path.start), 0.0
    for node, action in enumerate(path.actions.tolist(), start=1):
        if action in (REJECT, NO_SYSTEM):
            total += problem.reject if action == REJECT else problem.unattributed
            continue
        row = actions[action]
        for s, number in (row[:2], row[2:]):
            if s < 0:
                continue
            step, skipped = step_of(number)
            before, begun = configuration[s], since[s]
            total += float(
                laws.missed[s, before, (skipped + 1) // 2, begun, node]
                if skipped
                else laws.jump[s, before, begun, node]
            )
            total += float(laws.turn[s, before + skipped, (step + 1) // 2])
            configuration[s], since[s] = before + skipped + step, node
        total += problem.simultaneous if row[2] >= 0 else 0.0
    return total + sum(float(laws.stay[s, q, since[s]]) for s, q in enumerate(configuration))


def step_of(number: int) -> tuple[int, int]:
    """Return the direction (±1) of a numbered step, and the jump without a candidate before it (±1, 0 for none)."""
    return 2 * (number % 2) - 1, (0, -1, 1)[number // 2]


@dataclass(frozen=True, slots=True)
class Path:
    """One complete assignment.

    Attributes
    ----------
    score
        Its score.
    start
        Configuration of each system at the window's begin.
    actions
        int64 (m,), row of the action table at each candidate.
    """

    score: float
    start: tuple[int, ...]
    actions: IntArray


@dataclass(frozen=True, slots=True)
class SearchResult:
    """The best paths, best first, and the work done.

    Attributes
    ----------
    paths
        At most as many as asked for, distinct, none further below the best than the margin.
    states
        Number of entries expanded.
    pruned
        Whether the budget cut off what may have held a better path.
    """

    paths: tuple[Path, ...]
    states: int
    pruned: bool


@dataclass(frozen=True, slots=True)
class Bounds:
    """Upper bounds of what can follow; see `bounds`.

    Attributes
    ----------
    rest
        (m + 1, m + 1): with the last changepoint at node i and candidates up to k decided, the best fits and laws.
    rest_fit
        The same without laws.
    own
        (S, Q, m + 1, m + 1): the best that a system may still do by its laws, its sojourn begun at node i and not ended
        up to candidate k.
    """

    rest: FloatArray
    rest_fit: FloatArray
    own: FloatArray


def search(problem: Problem, *, paths: int, margin: float, budget: int) -> SearchResult:
    """Find the best assignments.

    Parameters
    ----------
    problem
        The scores.
    paths
        How many to return at most.
    margin
        Paths further below the best than this are of no interest [log-likelihood].
    budget
        Extensions kept per candidate at most.
    """
    above = bounds(problem)
    quick = _run(problem, above, -np.inf, min(QUICK_BUDGET, budget), 1)
    full = _run(problem, above, quick.paths[0].score - margin - ROUNDING, budget, paths)
    # Where values are wild, and scores differ by millions, the full search may drop every path within its budget.
    found = full.paths or quick.paths
    close = tuple(path for path in found if path.score >= found[0].score - margin)
    return SearchResult(close, quick.states + full.states, full.pruned)


def bounds(problem: Problem) -> Bounds:
    """Compute the upper bounds by which paths are dropped; that every law term is ≤ 0 is used."""
    laws, fit = problem.laws, problem.fit
    own = np.full(laws.jump.shape, -np.inf)
    best_chains(laws.jump, laws.stay, laws.turn, laws.missed, own)
    with_law, size_only = _best_jump(problem)
    return Bounds(best_rest(fit, with_law), best_rest(fit, size_only), own)


def _best_jump(problem: Problem) -> tuple[FloatArray, FloatArray]:
    """Return the most that a jump at each node can be worth by law and size, and by size alone, (m + 1,) each."""
    laws, sizes = problem.laws, problem.sizes
    count, systems = problem.signs.shape[0], problem.configurations.size
    with_law = np.full(count + 1, problem.unattributed)
    size_only = np.zeros(count + 1)
    if sizes is None:
        ended = laws.jump + laws.turn.max(axis=2, initial=-np.inf)[:, :, None, None]
        best = np.maximum(ended, laws.missed.max(axis=2, initial=-np.inf)).max(axis=(0, 1, 2), initial=-np.inf)
        return np.maximum(with_law, best), size_only
    alone = sizes.log_density(0.0, sizes.unattributed_variance)
    with_law[1:] += alone
    size_only[1:] = np.maximum(0.0, alone)
    plain = np.full((max(systems, 2), count), -np.inf)  # best law of each system
    for s in range(systems):
        skips = laws.missed[s, :, :, :, 1:].max(axis=(0, 1, 2))
        for q in range(int(problem.configurations[s])):
            ends = laws.jump[s, q, :, 1:].max(axis=0)
            for direction, after in ((0, q - 1), (1, q + 1)):
                if not 0 <= after < problem.configurations[s]:
                    continue
                if sizes.law_variance[s, q] == 0.0:  # from rest the friction before is known
                    worth = sizes.log_density(
                        sizes.law_mean[s, after] - sizes.law_mean[s, q], sizes.law_variance[s, after]
                    )
                else:
                    worth = sizes.highest_density(sizes.law_variance[s, after])
                law = np.maximum(ends, skips) + laws.turn[s, q, direction]
                plain[s] = np.maximum(plain[s], law)
                with_law[1:] = np.maximum(with_law[1:], law + worth)
                size_only[1:] = np.maximum(size_only[1:], worth)
    # Two at once: both may return to rest only where the level may fall; otherwise one of them takes up friction.
    moving = sizes.law_variance[sizes.law_variance > 0]
    least = np.where(problem.signs[:, 0], 0.0, moving.min(initial=np.inf) if moving.size else 0.0)
    worth = sizes.highest_density(least)
    two = np.sort(plain, axis=0)[-2:].sum(axis=0) + problem.simultaneous
    with_law[1:] = np.maximum(with_law[1:], two + worth)
    if systems > 1:
        size_only[1:] = np.maximum(size_only[1:], worth)
    return with_law, size_only


def _run(problem: Problem, above: Bounds, cutoff: float, budget: int, paths: int) -> SearchResult:
    """Run the compiled search once and trace its paths back."""
    laws, sizes = problem.laws, problem.sizes
    count, shape = problem.signs.shape[0], laws.turn.shape[:2]
    tables = Tables(
        fit=problem.fit,
        jump=laws.jump,
        stay=laws.stay,
        turn=laws.turn,
        missed=laws.missed,
        rest=above.rest,
        rest_fit=above.rest_fit,
        own=above.own,
        configurations=problem.configurations,
        signs=problem.signs,
        actions=problem.actions,
        priors=np.array([problem.reject, problem.unattributed, problem.simultaneous]),
        sized=sizes is not None,
        size=sizes.jump if sizes else np.zeros(count),
        size_variance=sizes.variance if sizes else np.ones(count),
        law_mean=sizes.law_mean if sizes else np.zeros(shape),
        law_variance=sizes.law_variance if sizes else np.zeros(shape),
        log_range=sizes.log_range if sizes else 0.0,
        unattributed_variance=sizes.unattributed_variance if sizes else 1.0,
    )
    kept = KEPT_PER_STATE if paths > 1 else 1
    parent, action, last, score, states, lost = expand(tables, cutoff, budget, kept)
    found = []
    for at in np.argsort(-score, kind="stable")[:paths]:
        taken = np.zeros(problem.signs.shape[0], dtype=np.int64)
        node = int(last[at])
        for k in range(taken.size - 1, -1, -1):
            taken[k] = action[node]
            node = int(parent[node])
        found.append(Path(float(score[at]), _start_of(int(action[node]), problem.configurations), taken))
    return SearchResult(tuple(found), int(states), not found or bool(lost > found[0].score))


def _start_of(number: int, configurations: IntArray) -> tuple[int, ...]:
    """Return the configurations that the number of a start stands for; the last system counts fastest."""
    start = []
    for count in configurations[::-1]:
        number, q = divmod(number, int(count))
        start.append(q)
    return tuple(reversed(start))
