"""Makes the table of null distributions: `make nulls`, or `python -m benchmarks.nulls -o FILE`.

Null records follow the base model: the built-in wheel with its switching systems (long sojourns shortened to a quarter,
so that short records have jumps too), every motion, noise of every law, friction given or derived. On each the whole
catalogue is tried and the largest gain of each family is kept. Coloured and heavy-tailed noise are noise effects
themselves: the null distribution of the noise family is that on white noise alone.
"""

from __future__ import annotations

import argparse
import itertools
import json
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Final

import numpy as np

from rwa_monitor.discrepancy.explanation import prepare
from rwa_monitor.discrepancy.fitting import Effects, Fitting
from rwa_monitor.discrepancy.hypotheses import CANDIDATES
from rwa_monitor.discrepancy.noise_effects import CAGE, QUANTISED, fit_bursts_of, fit_noise, views_of
from rwa_monitor.discrepancy.record import make_record
from rwa_monitor.discrepancy.switching_effects import fits_of_jumps
from rwa_monitor.discrepancy.terms import Model
from rwa_monitor.simulation.motion import ProfileKind, SpeedProfile
from rwa_monitor.simulation.record import simulate
from rwa_monitor.simulation.scenario import FrictionNoise, Scenario
from rwa_monitor.wheel.durations import Uniform
from rwa_monitor.wheel.effects.catalogue import NOISE_EFFECTS
from rwa_monitor.wheel.wheel import Wheel, built_in_wheel

SEED: Final = 20_261_121
LENGTHS: Final = (300, 1_500, 6_000)  # samples
RECORDS: Final = 12  # for each length, motion and noise
MOTIONS: Final[tuple[ProfileKind, ...]] = ("one_direction", "crossings", "rich")
NOISES: Final = {
    "white": FrictionNoise(),
    "ar1": FrictionNoise(law="ar1", ar_coefficient=0.5),
    "student_t": FrictionNoise(law="student_t", degrees_of_freedom=5.0),
    "derived": FrictionNoise(std_Nm=0.0),
}
LONG: Final = 1_000  # slots: a sojourn that may last longer is shortened
SHORTENED: Final = 0.25  # some fourteen jumps in 20,000 samples
NOTHING: Final = -99.0  # reported in place of a statistic where no candidate reached a full fit: below all others


def livelier(wheel: Wheel) -> Wheel:
    """Return the wheel with the long sojourns of its systems shortened, so that short records have jumps too.

    Short sojourns stay as they are: shortened to a sample or two they would act as heavy tails instead of jumps.
    """

    def law(known: Any) -> Uniform:
        assert isinstance(known, Uniform), "the built-in wheel's laws are uniform"
        if known.high < LONG:
            return known
        return Uniform(low=round(known.low * SHORTENED), high=round(known.high * SHORTENED))

    systems = [fss.model_copy(update={"durations": tuple(map(law, fss.durations))}) for fss in wheel.fss]
    return wheel.model_copy(update={"fss": tuple(systems)})


def best_gain(fitting: Fitting, effects: Effects) -> tuple[Model, float]:
    """Return the base model, and by how much the best effect lowers its score."""
    base = fitting.settled(fitting.base())
    best = fitting.extensions(base, fitting.split_testable(effects, base)[0], all_of_them=True)[0]
    simpler = fitting.without(best, 0) if best.terms else base  # its jumps alone may lower the score
    base = min(base, simpler, key=lambda one: one.score)
    return base, base.score - best.score


def null_gains(count: int, motion: ProfileKind, noise: str, number: int) -> dict[str, float]:
    """Return the largest statistic of each family on one null record, and its log N."""
    wheel = livelier(built_in_wheel())
    given = noise != "derived"
    scenario = Scenario(
        duration_s=count * wheel.sample_period_s,
        speed=SpeedProfile(kind=motion),
        noise=NOISES[noise],
        friction_given=given,
    )
    place = [SEED, count, MOTIONS.index(motion), list(NOISES).index(noise), number]
    samples = simulate(scenario, wheel, np.random.default_rng(place)).samples
    problem = prepare([make_record(samples, wheel, "null")], wheel)
    base, gain = best_gain(Fitting(problem, jumps=True), CANDIDATES)
    of_jumps = [sum(fit.penalised_gain for fit in of) for of in fits_of_jumps(problem, base, wheel).values()]
    gains = {"mean": gain, "switching": max(of_jumps)}
    if noise == "white":
        views, bursts = views_of(problem, base, turns=False), fit_bursts_of(problem, base)
        names = [name for name in NOISE_EFFECTS if name not in (CAGE, QUANTISED)]
        of_noise = [sum(fit_noise(problem, view, name).penalised_gain for view in views) for name in names]
        gains["noise"] = max(*of_noise, sum(fitted.penalised_gain for fitted, _ in bursts))
    return {"log_size": problem.log_size, **{name: gain + problem.log_size for name, gain in gains.items()}}


def make_table(records: int, lengths: tuple[int, ...], workers: int) -> dict[str, Any]:
    """Simulate and search all null records; the result does not depend on `workers`."""
    rows: list[dict[str, Any]] = []
    with ProcessPoolExecutor(workers, get_context("spawn")) as pool:
        for count in lengths:
            plan = [(count, m, n, k) for m in MOTIONS for n in NOISES for k in range(records)]
            done = list(pool.map(null_gains, *zip(*plan, strict=True), chunksize=4))
            sys.stderr.write(f"{count} samples: {len(done)} records\n")
            for family, derived in itertools.product(("mean", "noise", "switching"), (False, True)):
                # The noise family uses the records with white noise, also for derived friction.
                noises = {"white"} if family == "noise" else {n for n in NOISES if (n == "derived") is derived}
                of = [one for (_, _, noise, _), one in zip(plan, done, strict=True) if noise in noises]
                row: dict[str, Any] = {"family": family, "derived": derived, "samples": count}
                row["log_size"] = round(float(np.mean([one["log_size"] for one in of])), 4)
                rows.append({**row, "statistics": sorted(round(max(one[family], NOTHING), 2) for one in of)})
    return {"command": "make nulls", "seed": SEED, "nulls": rows}


def main() -> None:
    """Write the table to the file that is asked for."""
    parser = argparse.ArgumentParser(description="Makes the table of null distributions that p-values are taken from.")
    parser.add_argument("-o", "--output", type=Path, required=True, help="file to write")
    parser.add_argument("--records", type=int, default=RECORDS, help="for each length, motion and noise")
    parser.add_argument("--lengths", type=int, nargs="+", default=LENGTHS, help="samples")
    parser.add_argument("--workers", type=int, default=2, help="processes (default 2)")
    arguments = parser.parse_args()
    table = make_table(arguments.records, tuple(arguments.lengths), arguments.workers)
    arguments.output.write_text(json.dumps(table, indent=None) + "\n", encoding="utf-8")
    sys.stderr.write(f"wrote {arguments.output}\n")


if __name__ == "__main__":
    main()
