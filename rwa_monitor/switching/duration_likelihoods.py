"""Log-probabilities of sojourns between candidates, tabulated once per window so that the search only looks them up.

Every duration law is *soft*: mixed with a small share of a broad one, so that no hard support makes a window
infeasible (an undetected short sojourn, a law that is a little wrong). The broad law is a Lomax law of the same mean m,

    P(τ ≥ e) = (1 + (e - 1) / m)^-2,

heavy-tailed enough for a sojourn that spans an undetected excursion, and flat enough for one that is much too short.

Sojourns at the window's ends are censored (errata 9). With S(e) = P(τ ≥ e), μ the mean duration, π the stationary law
of the jumping chain and N the length of the window, all of the soft laws:

- first sojourn, in q, ended by a jump after e slots:   π_q S_q(e) / Σ_j π_j μ_j
- last sojourn, in q, begun e slots before the end:     S_q(e)
- a system that does not jump in the window:            π_q Σ_{r ≥ N} S_q(r) / Σ_j π_j μ_j

Where earlier windows give the configuration in which a system entered the window, the law of the first sojourn is a
mixture of that configuration's, given its age, and of the above.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy import special

from rwa_monitor.kernels.laws import SOFT_SHARE, tabulate
from rwa_monitor.samples import FloatArray, IntArray
from rwa_monitor.switching.carried_state import CarriedState
from rwa_monitor.wheel.durations import DurationLaw
from rwa_monitor.wheel.switching_systems import jumping_chain_law
from rwa_monitor.wheel.wheel import SwitchingSystem

Number = float | FloatArray


class Onset(NamedTuple):
    """A system's first sojourn as known from earlier windows: configuration (-1: unknown), slots before the window."""

    configuration: int
    age: int


class DurationLikelihoods(NamedTuple):
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


def soft_survival_sum(law: DurationLaw, start: int) -> float:
    """Return Σ_{r ≥ start} P(τ ≥ r) of the law mixed with its broad companion [slots]; the mean for start = 1."""
    mean = law.mean()
    broad = mean**2 * float(special.zeta(2.0, mean + start - 1))  # Σ_r m² / (m + r - 1)²
    return (1 - SOFT_SHARE) * law.survival_sum(start) + SOFT_SHARE * broad


def broad_pmf(slots: FloatArray, mean: Number) -> FloatArray:
    """Return P(τ = slots) of the broad law."""
    share, following = mean / (mean + slots - 1.0), mean / (mean + (slots + 1.0) - 1.0)
    return share * share - following * following


def onsets(systems: tuple[SwitchingSystem, ...], carried: CarriedState | None) -> tuple[Onset | None, ...]:
    """Return for each system its first sojourn as known from earlier windows, or None."""

    def onset(system: SwitchingSystem) -> Onset | None:
        known = carried.system(system.name) if carried else None
        if known is None or known.configuration is None or known.configuration >= system.configurations:
            return None
        return Onset(known.configuration, known.age or 0)

    return tuple(map(onset, systems))


def tabulated_durations(
    systems: tuple[SwitchingSystem, ...], index: IntArray, slots: int, first: tuple[Onset | None, ...]
) -> DurationLikelihoods:
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
        Each system's first sojourn as known from earlier windows, or None.
    """
    nodes = index.size + 1
    width = max((system.configurations for system in systems), default=1)
    shape = (len(systems), width)
    tables = DurationLikelihoods(
        jump=np.full((*shape, nodes, nodes), -np.inf),
        stay=np.full((*shape, nodes), -np.inf),
        turn=np.full((*shape, 2), -np.inf),
        missed=np.full((*shape, 2, nodes, nodes), -np.inf),
    )
    at = index.astype(np.float64)
    begin, end = np.triu_indices(at.size, 1)
    between = at[end] - at[begin]
    for s, system in enumerate(systems):
        chain = _chain_of(system, slots)
        tables.turn[s, : system.configurations] = chain.turn
        known = first[s] or Onset(-1, 0)
        late, whole = known.age + at, (known.age + 1.0, known.age + slots)
        # In the order in which `tabulate` takes them, not softened.
        durations = np.concatenate((between, between + 1.0, at, slots - at, late, late + 1.0, whole))
        survivals = np.stack([law.survival(durations) for law in system.durations])
        tabulate(at, slots, survivals, chain, known, tables.jump[s], tables.stay[s], tables.missed[s])
    return tables


class Chain(NamedTuple):
    """Figures of a system's laws that depend on no candidate, at most on the window's length; Q configurations.

    Attributes
    ----------
    means
        float64 (Q,), mean durations of the soft laws [slots].
    entered
        float64 (Q,), rate at which sojourns in q begin, per slot: π_q / Σ_j π_j μ_j.
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
def _chain_of(system: SwitchingSystem, slots: int) -> Chain:
    """Return the figures of a system's laws for a window of `slots`."""
    laws, pi = system.durations, jumping_chain_law(system)
    cycle = sum(float(p) * soft_survival_sum(law, 1) for p, law in zip(pi, laws, strict=True))
    up = np.array([system.probability_up(q) for q in range(system.configurations)])
    with np.errstate(divide="ignore"):
        turn = np.log(np.stack([1.0 - up, up], axis=1))
    never = pi / cycle * np.array([soft_survival_sum(law, slots) for law in laws])
    return Chain(np.array([law.mean() for law in laws]), pi / cycle, never, turn)


def log_probability(
    system: SwitchingSystem, configurations: IntArray, starts: IntArray, slots: int, first: Onset | None
) -> float:
    """Return the log-probability of all that one system did in a window.

    Parameters
    ----------
    system, first
        The system, and its first sojourn as known from earlier windows.
    configurations, starts
        int64 (sojourns,), see `stage_results.Assignment`.
    slots
        Length of the window.
    """
    table, last = tabulated_durations((system,), starts[1:], slots, (first,)), starts.size - 1
    jump, stay, turn, q = table.jump[0], table.stay[0], table.turn[0], configurations.tolist()
    total = stay[q[last], last] + (jump[q[0], 0, 1] if last else 0.0)
    for j in range(last):
        total += turn[q[j], int(q[j + 1] > q[j])]
        if j:
            total += jump[q[j], j, j + 1]
    return float(total)
