"""Base, viscous and each sojourn's friction as one linear Gaussian model, given who jumped when.

The level between two changepoints is the base, plus the friction of the sojourn in which each system then is (0 in
configuration 0: a return jump undoes its entry), plus jumps that no system made. With Gaussian priors the posterior
and the evidence have closed forms; both come from the moments of the segments.

The priors are those of `friction_priors`: a mixture of cases, each a Gaussian model of its own. Where the window tells
the parts apart, all cases agree; where it does not, the mixture is what is known.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from rwa_monitor.changepoints.running_sums import Moments
from rwa_monitor.changepoints.stage_results import FlatStory, Story
from rwa_monitor.kernels.friction import condition, lay_out, solve_cases
from rwa_monitor.samples import FloatArray, IntArray
from rwa_monitor.switching.friction_priors import Priors, case_table, law_table

FLAT_STD: Final = 30.0  # normalised: a prior so wide says nothing, and the sums keep their digits


class Cases(NamedTuple):
    """The prior as a mixture: the base and each system are in one of a few states, and each case chooses them.

    Attributes
    ----------
    states
        float64 (states, 1 + systems, 2): mean and std of the base and of each system's anomaly in each of its states.
        A part with fewer states repeats its first.
    choice
        int64 (cases, 1 + systems), the state of each part.
    log_prior
        float64 (cases,), log-probability of each case.
    rest
        Standard deviation of an unattributed jump; mean and standard deviation of the slope.
    """

    states: FloatArray
    choice: IntArray
    log_prior: FloatArray
    rest: FloatArray


@dataclass(frozen=True, slots=True)
class Posterior:
    """Result of the linear model.

    Attributes
    ----------
    log_evidence
        Log-likelihood of the window with all friction values integrated out, up to a constant of the data.
    mean, std
        Of base, friction of each unknown sojourn, unattributed jumps, viscous coefficient, in this order.
    covariance
        Their covariance.
    column
        For each system: int64 (sojourns,), where its friction stands in `mean`; -1 where it is 0 by law.
    """

    log_evidence: float
    mean: FloatArray
    std: FloatArray
    covariance: FloatArray
    column: tuple[IntArray, ...]


def solve(
    story: Story, borders: IntArray, segments: Moments, priors: Priors, variance: float, scatter: float
) -> Posterior:
    """Solve the linear model of one story.

    Parameters
    ----------
    story
        Who jumped when.
    borders
        int64 (segments + 1,), slots at which segments begin and end.
    segments
        Moments of the segments.
    priors
        What is known before.
    variance
        Of the noise, as `segments.effective_variance`.
    scatter
        Variance of the levels about the model, as `segments.level_scatter`.
    """
    return solve_flat(story.flat(), borders, segments.table, priors, variance, scatter)


def solve_flat(
    story: FlatStory, borders: IntArray, moments: FloatArray, priors: Priors, variance: float, scatter: float
) -> Posterior:
    """Solve the linear model of one story; as `solve`, of the arrays behind story and moments."""
    table, cases = prior_tables(priors)
    evidence, mean, std, covariance, column = solve_cases(story, borders, table, moments, cases, variance, scatter)
    return Posterior(evidence, mean, std, covariance, story.split(column))


def prior_tables(priors: Priors) -> tuple[FloatArray, Cases]:
    """Return the priors as kernels take them: of friction laws, and of everything else."""
    rest = np.array([priors.unattributed_std, priors.slope.mean, priors.slope.std])
    return law_table(priors.laws), Cases(*case_table(priors.base, priors.anomaly), rest)


def measure(
    story: Story, borders: IntArray, segments: Moments, priors: Priors, variance: float, scatter: float
) -> Posterior:
    """Solve the linear model of one story without friction laws: what the samples alone say of base and sojourns.

    The log evidence is then that of the samples with base and friction integrated out over flat priors of density 1,
    so that stories with different numbers of them compare once their friction is weighed by its laws. Where systems
    never rest, friction can move from the base to each of them without a trace in the samples; of these directions it
    is the evidence per unit of the systems' friction, and the means are one point of many.

    Parameters
    ----------
    story, borders, segments, priors, variance, scatter
        See `solve`; of the priors, those of the slope and of unattributed jumps count.
    """
    flat = story.flat()
    levels, column, laws = lay_out(flat, borders, law_table(priors.laws))
    columns = flat.split(column)
    free = 1 + laws.shape[1]
    mean, std = np.zeros(levels.shape[1] + 1), np.full(levels.shape[1] + 1, priors.unattributed_std)
    mean[0], mean[1:free], std[:free] = priors.base[0].mean, laws[1], FLAT_STD
    mean[-1], std[-1] = priors.slope.mean, priors.slope.std
    covariance, independent = np.empty((mean.size, mean.size)), np.arange(mean.size)
    evidence = condition(
        levels,
        segments.table,
        mean.copy(),
        np.diag(std**2),
        independent,
        variance,
        scatter,
        mean,
        covariance,
    )
    # The sojourns of the systems that never rest: along such a direction all of them rise and the base falls.
    moving = [float(column.size) for column in columns if column.size and (column >= 0).all()]
    lost = np.linalg.slogdet(np.ones((len(moving), len(moving))) + np.diag(moving))[1]
    evidence += (free - len(moving)) * np.log(FLAT_STD * np.sqrt(2.0 * np.pi)) + 0.5 * lost
    return Posterior(float(evidence), mean, np.sqrt(np.maximum(np.diag(covariance), 0.0)), covariance, columns)
