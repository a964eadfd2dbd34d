"""Quickly made windows for the tests of stage 3: level plus noise, with true and false candidates."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from rwa_monitor.changepoints.running_sums import RunningSums, Structure
from rwa_monitor.changepoints.stage_results import Candidates, Evidence, NoiseEstimate
from rwa_monitor.kernels.running_sums import extend_sums
from rwa_monitor.samples import BoolArray, FloatArray, IntArray
from rwa_monitor.switching.assignment import Scores, action_table
from rwa_monitor.switching.duration_likelihoods import tabulated_durations
from rwa_monitor.wheel.durations import DurationLaw, Geometric, Lognormal, Uniform
from rwa_monitor.wheel.effects.torque_ripple import MAX_HARMONIC
from rwa_monitor.wheel.switching_systems import simulate_system
from rwa_monitor.wheel.wheel import FrictionRange, SwitchingSystem, Wheel

STD = 0.024  # the paper's noise, normalised
NO_CANDIDATES = Candidates(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros(0))
NO_STRUCTURE = Structure(np.zeros(0), np.zeros((4, 0)), np.zeros((0, 2 * MAX_HARMONIC)), zero_runs=0, plateaus=0)


def system(name: str, *laws: DurationLaw, low: float = 0.3, high: float = 0.6) -> SwitchingSystem:
    """A system that rests in configuration 0; the range of the friction in configuration q is q times that in 1."""
    rest = FrictionRange(low=0.0, high=0.0)
    active = [FrictionRange(low=q * low, high=q * high) for q in range(1, len(laws))]
    return SwitchingSystem(name=name, durations=laws, friction=(rest, *active))


def sums_of(x: FloatArray, z: FloatArray, used: np.ndarray | None = None) -> RunningSums:
    """Running sums of the samples; without `used`, all are used."""
    sums = RunningSums(x, z, np.ones(x.size, dtype=np.bool_) if used is None else used)
    extend_sums(sums.arrays, sums.running, 0, x.size)
    sums.slots = x.size
    return sums


def record_of(
    seed: int, slots: int, jumps: Iterable[tuple[int, float]] = (), share: float = 1.0
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """x, z and used: levels with jumps (slot, size), viscous friction and noise; a share of the samples is used."""
    rng = np.random.default_rng(seed)
    x = 1.0 + 0.3 * np.sin(np.arange(slots) / 150.0)
    z = 1.0 + 1.1 * x + STD * rng.standard_normal(slots)
    for slot, size in jumps:
        z[slot:] += size
    return x, z, rng.random(slots) < share


def evidence_at(x: FloatArray, z: FloatArray, slots: Iterable[int], used: BoolArray | None = None) -> Evidence:
    """A window with candidates at given slots."""
    return evidence_of(x, z, candidates_at(x, z, np.array(list(slots), dtype=np.int64), STD, 1.0), STD, used)


@dataclass
class Window:
    """A window with its truth: slot, system and direction of every jump."""

    evidence: Evidence
    jumps: list[tuple[int, int, int]]
    configuration: FloatArray
    friction: FloatArray
    x: FloatArray
    z: FloatArray


def simulate(
    wheel: Wheel, rng: np.random.Generator, base: float = 1.0, viscous: float = 1.0
) -> tuple[FloatArray, FloatArray, list[tuple[int, int, int]], FloatArray, FloatArray]:
    """Simulate x, z, the jumps (slot, system, direction), and configuration and friction of each system."""
    slots, phase = 80_000, rng.uniform(0, 2 * np.pi)
    x = 0.6 + 0.35 * np.sin(2 * np.pi * np.arange(slots) / 46_000.0 + phase)
    parts = [simulate_system(system, slots, rng) for system in wheel.fss]
    friction, configuration = (np.stack([getattr(p, name) for p in parts]) for name in ("friction", "configuration"))
    jumps = sorted(
        (int(k), s, int(p.configuration[k] - p.configuration[k - 1])) for s, p in enumerate(parts) for k in p.jump_index
    )
    z = base + friction.sum(axis=0) + viscous * x + STD * rng.standard_normal(slots)
    return x, z, jumps, configuration, friction


def candidates_at(x: FloatArray, z: FloatArray, slots: IntArray, std: float, viscous: float) -> Candidates:
    """Make candidates at given slots, with the contrast that a detector of matching scale would report."""
    slots = np.unique(slots).astype(np.int64)
    y = z - viscous * x
    scale = np.zeros(slots.size, dtype=np.int64)
    statistic, jump = np.zeros(slots.size), np.zeros(slots.size)
    borders = np.concatenate([[0], slots, [z.size]])
    for i, k in enumerate(slots):
        room = int(min(k - borders[i], borders[i + 2] - k))
        w = 2
        while w < 128 and 2 * w <= room:
            w *= 2
        before, after = y[max(k - w, borders[i]) : k], y[k : min(k + w, borders[i + 2])]
        scale[i], jump[i] = w, after.mean() - before.mean()
        statistic[i] = jump[i] ** 2 / (std**2 * (1 / before.size + 1 / after.size))
    return Candidates(slots, scale, statistic, jump)


def evidence_of(
    x: FloatArray, z: FloatArray, candidates: Candidates, std: float, used: np.ndarray | None = None
) -> Evidence:
    count = x.size if used is None else int(used.sum())
    noise = NoiseEstimate(std, np.array([std**2]), 1.0)
    return Evidence(x.size, count, count, candidates, sums_of(x, z, used), noise, NO_STRUCTURE)


def window(
    wheel: Wheel,
    rng: np.random.Generator,
    *,
    false_candidates: float = 4.0,
    jitter: int = 2,
    base: float = 1.0,
    viscous: float = 1.0,
) -> Window:
    """Make a window whose candidates are the true jumps, moved by up to `jitter` slots, and false ones."""
    x, z, jumps, configuration, friction = simulate(wheel, rng, base, viscous)
    truth = np.array([k for k, _, _ in jumps], dtype=np.int64)
    moved = truth + rng.integers(-jitter, jitter, size=truth.size, endpoint=True)
    count = int(rng.poisson(false_candidates))
    # Half of the false ones lie anywhere, half near a true jump, like the side lobes of a window detector.
    anywhere = rng.integers(1, x.size, size=count)
    if truth.size:
        side = rng.choice(truth, size=count) + rng.choice([-1, 1], size=count) * rng.integers(4, 40, size=count)
        anywhere = np.where(rng.random(count) < 0.5, anywhere, side)
    slots = np.clip(np.concatenate([moved, anywhere]), 1, x.size - 1)
    return Window(
        evidence_of(x, z, candidates_at(x, z, slots, STD, viscous), STD), jumps, configuration, friction, x, z
    )


# ---- assignment problems for tests -----------------------------------------------------------------------------------


SHORT = SwitchingSystem(name="short", durations=(Uniform(low=200, high=500), Uniform(low=1, high=40)))
LONG = SwitchingSystem(name="long", durations=(Uniform(low=300, high=900),) * 3, up=(1.0, 0.4, 0.0))
FREE = SwitchingSystem(name="free", durations=(Geometric(mean=400), Lognormal(mu=5.0, sigma=0.5)))
SLOTS = 3000


def random_scores(
    rng: np.random.Generator,
    systems: tuple[SwitchingSystem, ...],
    candidates: int,
    *,
    rare: bool = True,
    sized: bool = False,
) -> Scores:
    """A window with random candidates and levels; without `rare` events, no missed jump and no two at once.

    The sizes of the jumps count only where it is `sized`.
    """
    index = np.sort(rng.choice(np.arange(1, SLOTS), size=candidates, replace=False)).astype(np.int64)
    nodes = np.concatenate([[0], index, [SLOTS]])
    # Fits like those of real levels: merging different levels is costly, merging equal ones is not.
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
    actions = action_table(len(systems))
    at_rest = np.arange(durations.turn.shape[1]) == 0
    scores = Scores(
        fit=fit,
        **durations._asdict(),
        configurations=np.array([system.configurations for system in systems], dtype=np.int64),
        signs=signs,
        actions=actions if rare else actions[actions[:, 2] < 0],
        size=np.diff(level),
        size_variance=0.01**2 * (1.0 + rng.exponential(1.0, size=candidates)),
        law_mean=np.tile(np.where(at_rest, 0.0, 0.5 * np.arange(at_rest.size)), (len(systems), 1)),
        law_variance=np.tile(np.where(at_rest, 0.0, 0.1**2), (len(systems), 1)),
        log_range=0.0,
        unattributed=-10.0,
        unattributed_variance=0.3**2,
    )
    return scores if sized else without_sizes(scores)


def without_sizes(scores: Scores) -> Scores:
    """Return the scores with such uncertain sizes that none is informative: each has the density that fits assume."""
    none = np.zeros_like(scores.law_mean)
    return scores._replace(
        size_variance=np.full(scores.size.size, 1e30),
        law_mean=none,
        law_variance=none,
        log_range=0.5 * np.log(2e30 * np.pi),
    )


def step_of(number: int) -> tuple[int, int]:
    """Return the direction (±1) of a numbered step, and the jump without a candidate before it (±1, 0 for none)."""
    return 2 * (number % 2) - 1, (0, -1, 1)[number // 2]
