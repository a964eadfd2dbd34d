"""Friction split into base, viscous and each sojourn's share, given who jumped when (errata 10).

The same linear Gaussian model that ranks the assignments. Where a system rests in the window, the data alone tell base
and system apart. Where it never does, learned friction laws and earlier windows decide as far as they can; what they
leave open shows in the standard deviations.
"""

from __future__ import annotations

import numpy as np

from rwa_monitor.diagnosis.friction_model import Story, priors_of, solve
from rwa_monitor.diagnosis.results import REJECTED, UNATTRIBUTED, Assignment, Components, Estimate, Evidence
from rwa_monitor.diagnosis.segments import effective_variance, level_scatter
from rwa_monitor.diagnosis.state import CarriedState
from rwa_monitor.physics.wheel import Wheel
from rwa_monitor.samples import FloatArray, IntArray


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
        What earlier windows told, or None.

    Returns
    -------
    Components
        Normalised. Jumps that no system made are part of the base: it is the mean over the window's samples.
    """
    is_free = assignment.system == UNATTRIBUTED
    story = Story(assignment.configurations, assignment.starts, assignment.index[is_free])
    jumps = np.unique(assignment.index[assignment.system != REJECTED])
    borders = np.concatenate([[0], jumps, [evidence.slots]]).astype(np.int64)
    segments = evidence.sums.between(borders[:-1], borders[1:])
    sizes = np.abs(assignment.jump[assignment.system != REJECTED])
    typical_jump = float(np.median(sizes)) if sizes.size else 0.0
    seen = np.isfinite(estimate.level)
    priors = priors_of(wheel, carried, float(np.mean(estimate.level[seen])) if seen.any() else 0.0, typical_jump)
    variance = effective_variance(evidence.noise)
    posterior = solve(story, borders, segments, priors, variance, level_scatter(variance))

    weights = np.zeros(posterior.mean.size)
    weights[0] = 1.0
    first_free = posterior.mean.size - 1 - story.unattributed.size
    total = max(float(segments.n.sum()), 1.0)
    for j, slot in enumerate(story.unattributed):
        weights[first_free + j] = float(segments.n[borders[:-1] >= slot].sum()) / total
    friction, friction_std = [], []
    for column in posterior.column:
        known = column >= 0
        friction.append(np.where(known, posterior.mean[column], 0.0))
        friction_std.append(np.where(known, posterior.std[column], 0.0))
    return Components(
        base_dry=float(weights @ posterior.mean),
        base_dry_std=float(np.sqrt(np.maximum(weights @ posterior.covariance @ weights, 0.0))),
        viscous=float(posterior.mean[-1]),
        viscous_std=float(posterior.std[-1]),
        fss_friction=tuple(friction),
        fss_friction_std=tuple(friction_std),
        base_ambiguous=not all(
            _rests(configurations, starts, borders, segments.n)
            for configurations, starts in zip(assignment.configurations, assignment.starts, strict=True)
        ),
    )


def _rests(configurations: IntArray, starts: IntArray, borders: IntArray, samples: FloatArray) -> bool:
    """Whether the system is in configuration 0 in any segment that holds samples."""
    sojourn = np.searchsorted(starts, borders[1:] - 1, side="right") - 1
    return bool(np.any((configurations[sojourn] == 0) & (samples > 0)))
