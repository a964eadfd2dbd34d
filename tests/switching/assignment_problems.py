"""Assignment problems for tests: random candidates, levels and laws, and paths through them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rwa_monitor.samples import BoolArray, FloatArray, IntArray
from rwa_monitor.switching.assignment import Scores, action_table
from rwa_monitor.switching.duration_likelihoods import DurationLikelihoods, tabulated_durations
from rwa_monitor.wheel.durations import Geometric, Lognormal, Uniform
from rwa_monitor.wheel.wheel import SwitchingSystem

SHORT = SwitchingSystem(name="short", durations=(Uniform(low=200, high=500), Uniform(low=1, high=40)))
LONG = SwitchingSystem(name="long", durations=(Uniform(low=300, high=900),) * 3, up=(1.0, 0.4, 0.0))
FREE = SwitchingSystem(name="free", durations=(Geometric(mean=400), Lognormal(mu=5.0, sigma=0.5)))
SLOTS = 3000
UNATTRIBUTED = -10.0  # log prior


@dataclass(frozen=True)
class Sizes:
    """Sizes of the jumps and what the friction laws expect, as in `Scores`."""

    jump: FloatArray
    variance: FloatArray
    law_mean: FloatArray
    law_variance: FloatArray
    log_range: float
    unattributed_variance: float


@dataclass(frozen=True)
class Problem:
    """All that the score of a path depends on, by parts; without `sizes` these do not count."""

    fit: FloatArray
    durations: DurationLikelihoods
    configurations: IntArray
    signs: BoolArray
    pairs: bool
    sizes: Sizes | None = None

    @property
    def actions(self) -> IntArray:
        table = action_table(self.configurations.size)
        return table if self.pairs else table[table[:, 2] < 0]

    @property
    def scores(self) -> Scores:
        durations, sizes, count = self.durations, self.sizes, self.signs.shape[0]
        none = np.zeros(durations.turn.shape[:2])
        # Measured so badly that no size shows anything: each has the density that the fits assume.
        sizes = sizes or Sizes(np.zeros(count), np.full(count, 1e30), none, none, 0.5 * np.log(2e30 * np.pi), 1.0)
        return Scores(
            fit=self.fit,
            **durations._asdict(),
            configurations=self.configurations,
            signs=self.signs,
            actions=self.actions,
            size=sizes.jump,
            size_variance=sizes.variance,
            law_mean=sizes.law_mean,
            law_variance=sizes.law_variance,
            log_range=sizes.log_range,
            unattributed=UNATTRIBUTED,
            unattributed_variance=sizes.unattributed_variance,
        )


def random_problem(
    rng: np.random.Generator,
    systems: tuple[SwitchingSystem, ...],
    candidates: int,
    *,
    rare: bool = True,
    sized: bool = False,
) -> Problem:
    """A window with random candidates and levels; without `rare` events, no missed jump and no two at once."""
    index = np.sort(rng.choice(np.arange(1, SLOTS), size=candidates, replace=False)).astype(np.int64)
    nodes = np.concatenate([[0], index, [SLOTS]])
    # Fits like those of real levels: merging true levels is dear, merging equal ones is cheap.
    level = np.cumsum(rng.choice([-0.5, 0.0, 0.5], size=candidates + 1) + 0.02 * rng.standard_normal(candidates + 1))
    length = np.diff(nodes)
    fit = np.zeros((candidates + 2, candidates + 2))
    for i in range(candidates + 1):
        for j in range(i + 1, candidates + 2):
            weights = length[i:j] / length[i:j].sum()
            spread = weights @ level[i:j] ** 2 - (weights @ level[i:j]) ** 2
            fit[i, j] = -0.5 * spread * length[i:j].sum() / 4.0 - 3.0 - rng.exponential(1.0)
    durations = tabulated_durations(systems, index, SLOTS, (None,) * len(systems))
    signs = rng.random((candidates, 2)) < 0.6
    signs[~signs.any(axis=1), 0] = True
    if not rare:
        durations.missed[:] = -np.inf
    at_rest = np.arange(durations.turn.shape[1]) == 0
    sizes = Sizes(
        jump=np.diff(level),
        variance=0.01**2 * (1.0 + rng.exponential(1.0, size=candidates)),
        law_mean=np.tile(np.where(at_rest, 0.0, 0.5 * np.arange(at_rest.size)), (len(systems), 1)),
        law_variance=np.tile(np.where(at_rest, 0.0, 0.1**2), (len(systems), 1)),
        log_range=0.0,
        unattributed_variance=0.3**2,
    )
    return Problem(
        fit=fit,
        durations=durations,
        configurations=np.array([system.configurations for system in systems], dtype=np.int64),
        signs=signs,
        pairs=rare,
        sizes=sizes if sized else None,
    )


def step_of(number: int) -> tuple[int, int]:
    """Return the direction (±1) of a numbered step, and the jump without a candidate before it (±1, 0 for none)."""
    return 2 * (number % 2) - 1, (0, -1, 1)[number // 2]
