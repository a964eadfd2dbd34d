"""What the discrepancy search costs: processor time, wall-clock time and memory, and how they grow with the record.

Every record is searched by a process of its own, and by those that it starts, so that its memory is its own. The
machine's load changes the wall-clock time, hardly the processor time.
"""

from __future__ import annotations

import os
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from typing import Final

import numpy as np

from rwa_monitor.discrepancy.find import find_discrepancy
from rwa_monitor.evaluation.speed.machine import peak_memory_bytes, shared_memory_bytes
from rwa_monitor.evaluation.speed.report import Section, Target
from rwa_monitor.physics.scenario import Scenario
from rwa_monitor.physics.speed import SpeedProfile
from rwa_monitor.physics.telemetry import simulate
from rwa_monitor.physics.wheel import EffectBlock, built_in_wheel
from rwa_monitor.processes import for_a_search, on_processes

SEED: Final = 3
LENGTHS: Final = (20_000, 80_000, 320_000)  # samples
LENGTH: Final = 80_000  # of the records with nothing and with two effects hidden
# Some 0.5 standard deviations of the noise each, beside sign, speed and levels.
HIDDEN: Final = (
    EffectBlock(name="stribeck", parameters={"strength_Nm": 5.0e-4, "stribeck_speed_rad_s": 8.0, "exponent": 1.0}),
    EffectBlock(name="quadratic_drag", parameters={"strength_Nm_s2_rad2": 4.0e-9}),
)
WARM: Final = 3_000  # samples: compiled loops are loaded before the clock starts
MOST_SECONDS: Final = 20.0
MOST_GB: Final = 2.0
MOST_GROWTH: Final = 1.2
GIGA: Final = 1e9


@dataclass(frozen=True, slots=True)
class SearchCost:
    """What one search cost.

    Attributes
    ----------
    samples, hidden, processes
        Length of the record, how many effects are hidden in it, and how many candidates are tried at a time.
    wall_s, processor_s
        Times [s], the start of the processes included.
    memory_GB
        Largest resident memory of all processes together [GB], what those that were started share counted once.
    named
        The effects named.
    """

    samples: int
    hidden: int
    processes: int
    wall_s: float
    processor_s: float
    memory_GB: float
    named: tuple[str, ...]

    def in_words(self) -> str:
        """Return the costs in one line."""
        return f"{self.processor_s:.1f} s of processor time, {self.wall_s:.1f} s by the clock, {self.memory_GB:.2f} GB"


def measure(samples: int, hidden: int, processes: int) -> SearchCost:
    """Search a record of rich motion with so many effects hidden in it, in so many processes, and return the cost."""
    wheel = built_in_wheel()
    scenario = Scenario(duration_s=samples * wheel.sample_period_s, speed=SpeedProfile(kind="rich"), anomalies={})
    hiding = wheel.model_copy(update={"effect": HIDDEN[:hidden]})
    record = simulate(scenario, hiding, np.random.default_rng(SEED)).samples
    find_discrepancy([("warm", record[slice(0, WARM)])], wheel)
    wall, before = time.perf_counter(), time.process_time()
    with on_processes(processes) as each:
        found = find_discrepancy([("record", record)], wheel, each=each)
        wall = time.perf_counter() - wall
        # Two for each process: one at least comes to every one.
        used = {of: figures for of, *figures in each(_used, range(2 * processes), apart=True)}
    own, processor_s, peak, _ = _used(0)
    used[own] = [processor_s - before, peak, 0]
    shared = max(shared for _, _, shared in used.values())
    return SearchCost(
        samples,
        hidden,
        processes,
        wall,
        sum(processor_s for processor_s, *_ in used.values()),
        (shared + sum(peak - of_all for _, peak, of_all in used.values())) / GIGA,
        tuple(effect.name for effect in found.result.effects),
    )


def _used(_: int) -> tuple[int, float, int, int]:
    """Return of this process the number, processor time [s], largest memory, and what it shares of that [bytes]."""
    return os.getpid(), time.process_time(), peak_memory_bytes(), shared_memory_bytes()


def measure_apart(samples: int, hidden: int, processes: int) -> SearchCost:
    """Measure in a process of its own."""
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        return pool.submit(measure, samples, hidden, processes).result()


def growth(costs: list[SearchCost]) -> float:
    """Return the processor time per sample of the last record over that of the first; 1 is linear."""
    first, last = costs[0], costs[-1]
    return (last.processor_s / last.samples) / (first.processor_s / first.samples)


def search_costs() -> list[SearchCost]:
    """Measure records of all lengths with one effect, then one with none and with two, as the command does it."""
    cases = [*((samples, 1) for samples in LENGTHS), (LENGTH, 0), (LENGTH, 2)]
    return [measure_apart(samples, hidden, for_a_search(samples)) for samples, hidden in cases]


def search_section(costs: list[SearchCost]) -> Section:
    """Hold the search against time, memory and growth."""
    by_length = sorted((cost for cost in costs if cost.hidden == 1), key=lambda cost: cost.samples)
    by_hidden = sorted((cost for cost in costs if cost.samples == LENGTH), key=lambda cost: cost.hidden)
    return Section(
        title=f"The discrepancy search, {costs[0].processes} processes",
        text=(
            f"The whole catalogue on records of rich motion, {' and '.join(effect.name for effect in HIDDEN)} hidden "
            f"in them in this order, seed {SEED}, each by a process of its own and those that it starts. Times by the "
            "clock hold whatever else the machine did; processor times and memory are of all processes."
        ),
        targets=tuple(
            Target(what, reached, most, least=False, absolute=figures)
            for what, reached, most, figures in (
                (
                    f"search of {LENGTH:,} samples by the clock, the slowest of {len(by_hidden)} [s]",
                    max(cost.wall_s for cost in by_hidden),
                    MOST_SECONDS,
                    "; ".join(f"{cost.hidden} hidden: {cost.wall_s:.1f} s" for cost in by_hidden),
                ),
                (
                    f"memory of a search of {LENGTH:,} samples [GB]",
                    max(cost.memory_GB for cost in by_hidden),
                    MOST_GB,
                    ", ".join(f"{cost.memory_GB:.2f} GB" for cost in by_hidden),
                ),
                (
                    f"search, processor time per sample, {by_length[-1].samples:,} / {by_length[0].samples:,} samples",
                    growth(by_length),
                    MOST_GROWTH,
                    ", ".join(f"{cost.samples:,}: {cost.processor_s:.1f} s" for cost in by_length),
                ),
            )
        ),
        figures={
            f"{cost.samples:,} samples, {cost.hidden} hidden, named {', '.join(cost.named) or 'none'}": cost.in_words()
            for cost in costs
        },
    )
