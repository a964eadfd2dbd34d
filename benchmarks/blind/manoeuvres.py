"""Tests `--plan` in closed loop: a record leaves causes ambiguous, the proposed manoeuvre is flown and searched too.

    python -m benchmarks.blind.manoeuvres [--draws N] [--seed N]

Causes, motions and torques are those of `formulas`, which share no code with the package. A case counts where the first
search names the truth in a set of several. For comparison, manoeuvres of the library are flown in a random order.
"""

from __future__ import annotations

import argparse
import itertools
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from scipy.ndimage import uniform_filter1d

from benchmarks.blind import formulas
from benchmarks.blind.generator import orthogonal_rms
from benchmarks.blind.table import rate
from rwa_monitor.discrepancy.find import find_discrepancy
from rwa_monitor.discrepancy.plan import MANOEUVRES, Manoeuvre, plan
from rwa_monitor.discrepancy.result import Search
from rwa_monitor.samples import Samples
from rwa_monitor.wheel.wheel import Wheel, built_in_wheel

Array = np.ndarray[Any, np.dtype[np.float64]]

MOST_FLOWN: Final = 5  # manoeuvres after which a case is abandoned
TOP_RAD_S: Final = 180.0
DRY_NM: Final = 1.6e-3
VISCOUS_NM_S: Final = 5.333e-6
NOISE_NM: Final = 3.9e-5
RAMP_S: Final = 20.0  # duration of a change of speed
JUMP: Final = 0.5  # size, of the dry friction, in manoeuvres that wait for a jump
# From current and speed alone no manoeuvre distinguishes them: K_T scales all friction, and J with it.
INSEPARABLE: Final = frozenset({"inertia_error", "torque_constant_error"})


def to_and_fro(time: Array) -> Array:
    """Return one speed, forwards and backwards."""
    return np.asarray(0.6 * TOP_RAD_S * np.where((time // 25.0) % 2 == 0, 1.0, -1.0))


def few_dwells(time: Array) -> Array:
    """Return dwells at three speeds, in both directions."""
    return np.asarray(TOP_RAD_S * np.array([0.3, 0.6, 1.0, -0.3, -0.6, -1.0])[(time // 80.0).astype(int) % 6])


def one_way(time: Array) -> Array:
    """Return a speed that rises and falls in one direction."""
    return np.asarray(TOP_RAD_S * (0.6 + 0.3 * np.sin(2 * np.pi * time / 300.0)))


def swing(time: Array) -> Array:
    """Return a speed that reverses at one acceleration."""
    return np.asarray(0.3 * TOP_RAD_S * np.sin(2 * np.pi * time / 200.0 + 0.2))


CONFUSING: Final[dict[Callable[[Array], Array], tuple[str, ...]]] = {
    to_and_fro: ("torque_bias", "coulomb_asymmetry", "viscous_asymmetry"),
    few_dwells: ("torque_bias", "coulomb_asymmetry", "saturating_drag"),
    one_way: ("load_dependence", "inertia_error", "torque_constant_error"),
    swing: ("presliding", "current_delay", "torque_bias", "coulomb_asymmetry"),
}


@dataclass(frozen=True)
class Case:
    """A hidden cause, the motion on which it is ambiguous, and the seed of all draws."""

    motion: Callable[[Array], Array]
    cause: str
    seed: int


class Hidden:
    """A wheel with a hidden cause of the same size and shape on every manoeuvre."""

    def __init__(self, case: Case) -> None:
        self.rng = np.random.default_rng(case.seed)
        self.wheel: Wheel = built_in_wheel()
        assert self.wheel.inertia_kg_m2 is not None, "built in"
        assert self.wheel.torque_constant_Nm_A is not None, "built in"
        self.inertia, self.torque_constant = self.wheel.inertia_kg_m2, self.wheel.torque_constant_Nm_A
        self.cause = case.cause
        time = np.arange(8000.0) * self.wheel.sample_period_s
        truth = self._truth(time, case.motion(time), np.full(time.size, DRY_NM))
        self.shape = formulas.draw_shape(case.cause, self._truth(*self._motion(MANOEUVRES[0])), self.rng)
        unit = formulas.MEAN[case.cause](truth, self.shape)
        sign = 1.0 if case.cause in formulas.ONE_SIGN else float(self.rng.choice([-1.0, 1.0]))
        self.strength = sign * float(self.rng.uniform(0.3, 1.0)) * NOISE_NM / orthogonal_rms(unit, truth)
        self.seen = self._samples(truth)

    def fly(self, manoeuvre: Manoeuvre) -> Samples:
        """Return the telemetry of a manoeuvre."""
        return self._samples(self._truth(*self._motion(manoeuvre)))

    def _motion(self, manoeuvre: Manoeuvre) -> tuple[Array, Array, Array]:
        time = np.arange(0.0, manoeuvre.duration_s, self.wheel.sample_period_s)
        level = np.full(time.size, DRY_NM)
        if manoeuvre.jump_at is not None:
            level[int(manoeuvre.jump_at * time.size) :] *= 1.0 + JUMP
        return time, manoeuvre.speed(time, TOP_RAD_S), level

    def _truth(self, time: Array, speed: Array, level: Array) -> formulas.Truth:
        period = self.wheel.sample_period_s
        speed = uniform_filter1d(speed, int(RAMP_S / period))
        acceleration = np.gradient(speed, period)
        jumps = np.flatnonzero(np.diff(level)) + 1
        return formulas.Truth(
            time=time,
            speed=speed,
            acceleration=acceleration,
            angle=np.cumsum(speed) * period,
            motor_torque=np.sign(speed) * level + VISCOUS_NM_S * speed + self.inertia * acceleration,
            temperature=20.0 + 1.5 * np.sin(2 * np.pi * time / 5800.0),
            level=level,
            period=period,
            speed_unit=TOP_RAD_S,
            torque_unit=DRY_NM,
            jump_index=jumps,
            jump_size=level[jumps] - level[jumps - 1],
        )

    def _samples(self, truth: formulas.Truth) -> Samples:
        torque = self.strength * formulas.MEAN[self.cause](truth, self.shape)
        friction = np.sign(truth.speed) * truth.level + VISCOUS_NM_S * truth.speed + torque
        friction = friction + NOISE_NM * self.rng.normal(size=truth.time.size)
        motor = friction + self.inertia * truth.acceleration
        return Samples(
            np.round(truth.time * 1e9).astype(np.int64),
            truth.speed + self.rng.normal(0.0, 0.01, truth.time.size),
            friction,
            motor_current_A=motor / self.torque_constant,
            bearing_temperature_degC=truth.temperature + self.rng.normal(0.0, 0.02, truth.time.size),
        )


def sets_of(found: Search) -> list[set[str]]:
    """Return the set of names of each mean effect found; names that no record distinguishes count as one."""
    sets = [{one.name, *one.equivalent} for one in found.result.effects if one.family == "mean"]
    return [one - {"torque_constant_error"} if one >= INSEPARABLE else one for one in sets]


def is_decided(found: Search, cause: str) -> bool:
    """Return whether the search names the cause and nothing else."""
    return sets_of(found) in ([{cause}], [INSEPARABLE & {cause}])


def manoeuvres_needed(hidden: Hidden, first: Search, order: Sequence[Manoeuvre] | None) -> int:
    """Return after how many manoeuvres the cause is named alone, MOST_FLOWN + 1 for never.

    They are flown in a given order, or, with None, by a plan that is renewed after each manoeuvre.
    """
    recordings, found, flown = [("seen", hidden.seen)], first, []
    for count in range(1, MOST_FLOWN + 1):
        if order is None:
            left = [entry.name for entry in plan(found).manoeuvres if entry.name not in flown]
            if not left:
                return MOST_FLOWN + 1
            flown.append(left[0])
        else:
            flown.append(order[count - 1].name)
        manoeuvre = next(entry for entry in MANOEUVRES if entry.name == flown[-1])
        recordings.append((manoeuvre.name, hidden.fly(manoeuvre)))
        found = find_discrepancy(recordings, hidden.wheel)
        if is_decided(found, hidden.cause):
            return count
    return MOST_FLOWN + 1


def run(case: Case) -> tuple[int, int] | None:
    """Return how many manoeuvres a case takes, planned and in a random order; None without ambiguity."""
    hidden = Hidden(case)
    first = find_discrepancy([("seen", hidden.seen)], hidden.wheel)
    if not any(case.cause in one and len(one) > 1 for one in sets_of(first)):
        return None
    # The orbit at constant speed takes hours: nobody would choose it at random, so it is left out.
    short = [entry for entry in MANOEUVRES if entry.duration_s == MANOEUVRES[0].duration_s]
    order = [short[i] for i in hidden.rng.permutation(len(short))]
    again = Hidden(case)
    return manoeuvres_needed(hidden, first, None), manoeuvres_needed(again, first, order)


def cases(draws: int, seed: int) -> list[Case]:
    """Return all pairs of motion and cause, `draws` times."""
    seeds = itertools.count(seed)
    pairs = [(motion, cause) for motion, causes in CONFUSING.items() for cause in causes]
    return [Case(motion, cause, next(seeds)) for _ in range(draws) for motion, cause in pairs]


def main(argv: list[str] | None = None) -> int:
    """Run all cases and print the results; exit code 1 where a target is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=2)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args(argv)
    needed = []
    for case in cases(options.draws, options.seed):
        counts = run(case)
        print(case.motion.__name__, case.cause, case.seed, "one name" if counts is None else counts, flush=True)
        if counts is not None:
            needed.append(counts)
    planned, by_chance = np.array(needed).T
    print(f"one name within two planned manoeuvres: {rate(planned, lambda count: count <= 2)} (wanted: 90 % or more)")
    print(f"manoeuvres: {planned.mean():.2f} planned, {by_chance.mean():.2f} by chance (wanted: half or fewer)")
    return 0 if np.mean(planned <= 2) >= 0.9 and 2.0 * planned.mean() <= by_chance.mean() else 1


if __name__ == "__main__":
    sys.exit(main())
