"""Friction switching systems simulated as semi-Markov processes (paper, section III-B), started in the stationary law.

A record begins at an arbitrary time of a wheel's life, so the first configuration has probability ∝ π_j μ_j
(π: stationary law of the jumping chain, μ: mean durations) and its remaining duration has P(rest = r) = S(r)/μ, the
law at a randomly chosen time (errata 9).
"""

from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.random import Generator

from rwa_monitor.errors import InputError
from rwa_monitor.samples import FloatArray, IntArray
from rwa_monitor.wheel.durations import DurationLaw
from rwa_monitor.wheel.wheel import SwitchingSystem

# The factor by which an anomaly multiplies the friction of a sojourn, by the slot at which the sojourn begins.
FrictionFactor = Callable[[int], float]


class Realisation(NamedTuple):
    """One switching system over n slots.

    Attributes
    ----------
    configuration
        int64 (n,), configuration q of each slot.
    friction
        float64 (n,), its friction, in units of the nominal dry torque.
    jump_index
        int64 (m,), first slot of each new configuration; never slot 0.
    """

    configuration: IntArray
    friction: FloatArray
    jump_index: IntArray

    @property
    def jump(self) -> FloatArray:
        """float64 (m,), change of friction at each jump, in units of the nominal dry torque."""
        return self.friction[self.jump_index] - self.friction[self.jump_index - 1]


def jumping_chain_law(system: SwitchingSystem) -> FloatArray:
    """Return π, float64 (Q,): how often each configuration is entered, as a share of all entries.

    Transitions go to adjacent configurations, so π balances pair by pair: π_q·up_q = π_{q+1}·(1 − up_{q+1}).
    """
    up = np.array([system.probability_up(q) for q in range(system.configurations)])
    weight = np.eye(system.configurations)[0]
    for q in range(system.configurations - 1):
        down = 1.0 - up[q + 1]
        if down == 0.0:
            # The chain never comes back down: all configurations below are transient.
            weight[: q + 1] = 0.0
            weight[q + 1] = 1.0
        else:
            weight[q + 1] = weight[q] * up[q] / down
    return np.asarray(weight / weight.sum())


@lru_cache(maxsize=256)
def jump_rate(system: SwitchingSystem) -> float:
    """Return the mean number of jumps per slot, one over the mean sojourn; cached, as every window needs it."""
    return 1.0 / float(jumping_chain_law(system) @ np.array([law.mean() for law in system.durations]))


def time_law(system: SwitchingSystem) -> FloatArray:
    """Return the stationary law of the configuration at a random moment, float64 (Q,): ∝ π_q·μ_q (errata 9)."""
    weight = jumping_chain_law(system) * np.array([law.mean() for law in system.durations])
    return np.asarray(weight / weight.sum())


def residual_duration(law: DurationLaw, rng: Generator, limit: int) -> int:
    """Draw the remaining duration [slots] of a sojourn observed at a random time, the current slot included.

    P(rest = r) = S(r)/μ for r ≥ 1, drawn by inverting its cumulative sum. Results above `limit` are returned as
    limit + 1: the record ends before.
    """
    survivals = np.cumsum(law.survival(np.arange(1, min(limit, int(law.longest())) + 1)))
    target = rng.random() * law.mean()
    remaining = int(np.searchsorted(survivals, target, side="right")) + 1
    return min(remaining, limit + 1)


def simulate_system(
    system: SwitchingSystem,
    slots: int,
    rng: Generator,
    friction_factor: FrictionFactor = lambda _slot: 1.0,
) -> Realisation:
    """Simulate a switching system over `slots` slots, started in its stationary law.

    Parameters
    ----------
    system
        Duration, transition and friction laws.
    slots
        Length of the record, at least 1.
    rng
        Source of all randomness.
    friction_factor
        The anomaly's factor on the friction of every sojourn, a function of the sojourn's first slot.

    Returns
    -------
    Realisation
        Configuration, friction and jumps.

    Raises
    ------
    InputError
        If the system has no friction ranges, without which it cannot be simulated.
    """
    if (ranges := system.friction) is None:
        problem = "is missing; a system without friction ranges cannot be simulated"
        raise InputError(f"fss {system.name}", problem, "friction")
    configuration, friction = np.empty(slots, dtype=np.int64), np.empty(slots)
    starts, start = [], 0
    q = int(rng.choice(system.configurations, p=time_law(system)))
    duration = residual_duration(system.durations[q], rng, slots)
    while True:
        sojourn = slice(start, min(start + duration, slots))
        configuration[sojourn] = q
        friction[sojourn] = friction_factor(start) * rng.uniform(ranges[q].low, ranges[q].high)
        starts.append(start)
        start += duration
        if start >= slots:
            break
        q += 1 if rng.random() < system.probability_up(q) else -1
        duration = int(system.durations[q].sample(rng, 1)[0])
    return Realisation(configuration, friction, np.array(starts[1:], dtype=np.int64))
