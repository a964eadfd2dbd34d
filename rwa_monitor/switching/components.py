"""Friction split into base, viscous and each sojourn's share, given a switching path (errata 10).

Uses the same linear Gaussian model that ranks the assignments. Where a system rests in the window, the data alone
separate base and system. Where it never does, learned friction laws and earlier windows do so as far as they can. A
system that visits fewer configurations than it has may also be one configuration higher or lower throughout, which
leaves every jump unchanged and moves the base by a whole configuration: such paths are weighted by their probability.
The values are those of the assigned path; the standard deviations include the distance to the alternatives.
"""

import math
from collections.abc import Callable, Sequence
from functools import partial
from itertools import islice, product
from typing import Final

import numpy as np

from rwa_monitor.changepoints.estimation import effective_variance, level_scatter
from rwa_monitor.changepoints.noise import median_size
from rwa_monitor.changepoints.stage_results import (
    REJECTED,
    UNATTRIBUTED,
    Alternative,
    Assignment,
    Components,
    ConditionalEstimate,
    Estimate,
    Evidence,
    SwitchingPath,
)
from rwa_monitor.samples import FloatArray, IntArray
from rwa_monitor.switching.assignment import KEPT_PATHS, softmax
from rwa_monitor.switching.carried_state import CarriedState
from rwa_monitor.switching.duration_likelihoods import Number, log_probability, onsets
from rwa_monitor.switching.friction_model import Posterior, Priors, measure, priors_of, solve
from rwa_monitor.wheel.wheel import Wheel

MOST_PATHS: Final = 8  # paths that are returned
LEAST_SCORE: Final = -8.0  # below the assigned path's, under broad friction laws: learned laws make up for less


def split(
    assignment: Assignment, estimate: Estimate, evidence: Evidence, wheel: Wheel, carried: CarriedState | None = None
) -> Components:
    """Split the friction of a window into its parts.

    Parameters
    ----------
    assignment, estimate
        Result of `assignment.assign`.
    evidence, wheel
        The window and its wheel.
    carried
        The state after earlier windows, or None.

    Returns
    -------
    Components
        Normalised. Jumps that no system made are part of the base: it is the mean over the window's samples. Where the
        wheel names no system at all, jumps imply that there is one, and any share of the level may be its friction:
        the base's standard deviation then includes the base itself.
    """
    path = SwitchingPath.of(
        assignment.configurations, assignment.starts, assignment.index[assignment.system == UNATTRIBUTED]
    )
    jumps = estimate.index
    seen = estimate.level[np.isfinite(estimate.level)]
    level = float(seen.sum()) / seen.size if seen.size else 0.0
    priors = priors_of(wheel, carried, level, median_size(assignment.jump[assignment.system != REJECTED]))
    estimate_by = partial(_estimate, evidence, priors, effective_variance(evidence.noise))

    paths = _shifted(path, wheel)
    durations_of = _durations_of(paths, wheel, evidence.slots, carried)
    estimates = [estimate_by(solve, one, jumps, log) for one, log in zip(paths, durations_of, strict=True)]
    scores = [one.log_weight for one in estimates]
    weights = softmax(np.array(scores))
    parts = [one.components for one in estimates]
    base_std = _spread(weights, [one.base_dry for one in parts], [one.base_dry_std for one in parts])
    alternatives = _alternatives(assignment, jumps, paths, scores, durations_of)
    # If a configuration 0 has friction of its own, that is not separable from the base, and paths are not comparable.
    compare = len(alternatives) > 1 and all(of_system[0].fixed_at_zero for of_system in priors.laws)
    return parts[0]._replace(
        base_dry_std=float(np.hypot(base_std, parts[0].base_dry if jumps.size and not wheel.fss else 0.0)),
        fss_friction_std=tuple(
            _spread(weights, [one.fss_friction[s] for one in parts], [one.fss_friction_std[s] for one in parts])
            for s in range(len(wheel.fss))
        ),
        by_path=tuple(estimate_by(measure, one.path, one.index, one.log_durations) for one in alternatives if compare),
    )


def _shifted(path: SwitchingPath, wheel: Wheel) -> list[SwitchingPath]:
    """Return the path, then those in which systems are shifted up or down by whole configurations throughout."""
    options = []
    for system, visited in zip(wheel.fss, path.split(path.configurations), strict=True):
        low, high = -int(visited.min()), system.configurations - 1 - int(visited.max())
        options.append([0, *(offset for offset in range(low, high + 1) if offset)])
    return [
        path._replace(configurations=path.configurations + np.repeat(np.array(offset, dtype=np.int64), path.sojourns))
        for offset in islice(product(*options), KEPT_PATHS)
    ]


def _durations_of(paths: list[SwitchingPath], wheel: Wheel, slots: int, carried: CarriedState | None) -> list[float]:
    """Return the log-probability of each path's durations; 0 for a single path, which is compared with no other."""
    if len(paths) == 1:
        return [0.0]
    first_sojourns = onsets(wheel.fss, carried)
    return [
        sum(
            log_probability(system, configurations, starts, slots, first)
            for system, configurations, starts, first in zip(
                wheel.fss, path.split(path.configurations), path.split(path.starts), first_sojourns, strict=True
            )
        )
        for path in paths
    ]


def _estimate(
    evidence: Evidence,
    priors: Priors,
    variance: float,
    solver: Callable[..., Posterior],
    path: SwitchingPath,
    index: IntArray,
    durations: float,
) -> ConditionalEstimate:
    """Return the parts of friction given one path, the slots of its jumps, and the log-probability of its durations.

    `solver` is `solve` or `measure`; `variance` as they take it.
    """
    borders, segments = np.concatenate(([0], index, [evidence.slots])), evidence.sums.intervals(index)
    posterior, samples = solver(path, borders, segments, priors, variance, level_scatter(variance)), segments[0]
    base, base_variance = float(posterior.mean[0]), float(posterior.covariance[0, 0])
    if path.unattributed.size:
        weights, later = np.zeros(posterior.mean.size), borders[:-1] >= path.unattributed[:, None]
        weights[0] = 1.0
        weights[-1 - path.unattributed.size : -1] = (later * samples).sum(axis=1) / max(float(samples.sum()), 1.0)
        base, base_variance = float(weights @ posterior.mean), float(weights @ posterior.covariance @ weights)
    components = Components(
        base_dry=base,
        base_dry_std=math.sqrt(max(base_variance, 0.0)),
        viscous=float(posterior.mean[-1]),
        viscous_std=float(posterior.std[-1]),
        fss_friction=tuple(np.where(at >= 0, posterior.mean[at], 0.0) for at in posterior.column),
        fss_friction_std=tuple(np.where(at >= 0, posterior.std[at], 0.0) for at in posterior.column),
    )
    return ConditionalEstimate(path, durations + posterior.log_evidence, components)


def _alternatives(
    assignment: Assignment, index: IntArray, paths: list[SwitchingPath], scores: list[float], durations: list[float]
) -> list[Alternative]:
    """Return the likely paths: those of the assignment, and the assigned one with systems shifted throughout.

    Parameters
    ----------
    assignment, index
        The assignment and the slots of its jumps.
    paths, scores, durations
        The assigned path and the shifted ones (`_shifted`), their log-likelihoods and the durations' part of these.
    """
    assigned = (
        assignment.alternatives[0] if assignment.alternatives else Alternative(paths[0], index, durations[0], scores[0])
    )
    found = {alternative.path.visited(): alternative for alternative in assignment.alternatives}
    for path, score, duration in zip(paths, scores, durations, strict=True):
        raised = Alternative(
            path, index, assigned.log_durations + duration - durations[0], assigned.log_score + score - scores[0]
        )
        found.setdefault(path.visited(), raised)
    likely = [
        alternative for alternative in found.values() if alternative.log_score >= assigned.log_score + LEAST_SCORE
    ]
    return sorted(likely, key=lambda alternative: -alternative.log_score)[:MOST_PATHS]


def _spread(weights: FloatArray, values: Sequence[Number], stds: Sequence[Number]) -> FloatArray:
    """Return the root mean square deviation from the first path's values over all paths; one entry per path."""
    if weights.size == 1:
        return np.asarray(stds[0])
    squares = np.array(stds) ** 2 + (np.array(values) - values[0]) ** 2
    # Not weights @ squares: with BLAS the order of the sum, and whether it is fused, depends on the processor.
    return np.asarray(np.sqrt((squares.T * weights).sum(axis=-1)))
