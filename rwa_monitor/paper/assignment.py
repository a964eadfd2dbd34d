"""Section IV-C, maximum likelihood assignment, as the paper prints it (errata 7 to 11), and Algorithm 1.

Dynamic programming over (configuration, time since the last jump) of all systems, with hard duration supports, and an
optimistic beginning (the time before the window is chosen to maximise the probability of the first jump). A changepoint
is rejected at the cost of merging its two intervals. Friction values by Algorithm 1, which assumes that every system
rests at least once in the window. The time from the last changepoint to the window's end is not scored.
"""

from functools import lru_cache
from itertools import product
from typing import Final, NamedTuple

import numpy as np

from rwa_monitor.changepoints.stage_results import (
    REJECTED,
    UNATTRIBUTED,
    Assignment,
    Components,
    Estimate,
    NoiseEstimate,
)
from rwa_monitor.paper.detection import SCALE, Signal
from rwa_monitor.paper.estimation import estimate
from rwa_monitor.samples import FloatArray, IntArray
from rwa_monitor.switching.assignment import BUDGET
from rwa_monitor.wheel.durations import DurationLaw
from rwa_monitor.wheel.wheel import SwitchingSystem, Wheel

OPTIMISTIC_GRID: Final = 257  # times before the window that are tried for the first sojourn
LOG_IMPOSSIBLE: Final = -50.0  # of a duration outside its hard support, where no other path exists
NOT_YET: Final = -1  # in place of a candidate: the system has not jumped in the window


class _Tables(NamedTuple):
    """Log-probabilities of one system, by configuration and candidate; `since` NOT_YET is the last row.

    Attributes
    ----------
    ends
        (Q, m + 1, m): the sojourn begun at one candidate ends at the other.
    lasts
        (Q, m + 1, m): it lasts at least to the other.
    turn
        (Q, 2): the transition goes down, up.
    """

    ends: FloatArray
    lasts: FloatArray
    turn: FloatArray


# A state: configuration of each system, and the candidate of its last jump. It represents the paper's (q, τ).
_State = tuple[tuple[int, ...], tuple[int, ...]]
_Choices = tuple[int, ...]
_Best = dict[_State, tuple[float, _Choices, tuple[int, ...]]]  # by state its score, the choices, and the start


def assign(
    signal: Signal,
    index: IntArray,
    noise: NoiseEstimate,
    wheel: Wheel,
    *,
    hard: bool = False,
    w: int = SCALE,
) -> tuple[Assignment, Estimate]:
    """Assign changepoints to switching systems by the paper's dynamic programme.

    Parameters
    ----------
    signal, noise
        The window's samples and the estimate of its noise.
    index
        int64 (N_cp,), its changepoints, ascending.
    wheel
        Its wheel.
    hard
        Whether to use the hard duration laws as printed even where no sequence of jumps is possible under them.
    w
        Half-width by which the changepoints were found [samples].

    Returns
    -------
    tuple[Assignment, Estimate]
        Where no sequence of jumps is possible under the hard duration laws, impossible durations are allowed with a
        penalty, unless `hard`; where none is possible even so, all changepoints are unattributed. The levels are those
        between the changepoints that were not rejected.
    """
    levels, rejection = estimate(signal, index, noise, w)
    jump, std = np.diff(levels.level), levels.jump_std
    directions = np.where(jump >= 0, 1, -1)  # Δf_i
    tables = [_tables(system, index) for system in wheel.fss]
    choices, start, score, states, pruned = _programme(tables, directions, rejection)
    if choices is None and not hard:
        # A missed jump makes every sequence impossible under hard laws; then impossible durations get a penalty, but
        # impossible transitions stay impossible.
        tables = [
            table._replace(ends=np.maximum(table.ends, LOG_IMPOSSIBLE), lasts=np.maximum(table.lasts, LOG_IMPOSSIBLE))
            for table in tables
        ]
        choices, start, score, more, pruned = _programme(tables, directions, rejection)
        states += more
    system = np.array(choices, dtype=np.int64) if choices is not None else np.full(index.size, UNATTRIBUTED)
    accepted = system != REJECTED
    remaining, _ = estimate(signal, index[accepted], noise, w)
    jump[accepted], std[accepted] = np.diff(remaining.level), remaining.jump_std
    direction = np.where(accepted, directions, 0).astype(np.int64)
    configurations, starts = _sojourns(start, system, direction, index)
    assignment = Assignment(
        index=index,
        system=system.astype(np.int64),
        direction=direction,
        jump=jump,
        jump_std=std,
        confidence=np.ones(index.size),  # the paper gives none
        configurations=configurations,
        starts=starts,
        log_score=score,
        states=states,
        pruned=pruned,
    )
    return assignment, remaining


def _programme(
    tables: list[_Tables], directions: IntArray, rejection: FloatArray
) -> tuple[_Choices | None, tuple[int, ...], float, int, bool]:
    """Run the programme; return the choices, initial configurations, score, states expanded, and whether pruned."""
    best: _Best = {(q, (NOT_YET,) * len(tables)): (0.0, (), q) for q in product(*(range(len(t.turn)) for t in tables))}
    expanded, pruned = 0, False
    for k, direction in enumerate(directions):
        found: _Best = {}
        for state, (score, choices, start) in best.items():
            expanded += 1
            for choice, following, gain in _options(tables, state, k, int(direction), float(rejection[k])):
                if following not in found or found[following][0] < score + gain:
                    found[following] = (score + gain, (*choices, choice), start)
        alive = [(entry[0] + _survival(tables, state, k), state) for state, entry in found.items()]
        alive = sorted((one for one in alive if one[0] > -np.inf), reverse=True)
        pruned = pruned or len(alive) > BUDGET
        best = {state: found[state] for _, state in alive[:BUDGET]}  # their number "may increase exponentially"
    last = len(directions) - 1
    complete = [(entry[0] + _survival(tables, state, last), state) for state, entry in best.items()]
    if not complete:
        return None, tuple(0 for _ in tables), -np.inf, expanded, pruned
    score, state = max(complete)
    return best[state][1], best[state][2], score, expanded, pruned


def _options(
    tables: list[_Tables], state: _State, k: int, direction: int, rejection: float
) -> list[tuple[int, _State, float]]:
    """List what can happen at candidate k: (choice, following state, score of it)."""
    configuration, since = state
    options = [(REJECTED, state, rejection)]
    for s, table in enumerate(tables):
        q = configuration[s]
        gain = table.ends[q, since[s], k] + table.turn[q, (direction + 1) // 2]
        if gain > -np.inf:
            after = (*configuration[:s], q + direction, *configuration[s + 1 :])
            options.append((s, (after, (*since[:s], k, *since[s + 1 :])), float(gain)))
    return options


def _survival(tables: list[_Tables], state: _State, k: int) -> float:
    """Return the log-probability that no sojourn of the state has ended by candidate k."""
    if k < 0:
        return 0.0
    return float(sum(table.lasts[q, since, k] for table, q, since in zip(tables, *state, strict=True) if since != k))


def _tables(system: SwitchingSystem, index: IntArray) -> _Tables:
    """Tabulate one system's laws between candidates."""
    count = index.size
    ends = np.full((system.configurations, count + 1, count), -np.inf)
    lasts = np.full((system.configurations, count + 1, count), -np.inf)
    turn = np.empty((system.configurations, 2))
    between = index[None, :] - index[:, None]
    with np.errstate(divide="ignore"):
        for q, law in enumerate(system.durations):
            up = system.probability_up(q)
            turn[q] = np.log([1.0 - up, up])
            ends[q, :count] = np.where(between > 0, np.log(law.pmf(between)), -np.inf)
            lasts[q, :count] = np.where(between > 0, np.log(law.survival(between)), -np.inf)
            ends[q, NOT_YET], lasts[q, NOT_YET] = _optimistic(law, index)
    return _Tables(ends, lasts, turn)


def _optimistic(law: DurationLaw, elapsed: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return log max over τ₀ of P(τ = τ₀ + e | τ ≥ τ₀), and of P(τ ≥ τ₀ + e | τ ≥ τ₀), for each elapsed e."""
    before = _grid(law)
    total = before[:, None] + elapsed[None, :].astype(np.float64)
    alive = law.survival(before)[:, None]
    # The most probable τ₀ often makes the jump the latest possible one: τ₀ = longest - e, different for every e.
    longest = np.full(elapsed.size, np.floor(law.longest()))
    latest = np.maximum(longest - elapsed, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.nanmax(np.where(alive > 0, law.pmf(total) / alive, 0.0), axis=0, initial=0.0)
        at_latest = law.pmf(latest + elapsed) / law.survival(latest)
        lasts = np.nanmax(np.where(alive > 0, law.survival(total) / alive, 0.0), axis=0, initial=0.0)
        return np.log(np.fmax(ends, at_latest)), np.log(lasts)


@lru_cache(maxsize=256)
def _grid(law: DurationLaw) -> FloatArray:
    """Return the times before the window that are tried."""
    return np.unique(np.rint(np.linspace(0.0, law.longest(), OPTIMISTIC_GRID)))


def _sojourns(
    start: tuple[int, ...], system: IntArray, direction: IntArray, index: IntArray
) -> tuple[tuple[IntArray, ...], tuple[IntArray, ...]]:
    """Return configurations and first slots of each system's sojourns."""
    configurations, starts = [], []
    for s, q in enumerate(start):
        mine = system == s
        configurations.append(np.concatenate([[q], q + np.cumsum(direction[mine])]).astype(np.int64))
        starts.append(np.concatenate([[0], index[mine]]).astype(np.int64))
    return tuple(configurations), tuple(starts)


def split(assignment: Assignment, levels: Estimate, wheel: Wheel) -> Components:
    """Split friction by Algorithm 1: each system starts at 0, jumps add up, its minimum is taken to be 0.

    Parameters
    ----------
    assignment, levels
        Result of `assign`.
    wheel
        Its wheel.
    """
    base, base_variance = float(levels.level[0]), float(levels.level_std[0]) ** 2
    friction, friction_std = [], []
    for s in range(len(wheel.fss)):
        mine = assignment.system == s
        values = np.concatenate([[0.0], np.cumsum(assignment.jump[mine])])
        variance = assignment.jump_std[mine] ** 2
        lowest = int(np.argmin(values))
        base += float(values[lowest])
        base_variance += float(variance[:lowest].sum())
        friction.append(values - values[lowest])
        # A value's variance is the sum of those of the jumps between it and the lowest: infinite at constant speed.
        before, after = np.cumsum(variance[:lowest][::-1])[::-1], np.cumsum(variance[lowest:])
        friction_std.append(np.sqrt(np.concatenate([before, [0.0], after])))
    return Components(
        base_dry=base,
        base_dry_std=float(np.sqrt(base_variance)),
        viscous=levels.viscous,
        viscous_std=levels.viscous_std,
        fss_friction=tuple(friction),
        fss_friction_std=tuple(friction_std),
    )
