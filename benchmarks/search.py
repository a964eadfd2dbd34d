"""How the discrepancy search grows with the record: processor time, wall-clock time and memory, as ratios too.

`python -m benchmarks.search` prints one JSON line for each length and one with the growth: that part of
`rwa-monitor benchmark speed` alone, with lengths, hidden effects and threads of one's own.
"""

from __future__ import annotations

import argparse
import json
import math
from dataclasses import asdict

from benchmarks.speed.search import LENGTHS, growth, measure_apart
from rwa_monitor.threads import cores


def main() -> None:
    """Measure all lengths, one after the other."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--samples", type=int, nargs="+", default=LENGTHS)
    parser.add_argument("--hidden", type=int, choices=(0, 1, 2), default=1)
    parser.add_argument("--threads", type=int, default=cores())
    options = parser.parse_args()
    costs = []
    for samples in options.samples:
        costs.append(measure_apart(samples, options.hidden, options.threads))
        print(json.dumps(asdict(costs[-1])), flush=True)
    factor, longer = growth(costs), costs[-1].samples / costs[0].samples
    exponent = 1 + math.log(factor) / math.log(longer) if longer > 1 else math.nan
    print(json.dumps({"times_longer": longer, "per_sample": round(factor, 3), "exponent": round(exponent, 3)}))


if __name__ == "__main__":
    main()
