"""How large a gain chance makes: the best candidate's gain on records that hide nothing.

`python -m benchmarks.blind_nulls --records 60` prints, for each noise, quantiles of the largest penalised gain over the
whole catalogue, and how many independent tests the catalogue is worth (EFFECTIVE_TESTS of `discrepancy/find.py`): the m
for which the smallest of m uniform p-values has the median that was measured. Gains below 0 are not kept: where the
median is 0 the number is an upper bound.
"""

from __future__ import annotations

import argparse
import json
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context

import numpy as np
from scipy import stats

from rwa_monitor.discrepancy.base_fit import make_problem
from rwa_monitor.discrepancy.jump_terms import JUMP_TERMS
from rwa_monitor.discrepancy.record import make_record
from rwa_monitor.discrepancy.search import search
from rwa_monitor.physics.effects.catalogue import MEAN_EFFECTS
from tests.blind.generator import MANOEUVRES, NOISES, Case, generate, plan


def best_gain(case: Case, samples: int) -> tuple[float, float]:
    """Return the best candidate's penalised gain, and log N."""
    table, wheel, _ = generate(case)
    problem = make_problem([make_record(table[slice(0, samples)], wheel, "null")], wheel)
    # Nothing is accepted, so that the best candidate is always the best rejected one.
    found = search(problem, [*MEAN_EFFECTS.values(), *JUMP_TERMS], lambda *_: False)
    return found.best_rejected, problem.log_size


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--records", type=int, default=60, help="per noise")
    parser.add_argument("--samples", type=int, default=5000)
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    rows = []
    with ProcessPoolExecutor(options.jobs, get_context("spawn")) as pool:
        for noise in NOISES:
            plans = [plan("null", (), k, 77_000 + k) for k in range(options.records)]
            cases = [replace(c, noise=noise, manoeuvre=MANOEUVRES[k % 3]) for k, c in enumerate(plans)]
            measured = list(pool.map(best_gain, cases, [options.samples] * len(cases)))
            gains = np.array([gain for gain, _ in measured])
            # The penalty of one parameter put back: χ² with one degree of freedom is the most lenient reading.
            p = stats.chi2.sf(np.maximum(gains + np.array([log for _, log in measured]), 0), 1)
            tests = float(np.log(0.5) / np.log1p(-min(float(np.median(p)), 0.5)))
            rows.append(
                {
                    "noise": noise,
                    "records": options.records,
                    "samples": options.samples,
                    "gain_quantiles": {str(q): round(float(np.quantile(gains, q)), 2) for q in (0.5, 0.9, 0.99, 1.0)},
                    "above_25": int(np.sum(gains >= 25)),
                    "effective_tests": round(tests, 1),
                }
            )
            print(json.dumps(rows[-1]), flush=True)


if __name__ == "__main__":
    main()
