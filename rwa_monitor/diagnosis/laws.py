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
from typing import Final

import numpy as np
from scipy import special

from rwa_monitor.diagnosis.state import CarriedState
from rwa_monitor.physics.durations import DurationLaw
from rwa_monitor.physics.switching import jumping_chain_law
from rwa_monitor.physics.wheel import SwitchingSystem
from rwa_monitor.samples import FloatArray, IntArray

SOFT_SHARE: Final = 1e-3  # of the broad law in every duration law
MISSED_SHARE: Final = 1e-2  # probability that a jump leaves no candidate: a sojourn of a few slots, or in a gap
CARRIED_TRUST: Final = 0.95  # that the last configuration told by an earlier window is right
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
        broad = self._broad_survival(slots) - self._broad_survival(slots + 1)
        return (1 - SOFT_SHARE) * self.law.pmf(slots) + SOFT_SHARE * broad

    def survival(self, slots: FloatArray) -> FloatArray:
        """Return P(τ ≥ slots) for slots ≥ 1."""
        return (1 - SOFT_SHARE) * self.law.survival(slots) + SOFT_SHARE * self._broad_survival(slots)

    def survival_sum(self, start: int) -> float:
        """Return Σ_{r ≥ start} P(τ ≥ r) [slots]; the mean for start = 1."""
        broad = self.mean**2 * float(special.zeta(2.0, self.mean + start - 1))  # Σ_r m² / (m + r - 1)²
        return (1 - SOFT_SHARE) * _survival_sum(self.law, start) + SOFT_SHARE * broad

    def _broad_survival(self, slots: FloatArray) -> FloatArray:
        return (1.0 + (slots - 1.0) / self.mean) ** -2.0


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
    for s, system in enumerate(systems):
        _fill(tables, s, system, index, slots, first[s])
    return tables


def _fill(tables: LawTables, s: int, system: SwitchingSystem, index: IntArray, slots: int, first: Onset | None) -> None:
    """Fill the tables of one system."""
    at = index.astype(np.float64)
    later = np.triu(np.ones((index.size, index.size), dtype=np.bool_), k=1)
    between = (at[None, :] - at[:, None])[later]  # durations of sojourns that begin and end at candidates
    laws, *_ = _laws_of(system)
    inner = tables.jump[s, :, 1:, 1:]
    with np.errstate(divide="ignore"):
        for q, law in enumerate(laws):
            up = system.probability_up(q)
            tables.turn[s, q] = np.log([1.0 - up, up])
            inner[q][later] = np.log(law.pmf(between))
            tables.stay[s, q, 1:] = np.log(law.survival(slots - at))
            tables.jump[s, q, 0, 1:] = np.log(_first_ends(system, q, at, first))
            tables.stay[s, q, 0] = np.log(_never_ends(system, q, slots, first))
            for direction, step in ((DOWN, -1), (UP, 1)):
                if 0 <= q + step < system.configurations:
                    both = law.mean + laws[q + step].mean  # of two sojourns in a row, seen as one
                    lomax = np.log(2.0 / both) - 3.0 * np.log1p(between / both)
                    tables.missed[s, q, direction, 1:, 1:][later] = np.where(
                        between >= 2, np.log(MISSED_SHARE) + tables.turn[s, q, direction] + lomax, -np.inf
                    )


@lru_cache(maxsize=256)
def _laws_of(system: SwitchingSystem) -> tuple[tuple[SoftLaw, ...], FloatArray, float]:
    """Return the soft laws, the stationary law of the jumping chain, and the mean time between its jumps [slots]."""
    laws = tuple(soften(law) for law in system.durations)
    pi = jumping_chain_law(system)
    return laws, pi, sum(float(p) * law.survival_sum(1) for p, law in zip(pi, laws, strict=True))


def _first_ends(system: SwitchingSystem, q: int, after: FloatArray, first: Onset | None) -> FloatArray:
    """Return the probability that the first sojourn is in q and ends `after` slots of the window."""
    laws, pi, cycle = _laws_of(system)
    law = laws[q]
    ended = pi[q] * law.survival(after) / cycle
    if first is not None:
        told = 1.0 if q == first.configuration else 0.0
        alive = law.survival(np.array([first.age + 1.0]))
        ended = (1 - CARRIED_TRUST) * ended + CARRIED_TRUST * told * law.pmf(first.age + after) / alive
    return np.asarray(ended)


def _never_ends(system: SwitchingSystem, q: int, slots: int, first: Onset | None) -> float:
    """Return the probability that the first sojourn is in q and outlasts the window."""
    laws, pi, cycle = _laws_of(system)
    law = laws[q]
    never = float(pi[q] * law.survival_sum(slots) / cycle)
    if first is not None:
        told = 1.0 if q == first.configuration else 0.0
        gone = law.survival(np.array([first.age + slots])) / law.survival(np.array([first.age + 1.0]))
        never = (1 - CARRIED_TRUST) * never + CARRIED_TRUST * told * float(gone[0])
    return never


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
    laws, *_ = _laws_of(system)
    at, last = starts[1:].astype(np.float64), int(configurations[-1])
    left = configurations[:-1]
    moves = np.empty(left.size)
    with np.errstate(divide="ignore"):
        for q in range(system.configurations):
            inner = np.flatnonzero(left[1:] == q)
            moves[1 + inner] = np.log(laws[q].pmf(at[1 + inner] - at[inner]))
        if left.size == 0:
            stayed = np.log(_never_ends(system, last, slots, first))
        else:
            moves[0] = np.log(_first_ends(system, int(left[0]), at[:1], first))[0]
            stayed = np.log(laws[last].survival(slots - at[-1:]))[0]
        up = [system.probability_up(q) for q in range(system.configurations)]
        turn = np.log([[1.0 - probability, probability] for probability in up])
    moves += turn[left, (np.diff(configurations) > 0).astype(np.int64)]
    return float(moves.sum() + stayed)
