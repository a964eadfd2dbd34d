"""Base, viscous and each sojourn's friction as one linear Gaussian model, given who jumped when.

The level between two changepoints is the base, plus the friction of the sojourn in which each system then is (0 in
configuration 0: a return jump undoes its entry), plus jumps that no system made. With Gaussian priors the posterior
and the evidence have closed forms; both come from the moments of the segments.

Prior of a system's friction: sojourn j in configuration q has (1 + a) (mid_q + d_j), where the anomaly a is shared by
all sojourns of the system (paper: an anomaly changes P_f) and d_j is the scatter of the friction law. The base and each
system are healthy, or one or two of them are not: each such case is a Gaussian model of its own, and the posterior is
their mixture. Where the window tells the parts apart, all cases agree; where it does not, the mixture is what is known.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from typing import Final

import numpy as np
from numba import njit

from rwa_monitor.diagnosis.estimation import SlopePrior, nominal_viscous
from rwa_monitor.diagnosis.results import Story
from rwa_monitor.diagnosis.running_sums import Moments
from rwa_monitor.diagnosis.state import CHANGE_PER_WINDOW, CarriedState
from rwa_monitor.physics.wheel import SwitchingSystem, Wheel
from rwa_monitor.samples import FloatArray, IntArray

VISCOUS_SPREAD: Final = 0.5  # the same of the viscous coefficient
CARRIED_VISCOUS_SPREAD: Final = 0.05  # at least, where earlier windows told the viscous coefficient
LEARNED_SPREAD: Final = 0.15  # of the friction of a system against what earlier windows of this very wheel showed
UNKNOWN_SPREAD: Final = 1.0  # relative, where no friction law is known at all
MIN_LEARNED: Final = 3.0  # sojourns from which what earlier windows showed replaces the wheel's ranges
UNATTRIBUTED_SPREAD: Final = 0.5  # prior std of a jump that no system made, over the unit of friction
MOST_ANOMALIES: Final = 2  # at once, among base and systems
FLAT_STD: Final = 30.0  # normalised: a prior so wide says nothing, and the sums keep their digits


@dataclass(frozen=True, slots=True)
class Case:
    """One of the states that a part may be in: its probability, and what it then is, Gaussian."""

    probability: float
    mean: float
    std: float


# Healthy wheels differ by a few per cent; anomalies worth finding are from +20 % to a multiple. Weights and widths are
# broad on purpose: they only decide where the window cannot.
BASE_CASES: Final = (Case(0.8, 1.0, 0.06), Case(0.2, 1.5, 0.4))  # base dry friction over its nominal value
ANOMALY_CASES: Final = (Case(0.8, 0.0, 0.06), Case(0.2, 0.8, 0.5))  # a system's anomaly a
PIVOT_ROUNDING: Final = 2.0**-52  # of a pivot, relative to the diagonal
LEAST_PIVOT: Final = 1e-60  # of a coefficient that a wheel file leaves no room for


@dataclass(frozen=True, slots=True)
class FrictionLaw:
    """Gaussian law of a configuration's friction in a healthy system, normalised: its mean and standard deviation."""

    mid: float
    scatter: float

    @property
    def fixed_at_zero(self) -> bool:
        """Whether the configuration has no friction at all (rest)."""
        return self.mid == 0.0 and self.scatter == 0.0


@dataclass(frozen=True, slots=True)
class Priors:
    """What is known before the window, normalised.

    Attributes
    ----------
    base
        Cases of the dry friction with all systems at rest, the healthy one first.
    anomaly
        For each system: cases of its anomaly a, the healthy one first.
    laws
        For each system and configuration: the friction law at a = 0.
    slope
        Viscous coefficient.
    unattributed_std
        Standard deviation of a jump that no system made.
    """

    base: tuple[Case, ...]
    anomaly: tuple[tuple[Case, ...], ...]
    laws: tuple[tuple[FrictionLaw, ...], ...]
    slope: SlopePrior
    unattributed_std: float

    def cases(self) -> list[tuple[Case, ...]]:
        """Return all states of (base, each system) with at most `MOST_ANOMALIES` anomalies."""
        return _cases(self.base, self.anomaly)

    def moments(self, s: int, q: int) -> tuple[float, float]:
        """Return mean and variance of the friction of a sojourn over all cases of its system."""
        law, cases = self.laws[s][q], self.anomaly[s]
        total = sum(case.probability for case in cases)
        first = sum(case.probability * (1 + case.mean) for case in cases) / total
        second = sum(case.probability * ((1 + case.mean) ** 2 + case.std**2) for case in cases) / total
        return law.mid * first, second * (law.mid**2 + law.scatter**2) - (law.mid * first) ** 2


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


def priors_of(wheel: Wheel, carried: CarriedState | None, typical_level: float, typical_jump: float) -> Priors:
    """Gather what wheel and earlier windows tell.

    Parameters
    ----------
    wheel, carried
        The wheel; what earlier windows told, or None.
    typical_level, typical_jump
        Sizes in this window: the scale of everything that neither wheel nor earlier windows tell.
    """
    jump = typical_jump if typical_jump > 0 else max(abs(typical_level), 1e-300)
    if carried and carried.base_dry:
        drifted = carried.base_dry.drifted()
        held = Case(drifted.held, drifted.mean, max(drifted.std, 1e-6 * abs(drifted.mean)))
        base: tuple[Case, ...] = (held, _anywhere(1.0 - drifted.held, drifted.mean, wheel))
    elif wheel.nominal:
        base = BASE_CASES
    else:
        base = (Case(1.0, typical_level, 3.0 * (abs(typical_level) + jump)),)
    systems = [_system_of(system, carried, jump) for system in wheel.fss]
    return Priors(
        base=base,
        anomaly=tuple(cases for cases, _ in systems),
        laws=tuple(laws for _, laws in systems),
        slope=slope_prior(wheel, carried, typical_level),
        unattributed_std=UNATTRIBUTED_SPREAD * (1.0 if wheel.nominal else jump),
    )


def _anywhere(probability: float, mean: float, wheel: Wheel) -> Case:
    """Return the case of a base that changed since earlier windows: healthy or not, as one broad Gaussian."""
    if wheel.nominal is None:
        return Case(probability, mean, BASE_CASES[1].std * abs(mean))
    middle = sum(case.probability * case.mean for case in BASE_CASES)
    variance = sum(case.probability * (case.std**2 + (case.mean - middle) ** 2) for case in BASE_CASES)
    return Case(probability, middle, variance**0.5)


def slope_prior(wheel: Wheel, carried: CarriedState | None, typical_level: float) -> SlopePrior:
    """Return the prior of the viscous coefficient: of earlier windows, around the nominal one, or wide."""
    nominal = nominal_viscous(wheel)
    if carried and carried.viscous:
        drifted = carried.viscous.drifted()
        return SlopePrior(drifted.mean, max(drifted.std, CARRIED_VISCOUS_SPREAD * abs(drifted.mean)))
    if nominal is None:
        return SlopePrior(0.0, 10.0 * max(abs(typical_level), 1e-12))
    # A wheel may have no viscous friction to speak of; the dry torque at nominal speed then sets the spread.
    return SlopePrior(nominal, VISCOUS_SPREAD * max(nominal, 0.1))


def _system_of(
    system: SwitchingSystem, carried: CarriedState | None, jump: float
) -> tuple[tuple[Case, ...], tuple[FrictionLaw, ...]]:
    """Return a system's anomaly and friction laws: learned, else the wheel's, else wide and in proportion to q."""
    known = carried.system(system.name) if carried else None
    memories = [known.friction[q] if known and q < len(known.friction) else None for q in range(system.configurations)]
    learned = any(memory is not None and memory.count >= MIN_LEARNED for memory in memories)
    laws = []
    for q, memory in enumerate(memories):
        given = system.friction[q] if system.friction else None
        if q == 0 and (given is None or given.low == given.high == 0.0):
            laws.append(FrictionLaw(0.0, 0.0))
        elif memory is not None and memory.count >= MIN_LEARNED:
            laws.append(FrictionLaw(memory.mean, max(memory.std, 0.02 * abs(memory.mean))))
        elif given is not None:
            mid = 0.5 * (given.low + given.high)
            laws.append(FrictionLaw(mid, max((given.high - given.low) / 12.0**0.5, 0.02 * abs(mid))))
        else:
            laws.append(FrictionLaw(q * jump, UNKNOWN_SPREAD * jump))
    if learned:
        changed = ANOMALY_CASES[1]
        return (
            Case(1.0 - CHANGE_PER_WINDOW, 0.0, LEARNED_SPREAD),
            Case(CHANGE_PER_WINDOW, changed.mean, changed.std),
        ), tuple(laws)
    return (ANOMALY_CASES if system.friction else (Case(1.0, 0.0, UNKNOWN_SPREAD),)), tuple(laws)


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
    design = _design(story, borders, priors)
    cases, log_prior = _case_table(priors.base, priors.anomaly)
    rest = np.array([priors.unattributed_std, priors.slope.mean, priors.slope.std])
    conditioned = _condition_cases(design.levels, segments.table, cases, design.laws, rest, variance, scatter)
    log_evidence, mean, std, covariance = _mix(*conditioned, log_prior)
    return Posterior(float(log_evidence), mean, std, covariance, design.column)


def _cases(base: tuple[Case, ...], anomaly: tuple[tuple[Case, ...], ...]) -> list[tuple[Case, ...]]:
    parts = (base, *anomaly)
    numbered = product(*(range(len(part)) for part in parts))
    return [
        tuple(part[i] for part, i in zip(parts, choice, strict=True))
        for choice in numbered
        if sum(i > 0 for i in choice) <= MOST_ANOMALIES
    ]


@lru_cache(maxsize=256)
def _case_table(base: tuple[Case, ...], anomaly: tuple[tuple[Case, ...], ...]) -> tuple[FloatArray, FloatArray]:
    """Return mean and std of each part in all cases, float64 (cases, parts, 2), and the log of their probabilities."""
    cases = _cases(base, anomaly)
    table = np.array([[(part.mean, part.std) for part in case] for case in cases], dtype=np.float64)
    return table, np.array([sum(np.log(part.probability) for part in case) for case in cases])


@njit(cache=True)
def _condition_cases(
    levels: FloatArray,
    moments: FloatArray,
    cases: FloatArray,
    laws: FloatArray,
    rest: FloatArray,
    variance: float,
    scatter: float,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Condition the prior of each case on the segments.

    Parameters
    ----------
    levels, moments, variance, scatter
        As in `_condition`.
    cases
        float64 (cases, 1 + systems, 2): mean and std of the base and of each system's anomaly.
    laws
        float64 (3, free sojourns): system, mean and standard deviation of each sojourn's friction law.
    rest
        Standard deviation of an unattributed jump; mean and standard deviation of the slope.

    Returns
    -------
    tuple
        Log evidence (cases,), posterior mean (cases, unknowns) and covariance (cases, unknowns, unknowns).
    """
    count, unknowns, sojourns = cases.shape[0], levels.shape[1] + 1, laws.shape[1]
    log_evidence = np.empty(count)
    means = np.empty((count, unknowns))
    covariances = np.empty((count, unknowns, unknowns))
    for c in range(count):
        mean, covariance = np.zeros(unknowns), np.zeros((unknowns, unknowns))
        mean[0], covariance[0, 0] = cases[c, 0, 0], cases[c, 0, 1] * cases[c, 0, 1]
        for i in range(sojourns):
            owner = 1 + int(laws[0, i])
            factor = 1.0 + cases[c, owner, 0]
            mean[1 + i] = factor * laws[1, i]
            deviation = factor * laws[2, i]
            covariance[1 + i, 1 + i] = deviation * deviation
        for i in range(1 + sojourns, unknowns - 1):
            covariance[i, i] = rest[0] * rest[0]
        mean[unknowns - 1], covariance[unknowns - 1, unknowns - 1] = rest[1], rest[2] * rest[2]
        for i in range(sojourns):  # what a system's anomaly does to its sojourns is common to them
            for j in range(sojourns):
                if laws[0, i] == laws[0, j]:
                    spread = cases[c, 1 + int(laws[0, i]), 1]
                    covariance[1 + i, 1 + j] += (spread * laws[1, i]) * (spread * laws[1, j])
        log_evidence[c], means[c], covariances[c] = _condition(levels, moments, mean, covariance, variance, scatter)
    return log_evidence, means, covariances


@njit(cache=True)
def _mix(
    log_evidences: FloatArray, means: FloatArray, covariances: FloatArray, log_prior: FloatArray
) -> tuple[float, FloatArray, FloatArray, FloatArray]:
    """Mix the posteriors of all cases; return log evidence, mean, standard deviation and covariance of the mixture."""
    scores = log_evidences + log_prior
    best = scores.max()
    weights = np.exp(scores - best)
    log_evidence = best + np.log(weights.sum())
    weights /= weights.sum()
    unknowns = means.shape[1]
    mean, covariance = np.zeros(unknowns), np.zeros((unknowns, unknowns))
    for c in range(weights.size):
        mean += weights[c] * means[c]
    for c in range(weights.size):
        for a in range(unknowns):
            apart = weights[c] * (means[c, a] - mean[a])
            for b in range(unknowns):
                covariance[a, b] += weights[c] * covariances[c, a, b] + apart * (means[c, b] - mean[b])
    std = np.empty(unknowns)
    for a in range(unknowns):
        std[a] = np.sqrt(max(covariance[a, a], 0.0))
    return log_evidence, mean, std, covariance


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
    design = _design(story, borders, priors)
    free = 1 + design.laws.shape[1]
    mean, std = np.zeros(design.levels.shape[1] + 1), np.full(design.levels.shape[1] + 1, priors.unattributed_std)
    mean[0], mean[1:free], std[:free] = priors.base[0].mean, design.laws[1], FLAT_STD
    mean[-1], std[-1] = priors.slope.mean, priors.slope.std
    log_evidence, mean, covariance = _condition(design.levels, segments.table, mean, np.diag(std**2), variance, scatter)
    # The sojourns of the systems that never rest: along such a direction all of them rise and the base falls.
    moving = [float(column.size) for column in design.column if column.size and (column >= 0).all()]
    lost = np.linalg.slogdet(np.ones((len(moving), len(moving))) + np.diag(moving))[1]
    log_evidence += (free - len(moving)) * np.log(FLAT_STD * np.sqrt(2.0 * np.pi)) + 0.5 * lost
    return Posterior(
        float(log_evidence), mean, np.sqrt(np.maximum(np.diag(covariance), 0.0)), covariance, design.column
    )


@njit(cache=True)
def _condition(
    levels: FloatArray, moments: FloatArray, mean: FloatArray, covariance: FloatArray, variance: float, scatter: float
) -> tuple[float, FloatArray, FloatArray]:
    """Condition the prior N(mean, covariance) on the segments; return log evidence, posterior mean and covariance.

    Plain loops over small matrices: a tuned library is slower here, and its sums depend on the machine.
    """
    segments, unknowns = levels.shape[0], mean.size
    slope_at = unknowns - 1
    precision, log_determinant = _inverse(covariance)
    response = np.zeros(unknowns)
    row = np.zeros(unknowns)
    squares = 0.0
    for i in range(segments):
        n, x, z, xx, xz, zz = moments[:, i]
        if n == 0.0:
            continue
        x_mean, z_mean = x / n, z / n
        # About the segment's own mean only the slope counts; what is left of z after its prior mean is small.
        sxx = xx - n * x_mean * x_mean
        sxz = xz - n * x_mean * z_mean
        szz = zz - n * z_mean * z_mean
        slope = mean[slope_at]
        precision[slope_at, slope_at] += sxx / variance
        response[slope_at] += (sxz - slope * sxx) / variance
        squares += (szz - 2.0 * slope * sxz + slope * slope * sxx) / variance
        # The mean is one observation of level + slope x_mean.
        mean_variance = variance / n + scatter
        for a in range(slope_at):
            row[a] = levels[i, a]
        row[slope_at] = x_mean
        rest = z_mean
        for a in range(unknowns):
            rest -= row[a] * mean[a]
        squares += rest * rest / mean_variance
        log_determinant += np.log(mean_variance * n / variance)  # relative to independent samples
        for a in range(unknowns):
            if row[a] != 0.0:
                response[a] += row[a] * rest / mean_variance
                for b in range(unknowns):
                    precision[a, b] += row[a] * row[b] / mean_variance
    posterior, log_determinant_precision = _inverse(precision)
    shift = np.zeros(unknowns)
    explained = 0.0
    for a in range(unknowns):
        for b in range(unknowns):
            shift[a] += posterior[a, b] * response[b]
        explained += shift[a] * response[a]
    log_evidence = -0.5 * (squares - explained) - 0.5 * (log_determinant + log_determinant_precision)
    return log_evidence, mean + shift, posterior


@njit(cache=True)
def _inverse(matrix: FloatArray) -> tuple[FloatArray, float]:
    """Return inverse and log-determinant of a symmetric positive definite matrix, by its Cholesky factor."""
    size = matrix.shape[0]
    factor, rest, column = np.zeros((size, size)), matrix.copy(), np.empty(size)
    log_determinant = 0.0
    for j in range(size):
        # A pivot smaller than its rounding is taken for that: noise a billionth of the friction leaves no digits in it.
        pivot = max(rest[j, j], PIVOT_ROUNDING * matrix[j, j], LEAST_PIVOT)
        log_determinant += np.log(pivot)
        factor[j, j] = column[j] = np.sqrt(pivot)
        for i in range(j + 1, size):
            factor[i, j] = column[i] = rest[i, j] / column[j]
        for i in range(j + 1, size):  # inner loops along rows, here and below: in the cache, several entries at once
            for c in range(j + 1, i + 1):
                rest[i, c] -= column[i] * column[c]
    lower = np.zeros((size, size))  # inverse of the factor
    for i in range(size):
        for c in range(i):
            for j in range(c + 1):
                lower[i, j] -= factor[i, c] * lower[c, j]
        for j in range(i):
            lower[i, j] /= factor[i, i]
        lower[i, i] = 1.0 / factor[i, i]
    inverse = np.zeros((size, size))
    for c in range(size):
        for i in range(c + 1):
            for j in range(i + 1):
                inverse[i, j] += lower[c, i] * lower[c, j]
    for i in range(size):
        for j in range(i):
            inverse[j, i] = inverse[i, j]
    return inverse, log_determinant


@dataclass(frozen=True, slots=True)
class _Design:
    """The linear model of a story.

    Attributes
    ----------
    levels
        float64 (segments, unknowns - 1), the slope's column left out.
    column
        For each system: int64 (sojourns,), column of each sojourn's friction, -1 where it is 0 by law.
    laws
        float64 (3, free sojourns), of each column that holds a sojourn's friction, which follow the base's: its system,
        mean and standard deviation of its friction law.
    """

    levels: FloatArray
    column: tuple[IntArray, ...]
    laws: FloatArray


def _design(story: Story, borders: IntArray, priors: Priors) -> _Design:
    """Return the linear model of a story; columns are base, sojourns, unattributed jumps."""
    sojourns = np.array([configurations.size for configurations in story.configurations], dtype=np.int64)
    none = np.zeros(0, dtype=np.int64)
    levels, column, laws = _lay_out(
        np.concatenate((none, *story.configurations)),
        np.concatenate((none, *story.starts)),
        sojourns,
        story.unattributed,
        borders,
        _law_table(priors.laws),
    )
    ends = np.cumsum(sojourns).tolist()
    return _Design(
        levels, tuple(column[end - count : end] for end, count in zip(ends, sojourns.tolist(), strict=True)), laws
    )


@lru_cache(maxsize=256)
def _law_table(laws: tuple[tuple[FrictionLaw, ...], ...]) -> FloatArray:
    """Return mean and standard deviation of all friction laws, float64 (systems, configurations, 2); padded."""
    table = np.zeros((len(laws), max((len(of_system) for of_system in laws), default=1), 2))
    for s, of_system in enumerate(laws):
        table[s, : len(of_system)] = [(law.mid, law.scatter) for law in of_system]
    return table


@njit(cache=True)
def _lay_out(
    configurations: IntArray,
    starts: IntArray,
    sojourns: IntArray,
    unattributed: IntArray,
    borders: IntArray,
    table: FloatArray,
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Lay out the linear model of a story.

    Parameters
    ----------
    configurations, starts
        int64 (all sojourns,), of all systems one after the other.
    sojourns
        int64 (systems,), how many of these each has.
    unattributed, borders
        See `Story` and `solve`.
    table
        See `_law_table`.

    Returns
    -------
    levels, column, laws
        See `_Design`; `column` of all systems one after the other.
    """
    column = np.full(configurations.size, -1)
    laws = np.empty((3, configurations.size))
    free = 0
    at = 0
    for s in range(sojourns.size):
        for _ in range(sojourns[s]):
            mid, scatter = table[s, configurations[at]]
            if mid != 0.0 or scatter != 0.0:
                laws[0, free], laws[1, free], laws[2, free] = s, mid, scatter
                free += 1
                column[at] = free
            at += 1
    segments = borders.size - 1
    levels = np.zeros((segments, 1 + free + unattributed.size))
    levels[:, 0] = 1.0
    first = 0
    for s in range(sojourns.size):
        own = first
        for segment in range(segments):
            # A segment belongs to the sojourns that hold at its end.
            while own + 1 < first + sojourns[s] and starts[own + 1] < borders[segment + 1]:
                own += 1
            if column[own] >= 0:
                levels[segment, column[own]] = 1.0
        first += sojourns[s]
    for j in range(unattributed.size):
        for segment in range(segments):
            if borders[segment + 1] > unattributed[j]:
                levels[segment, 1 + free + j] = 1.0
    return levels, column, np.ascontiguousarray(laws[:, :free])
