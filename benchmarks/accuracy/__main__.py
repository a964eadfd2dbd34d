"""Writes the whole page docs/benchmark.md: `python benchmarks/accuracy.py [--seed N] [--windows N] [--jobs N] …`.

Half an hour of processor time with the defaults. What it finds does not depend on the number of processes. Progress
goes to stderr. Exit code 1 when a target is missed.
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

# One thread for linear algebra in every process, before numpy is imported: the workers share the cores.
for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

from benchmarks.accuracy.benchmark import (  # noqa: E402
    LAWS_WHEELS,
    RECIPES,
    SEED,
    SPLITS,
    STORY_WHEELS,
    WINDOWS,
    run,
    targets,
)
from benchmarks.accuracy.page import to_markdown  # noqa: E402

PAGE = Path(__file__).resolve().parents[2] / "docs" / "benchmark.md"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--windows", type=int, default=WINDOWS, help="windows per recipe (default %(default)s)")
    parser.add_argument("--seed", type=int, default=SEED, help="of the data sets (default %(default)s)")
    parser.add_argument("--jobs", type=int, default=2, help="processes (default %(default)s)")
    parser.add_argument("--recipes", nargs="+", default=list(RECIPES), help="data sets (default: %(default)s)")
    parser.add_argument("--splits", type=int, default=SPLITS, help="random splits (default %(default)s)")
    parser.add_argument("--recipes-only", action="store_true", help="no carried states and no identified laws")
    parser.add_argument("-o", "--output", type=Path, default=PAGE, help="page to write (default docs/benchmark.md)")
    arguments = parser.parse_args()
    result = run(
        arguments.recipes,
        arguments.windows,
        arguments.seed,
        arguments.jobs,
        arguments.splits,
        stories={} if arguments.recipes_only else STORY_WHEELS,
        laws_wheels=0 if arguments.recipes_only else LAWS_WHEELS,
    )
    command = (
        f"python benchmarks/accuracy.py --windows {arguments.windows} --seed {arguments.seed}"
        f" --splits {arguments.splits}"
    )
    arguments.output.write_text(to_markdown(result, command), encoding="utf-8")
    missed = [target for target in targets(result) if not target.met]
    for target in missed:
        sys.stderr.write(f"missed: {target.name}: {target.reached:.4f}, wanted {target.wanted:.4f}\n")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
