"""Base, viscous and each sojourn's friction as one linear Gaussian model, given who jumped when.

The level between two changepoints is the base, plus the friction of the sojourn in which each system then is (0 in
configuration 0: a return jump undoes its entry), plus jumps that no system made. With Gaussian priors the posterior
and the evidence have closed forms; both come from the moments of the segments.

Prior of a system's friction: sojourn j in configuration q has (1 + a) · mid_q + d_j, where the anomaly a is shared by
all sojourns of the system (paper: an anomaly changes P_f) and d_j is the scatter of the friction law. Both are Gaussian
and wide enough that a factor of 2.5 is unlikely but not forbidden.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numba import njit

from rwa_monitor.diagnosis.estimation import SlopePrior, nominal_viscous
from rwa_monitor.diagnosis.results import Moments
from rwa_monitor.diagnosis.state import CarriedState
from rwa_monitor.physics.wheel import SwitchingSystem, Wheel
from rwa_monitor.samples import FloatArray, IntArray

BASE_SPREAD: Final = 0.3  # prior std of base dry friction over its nominal value: +30 % is a mild anomaly
VISCOUS_SPREAD: Final = 0.5  # the same of the viscous coefficient
CARRIED_VISCOUS_SPREAD: Final = 0.05  # at least, where earlier windows told the viscous coefficient
ANOMALY_MEAN: Final = 0.1  # prior mean of a system's anomaly a: mostly 0, sometimes 0.4 … 1.5
ANOMALY_SPREAD: Final = 0.4
LEARNED_ANOMALY_SPREAD: Final = 0.15  # about what earlier windows of this very wheel showed
UNKNOWN_SPREAD: Final = 1.0  # relative, where no friction law is known at all
MIN_LEARNED: Final = 3.0  # sojourns from which what earlier windows showed replaces the wheel's ranges
UNATTRIBUTED_SPREAD: Final = 0.5  # prior std of a jump that no system made, over the unit of friction


@dataclass(frozen=True, slots=True)
class FrictionLaw:
    """Gaussian law of a configuration's friction: (1 + a) mid + d, normalised.

    Attributes
    ----------
    mid
        Nominal friction.
    scatter
        Standard deviation of d, from sojourn to sojourn.
    anomaly, anomaly_spread
        Mean and standard deviation of a.
    """

    mid: float
    scatter: float
    anomaly: float
    anomaly_spread: float

    @property
    def mean(self) -> float:
        """Prior mean of the friction."""
        return self.mid * (1.0 + self.anomaly)

    @property
    def variance(self) -> float:
        """Prior variance of the friction of one sojourn."""
        return self.scatter**2 + (self.mid * self.anomaly_spread) ** 2

    @property
    def fixed_at_zero(self) -> bool:
        """Whether the configuration has no friction at all (rest)."""
        return self.mid == 0.0 and self.scatter == 0.0


@dataclass(frozen=True, slots=True)
class Priors:
    """What is known before the window, normalised.

    Attributes
    ----------
    base, base_std
        Dry friction with all systems at rest.
    slope
        Viscous coefficient.
    laws
        For each system and configuration.
    unattributed_std
        Standard deviation of a jump that no system made.
    """

    base: float
    base_std: float
    slope: SlopePrior
    laws: tuple[tuple[FrictionLaw, ...], ...]
    unattributed_std: float


@dataclass(frozen=True, slots=True)
class Story:
    """Who jumped when: all that the friction model needs of an assignment.

    Attributes
    ----------
    configurations, starts
        For each system: int64 (sojourns,), configuration and first slot of each sojourn; the first starts at 0.
    unattributed
        int64, slots of the jumps that no system made.
    """

    configurations: tuple[IntArray, ...]
    starts: tuple[IntArray, ...]
    unattributed: IntArray


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
        base, base_std = drifted.mean, max(drifted.std, 1e-6 * abs(drifted.mean))
    elif wheel.nominal:
        base, base_std = 1.0, BASE_SPREAD
    else:
        base, base_std = typical_level, 3.0 * (abs(typical_level) + jump)
    laws = tuple(_laws_of(system, carried, jump) for system in wheel.fss)
    unit = 1.0 if wheel.nominal else jump
    return Priors(base, base_std, slope_prior(wheel, carried, typical_level), laws, UNATTRIBUTED_SPREAD * unit)


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


def _laws_of(system: SwitchingSystem, carried: CarriedState | None, jump: float) -> tuple[FrictionLaw, ...]:
    """Return the friction law of each configuration: learned, else the wheel's, else wide and in proportion to q."""
    known = carried.system(system.name) if carried else None
    laws = []
    for q in range(system.configurations):
        memory = known.friction[q] if known and q < len(known.friction) else None
        given = system.friction[q] if system.friction else None
        if q == 0 and (given is None or given.low == given.high == 0.0):
            laws.append(FrictionLaw(0.0, 0.0, 0.0, 0.0))
        elif memory is not None and memory.count >= MIN_LEARNED:
            scatter = max(memory.std, 0.02 * abs(memory.mean))
            laws.append(FrictionLaw(memory.mean, scatter, 0.0, LEARNED_ANOMALY_SPREAD))
        elif given is not None:
            mid = 0.5 * (given.low + given.high)
            scatter = max((given.high - given.low) / np.sqrt(12.0), 0.02 * abs(mid))
            laws.append(FrictionLaw(mid, float(scatter), ANOMALY_MEAN, ANOMALY_SPREAD))
        else:
            laws.append(FrictionLaw(q * jump, UNKNOWN_SPREAD * jump, 0.0, UNKNOWN_SPREAD))
    return tuple(laws)


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
    levels, column, mean, covariance = _design(story, borders, priors)
    moments = np.stack([segments.n, segments.x, segments.z, segments.xx, segments.xz, segments.zz])
    log_evidence, posterior_mean, posterior = _condition(levels, moments, mean, covariance, variance, scatter)
    std = np.sqrt(np.maximum(np.diag(posterior), 0.0))
    return Posterior(float(log_evidence), posterior_mean, std, posterior, column)


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
    factor = np.zeros((size, size))
    log_determinant = 0.0
    for j in range(size):
        rest = matrix[j, j]
        for c in range(j):
            rest -= factor[j, c] ** 2
        factor[j, j] = np.sqrt(rest)
        log_determinant += np.log(rest)
        for i in range(j + 1, size):
            rest = matrix[i, j]
            for c in range(j):
                rest -= factor[i, c] * factor[j, c]
            factor[i, j] = rest / factor[j, j]
    lower = np.zeros((size, size))  # inverse of the factor
    for j in range(size):
        lower[j, j] = 1.0 / factor[j, j]
        for i in range(j + 1, size):
            total = 0.0
            for c in range(j, i):
                total -= factor[i, c] * lower[c, j]
            lower[i, j] = total / factor[i, i]
    inverse = np.zeros((size, size))
    for i in range(size):
        for j in range(i + 1):
            total = 0.0
            for c in range(i, size):
                total += lower[c, i] * lower[c, j]
            inverse[i, j] = inverse[j, i] = total
    return inverse, log_determinant


def _design(
    story: Story, borders: IntArray, priors: Priors
) -> tuple[FloatArray, tuple[IntArray, ...], FloatArray, FloatArray]:
    """Return the design without the slope (segments, levels), columns of the sojourns, prior mean and covariance."""
    last_slot = borders[1:] - 1  # a segment belongs to the sojourns that hold at its end (see `Story`)
    columns: list[FloatArray] = [np.ones(last_slot.size)]
    means, deviations = [priors.base], [priors.base_std]
    shared: list[tuple[int, int, float]] = []  # (column, system, std of the part that the system's anomaly moves)
    places: list[IntArray] = []
    for s, (configurations, starts) in enumerate(zip(story.configurations, story.starts, strict=True)):
        sojourn = np.searchsorted(starts, last_slot, side="right") - 1
        place = np.full(configurations.size, -1, dtype=np.int64)
        for j, q in enumerate(configurations):
            law = priors.laws[s][int(q)]
            if law.fixed_at_zero:
                continue
            place[j] = len(columns)
            shared.append((len(columns), s, law.mid * law.anomaly_spread))
            columns.append((sojourn == j).astype(np.float64))
            means.append(law.mean)
            deviations.append(law.scatter)
        places.append(place)
    for slot in story.unattributed:
        columns.append((last_slot >= slot).astype(np.float64))
        means.append(0.0)
        deviations.append(priors.unattributed_std)
    means.append(priors.slope.mean)
    deviations.append(priors.slope.std)
    covariance = np.diag(np.square(deviations))
    common = np.zeros((len(means), len(priors.laws)))
    for at, s, size in shared:
        common[at, s] = size
    covariance += common @ common.T
    return np.stack(columns, axis=1), tuple(places), np.array(means), covariance
