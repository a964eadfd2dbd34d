"""Log-probabilities of sojourns between candidates, tabulated once per window so that the search only looks them up.

Every duration law is *soft*: mixed with a small share of a broad one, so that no hard support makes a window
infeasible (an undetected short sojourn, a law that is a little wrong). The broad law is a Lomax law of the same mean,

    P(τ ≥ e) = (1 + (e - 1) / m)^-2,

heavy enough for a sojourn that swallowed an undetected excursion and flat enough for one that is much too short.

The ends of the window are censored (errata 9). With S(e) = P(τ ≥ e), μ the mean duration, π the stationary law of the
jumping chain and N the length of the window, all of the soft laws:

- first sojourn, in q, ended by a jump after e slots:   π_q S_q(e) / Σ_j π_j μ_j
- last sojourn, in q, begun e slots before the end:     S_q(e)
- a system that does not jump in the window:            π_q Σ_{r ≥ N} S_q(r) / Σ_j π_j μ_j

Where earlier windows tell in which configuration a system entered the window, the first sojourn is a mixture of what
they tell and of the above.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np
from numba import njit
from scipy import special

from rwa_monitor.diagnosis.state import CarriedState
from rwa_monitor.physics.durations import DurationLaw
from rwa_monitor.physics.switching import jumping_chain_law
from rwa_monitor.physics.wheel import SwitchingSystem
from rwa_monitor.samples import FloatArray, IntArray

SOFT_SHARE: Final = 1e-3  # of the broad law in every duration law
MISSED_SHARE: Final = 1e-2  # probability that a jump leaves no candidate: a sojourn of a few slots, or in a gap
CARRIED_TRUST: Final = 0.95  # that the last configuration told by an earlier window is right
Number = float | FloatArray
DOWN, UP = 0, 1  # last axis of tables over directions


@dataclass(frozen=True, slots=True)
class Onset:
    """What is known of a system's first sojourn: its configuration, and the slots it lasted before the window."""

    configuration: int
    age: int


@dataclass(frozen=True, slots=True)
class LawTables:
    """Log-probabilities over nodes: node 0 is the window's begin, nodes 1 … m are the candidates.

    Axes: S systems, Q configurations (padded with -inf to the largest system), nodes where a sojourn begins (0: before
    the window) and where it ends.

    Attributes
    ----------
    jump
        (S, Q, m + 1, m + 1): the sojourn lasts from one node to exactly the other.
    stay
        (S, Q, m + 1): the sojourn lasts at least from the node to the window's end.
    turn
        (S, Q, 2): a transition goes down or up.
    missed
        (S, Q, 2, m + 1, m + 1): the sojourn ends by a jump (down or up) without a candidate, and the one after it ends
        at the later node; with the prior of a missed jump.
    """

    jump: FloatArray
    stay: FloatArray
    turn: FloatArray
    missed: FloatArray


@dataclass(frozen=True, slots=True)
class SoftLaw:
    """A duration law with its share of the broad law."""

    law: DurationLaw
    mean: float

    def pmf(self, slots: FloatArray) -> FloatArray:
        """Return P(τ = slots) for slots ≥ 1."""
        return np.asarray(_soft_pmf(self.law.survival(slots), self.law.survival(slots + 1.0), slots, self.mean))

    def survival(self, slots: FloatArray) -> FloatArray:
        """Return P(τ ≥ slots) for slots ≥ 1."""
        return np.asarray(_soft_survival(self.law.survival(slots), slots, self.mean))

    def survival_sum(self, start: int) -> float:
        """Return Σ_{r ≥ start} P(τ ≥ r) [slots]; the mean for start = 1."""
        broad = self.mean**2 * float(special.zeta(2.0, self.mean + start - 1))  # Σ_r m² / (m + r - 1)²
        return (1 - SOFT_SHARE) * _survival_sum(self.law, start) + SOFT_SHARE * broad


@njit(cache=True, error_model="numpy", nogil=True)
def broad_survival(slots: Number, mean: Number) -> Number:
    """Return P(τ ≥ slots) of the broad law; numbers or arrays."""
    share = mean / (mean + slots - 1.0)
    return share * share


@njit(cache=True, error_model="numpy", nogil=True)
def _soft_survival(survival: Number, slots: Number, mean: float) -> Number:
    """Mix a law's P(τ ≥ slots) with that of the broad law."""
    return (1.0 - SOFT_SHARE) * survival + SOFT_SHARE * broad_survival(slots, mean)


@njit(cache=True, error_model="numpy", nogil=True)
def _soft_pmf(survival: Number, following: Number, slots: Number, mean: float) -> Number:
    """Mix a law's P(τ = slots), from P(τ ≥ slots) and P(τ ≥ slots + 1), likewise."""
    broad = broad_survival(slots, mean) - broad_survival(slots + 1.0, mean)
    return (1.0 - SOFT_SHARE) * (survival - following) + SOFT_SHARE * broad


@lru_cache(maxsize=4096)
def _survival_sum(law: DurationLaw, start: int) -> float:
    return law.survival_sum(start)


def soften(law: DurationLaw) -> SoftLaw:
    """Return the law mixed with its broad companion."""
    return SoftLaw(law, _survival_sum(law, 1))


def onsets(systems: tuple[SwitchingSystem, ...], carried: CarriedState | None) -> tuple[Onset | None, ...]:
    """Return for each system what earlier windows tell of its first sojourn."""
    found: list[Onset | None] = []
    for system in systems:
        known = carried.system(system.name) if carried else None
        if known is None or known.configuration is None or known.configuration >= system.configurations:
            found.append(None)
        else:
            found.append(Onset(known.configuration, known.age or 0))
    return tuple(found)


def law_tables(
    systems: tuple[SwitchingSystem, ...], index: IntArray, slots: int, first: tuple[Onset | None, ...]
) -> LawTables:
    """Tabulate the laws of all systems between the candidates of a window.

    Parameters
    ----------
    systems
        The wheel's switching systems.
    index
        int64 (m,), the candidates' slots, strictly increasing, each in [1, slots).
    slots
        Length of the window [slots].
    first
        What is known of each system's first sojourn, or None.
    """
    nodes = index.size + 1
    width = max((system.configurations for system in systems), default=1)
    shape = (len(systems), width)
    tables = LawTables(
        jump=np.full((*shape, nodes, nodes), -np.inf),
        stay=np.full((*shape, nodes), -np.inf),
        turn=np.full((*shape, 2), -np.inf),
        missed=np.full((*shape, 2, nodes, nodes), -np.inf),
    )
    at = index.astype(np.float64)
    durations = _durations(at, slots)
    for s, system in enumerate(systems):
        _fill(tables, s, system, at, durations, slots, first[s])
    return tables


class Chain(NamedTuple):
    """What of a system's laws depends on the window's length at most, as compiled code takes it; Q configurations.

    Attributes
    ----------
    means
        float64 (Q,), mean durations of the soft laws [slots].
    entered
        float64 (Q,), how often a sojourn in q begins, per slot: π_q / Σ_j π_j μ_j.
    never
        float64 (Q,), probability that the first sojourn is in q and outlasts the window.
    turn
        float64 (Q, 2), log-probabilities of a transition down and up.
    """

    means: FloatArray
    entered: FloatArray
    never: FloatArray
    turn: FloatArray


@lru_cache(maxsize=256)
def _laws_of(system: SwitchingSystem, slots: int) -> tuple[tuple[SoftLaw, ...], Chain]:
    """Return a system's soft laws, and what else of them does not depend on what happened in a window of `slots`."""
    soft = tuple(soften(law) for law in system.durations)
    pi = jumping_chain_law(system)
    cycle = sum(float(p) * law.survival_sum(1) for p, law in zip(pi, soft, strict=True))
    up = np.array([system.probability_up(q) for q in range(system.configurations)])
    with np.errstate(divide="ignore"):
        turn = np.log(np.stack([1.0 - up, up], axis=1))
    never = pi / cycle * np.array([law.survival_sum(slots) for law in soft])
    return soft, Chain(np.array([law.mean for law in soft]), pi / cycle, never, turn)


def _survivals(laws: tuple[SoftLaw, ...], slots: FloatArray) -> FloatArray:
    """Return P(τ ≥ slots) of the laws, not softened: float64 (Q, points)."""
    survivals = np.empty((len(laws), slots.size))
    for q, law in enumerate(laws):
        survivals[q] = law.law.survival(slots)
    return survivals


class _Told(NamedTuple):
    """What an earlier window tells of a first sojourn: its configuration (-1: nothing), and how long it goes on.

    `ends`, float64 (points,): probability that it ends after so many slots; `lasts`: that it outlasts the window.
    """

    configuration: int
    ends: FloatArray
    lasts: float


def _told_by(first: Onset | None, laws: tuple[SoftLaw, ...], after: FloatArray, slots: int) -> _Told:
    """Return what is known of a first sojourn that would end `after` slots of the window."""
    if first is None:
        return _Told(-1, after, 0.0)
    law = laws[first.configuration]
    alive, gone = law.survival(np.array([first.age + 1.0, float(first.age + slots)]))
    return _Told(first.configuration, law.pmf(first.age + after) / alive, float(gone / alive))


def _fill(
    tables: LawTables,
    s: int,
    system: SwitchingSystem,
    at: FloatArray,
    durations: FloatArray,
    slots: int,
    first: Onset | None,
) -> None:
    """Fill the tables of one system; `durations` as from `_durations`."""
    laws, chain = _laws_of(system, slots)
    tables.turn[s, : len(laws)] = chain.turn
    told = _told_by(first, laws, at, slots)
    _tabulate(at, slots, _survivals(laws, durations), chain, told, tables.jump[s], tables.stay[s], tables.missed[s])


@njit(cache=True, error_model="numpy", nogil=True)
def _durations(at: FloatArray, slots: int) -> FloatArray:
    """Return the durations at which `_tabulate` asks for survival, in its order: float64 (points,)."""
    count = at.size
    pairs = count * (count - 1) // 2
    durations = np.empty(2 * pairs + 2 * count)
    pair = 0
    for i in range(count):
        for j in range(i + 1, count):
            durations[pair], durations[pairs + pair] = at[j] - at[i], at[j] - at[i] + 1.0
            pair += 1
    for k in range(count):
        durations[2 * pairs + k], durations[2 * pairs + count + k] = at[k], slots - at[k]
    return durations


@njit(cache=True, error_model="numpy", nogil=True)
def _tabulate(
    at: FloatArray,
    slots: int,
    survivals: FloatArray,
    chain: Chain,
    told: _Told,
    jump: FloatArray,
    stay: FloatArray,
    missed: FloatArray,
) -> None:
    """Fill the tables of one system; they hold -inf.

    Parameters
    ----------
    at, slots
        float64 (m,), the candidates' slots, and the length of the window.
    survivals
        float64 (Q, points), see `_survivals`: at the durations between all pairs of candidates (i < j, row by row), at
        these + 1, from the window's begin to each candidate, and from each to the window's end.
    chain, told
        The system's laws, and what is known of its first sojourn.
    jump, stay, missed
        The system's part of `LawTables`.
    """
    count, configurations = at.size, chain.means.size
    pairs = count * (count - 1) // 2
    begun, left = survivals[:, 2 * pairs : 2 * pairs + count], survivals[:, 2 * pairs + count :]
    for q in range(configurations):
        mean = chain.means[q]
        pair = 0
        for i in range(count):
            for j in range(i + 1, count):
                duration = at[j] - at[i]
                jump[q, 1 + i, 1 + j] = np.log(
                    _soft_pmf(survivals[q, pair], survivals[q, pairs + pair], duration, mean)
                )
                pair += 1
        for k in range(count):
            stay[q, 1 + k] = np.log(_soft_survival(left[q, k], slots - at[k], mean))
            ended = chain.entered[q] * _soft_survival(begun[q, k], at[k], mean)
            jump[q, 0, 1 + k] = np.log(_first(ended, told.ends[k], q, told.configuration))
        stay[q, 0] = np.log(_first(chain.never[q], told.lasts, q, told.configuration))
        if q + 1 == configurations:
            continue
        both = mean + chain.means[q + 1]  # of two sojourns in a row, up or down, seen as one
        log_up = np.log(MISSED_SHARE) + chain.turn[q, UP] + np.log(2.0 / both)
        log_down = np.log(MISSED_SHARE) + chain.turn[q + 1, DOWN] + np.log(2.0 / both)
        for i in range(count):
            for j in range(i + 1, count):
                duration = at[j] - at[i]
                if duration >= 2.0:
                    longer = 3.0 * np.log1p(duration / both)
                    missed[q, UP, 1 + i, 1 + j] = log_up - longer
                    missed[q + 1, DOWN, 1 + i, 1 + j] = log_down - longer


@njit(cache=True, error_model="numpy", nogil=True)
def _first(unknown: float, told: float, q: int, configuration: int) -> float:
    """Return a probability of the first sojourn, in q: a mixture where earlier windows tell its configuration."""
    if configuration < 0:
        return unknown
    return (1.0 - CARRIED_TRUST) * unknown + (CARRIED_TRUST * told if q == configuration else 0.0)


def log_probability(
    system: SwitchingSystem, configurations: IntArray, starts: IntArray, slots: int, first: Onset | None
) -> float:
    """Return the log-probability of all that one system did in a window.

    Parameters
    ----------
    system, first
        Its laws, and what is known of its first sojourn.
    configurations, starts
        int64 (sojourns,), see `results.Assignment`.
    slots
        Length of the window.
    """
    (laws, chain), at = _laws_of(system, slots), starts[1:].astype(np.float64)
    between = at[1:] - at[:-1]
    survivals = _survivals(laws, np.concatenate((between, between + 1.0, at[:1], slots - at[-1:])))
    return float(_add_up(configurations, at, slots, survivals, chain, _told_by(first, laws, at[:1], slots)))


@njit(cache=True, error_model="numpy", nogil=True)
def _add_up(
    configurations: IntArray, at: FloatArray, slots: int, survivals: FloatArray, chain: Chain, told: _Told
) -> float:
    """Add up the log-probabilities of a system's sojourns in `configurations`, the later ones begun at the slots `at`.

    Parameters as in `_tabulate`, the durations those of the sojourns between its first and last.
    """
    first, last = configurations[0], configurations[-1]
    if at.size == 0:
        return float(np.log(_first(chain.never[first], told.lasts, first, told.configuration)))
    ended = chain.entered[first] * _soft_survival(survivals[first, -2], at[0], chain.means[first])
    total = np.log(_first(ended, told.ends[0], first, told.configuration))
    total += np.log(_soft_survival(survivals[last, -1], slots - at[-1], chain.means[last]))
    for j in range(at.size):
        q = configurations[j]
        total += chain.turn[q, UP if configurations[j + 1] > q else DOWN]
        if j > 0:
            survival, following = survivals[q, j - 1], survivals[q, at.size - 1 + j - 1]
            total += np.log(_soft_pmf(survival, following, at[j] - at[j - 1], chain.means[q]))
    return float(total)
