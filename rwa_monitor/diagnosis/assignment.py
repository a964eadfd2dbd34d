"""Stage 3: which hidden switching system made which jump, and which candidates are no jumps (method `joint`, errata 8).

1. The slope that all levels share, positions of the candidates and signs of their jumps, from the range sums.
2. The best assignments for these, by the exact search of `assignment_search`.
3. Slope, positions and signs again, from the accepted changepoints; back to 2 until nothing changes.
4. The best few are ranked by the full likelihood: slope and friction of all sojourns integrated out, closure at q = 0,
   friction laws (`friction_model`).
5. The probability of each attribution is the weight of the assignments that share it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from rwa_monitor.diagnosis import segments
from rwa_monitor.diagnosis.assignment_search import NO_SYSTEM, REJECT, Path, Problem, Sizes, log_laws, search, step_of
from rwa_monitor.diagnosis.estimation import estimate, jump_std
from rwa_monitor.diagnosis.friction_model import Posterior, solve
from rwa_monitor.diagnosis.friction_priors import Priors, priors_of
from rwa_monitor.diagnosis.laws import Onset, law_tables, onsets
from rwa_monitor.diagnosis.results import (
    REJECTED,
    UNATTRIBUTED,
    Assignment,
    Candidates,
    Estimate,
    Evidence,
    Rival,
    Story,
)
from rwa_monitor.diagnosis.state import CarriedState
from rwa_monitor.physics.wheel import Wheel
from rwa_monitor.samples import BoolArray, FloatArray, IntArray

LOG_REJECT: Final = 0.0  # candidates cost nothing to reject: that they exist is already in the data
UNATTRIBUTED_PER_WINDOW: Final = 0.03  # jumps expected per window that no switching system makes
UNATTRIBUTED_ALONE: Final = 3.0  # the same for a wheel without switching systems
LOG_SIMULTANEOUS: Final = 0.0  # two laws must both end at this very slot, which is rare enough
KEPT_PATHS: Final = 16
MARGIN: Final = 10.0  # log-likelihood below the best at which an assignment is of no interest (e^-10 < 1e-4)
BUDGET: Final = 2000  # extensions kept per candidate
MAX_ROUNDS: Final = 4
SETTLED: Final = 0.1  # log-likelihood that a change of the slope may still be worth
SAME_JUMP: Final = 5  # slots: attributions of positions closer than this are the same


@dataclass(frozen=True, slots=True)
class _Case:
    """The window, its wheel, and what is known before it."""

    evidence: Evidence
    wheel: Wheel
    priors: Priors
    onsets: tuple[Onset | None, ...]
    variance: float  # of the noise, see `segments.effective_variance`


@dataclass(frozen=True, slots=True)
class _Level:
    """The window at given positions of the candidates: all that scores need."""

    index: IntArray
    pairs: FloatArray  # moments between all pairs of nodes, see `segments.pair_moments`
    slope: float
    information: float  # of the slope
    variance: float
    spread: float  # width of the prior of a level
    jump: FloatArray  # size of each candidate's jump, between accepted neighbours
    jump_variance: FloatArray


@dataclass(frozen=True, slots=True)
class _Ranked:
    """The story that a path tells, and its full log-likelihood."""

    story: Story
    system: IntArray  # (m, 2): who jumped at each candidate; REJECTED or UNATTRIBUTED alone, REJECTED in second place
    direction: IntArray  # (m, 2)
    posterior: Posterior
    score: float


def assign(
    evidence: Evidence, wheel: Wheel, carried: CarriedState | None = None, *, limit: int = BUDGET
) -> tuple[Assignment, Estimate]:
    """Decide which candidates are changepoints and which switching system made each.

    Parameters
    ----------
    evidence
        Candidates, range sums and noise of the window.
    wheel
        Its wheel; any number of switching systems.
    carried
        What earlier windows told, or None.
    limit
        Extensions of partial assignments kept per candidate; past it the search is pruned and says so.

    Returns
    -------
    tuple[Assignment, Estimate]
        All candidates, with rejected ones; and levels and slope between the accepted changepoints.
    """
    case = _Case(
        evidence,
        wheel,
        _priors(evidence, wheel, carried),
        onsets(wheel.fss, carried),
        segments.effective_variance(evidence.noise),
    )
    candidates = evidence.candidates
    everyone: IntArray = np.arange(len(candidates), dtype=np.int64)
    level = _measure(case, candidates.index, everyone)
    reach = segments.reach_of(candidates)
    index = segments.refine(evidence.sums, candidates.index, reach, level.slope, level.variance)
    level = _measure(case, index, everyone)
    signs = _signs(candidates, level, everyone)
    problem = _problem(case, level, signs)
    result = search(problem, paths=KEPT_PATHS, margin=MARGIN, budget=limit)
    states = result.states
    for _ in range(MAX_ROUNDS - 1):
        accepted = np.flatnonzero(result.paths[0].actions != REJECT)
        again = _measure(case, _refine_accepted(case, level, accepted), accepted)
        new_signs = signs.copy()
        new_signs[accepted] = _signs(candidates, again, accepted)[accepted]
        settled = 0.5 * again.information * (again.slope - level.slope) ** 2 < SETTLED
        if settled and np.array_equal(again.index, level.index) and np.array_equal(new_signs, signs):
            break
        level, signs = again, new_signs
        problem = _problem(case, level, signs)
        result = search(problem, paths=KEPT_PATHS, margin=MARGIN, budget=limit)
        states += result.states
    ranked = _rank(case, problem, result.paths, level)
    return _result(case, level.index, ranked, states, result.pruned)


def _priors(evidence: Evidence, wheel: Wheel, carried: CarriedState | None) -> Priors:
    """Gather the priors; sizes seen in the window stand in for what the wheel does not tell."""
    whole = evidence.sums.between(np.array([0]), np.array([evidence.slots]))
    typical_level = float(whole.z[0] / max(whole.n[0], 1.0))
    jumps = np.abs(evidence.candidates.jump[np.isfinite(evidence.candidates.jump)])
    return priors_of(wheel, carried, typical_level, float(np.median(jumps)) if jumps.size else 0.0)


def _measure(case: _Case, index: IntArray, accepted: IntArray) -> _Level:
    """Measure slope and levels between the accepted candidates."""
    sums, variance, prior = case.evidence.sums, case.variance, case.priors.slope
    pairs = segments.pair_moments(np.concatenate(([0], index, [case.evidence.slots])), sums.arrays)
    nodes = _nodes(accepted, index.size)
    slope, information = segments.shared_slope(pairs, nodes, variance, prior.mean, prior.std)
    spread = segments.level_range(segments.levels_of(pairs, nodes, slope), variance)
    jump, jump_variance = segments.jumps_of(pairs, nodes, slope, information, variance)
    return _Level(index, pairs, slope, information, variance, spread, jump, jump_variance)


def _problem(case: _Case, level: _Level, signs: BoolArray) -> Problem:
    """Tabulate all scores at the present positions, slope and signs."""
    systems, slots = case.wheel.fss, case.evidence.slots
    return Problem(
        fit=segments.fit_table(level.pairs, level.slope, level.variance, level.spread),
        laws=law_tables(systems, level.index, slots, case.onsets),
        configurations=np.array([system.configurations for system in systems], dtype=np.int64),
        signs=signs,
        reject=LOG_REJECT,
        unattributed=_log_unattributed(case.wheel, slots),
        simultaneous=LOG_SIMULTANEOUS,
        sizes=_sizes(case, level),
    )


def _sizes(case: _Case, level: _Level) -> Sizes:
    """Put sizes of jumps and friction laws side by side."""
    laws = case.priors.laws
    shape = (len(laws), max((len(of_system) for of_system in laws), default=1))
    mean, variance = np.zeros(shape), np.zeros(shape)
    for s, of_system in enumerate(laws):
        for q in range(len(of_system)):
            mean[s, q], variance[s, q] = case.priors.moments(s, q)
    blind = ~np.isfinite(level.jump_variance)
    return Sizes(
        jump=level.jump,
        variance=np.where(blind, level.spread**2, level.jump_variance),
        law_mean=mean,
        law_variance=variance,
        log_range=float(np.log(level.spread)),
        unattributed_variance=case.priors.unattributed_std**2,
    )


def _nodes(accepted: IntArray, count: int) -> IntArray:
    """Return the nodes of the segments between the accepted candidates."""
    return np.concatenate(([0], accepted + 1, [count + 1]))


def _signs(candidates: Candidates, level: _Level, accepted: IntArray) -> BoolArray:
    """Return the possible signs of all candidates; those accepted by the levels beside them."""
    levels = segments.levels_of(level.pairs, _nodes(accepted, len(candidates)), level.slope)
    by_node = np.full(len(candidates) + 1, np.nan)
    by_node[0] = levels[0]
    by_node[accepted + 1] = levels[1:]
    filled = np.maximum.accumulate(np.where(np.isfinite(by_node), np.arange(by_node.size), 0))
    return segments.possible_signs(candidates, by_node[filled])


def _refine_accepted(case: _Case, level: _Level, accepted: IntArray) -> IntArray:
    """Refine the positions of the accepted candidates between accepted neighbours; keep the order of all."""
    evidence = case.evidence
    reach = segments.reach_of(evidence.candidates)[accepted]
    moved = level.index.copy()
    moved[accepted] = segments.refine(evidence.sums, level.index[accepted], reach, level.slope, level.variance)
    return moved if np.all(np.diff(moved) > 0) else level.index


def _log_unattributed(wheel: Wheel, slots: int) -> float:
    """Return the log prior, per slot, of a jump that no switching system made."""
    expected = UNATTRIBUTED_PER_WINDOW if wheel.fss else UNATTRIBUTED_ALONE
    return float(np.log(min(expected / slots, 1.0)))


# ---- ranking by the full likelihood ----------------------------------------------------------------------------------


def _rank(case: _Case, problem: Problem, paths: tuple[Path, ...], level: _Level) -> list[_Ranked]:
    """Score the best paths by the full likelihood, best first."""
    actions, index, scatter = problem.actions, level.index, segments.level_scatter(level.variance)
    ranked = []
    for path in paths:
        accepted = np.flatnonzero(path.actions != REJECT)
        nodes = _nodes(accepted, index.size)
        story, system, direction = _tell(path, actions, index)
        borders = np.concatenate([[0], index[accepted], [case.evidence.slots]])
        posterior = solve(story, borders, segments.chain_of(level.pairs, nodes), case.priors, level.variance, scatter)
        laws = log_laws(problem, path)
        ranked.append(_Ranked(story, system, direction, posterior, laws + posterior.log_evidence))
    return sorted(ranked, key=lambda one: -one.score)


def _tell(path: Path, actions: IntArray, index: IntArray) -> tuple[Story, IntArray, IntArray]:
    """Turn a path into sojourns, and into systems and directions per candidate."""
    configurations = [[q] for q in path.start]
    starts = [[0] for _ in path.start]
    system = np.full((index.size, 2), REJECTED, dtype=np.int64)
    direction = np.zeros((index.size, 2), dtype=np.int64)
    rows, slots = actions.tolist(), index.tolist()
    for k, action in enumerate(path.actions.tolist()):
        if action == REJECT:
            continue
        if action == NO_SYSTEM:
            system[k, 0] = UNATTRIBUTED
            continue
        row = rows[action]
        for place, (who, number) in enumerate((row[:2], row[2:])):
            if who < 0:
                continue
            step, missed = step_of(number)
            if missed:  # where it happened is not known; the level says: right after the sojourn began
                starts[who].append(starts[who][-1] + 1)
                configurations[who].append(configurations[who][-1] + missed)
            system[k, place], direction[k, place] = who, step
            starts[who].append(slots[k])
            configurations[who].append(configurations[who][-1] + step)
    story = Story(
        tuple(np.array(q, dtype=np.int64) for q in configurations),
        tuple(np.array(slot, dtype=np.int64) for slot in starts),
        index[system[:, 0] == UNATTRIBUTED],
    )
    return story, system, direction


def _result(
    case: _Case, index: IntArray, ranked: list[_Ranked], states: int, pruned: bool
) -> tuple[Assignment, Estimate]:
    """Put the best story into the form that later stages read."""
    best = ranked[0]
    evidence, candidates = case.evidence, case.evidence.candidates
    accepted = np.flatnonzero(best.system[:, 0] != REJECTED)
    levels = estimate(evidence, index[accepted], prior=case.priors.slope)
    jump, std = candidates.jump.copy(), _contrast_std(candidates)
    jump[accepted] = np.diff(levels.level)
    std[accepted] = jump_std(evidence, levels)
    sure = _confidence(ranked, index)
    rows = []
    for k, place in np.argwhere((best.system != REJECTED) | (np.array([0, 1]) == 0)):
        who, direction = int(best.system[k, place]), int(best.direction[k, place])
        size, size_std = float(jump[k]), float(std[k])
        if best.system[k, 1] != REJECTED:
            size, size_std = _own_jump(best, who, int(index[k]))
        if who == UNATTRIBUTED:
            direction = int(np.sign(size))
        rows.append((int(index[k]), who, direction, size, size_std, sure[k, place]))
    columns = list(zip(*rows, strict=True)) if rows else [()] * 6
    assignment = Assignment(
        index=np.array(columns[0], dtype=np.int64),
        system=np.array(columns[1], dtype=np.int64),
        direction=np.array(columns[2], dtype=np.int64),
        jump=np.array(columns[3], dtype=np.float64),
        jump_std=np.array(columns[4], dtype=np.float64),
        confidence=np.array(columns[5], dtype=np.float64),
        configurations=best.story.configurations,
        starts=best.story.starts,
        log_score=best.score,
        states=states,
        pruned=pruned,
        rivals=_rivals(ranked, index),
    )
    return assignment, levels


def _rivals(ranked: list[_Ranked], index: IntArray) -> tuple[Rival, ...]:
    """Return the likeliest story of each sequence of configurations, with the weight of all that share it."""
    alike: dict[tuple[bytes, ...], list[_Ranked]] = {}
    for one in ranked:
        same = (*(q.tobytes() for q in one.story.configurations), one.story.unattributed.tobytes())
        alike.setdefault(same, []).append(one)
    return tuple(
        Rival(
            story=best.story,
            index=index[best.system[:, 0] != REJECTED],
            log_laws=float(np.logaddexp.reduce([one.score for one in (best, *others)])) - best.posterior.log_evidence,
            log_score=best.score,
        )
        for best, *others in alike.values()
    )


def _confidence(ranked: list[_Ranked], index: IntArray) -> FloatArray:
    """Return the probability of each attribution of the best: the weight of all that say the same, (m, 2).

    The same system and direction at a candidate within SAME_JUMP slots is the same attribution.
    """
    best = ranked[0]
    weights = np.exp(np.array([one.score for one in ranked]) - best.score)
    weights /= weights.sum()
    sure = np.zeros(best.system.shape)
    for weight, one in zip(weights, ranked, strict=True):
        # Two that jump at once are listed in the order of their systems, so places correspond.
        same = (one.system == best.system) & (one.direction == best.direction)
        for k, place in np.argwhere(~same & (best.system != REJECTED)):
            near = np.abs(index - index[k]) <= SAME_JUMP
            alike = (one.system == best.system[k, place]) & (one.direction == best.direction[k, place])
            same[k, place] = bool(np.any(alike[near]))
        sure += weight * same
    return np.minimum(sure, 1.0)


def _contrast_std(candidates: Candidates) -> FloatArray:
    """Return the standard deviation of each contrast: jump over the root of its χ² statistic."""
    return np.asarray(np.abs(candidates.jump) / np.sqrt(np.maximum(candidates.statistic, 1e-12)))


def _own_jump(best: _Ranked, who: int, slot: int) -> tuple[float, float]:
    """Return one system's share of a jump that two made at once, from the friction of its sojourns."""
    after = int(np.searchsorted(best.story.starts[who], slot, side="right")) - 1
    size, variance = 0.0, 0.0
    for sojourn, sign in ((after - 1, -1.0), (after, 1.0)):
        column = int(best.posterior.column[who][sojourn])
        if column >= 0:
            size += sign * float(best.posterior.mean[column])
            variance += float(best.posterior.std[column]) ** 2
    return size, float(np.sqrt(variance))
