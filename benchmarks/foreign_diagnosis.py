"""Anomalies found in wheels of a simulator that shares no code with the package: `make foreign-diagnosis`.

    python -m benchmarks.foreign_diagnosis [--wheels N] [--seed S] [--jobs N] [-o FILE]

Wheels, motions, sensors and switching systems are those of `benchmarks/foreign`. A window passes as a table and a wheel
file with the healthy constants through the public interface; each wheel is diagnosed healthy and with each anomaly.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

import rwa_monitor
from benchmarks.accuracy.campaign import in_processes
from benchmarks.foreign.draws import Record, draw_systems, write
from benchmarks.foreign.generator import Plant, System, draw_plant, draw_world, measured
from benchmarks.page import add_output_option, counted, page, put_out, table
from benchmarks.target import Target, at_most, exit_code, target_table
from rwa_monitor.cli.options import track
from rwa_monitor.diagnosis.model import built_in_model

SAMPLES: Final = 20_000
DRY: Final = 1.3  # factors of the anomalies
VISCOUS: Final = 1.3
SYSTEM: Final = 1.6
ANOMALIES: Final = ("dry", "viscous", "system_1")
SENSORS: Final = {True: "friction is given", False: "friction from current and speed"}
SYSTEMS: Final = {False: "seldom", True: "often"}
LOOKED_AT: Final = 4  # the last of the seeds, from 1 on, that were run so far
Result = tuple[str, frozenset[str]]  # the verdict, and the anomalies found where it is anomalous


@dataclass(frozen=True, slots=True)
class Case:
    """One wheel and what is wrong with it: nothing (""), or one of ANOMALIES."""

    number: int
    seed: int
    given: bool
    often: bool
    anomaly: str = ""

    def run(self) -> Result:
        """Draw the wheel and its window, and diagnose it."""
        rng = np.random.default_rng([self.seed, self.number])
        healthy = draw_plant(rng, self.given)
        declared = (_switching_often(rng),) if self.often else draw_systems(rng)[0]
        plant, systems = self._failing(healthy, declared)
        world = draw_world(plant, systems, SAMPLES, rng, lambda share: np.ones(share.size))
        record = Record(replace(world, plant=healthy), declared, (), (), measured(world, (), rng))
        with tempfile.TemporaryDirectory() as folder:
            recording, file = write(record, Path(folder))
            wheel, samples = rwa_monitor.read_wheel(file), rwa_monitor.read(recording)
        window = wheel.window.model_copy(update={"samples": SAMPLES})
        (diagnosis,) = rwa_monitor.diagnose(samples, wheel.model_copy(update={"window": window}))
        least = built_in_model().undecided[1]
        found = {name for name, one in diagnosis.anomalies.items() if one.active and one.probability >= least}
        return diagnosis.verdict, frozenset(found if diagnosis.verdict == "anomalous" else ())

    def _failing(self, plant: Plant, systems: Sequence[System]) -> tuple[Plant, tuple[System, ...]]:
        # The systems' friction is stated as a share of the dry friction, which they do not follow.
        factor = {"dry": 1.0 / DRY}.get(self.anomaly, 1.0)
        first, *others = (_scaled(system, factor) for system in systems)
        match self.anomaly:
            case "dry":
                plant = replace(plant, dry=DRY * plant.dry)
            case "viscous":
                plant = replace(plant, viscous=VISCOUS * plant.viscous)
            case "system_1":
                first = _scaled(first, SYSTEM)
        return plant, (first, *others)


def _scaled(system: System, factor: float) -> System:
    return replace(system, friction=tuple((factor * low, factor * high) for low, high in system.friction))


def _switching_often(rng: np.random.Generator) -> System:
    """Return a memoryless system whose sojourns last 75 to 400 samples in the mean."""
    rest, low = rng.uniform(150.0, 400.0), rng.uniform(0.3, 0.6)
    active = rest * rng.uniform(0.5, 1.0)
    return System("system_1", (("geometric", rest, 0.0), ("geometric", active, 0.0)), ((0.0, 0.0), (low, 1.3 * low)))


def to_markdown(cases: Sequence[Case], results: Sequence[Result], wanted: Sequence[Target], seed: int) -> str:
    """Return the page."""
    rows = []
    for given, sensor in SENSORS.items():
        for often, systems in SYSTEMS.items():
            of_these = [
                (case.anomaly, verdict, found)
                for case, (verdict, found) in zip(cases, results, strict=True)
                if (case.given, case.often) == (given, often)
            ]
            wrong = sum(bool(found - {anomaly}) for anomaly, _, found in of_these)
            rows.append([sensor, systems])
            for name in ANOMALIES:
                there = [name in found for anomaly, _, found in of_these if anomaly == name]
                rows[-1].append(counted(sum(there), len(there)))
            verdicts = [verdict for anomaly, verdict, _ in of_these if not anomaly]
            rows[-1] += [counted(wrong, len(of_these)), counted(verdicts.count("inconclusive"), len(verdicts))]
    header = ["", "systems switch", *(f"{name} found" for name in ANOMALIES)]
    return page(
        "Anomalies in wheels of a foreign simulator",
        f"Seed {seed}; seeds 1 to {LOOKED_AT} were run so far, the last one once, after the last change. Wheels of"
        " 1e-4 to 0.1 kg m² sampled at 1 to 5 Hz, over motions with reversals, by sensors that read a moment or a mean;"
        " `benchmarks/foreign` shares no line with the package, which sees a table of"
        f" {SAMPLES:,} samples and a wheel file with the healthy constants. Dry friction is {DRY} times too large,"
        f" viscous friction {VISCOUS} times, the friction of a system {SYSTEM} times. Systems that switch often have"
        " sojourns of 75 to 400 samples, the others of some hundred to 5,000. Brackets: 95 % intervals.",
        target_table(wanted),
        table([*header, "windows with a false anomaly", "healthy, but inconclusive"], rows),
    )


def targets(cases: Sequence[Case], results: Sequence[Result]) -> list[Target]:
    """Return the target with the figure reached."""
    false = sum(bool(found - {case.anomaly}) for case, (_, found) in zip(cases, results, strict=True))
    return [at_most("windows with a false anomaly", false / len(cases), 0.01)]


def main() -> int:
    """Diagnose all wheels, write the page, return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--wheels", type=int, default=24, help="of each kind (default %(default)s)")
    parser.add_argument("--seed", type=int, default=LOOKED_AT, help="(default %(default)s)")
    parser.add_argument("--jobs", type=int, default=2, help="processes (default %(default)s)")
    add_output_option(parser)
    options = parser.parse_args()
    cases = [
        Case(number, options.seed, given, often, anomaly)
        for number in range(options.wheels)
        for given in SENSORS
        for often in SYSTEMS
        for anomaly in ("", *ANOMALIES)
    ]
    results = list(track(in_processes(Case.run, iter(cases), options.jobs), len(cases), "windows"))
    wanted = targets(cases, results)
    put_out(to_markdown(cases, results, wanted, options.seed), options.output)
    return exit_code(wanted)


if __name__ == "__main__":
    sys.exit(main())
