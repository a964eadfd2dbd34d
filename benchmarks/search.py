"""How the discrepancy search grows with the record: processor time, wall-clock time and memory, as ratios too.

`python -m benchmarks.search` prints one JSON line for each length and one with the growth. Every length runs in a
process of its own, so that its memory is its own; the record hides a Stribeck effect, so that the search takes all its
steps. The machine's load changes the wall-clock time, hardly the processor time.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import resource
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any

import numpy as np

from rwa_monitor.discrepancy.find import find_discrepancy
from rwa_monitor.physics.scenario import Scenario
from rwa_monitor.physics.speed import SpeedProfile
from rwa_monitor.physics.telemetry import simulate
from rwa_monitor.physics.wheel import EffectBlock, built_in_wheel
from rwa_monitor.threads import on_threads

LENGTHS = (20_000, 80_000, 320_000)
SEED = 3
HIDDEN = EffectBlock(name="stribeck", parameters={"strength_Nm": 5.0e-4, "stribeck_speed_rad_s": 8.0, "exponent": 1.0})


def measure(count: int, threads: int) -> dict[str, Any]:
    """Search a record of `count` samples once and return what it cost: times [s], largest resident memory [GB]."""
    wheel = built_in_wheel()
    scenario = Scenario(duration_s=count * wheel.sample_period_s, speed=SpeedProfile(kind="rich"), anomalies={})
    hiding = wheel.model_copy(update={"effect": (HIDDEN,)})
    samples = simulate(scenario, hiding, np.random.default_rng(SEED)).samples
    find_discrepancy([("warm", samples[slice(0, 3000)])], wheel)  # compiled loops are loaded
    wall, processor = time.perf_counter(), time.process_time()
    found = find_discrepancy([("record", samples)], wheel, each=on_threads(threads))
    return {
        "samples": count,
        "threads": threads,
        "wall_s": round(time.perf_counter() - wall, 2),
        "processor_s": round(time.process_time() - processor, 2),
        "memory_GB": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9, 2),
        "named": [effect.name for effect in found.result.effects],
    }


def growth(rows: list[dict[str, Any]]) -> float:
    """Return the processor time per sample of the longest record over that of the shortest; 1 is linear."""
    first, last = rows[0], rows[-1]
    return float((last["processor_s"] / last["samples"]) / (first["processor_s"] / first["samples"]))


def main() -> None:
    """Measure all lengths, one after the other."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--samples", type=int, nargs="+", default=LENGTHS)
    parser.add_argument("--threads", type=int, default=os.cpu_count() or 1)
    options = parser.parse_args()
    rows = []
    for count in options.samples:
        with ProcessPoolExecutor(1, get_context("spawn")) as pool:
            rows.append(pool.submit(measure, count, options.threads).result())
        print(json.dumps(rows[-1]), flush=True)
    factor = growth(rows)
    longer = rows[-1]["samples"] / rows[0]["samples"]
    exponent = 1 + math.log(factor) / math.log(longer) if longer > 1 else math.nan
    print(json.dumps({"times_longer": longer, "per_sample": round(factor, 3), "exponent": round(exponent, 3)}))


if __name__ == "__main__":
    main()
