"""Dynamic programme over candidates: which are jumps, and which switching system made each (errata 8).

State: the last accepted changepoint, and for each system its configuration and the candidate that began its sojourn.
Paths that agree on it have the same future, so only the best few of each state are kept. The score of a path is

    Σ segments  fit(segment)  +  Σ sojourns  log P(duration), log P(transition)  +  Σ priors of rare events
    +  Σ jumps  log P(size | friction of the system before).

For given fits, durations, signs and sizes a path is dropped only when an upper bound of all that can follow stays more
than `margin` below a complete path that is already known: a narrow first pass finds one. Past the budget the best by
that bound survive, and the result is marked as pruned.

Without the last sum the search is exact. The sizes bring closure into it: a system that returns to rest undoes what it
added before. A system's friction is a function of its state where it has two configurations, and the search stays
exact; with more it depends on the path too, and is nearly always right because the few best entries of each state are
kept, each with its own friction (the tests count). The loops are in `kernels/assignment_search.cpp`,
the bounds in `assignment_bounds.cpp` beside it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import combinations
from typing import Final, NamedTuple

import numpy as np

from rwa_monitor.kernels.assignment import NO_SYSTEM, REJECT, STEPS, find_paths
from rwa_monitor.samples import BoolArray, FloatArray, IntArray
from rwa_monitor.switching.duration_likelihoods import DurationLikelihoods

__all__ = ["NO_SYSTEM", "REJECT", "Path", "Problem", "Scores", "SearchResult", "Sizes", "search"]

QUICK_BUDGET: Final = 16  # width of the first pass, which only finds a good complete path
KEPT_PER_STATE: Final = 4
ROUNDING: Final = 1e-6  # bounds and scores add up the same terms in different orders [log-likelihood]


class Scores(NamedTuple):
    """All that the score of a path depends on, as `Problem` and `Sizes` explain it, in the form that kernels take.

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


@dataclass(frozen=True)
class Problem:
    """Everything that the score of a path depends on. Nodes: 0 the window's begin, 1 … m candidates, m + 1 its end.

    Attributes
    ----------
    fit
        (m + 2, m + 2): log-likelihood of one level from node i to node j > i.
    durations
        See `DurationLikelihoods`.
    configurations
        int64 (S,), number of configurations of each system.
    signs
        bool (m, 2): whether the level may fall, may rise at each candidate.
    reject, unattributed, simultaneous
        Log prior (≤ 0) of a candidate that is no jump, of a jump that no system made, of two systems jumping at once
        beyond what their laws give.
    sizes
        Sizes of the jumps, or None to leave them out.
    """

    fit: FloatArray
    durations: DurationLikelihoods
    configurations: IntArray
    signs: BoolArray
    reject: float
    unattributed: float
    simultaneous: float
    sizes: Sizes | None = None

    @property
    def actions(self) -> IntArray:
        """What can happen at a candidate: rows (system, step, second system, step), -1 for none.

        Step 2·m + d, from 0 to STEPS - 1, goes down (d = 0) or up (1), after no jump without a candidate (m = 0), or
        one down (1) or up (2). The first two rows reject the candidate, and accept it as a jump that no system made.
        Where two jump at once, no jump is missed before.
        """
        return _actions(self.configurations.size)

    @cached_property
    def scores(self) -> Scores:
        """All of it, as kernels take it."""
        durations, sizes, count = self.durations, self.sizes, self.signs.shape[0]
        none = np.zeros(durations.turn.shape[:2])
        return Scores(
            fit=self.fit,
            jump=durations.jump,
            stay=durations.stay,
            turn=durations.turn,
            missed=durations.missed,
            configurations=self.configurations,
            signs=self.signs,
            actions=self.actions,
            priors=np.array([self.reject, self.unattributed, self.simultaneous]),
            sized=sizes is not None,
            size=sizes.jump if sizes else np.zeros(count),
            size_variance=sizes.variance if sizes else np.ones(count),
            law_mean=sizes.law_mean if sizes else none,
            law_variance=sizes.law_variance if sizes else none,
            log_range=sizes.log_range if sizes else 0.0,
            unattributed_variance=sizes.unattributed_variance if sizes else 1.0,
        )


@lru_cache(maxsize=16)
def _actions(systems: int) -> IntArray:
    """Return the table of actions, see `Problem.actions`."""
    rows = [(-1, -1, -1, -1), (-1, -1, -1, -1)]
    rows += [(s, step, -1, -1) for s in range(systems) for step in range(STEPS)]
    pairs = combinations(range(systems), 2)
    rows += [(s, step, t, other) for s, t in pairs for step in (0, 1) for other in (0, 1)]
    table = np.array(rows, dtype=np.int64)
    table.setflags(write=False)
    return table


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
    kept = KEPT_PER_STATE if paths > 1 else 1
    score, starts, taken, states, pruned = find_paths(
        problem.scores, paths, margin + ROUNDING, budget, QUICK_BUDGET, kept
    )
    found = tuple(
        Path(value, tuple(start), actions)
        for value, start, actions in zip(score.tolist(), starts.tolist(), taken, strict=True)
    )
    close = tuple(path for path in found if path.score >= found[0].score - margin)
    return SearchResult(close, states, pruned)
