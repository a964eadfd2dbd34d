"""Stage 3: which hidden switching system made which jump, and which candidates are no jumps (method `joint`, errata 8).

1. The slope that all levels share, positions of the candidates and signs of their jumps, from the range sums.
2. The best assignments for these, by the exact search of `assignment_search`.
3. Slope, positions and signs again, from the accepted changepoints; back to 2 until nothing changes.
4. The best few are ranked by the full likelihood: slope and friction of all sojourns integrated out, closure at q = 0,
   friction laws (`friction_model`).
5. The probability of each attribution is the weight of the assignments that share it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from rwa_monitor.changepoints.estimation import estimate, jump_std
from rwa_monitor.changepoints.stage_results import (
    REJECTED,
    UNATTRIBUTED,
    Alternative,
    Assignment,
    Candidates,
    Estimate,
    Evidence,
    FlatPath,
    SwitchingPath,
)
from rwa_monitor.kernels.assignment import add_agreement, weigh
from rwa_monitor.kernels.segments import fit_table
from rwa_monitor.samples import BoolArray, FloatArray, IntArray
from rwa_monitor.switching import segments
from rwa_monitor.switching.assignment_search import REJECT, Path, Problem, Sizes, search
from rwa_monitor.switching.carried_state import CarriedState
from rwa_monitor.switching.duration_likelihoods import Onset, onsets, tabulated_durations
from rwa_monitor.switching.friction_model import (
    Cases,
    Posterior,
    Priors,
    law_moments,
    prior_tables,
    priors_of,
    solve,
)
from rwa_monitor.switching.segments import Level
from rwa_monitor.wheel.wheel import Wheel

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


@dataclass(frozen=True, slots=True)
class _Ranked:
    """A path of the search as a switching path, with its full log-likelihood."""

    path: FlatPath
    system: IntArray  # (m, 2), see `kernels.assignment.tell`, as `direction`
    direction: IntArray
    borders: IntArray  # slots at which its segments begin and end
    moments: FloatArray  # of these
    log_evidence: float
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
        What earlier windows showed, or None.
    limit
        Extensions of partial assignments kept per candidate; past it the search is pruned and marked so.

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
    index = segments.refine(evidence.sums, candidates.index, reach, level.slope, case.variance)
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
        if settled and np.array_equal(again.at, level.at) and np.array_equal(new_signs, signs):
            break
        level, signs = again, new_signs
        problem = _problem(case, level, signs)
        result = search(problem, paths=KEPT_PATHS, margin=MARGIN, budget=limit)
        states += result.states
    ranked = _rank(case, problem, result.paths, level)
    return _result(case, level.at, ranked, states, result.pruned)


def _priors(evidence: Evidence, wheel: Wheel, carried: CarriedState | None) -> Priors:
    """Gather the priors; sizes seen in the window stand in for what the wheel file does not state."""
    whole = evidence.sums.between(np.array([0]), np.array([evidence.slots]))
    typical_level = float(whole.z[0] / max(whole.n[0], 1.0))
    return priors_of(wheel, carried, typical_level, segments.typical_jump(evidence.candidates.jump))


def _measure(case: _Case, index: IntArray, accepted: IntArray) -> Level:
    """Measure slope and levels between the accepted candidates."""
    evidence, prior = case.evidence, case.priors.slope
    nodes = segments.nodes_of(accepted, index.size)
    return segments.measure_level(
        index, nodes, evidence.sums.arrays, evidence.slots, case.variance, prior.mean, prior.std
    )


def _problem(case: _Case, level: Level, signs: BoolArray) -> Problem:
    """Tabulate all scores at the present positions, slope and signs."""
    systems, slots = case.wheel.fss, case.evidence.slots
    return Problem(
        fit=fit_table(level.pairs, level.slope, case.variance, level.spread),
        durations=tabulated_durations(systems, level.at, slots, case.onsets),
        configurations=np.array([system.configurations for system in systems], dtype=np.int64),
        signs=signs,
        reject=LOG_REJECT,
        unattributed=_log_unattributed(case.wheel, slots),
        simultaneous=LOG_SIMULTANEOUS,
        sizes=_sizes(case, level),
    )


def _sizes(case: _Case, level: Level) -> Sizes:
    """Put sizes of jumps and friction laws side by side."""
    mean, variance = law_moments(case.priors.laws, case.priors.anomaly)
    return Sizes(
        jump=level.jump,
        variance=np.where(np.isfinite(level.jump_variance), level.jump_variance, level.spread**2),
        law_mean=mean,
        law_variance=variance,
        log_range=float(np.log(level.spread)),
        unattributed_variance=case.priors.unattributed_std**2,
    )


def _signs(candidates: Candidates, level: Level, accepted: IntArray) -> BoolArray:
    """Return the possible signs of all candidates; those accepted by the levels beside them."""
    nodes = segments.nodes_of(accepted, len(candidates))
    return segments.possible_signs(candidates, level.pairs, nodes, level.slope)


def _refine_accepted(case: _Case, level: Level, accepted: IntArray) -> IntArray:
    """Refine the positions of the accepted candidates between accepted neighbours; keep the order of all."""
    evidence = case.evidence
    reach = segments.reach_of(evidence.candidates)[accepted]
    moved = level.at.copy()
    moved[accepted] = segments.refine(evidence.sums, level.at[accepted], reach, level.slope, case.variance)
    return moved if (moved[1:] > moved[:-1]).all() else level.at


def _log_unattributed(wheel: Wheel, slots: int) -> float:
    """Return the log prior, per slot, of a jump that no switching system made."""
    expected = UNATTRIBUTED_PER_WINDOW if wheel.fss else UNATTRIBUTED_ALONE
    return float(np.log(min(expected / slots, 1.0)))


# ---- ranking by the full likelihood ----------------------------------------------------------------------------------


def _rank(case: _Case, problem: Problem, paths: tuple[Path, ...], level: Level) -> list[_Ranked]:
    """Score the best paths by the full likelihood, best first."""
    knowns = Knowns(
        case.evidence.slots, *prior_tables(case.priors), case.variance, segments.level_scatter(case.variance)
    )
    ranked = []
    for path in paths:
        start = np.array(path.start, dtype=np.int64)
        weighed = weigh(problem.scores, start, path.actions, level.at, level.pairs, knowns)
        ranked.append(_Ranked(FlatPath(*weighed[0]), *weighed[1:]))
    return sorted(ranked, key=lambda one: -one.score)


def _result(
    case: _Case, index: IntArray, ranked: list[_Ranked], states: int, pruned: bool
) -> tuple[Assignment, Estimate]:
    """Bring the best path into the form that later stages read."""
    best = ranked[0]
    evidence, candidates = case.evidence, case.evidence.candidates
    accepted = np.flatnonzero(best.system[:, 0] != REJECTED)
    levels = estimate(evidence, index[accepted], prior=case.priors.slope)
    jump, std = candidates.jump.copy(), _contrast_std(candidates)
    jump[accepted] = levels.level[1:] - levels.level[:-1]
    std[accepted] = jump_std(evidence, levels)
    sure = _confidence(ranked, index)
    path = best.path.by_system()
    double, alone = best.system[:, 1] != REJECTED, best.system[:, 0] == UNATTRIBUTED
    direction = best.direction.copy()
    direction[alone, 0] = np.sign(jump[alone])
    # One entry for each candidate, and a second one where two systems jump at once, of which each has its own share.
    reported = np.ones_like(best.system, dtype=np.bool_)
    reported[:, 1] = double
    place = reported.ravel().nonzero()[0]
    size, size_std = jump[place // 2], std[place // 2]
    if place.size > double.size:
        scatter = segments.level_scatter(case.variance)
        posterior = solve(best.path, best.borders, best.moments, case.priors, case.variance, scatter)
        for entry in np.flatnonzero(double[place // 2]):
            who, slot = int(best.system.ravel()[place[entry]]), int(index[place[entry] // 2])
            size[entry], size_std[entry] = _own_jump(posterior, path, who, slot)
    assignment = Assignment(
        index=index[place // 2],
        system=best.system.ravel()[place],
        direction=direction.ravel()[place],
        jump=size,
        jump_std=size_std,
        confidence=sure.ravel()[place],
        configurations=path.configurations,
        starts=path.starts,
        log_score=best.score,
        states=states,
        pruned=pruned,
        alternatives=_alternatives(ranked, index),
    )
    return assignment, levels


def _alternatives(ranked: list[_Ranked], index: IntArray) -> tuple[Alternative, ...]:
    """Return the likeliest path of each sequence of configurations, with the weight of all that share it."""
    alike: dict[tuple[bytes, ...], list[_Ranked]] = {}
    for one in ranked:
        path = one.path
        same = tuple(part.tobytes() for part in (path.configurations, path.sojourns, path.unattributed))
        alike.setdefault(same, []).append(one)
    return tuple(
        Alternative(
            path=best.path.by_system(),
            index=index[best.system[:, 0] != REJECTED],
            log_durations=_log_sum(best.score, [one.score for one in others]) - best.log_evidence,
            log_score=best.score,
        )
        for best, *others in alike.values()
    )


def _log_sum(first: float, others: Sequence[float]) -> float:
    """Return the logarithm of the sum of what these are logarithms of."""
    return float(np.logaddexp.reduce([first, *others])) if others else first


def _confidence(ranked: list[_Ranked], index: IntArray) -> FloatArray:
    """Return the probability of each attribution of the best: the weight of all that agree, (m, 2).

    The same system and direction at a candidate within SAME_JUMP slots is the same attribution.
    """
    best = ranked[0]
    weights = np.exp(np.array([one.score for one in ranked]) - best.score)
    weights /= weights.sum()
    sure = np.zeros(best.system.shape)
    for weight, one in zip(weights, ranked, strict=True):
        add_agreement(index, SAME_JUMP, best.system, best.direction, one.system, one.direction, weight, sure)
    return np.minimum(sure, 1.0)


def _contrast_std(candidates: Candidates) -> FloatArray:
    """Return the standard deviation of each contrast: jump over the root of its χ² statistic."""
    return np.asarray(np.abs(candidates.jump) / np.sqrt(np.maximum(candidates.statistic, 1e-12)))


def _own_jump(posterior: Posterior, path: SwitchingPath, who: int, slot: int) -> tuple[float, float]:
    """Return one system's share of a jump that two made at once, from the friction of its sojourns."""
    after = int(np.searchsorted(path.starts[who], slot, side="right")) - 1
    size, variance = 0.0, 0.0
    for sojourn, sign in ((after - 1, -1.0), (after, 1.0)):
        column = int(posterior.column[who][sojourn])
        if column >= 0:
            size += sign * float(posterior.mean[column])
            variance += float(posterior.std[column]) ** 2
    return size, float(np.sqrt(variance))
