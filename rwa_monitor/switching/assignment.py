"""Stage 3: which hidden switching system made which jump, and which candidates are no jumps (method `joint`, errata 8).

1. Estimate the slope common to all levels, positions of the candidates and signs of their jumps from the range sums.
2. Find the best assignments for these by dynamic programming.
3. Estimate slope, positions and signs again from the accepted changepoints; repeat from 2 until nothing changes.
4. The best few are ranked by the full likelihood: slope and friction of all sojourns integrated out, closure at q = 0,
   friction laws (`friction_model`).
5. The probability of each attribution is the weight of the assignments that share it.

The search is a dynamic programme over the candidates. State: the last accepted changepoint, and for each system its
configuration and the candidate that began its sojourn. Paths that agree on it have the same future, so only the best
few of each state are kept. The score of a path is

    Σ segments  fit(segment)  +  Σ sojourns  log P(duration), log P(transition)  +  Σ priors of unattributed jumps
    +  Σ jumps  log P(size | friction of the system before).

For given fits, durations, signs and sizes a path is dropped only when an upper bound of its complete score is more
than `margin` below a complete path that is already known: a narrow first pass finds one. Beyond the budget only the
best by that bound are kept, and the result is marked as pruned.

Without the last sum the search would be exact. That sum enforces closure: a system that returns to rest removes what
it added before. Where a system has two configurations, its friction is a function of the state, and the search stays
exact; with more it depends on the path too, and the search is nearly always right because the few best entries of each
state are kept, each with its own friction (the tests count the failures). The loops are in `kernels/assignment.cpp`.
"""

from functools import lru_cache
from itertools import combinations
from typing import Final, NamedTuple

import numpy as np

from rwa_monitor.changepoints.estimation import (
    Level,
    effective_variance,
    estimate,
    level_scatter,
    measure_level,
    possible_signs,
)
from rwa_monitor.changepoints.noise import median_size
from rwa_monitor.changepoints.stage_results import (
    REJECTED,
    UNATTRIBUTED,
    Alternative,
    Assignment,
    Estimate,
    Evidence,
    SwitchingPath,
)
from rwa_monitor.kernels.assignment import REJECT, STEPS, find_paths, fit_table, refine_nodes, weigh
from rwa_monitor.samples import BoolArray, FloatArray, IntArray
from rwa_monitor.switching.carried_state import CarriedState
from rwa_monitor.switching.duration_likelihoods import Onset, onsets, tabulated_durations
from rwa_monitor.switching.friction_model import Posterior, Priors, law_moments, prior_tables, priors_of, solve
from rwa_monitor.wheel.wheel import Wheel

KEPT_PATHS: Final = 16  # paths ranked by the full likelihood
MARGIN: Final = 10.0  # log-likelihood below the best at which an assignment is negligible (e^-10 < 1e-4)
BUDGET: Final = 2000  # extensions kept per candidate
MAX_ROUNDS: Final = 4  # at most, of assignment and positions in turn
REACH: Final = (4, 32)  # by how many slots a position is refined at least and at most
SETTLED: Final = 0.1  # change of the log-likelihood by the slope below which the iteration has converged
SAME_JUMP: Final = 5  # slots: attributions of positions closer than this are the same


class Scores(NamedTuple):
    """All that the score of a path depends on, as kernels take it.

    Nodes: 0 is the window's begin, 1 … m the candidates, m + 1 its end. S systems, Q configurations.

    Attributes
    ----------
    fit
        float64 (m + 2, m + 2): log-likelihood of one level from node i to node j > i.
    jump, stay, turn, missed
        See `DurationLikelihoods`.
    configurations
        int64 (S,), number of configurations of each system.
    signs
        bool (m, 2): for each candidate, whether the level may fall there, and whether it may rise.
    actions
        See `action_table`.
    size, size_variance
        float64 (m,), level after less level before each candidate, and the variance of this measurement; normalised.
    law_mean, law_variance
        float64 (S, Q), friction of a new sojourn; both 0 at rest.
    log_range
        Logarithm of the width of the flat prior that the fits assume for each level.
    unattributed, unattributed_variance
        Log prior (≤ 0) of a jump that no system made, and the variance of its size.
    """

    fit: FloatArray
    jump: FloatArray
    stay: FloatArray
    turn: FloatArray
    missed: FloatArray
    configurations: IntArray
    signs: BoolArray
    actions: IntArray
    size: FloatArray
    size_variance: FloatArray
    law_mean: FloatArray
    law_variance: FloatArray
    log_range: float
    unattributed: float
    unattributed_variance: float


class _Inputs(NamedTuple):
    """The window, its wheel, and the priors."""

    evidence: Evidence
    wheel: Wheel
    priors: Priors
    onsets: tuple[Onset | None, ...]
    variance: float  # of the noise, see `estimation.effective_variance`


class _Ranked(NamedTuple):
    """A path of the search as a switching path, with its full log-likelihood; see `kernels.assignment.weigh`."""

    path: SwitchingPath
    system: IntArray
    direction: IntArray
    borders: IntArray
    statistics: FloatArray
    log_evidence: float
    score: float


def assign(
    evidence: Evidence,
    wheel: Wheel,
    carried: CarriedState | None = None,
    priors: Priors | None = None,
) -> tuple[Assignment, Estimate]:
    """Decide which candidates are changepoints and which switching system made each.

    Parameters
    ----------
    evidence
        Candidates, range sums and noise of the window.
    wheel
        Its wheel; any number of switching systems.
    carried
        The state after earlier windows, or None.
    priors
        Used in place of `window_priors`.

    Returns
    -------
    tuple[Assignment, Estimate]
        All candidates, including the rejected; and levels and slope between the accepted changepoints.
    """
    inputs = _Inputs(
        evidence,
        wheel,
        window_priors(evidence, wheel, carried) if priors is None else priors,
        onsets(wheel.fss, carried),
        effective_variance(evidence.noise),
    )
    candidates = evidence.candidates
    everyone: IntArray = np.arange(len(candidates), dtype=np.int64)
    level = _measure(inputs, candidates.index, everyone)
    level = _measure(inputs, _refined(inputs, level, everyone), everyone)
    signs = possible_signs(candidates, level)
    states = rounds = 0
    while True:
        rounds += 1
        scores = _scores(inputs, level, signs)
        score, starts, taken, expanded, pruned = find_paths(scores, KEPT_PATHS, MARGIN, BUDGET)
        states += expanded
        if rounds == MAX_ROUNDS:
            break
        accepted = np.flatnonzero(taken[0] != REJECT)
        moved = _refined(inputs, level, accepted)
        again = _measure(inputs, moved if (moved[1:] > moved[:-1]).all() else level.at, accepted)
        new_signs = signs.copy()
        new_signs[accepted] = possible_signs(candidates, again)[accepted]
        settled = 0.5 * again.information * (again.slope - level.slope) ** 2 < SETTLED
        if settled and np.array_equal(again.at, level.at) and np.array_equal(new_signs, signs):
            break
        level, signs = again, new_signs
    likely = score >= score[0] - MARGIN
    ranked = _rank(inputs, scores, starts[likely], taken[likely], level)
    halves, gain = _halves(ranked[0], level, inputs.variance)
    if halves.size:
        whole = evidence._replace(candidates=candidates[np.delete(everyone, halves)])
        undivided = assign(whole, wheel, carried, inputs.priors)
        if undivided[0].log_score + gain > ranked[0].score:
            return undivided
    return _result(inputs, level.at, ranked, states, pruned)


def _halves(best: _Ranked, level: Level, variance: float) -> tuple[IntArray, float]:
    """Return the changepoints that may be the smaller part of one jump, and what they add to the score without them.

    A sensor that averages over its slot divides a jump within a slot into two of the same sign, one sample apart. That
    sample, Gaussian about one of the levels elsewhere, is then uniform between both.
    """
    accepted = np.flatnonzero(best.system[:, 0] != REJECTED)
    first, second = accepted[:-1], accepted[1:]
    divided = (level.at[second] - level.at[first] == 1) & (level.jump[first] * level.jump[second] > 0.0)
    first, second = first[divided], second[divided]
    parts = np.abs(np.stack([level.jump[first], level.jump[second]]))
    smaller, whole = parts.min(axis=0), parts.sum(axis=0)
    gain = 0.5 * smaller**2 / variance - np.log(np.maximum(whole / np.sqrt(2.0 * np.pi * variance), 1.0))
    halves: IntArray = np.where(parts[0] < parts[1], first, second)
    return halves, float(gain.sum())


def window_priors(evidence: Evidence, wheel: Wheel, carried: CarriedState | None = None) -> Priors:
    """Return the priors of a window; its own level and jump sizes set the scale where the wheel file states none."""
    return priors_of(wheel, carried, evidence.sums.mean[1], median_size(evidence.candidates.jump))


def _measure(inputs: _Inputs, index: IntArray, accepted: IntArray) -> Level:
    """Measure slope and levels between the accepted candidates."""
    prior = inputs.priors.slope
    return measure_level(index, accepted, inputs.evidence.sums, inputs.variance, prior.mean, prior.std)


def _refined(inputs: _Inputs, level: Level, accepted: IntArray) -> IntArray:
    """Return the positions of all candidates, those of the accepted ones refined between accepted neighbours.

    A position may be off by half the half-width w that found it.
    """
    sums, moved = inputs.evidence.sums, level.at.copy()
    reach = np.clip(inputs.evidence.candidates.scale[accepted] // 2, *REACH)
    nodes = np.concatenate(([0], level.at[accepted], [sums.slots]))
    moved[accepted] = refine_nodes(nodes, reach, level.slope, inputs.variance, sums.arrays)
    return moved


def _scores(inputs: _Inputs, level: Level, signs: BoolArray) -> Scores:
    """Tabulate all scores at the present positions, slope and signs."""
    systems, priors, slots = inputs.wheel.fss, inputs.priors, inputs.evidence.slots
    durations = tabulated_durations(systems, level.at, slots, inputs.onsets)
    law_mean, law_variance = law_moments(priors.laws, priors.anomaly)
    # Rejecting a candidate has no prior cost: that it exists is already in the data. Neither have two systems that jump
    # at once: the duration laws make it rare enough that both sojourns end at the same slot.
    return Scores(
        fit=fit_table(level.pairs, level.slope, inputs.variance, level.spread),
        **durations._asdict(),
        configurations=np.array([system.configurations for system in systems], dtype=np.int64),
        signs=signs,
        actions=action_table(len(systems)),
        size=level.jump,
        size_variance=np.where(np.isfinite(level.jump_variance), level.jump_variance, level.spread**2),
        law_mean=law_mean,
        law_variance=law_variance,
        log_range=float(np.log(level.spread)),
        unattributed=float(np.log(min(priors.unattributed / slots, 1.0))),
        unattributed_variance=priors.unattributed_std**2,
    )


@lru_cache(maxsize=16)
def action_table(systems: int) -> IntArray:
    """Return what can happen at a candidate: rows (system, step, second system, step), -1 for none.

    Step 2·m + d, from 0 to STEPS - 1, goes down (d = 0) or up (1), preceded by no missed jump (m = 0; a missed jump has
    no candidate), or by one down (1) or up (2). The first two rows reject the candidate, and accept it as unattributed.
    Where two systems jump at once, neither has a missed jump before.
    """
    rows = [(-1, -1, -1, -1), (-1, -1, -1, -1)]
    rows += [(s, step, -1, -1) for s in range(systems) for step in range(STEPS)]
    pairs = combinations(range(systems), 2)
    rows += [(s, step, t, other) for s, t in pairs for step in (0, 1) for other in (0, 1)]
    table = np.array(rows, dtype=np.int64)
    table.setflags(write=False)
    return table


# ---- ranking by the full likelihood ----------------------------------------------------------------------------------


def _rank(inputs: _Inputs, scores: Scores, starts: IntArray, taken: IntArray, level: Level) -> list[_Ranked]:
    """Score the paths that `find_paths` returned by the full likelihood; best first."""
    cases = prior_tables(inputs.priors)
    slots, variance, scatter = inputs.evidence.slots, inputs.variance, level_scatter(inputs.variance)
    ranked = []
    for start, actions in zip(starts, taken, strict=True):
        weighed = weigh(scores, start, actions, level.at, level.pairs, slots, cases, variance, scatter)
        ranked.append(_Ranked(SwitchingPath(*weighed[0]), *weighed[1:]))
    return sorted(ranked, key=lambda one: -one.score)


def _result(
    inputs: _Inputs, index: IntArray, ranked: list[_Ranked], states: int, pruned: bool
) -> tuple[Assignment, Estimate]:
    """Convert the best path to an `Assignment` and the levels between its changepoints."""
    best = ranked[0]
    evidence, candidates = inputs.evidence, inputs.evidence.candidates
    accepted = np.flatnonzero(best.system[:, 0] != REJECTED)
    levels = estimate(evidence, index[accepted], prior=inputs.priors.slope)
    # The standard deviation of a contrast is the jump divided by the root of its χ² statistic.
    jump, std = candidates.jump.copy(), np.abs(candidates.jump) / np.sqrt(np.maximum(candidates.statistic, 1e-12))
    jump[accepted] = levels.level[1:] - levels.level[:-1]
    std[accepted] = levels.jump_std
    sure = _confidence(ranked, index)
    path = best.path
    starts = path.split(path.starts)
    double, alone = best.system[:, 1] != REJECTED, best.system[:, 0] == UNATTRIBUTED
    direction = best.direction.copy()
    direction[alone, 0] = np.sign(jump[alone])
    # One entry for each candidate, and a second one where two systems jump at once, each with its own share.
    reported = np.stack([np.ones_like(double), double], axis=1)
    row = reported.nonzero()[0]
    system, size, size_std = best.system[reported], jump[row], std[row]
    if double.any():
        scatter = level_scatter(inputs.variance)
        posterior = solve(path, best.borders, best.statistics, inputs.priors, inputs.variance, scatter)
        for entry in np.flatnonzero(double[row]):
            who, slot = int(system[entry]), int(index[row[entry]])
            size[entry], size_std[entry] = _own_jump(posterior, starts, who, slot)
    assignment = Assignment(
        index=index[row],
        system=system,
        direction=direction[reported],
        jump=size,
        jump_std=size_std,
        confidence=sure[reported],
        configurations=path.split(path.configurations),
        starts=starts,
        log_score=best.score,
        states=states,
        pruned=pruned,
        alternatives=_alternatives(ranked, index),
    )
    return assignment, levels


def _alternatives(ranked: list[_Ranked], index: IntArray) -> tuple[Alternative, ...]:
    """Return the likeliest path of each sequence of configurations, with the weight of all paths that share it."""
    alike: dict[bytes, list[_Ranked]] = {}
    for one in ranked:
        alike.setdefault(one.path.visited(), []).append(one)
    return tuple(
        Alternative(
            path=best.path,
            index=index[best.system[:, 0] != REJECTED],
            log_durations=float(np.logaddexp.reduce([best.score, *(one.score for one in others)])) - best.log_evidence,
            log_score=best.score,
        )
        for best, *others in alike.values()
    )


def _confidence(ranked: list[_Ranked], index: IntArray) -> FloatArray:
    """Return the probability of each attribution of the best path: the weight of all paths that agree, (m, 2).

    Two attributions agree where system and direction are equal, at candidates within SAME_JUMP slots.
    """
    system, direction = ranked[0].system, ranked[0].direction
    weights = softmax(np.array([one.score for one in ranked]))
    sure = np.zeros(system.shape)
    here, near = np.nonzero(np.abs(index[:, None] - index) <= SAME_JUMP)
    for weight, one in zip(weights, ranked, strict=True):
        same = (system == REJECTED) & (one.system == REJECTED)
        found = (system[here, :, None] == one.system[near, None]) & (
            direction[here, :, None] == one.direction[near, None]
        )
        pair, place = (found.any(axis=2) & (system[here] != REJECTED)).nonzero()
        same[here[pair], place] = True
        sure += weight * same
    return np.minimum(sure, 1.0)


def softmax(scores: FloatArray) -> FloatArray:
    """Return exp(scores) over their sum; the call overhead of scipy's exceeds the computation."""
    weights = np.exp(scores - scores.max())
    return np.asarray(weights / weights.sum())


def _own_jump(posterior: Posterior, starts: tuple[IntArray, ...], who: int, slot: int) -> tuple[float, float]:
    """Return size and std of one system's share of a jump that two made at once, from the friction of its sojourns."""
    after = int(np.searchsorted(starts[who], slot, side="right")) - 1
    size, variance = 0.0, 0.0
    for sojourn, sign in ((after - 1, -1.0), (after, 1.0)):
        column = int(posterior.column[who][sojourn])
        if column >= 0:
            size += sign * float(posterior.mean[column])
            variance += float(posterior.std[column]) ** 2
    return size, float(np.sqrt(variance))
