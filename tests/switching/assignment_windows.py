"""Windows for the tests of stage 3, made fast: level plus noise; candidates are the truth and false ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rwa_monitor.changepoints.running_sums import HARMONICS, RunningSums, Structure
from rwa_monitor.changepoints.stage_results import Candidates, Evidence, NoiseEstimate
from rwa_monitor.samples import FloatArray, IntArray
from rwa_monitor.wheel.switching_systems import simulate_system
from rwa_monitor.wheel.wheel import Wheel

NO_CANDIDATES = Candidates(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros(0))
NO_STRUCTURE = Structure(np.zeros(0), np.zeros((4, 0)), np.zeros((0, HARMONICS)), zero_runs=0, plateaus=0)


def sums_of(x: FloatArray, z: FloatArray, used: np.ndarray | None = None) -> RunningSums:
    """Running sums of samples that are all there."""
    sums = RunningSums(x, z, np.ones(x.size, dtype=np.bool_) if used is None else used)
    sums.extend(x.size)
    return sums


@dataclass
class Window:
    """A window with its truth: slot, system and direction of every jump."""

    evidence: Evidence
    jumps: list[tuple[int, int, int]]
    size: FloatArray
    configuration: FloatArray
    friction: FloatArray
    base: float
    viscous: float
    x: FloatArray
    z: FloatArray


def simulate(
    wheel: Wheel,
    rng: np.random.Generator,
    *,
    slots: int = 80_000,
    std: float = 0.024,
    base: float = 1.0,
    viscous: float = 1.0,
    factors: tuple[float, ...] = (),
) -> tuple[FloatArray, FloatArray, list[tuple[int, int, int]], FloatArray, FloatArray]:
    """Simulate x, z, the jumps (slot, system, direction), and configuration and friction of each system."""
    phase = rng.uniform(0, 2 * np.pi)
    x = 0.6 + 0.35 * np.sin(2 * np.pi * np.arange(slots) / 46_000.0 + phase)
    parts = [simulate_system(system, slots, rng, factors[s] if factors else 1.0) for s, system in enumerate(wheel.fss)]
    friction = np.stack([p.friction for p in parts]) if parts else np.zeros((0, slots))
    configuration = np.stack([p.configuration for p in parts]) if parts else np.zeros((0, slots), dtype=np.int64)
    jumps = sorted(
        (int(k), s, int(p.configuration[k] - p.configuration[k - 1])) for s, p in enumerate(parts) for k in p.jump_index
    )
    z = base + friction.sum(axis=0) + viscous * x + std * rng.standard_normal(slots)
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
    return Evidence(x.size, count, count, candidates, sums_of(x, z, used), noise, 20.0, NO_STRUCTURE)


def window(
    wheel: Wheel,
    rng: np.random.Generator,
    *,
    false_candidates: float = 4.0,
    jitter: int = 2,
    std: float = 0.024,
    **options: float,
) -> Window:
    """Make a window whose candidates are the true jumps, moved by up to `jitter` slots, and false ones."""
    x, z, jumps, configuration, friction = simulate(wheel, rng, std=std, **options)
    truth = np.array([k for k, _, _ in jumps], dtype=np.int64)
    moved = truth + rng.integers(-jitter, jitter, size=truth.size, endpoint=True)
    count = int(rng.poisson(false_candidates))
    # Half of the false ones lie anywhere, half near a true jump, like the side lobes of a window detector.
    anywhere = rng.integers(1, x.size, size=count)
    if truth.size:
        side = rng.choice(truth, size=count) + rng.choice([-1, 1], size=count) * rng.integers(4, 40, size=count)
        anywhere = np.where(rng.random(count) < 0.5, anywhere, side)
    slots = np.clip(np.concatenate([moved, anywhere]), 1, x.size - 1)
    viscous = float(options.get("viscous", 1.0))
    candidates = candidates_at(x, z, slots, std, viscous)
    size = np.array([friction[s, k] - friction[s, k - 1] for k, s, _ in jumps])
    return Window(
        evidence_of(x, z, candidates, std),
        jumps,
        size,
        configuration,
        friction,
        float(options.get("base", 1.0)),
        viscous,
        x,
        z,
    )
