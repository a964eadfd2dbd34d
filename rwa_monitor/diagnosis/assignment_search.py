"""Dynamic programme over candidates: which are jumps, and which switching system made each (errata 8).

State: the last accepted changepoint, and for each system its configuration and the candidate that began its sojourn.
Paths that agree on it have the same future, so only the best few of each state are kept. The score of a path is

    Σ segments  fit(segment)  +  Σ sojourns  log P(duration), log P(transition)  +  Σ priors of rare events.

For given fits, laws and signs the search is exact: a path is dropped only when an upper bound of all that can follow
stays more than `margin` below a complete path that is already known. Past the budget the best by that bound survive,
and the result says that it was pruned. The loops are in `assignment_kernel`.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Final

import numpy as np

from rwa_monitor.diagnosis.assignment_kernel import NO_SYSTEM, REJECT, STEPS, Tables, best_rest, expand
from rwa_monitor.diagnosis.laws import LawTables
from rwa_monitor.samples import BoolArray, FloatArray, IntArray

__all__ = ["NO_SYSTEM", "REJECT", "Bounds", "Path", "Problem", "SearchResult", "bounds", "search", "step_of"]

QUICK_BUDGET: Final = 32  # width of the first pass, which only finds a good complete path
KEPT_PER_STATE: Final = 3
ROUNDING: Final = 1e-6  # bounds and scores add up the same terms in different orders [log-likelihood]


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
    """

    fit: FloatArray
    laws: LawTables
    configurations: IntArray
    signs: BoolArray
    reject: float
    unattributed: float
    simultaneous: float

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
        Whether the budget cut the search, so that the best path may have been missed.
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
        (S, Q, m + 1, m + 1): a system's own best end of the sojourn begun at node i, not ended up to candidate k.
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
    best = full.paths[0].score
    close = tuple(path for path in full.paths if path.score >= best - margin)
    return SearchResult(close, quick.states + full.states, full.pruned)


def bounds(problem: Problem) -> Bounds:
    """Compute the upper bounds by which paths are dropped; that every law term is ≤ 0 is used."""
    laws, fit = problem.laws, problem.fit
    turn = laws.turn.max(axis=2, initial=-np.inf)[:, :, None, None]
    ended = np.maximum(laws.jump + turn, laws.missed.max(axis=2, initial=-np.inf))  # (S, Q, node, node)
    best_law = np.maximum(ended.max(axis=(0, 1, 2), initial=-np.inf), problem.unattributed)  # (node,)
    later = np.maximum.accumulate(ended[..., ::-1], axis=-1)[..., ::-1]  # best over nodes ≥ k
    own = np.broadcast_to(laws.stay[..., None], ended.shape).copy()
    own[..., :-1] = np.maximum(own[..., :-1], later[..., 1:])
    return Bounds(best_rest(fit, best_law), best_rest(fit, np.zeros_like(best_law)), own)


def _run(problem: Problem, above: Bounds, cutoff: float, budget: int, paths: int) -> SearchResult:
    """Run the compiled search once and trace its paths back."""
    laws = problem.laws
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
    )
    kept = KEPT_PER_STATE if paths > 1 else 1
    parent, action, last, score, states, pruned = expand(tables, cutoff, budget, kept)
    found = []
    for at in np.argsort(-score, kind="stable")[:paths]:
        taken = np.zeros(problem.signs.shape[0], dtype=np.int64)
        node = int(last[at])
        for k in range(taken.size - 1, -1, -1):
            taken[k] = action[node]
            node = int(parent[node])
        found.append(Path(float(score[at]), _start_of(int(action[node]), problem.configurations), taken))
    return SearchResult(tuple(found), int(states), bool(pruned))


def _start_of(number: int, configurations: IntArray) -> tuple[int, ...]:
    """Return the configurations that the number of a start stands for; the last system counts fastest."""
    start = []
    for count in configurations[::-1]:
        number, q = divmod(number, int(count))
        start.append(q)
    return tuple(reversed(start))
