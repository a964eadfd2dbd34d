"""Costs of the discrepancy search: processor time, wall-clock time and memory, and their growth with the record.

    python -m benchmarks.speed.search [--samples N …] [--hidden N] [--threads N]

This part of `make benchmark-speed` alone, as JSON: one line for each length, and one with the growth. Every record
is searched in a separate process, so that its memory can be measured. Other load changes the wall-clock time, but
hardly the processor time.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from multiprocessing import get_context
from typing import Final

import numpy as np

from benchmarks.machine import peak_memory_bytes
from benchmarks.speed.report import Section
from benchmarks.target import at_most
from rwa_monitor.discrepancy.find import find_discrepancy
from rwa_monitor.simulation.motion import SpeedProfile
from rwa_monitor.simulation.record import simulate
from rwa_monitor.simulation.scenario import Scenario
from rwa_monitor.threads import cores, on_threads, one_thread_of_algebra
from rwa_monitor.wheel.wheel import EffectBlock, built_in_wheel

SEED: Final = 3
LENGTHS: Final = (20_000, 80_000, 320_000)  # samples
LENGTH: Final = 80_000  # of the records with nothing and with two effects hidden
# About 0.5 standard deviations of the noise each, orthogonal to sign, speed and levels.
HIDDEN: Final = (
    EffectBlock(name="stribeck", parameters={"strength_Nm": 5.0e-4, "stribeck_speed_rad_s": 8.0, "exponent": 1.0}),
    EffectBlock(name="quadratic_drag", parameters={"strength_Nm_s2_rad2": 4.0e-9}),
)
MOST_SECONDS: Final = 20.0  # of processor time
SHORT: Final = 5_000  # rows of a table
MOST_SECONDS_SHORT: Final = 5.0
MOST_GB: Final = 2.0
MOST_GROWTH: Final = 1.2
GIGA: Final = 1e9


@dataclass(frozen=True, slots=True)
class SearchCost:
    """Cost of one search.

    Attributes
    ----------
    samples, hidden, threads
        Length of the record, number of hidden effects, and number of candidates tried at a time.
    wall_s, processor_s
        Times [s].
    memory_GB
        Largest resident memory [GB].
    named
        The effects named.
    """

    samples: int
    hidden: int
    threads: int
    wall_s: float
    processor_s: float
    memory_GB: float
    named: tuple[str, ...]

    def in_words(self) -> str:
        """Return the costs in one line."""
        return f"{self.processor_s:.1f} s of processor time, {self.wall_s:.1f} s by the clock, {self.memory_GB:.2f} GB"


@one_thread_of_algebra()
def measure(samples: int, hidden: int, threads: int) -> SearchCost:
    """Search a record of rich motion with so many effects hidden in it, on so many threads, and return the cost."""
    wheel = built_in_wheel()
    scenario = Scenario(duration_s=samples * wheel.sample_period_s, speed=SpeedProfile(kind="rich"), anomalies={})
    hiding = wheel.model_copy(update={"effect": HIDDEN[:hidden]})
    record = simulate(scenario, hiding, np.random.default_rng(SEED)).samples
    wall, busy = time.perf_counter(), time.process_time()
    found = find_discrepancy([("record", record)], wheel, each=on_threads(threads))
    wall, busy = time.perf_counter() - wall, time.process_time() - busy
    named = tuple(effect.name for effect in found.result.effects)
    return SearchCost(samples, hidden, threads, wall, busy, peak_memory_bytes() / GIGA, named)


def measure_apart(samples: int, hidden: int, threads: int) -> SearchCost:
    """Measure in a separate process."""
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        return pool.submit(measure, samples, hidden, threads).result()


def growth(costs: list[SearchCost]) -> float:
    """Return the processor time per sample of the last record over that of the first; 1 is linear."""
    first, last = costs[0], costs[-1]
    return (last.processor_s / last.samples) / (first.processor_s / first.samples)


def search_costs() -> list[SearchCost]:
    """Measure records of all lengths with one effect, then some with none and with two, as the command does it."""
    cases = [*((samples, 1) for samples in LENGTHS), (LENGTH, 0), (LENGTH, 2), (SHORT, 2)]
    return [measure_apart(samples, hidden, cores()) for samples, hidden in cases]


def search_section(costs: list[SearchCost]) -> Section:
    """Compare time, memory and growth of the search with the targets."""
    by_length = sorted((cost for cost in costs if cost.hidden == 1), key=lambda cost: cost.samples)
    short_s = max(cost.processor_s for cost in costs if cost.samples == SHORT)
    by_hidden = sorted((cost for cost in costs if cost.samples == LENGTH), key=lambda cost: cost.hidden)
    return Section(
        title=f"The discrepancy search, {costs[0].threads} threads",
        text=(
            f"The whole catalogue on records of rich motion, {' and '.join(effect.name for effect in HIDDEN)} hidden "
            f"in them in this order, seed {SEED}, each by a process of its own. Times by the clock hold whatever else "
            "the machine did."
        ),
        targets=tuple(
            at_most(what, reached, most, figures)
            for what, reached, most, figures in (
                (
                    f"search of {LENGTH:,} samples, processor time, the slowest of {len(by_hidden)} [s]",
                    max(cost.processor_s for cost in by_hidden),
                    MOST_SECONDS,
                    "; ".join(f"{cost.hidden} hidden: {cost.processor_s:.1f} s" for cost in by_hidden),
                ),
                (
                    f"search of {SHORT:,} samples, processor time [s]",
                    short_s,
                    MOST_SECONDS_SHORT,
                    f"{short_s:.1f} s",
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


def main() -> int:
    """Measure all lengths, one after the other, and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--samples", type=int, nargs="+", default=LENGTHS)
    parser.add_argument("--hidden", type=int, choices=(0, 1, 2), default=1)
    parser.add_argument("--threads", type=int, default=cores())
    options = parser.parse_args()
    costs = []
    for samples in options.samples:
        costs.append(measure_apart(samples, options.hidden, options.threads))
        sys.stdout.write(json.dumps(asdict(costs[-1])) + "\n")
    factor, longer = growth(costs), costs[-1].samples / costs[0].samples
    exponent = 1 + math.log(factor) / math.log(longer) if longer > 1 else math.nan
    whole = {"times_longer": longer, "per_sample": round(factor, 3), "exponent": round(exponent, 3)}
    sys.stdout.write(json.dumps(whole) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
