"""Base, viscous and each sojourn's friction as one linear Gaussian model, given a switching path.

The level between two changepoints is the base, plus the friction of each system's current sojourn (0 in configuration
0: a return jump cancels its entry), plus jumps that no system made. With Gaussian priors the posterior and the evidence
have closed forms; both come from the sufficient statistics of the segments.

The priors are a mixture of cases, each a Gaussian model of its own. Where the window identifies the parts, all cases
agree; where it does not, the mixture is the estimate.
"""

from __future__ import annotations

import math
from functools import lru_cache
from itertools import product
from typing import Final, NamedTuple

import numpy as np

from rwa_monitor.changepoints.estimation import SlopePrior, nominal_slope_prior
from rwa_monitor.changepoints.stage_results import SwitchingPath
from rwa_monitor.kernels.friction import solve_cases
from rwa_monitor.samples import TINY, FloatArray, IntArray
from rwa_monitor.switching.carried_state import CHANGE_PER_WINDOW, CarriedState
from rwa_monitor.wheel.wheel import SwitchingSystem, Wheel

FLAT_STD: Final = 30.0  # normalised: wide enough not to influence the estimate, without loss of digits in the sums


class Cases(NamedTuple):
    """The prior as a mixture: the base and each system are in one of a few states, and each case chooses them.

    Attributes
    ----------
    laws
        See `law_table`.
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

    laws: FloatArray
    states: FloatArray
    choice: IntArray
    log_prior: FloatArray
    rest: FloatArray


class Posterior(NamedTuple):
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
        For each system: int64 (sojourns,), index of its friction in `mean`; -1 where it is 0 by law.
    """

    log_evidence: float
    mean: FloatArray
    std: FloatArray
    covariance: FloatArray
    column: tuple[IntArray, ...]


def solve(
    path: SwitchingPath, borders: IntArray, statistics: FloatArray, priors: Priors, variance: float, scatter: float
) -> Posterior:
    """Solve the linear model of one path.

    Parameters
    ----------
    path
        Which system jumped at which slot.
    borders
        int64 (segments + 1,), slots at which segments begin and end.
    statistics
        float64 (6, segments), sufficient statistics of the segments, see `RunningSums.between`.
    priors
        The priors.
    variance
        Variance of the noise, as `estimation.effective_variance`.
    scatter
        Variance of the levels about the model, as `estimation.level_scatter`.
    """
    return _posterior(path, solve_cases(path, borders, statistics, prior_tables(priors), variance, scatter))


def _posterior(path: SwitchingPath, solved: tuple[float, FloatArray, FloatArray, FloatArray, IntArray]) -> Posterior:
    evidence, mean, std, covariance, column = solved
    return Posterior(evidence, mean, std, covariance, path.split(column))


def prior_tables(priors: Priors) -> Cases:
    """Return the priors as kernels take them."""
    rest = np.array([priors.unattributed_std, priors.slope.mean, priors.slope.std])
    return Cases(law_table(priors.laws), *case_table(priors.base, priors.anomaly), rest)


def measure(
    path: SwitchingPath, borders: IntArray, statistics: FloatArray, priors: Priors, variance: float, scatter: float
) -> Posterior:
    """Solve the linear model of one path without friction laws: base and sojourns from the samples alone.

    The log evidence is then that of the samples with base and friction integrated out over flat priors of density 1,
    so that paths with different numbers of sojourns are comparable once their friction is weighted by its laws. For
    systems that never rest, shifting friction from the base to them leaves the samples unchanged; along these
    directions it is the evidence per unit of the systems' friction, and the means are one solution of many.

    Parameters
    ----------
    path, borders, statistics, priors, variance, scatter
        See `solve`; of the priors, only those of the slope and of unattributed jumps matter.
    """
    laws = law_table(priors.laws).copy()
    laws[laws.any(axis=-1), 1] = FLAT_STD
    flat, unchanged = Case(1.0, priors.base[0].mean, FLAT_STD), Case(1.0, 0.0, 0.0)
    cases = prior_tables(priors._replace(base=(flat,), anomaly=((unchanged,),) * len(priors.laws)))
    found = _posterior(path, solve_cases(path, borders, statistics, cases._replace(laws=laws), variance, scatter))
    free = 1 + sum(int(np.count_nonzero(column >= 0)) for column in found.column)
    # Numbers of sojourns of the systems that never rest: along its direction all of a system's rise and the base falls.
    moving = [float(column.size) for column in found.column if column.size and (column >= 0).all()]
    lost = float(np.linalg.slogdet(np.ones((len(moving), len(moving))) + np.diag(moving))[1])
    gained = (free - len(moving)) * math.log(FLAT_STD * math.sqrt(2.0 * math.pi)) + 0.5 * lost
    return found._replace(log_evidence=found.log_evidence + gained)


# ---- the priors of friction in a window: from the wheel file and from earlier windows --------------------------------
#
# Prior of a system's friction: sojourn j in configuration q has (1 + a) (mid_q + d_j), where the anomaly a is shared by
# all sojourns of the system (paper: an anomaly changes P_f) and d_j is the scatter of the friction law. The base and
# each system are healthy, or one or two of them are not: each such case is Gaussian, and the model mixes them.

VISCOUS_SPREAD: Final = 0.5  # prior std of the viscous coefficient, over its nominal value
CARRIED_VISCOUS_SPREAD: Final = 0.05  # the same over its earlier estimate, at least, where there is one
LEARNED_SPREAD: Final = 0.15  # std of a system's anomaly against its friction in earlier windows of this very wheel
MIN_LEARNED: Final = 3.0  # number of sojourns from which the friction of earlier windows replaces the wheel's ranges
UNATTRIBUTED: Final = 0.03  # jumps expected per window that no switching system makes
UNATTRIBUTED_ALONE: Final = 3.0  # the same for a wheel without switching systems
UNATTRIBUTED_SPREAD: Final = 0.5  # prior std of a jump that no system made, over the unit of friction
MOST_ANOMALIES: Final = 2  # at once, among base and systems


class Case(NamedTuple):
    """One of the states that a part may be in: its probability, and the Gaussian prior of the part's value then."""

    probability: float
    mean: float
    std: float


# Healthy wheels differ by a few per cent; anomalies worth finding are from +20 % to a multiple. Weights and widths are
# broad on purpose: they matter only where the window does not identify the parts.
BASE_CASES: Final = (Case(0.8, 1.0, 0.06), Case(0.2, 1.5, 0.4))  # base dry friction over its nominal value
ANOMALY_CASES: Final = (Case(0.8, 0.0, 0.06), Case(0.2, 0.8, 0.5))  # a system's anomaly a


class FrictionLaw(NamedTuple):
    """Gaussian law of a configuration's friction in a healthy system, normalised: its mean and standard deviation."""

    mid: float
    scatter: float

    @property
    def fixed_at_zero(self) -> bool:
        """Whether the configuration has no friction at all (rest)."""
        return self.mid == 0.0 and self.scatter == 0.0


class Priors(NamedTuple):
    """The priors of a window, normalised.

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
    unattributed, unattributed_std
        Expected number of jumps that no system makes, and the standard deviation of the size of one.
    """

    base: tuple[Case, ...]
    anomaly: tuple[tuple[Case, ...], ...]
    laws: tuple[tuple[FrictionLaw, ...], ...]
    slope: SlopePrior
    unattributed: float
    unattributed_std: float


def priors_of(wheel: Wheel, carried: CarriedState | None, typical_level: float, typical_jump: float) -> Priors:
    """Derive the priors from the wheel file and the state after earlier windows.

    Parameters
    ----------
    wheel, carried
        The wheel; the state after earlier windows, or None.
    typical_level, typical_jump
        Sizes in this window: the scale of every prior that neither of them gives.
    """
    jump = typical_jump if typical_jump > 0 else max(abs(typical_level), TINY)
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
        unattributed=UNATTRIBUTED if wheel.fss else UNATTRIBUTED_ALONE,
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
    """Return the prior of the viscous coefficient: from earlier windows, else around the nominal one, else wide."""
    if carried and carried.viscous:
        drifted = carried.viscous.drifted()
        return SlopePrior(drifted.mean, max(drifted.std, CARRIED_VISCOUS_SPREAD * abs(drifted.mean)))
    if wheel.nominal is None:
        return SlopePrior(0.0, 10.0 * max(abs(typical_level), 1e-12))
    return nominal_slope_prior(wheel, VISCOUS_SPREAD)


def _system_of(
    system: SwitchingSystem, carried: CarriedState | None, jump: float
) -> tuple[tuple[Case, ...], tuple[FrictionLaw, ...]]:
    """Return a system's anomaly cases and friction laws: learned, else the wheel's, else wide and proportional to q."""
    known = carried.system(system.name) if carried else None
    memories = [known.friction[q] if known and q < len(known.friction) else None for q in range(system.configurations)]
    laws = _stated_laws(system, 0.0 if system.friction else jump)
    if not any(memory is not None and memory.count >= MIN_LEARNED for memory in memories):
        return (ANOMALY_CASES if system.friction else (Case(1.0, 0.0, 1.0),)), laws
    changed = ANOMALY_CASES[1]
    return (
        Case(1.0 - CHANGE_PER_WINDOW, 0.0, LEARNED_SPREAD),
        Case(CHANGE_PER_WINDOW, changed.mean, changed.std),
    ), tuple(
        stated
        if memory is None or memory.count < MIN_LEARNED or (q == 0 and stated.fixed_at_zero)
        else FrictionLaw(memory.mean, max(memory.std, 0.02 * abs(memory.mean)))
        for q, (stated, memory) in enumerate(zip(laws, memories, strict=True))
    )


@lru_cache(maxsize=256)
def _stated_laws(system: SwitchingSystem, jump: float) -> tuple[FrictionLaw, ...]:
    """Return a system's friction laws as the wheel states them; where it does not, proportional to q."""
    if system.friction is None:
        return FrictionLaw(0.0, 0.0), *(FrictionLaw(q * jump, jump) for q in range(1, system.configurations))
    laws = []
    for given in system.friction:
        width = given.high - given.low
        laws.append(FrictionLaw(given.middle, max(width / 12.0**0.5, 0.02 * abs(given.middle))))
    return tuple(laws)


@lru_cache(maxsize=256)
def case_table(
    base: tuple[Case, ...], anomaly: tuple[tuple[Case, ...], ...]
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Return states, choice and log_prior of `friction_model.Cases`."""
    parts = (base, *anomaly)
    numbered = product(*(range(len(part)) for part in parts))
    choices = [choice for choice in numbered if np.count_nonzero(choice) <= MOST_ANOMALIES]
    states = [[part[i if i < len(part) else 0] for part in parts] for i in range(max(map(len, parts)))]
    return (
        np.array([[(part.mean, part.std) for part in state] for state in states], dtype=np.float64),
        np.array(choices, dtype=np.int64),
        np.array([sum(np.log(parts[p][i].probability) for p, i in enumerate(choice)) for choice in choices]),
    )


@lru_cache(maxsize=256)
def law_table(laws: tuple[tuple[FrictionLaw, ...], ...]) -> FloatArray:
    """Return mean and standard deviation of all friction laws, float64 (systems, configurations, 2); padded."""
    table = np.zeros((len(laws), max((len(of_system) for of_system in laws), default=1), 2))
    for s, of_system in enumerate(laws):
        table[s, : len(of_system)] = [(law.mid, law.scatter) for law in of_system]
    return table


@lru_cache(maxsize=256)
def law_moments(
    laws: tuple[tuple[FrictionLaw, ...], ...], anomaly: tuple[tuple[Case, ...], ...]
) -> tuple[FloatArray, FloatArray]:
    """Return mean and variance of the friction of a sojourn, averaged over all cases of its system; padded.

    float64 (systems, configurations) each.
    """
    mid, scatter = np.moveaxis(law_table(laws), -1, 0)
    first, second = np.zeros((2, len(laws), 1))
    for s, cases in enumerate(anomaly):
        total = sum(case.probability for case in cases)
        first[s] = sum(case.probability * (1 + case.mean) for case in cases) / total
        second[s] = sum(case.probability * ((1 + case.mean) ** 2 + case.std**2) for case in cases) / total
    mean = mid * first
    return mean, second * (mid**2 + scatter**2) - mean**2
