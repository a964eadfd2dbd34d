"""How often diagnoses of labelled windows are right, against the paper and oracles: `make benchmark-accuracy`.

    python -m benchmarks.accuracy [--windows N] [--seed N] [--jobs N] [--recipes NAME …] [--recipes-only] [-o FILE]

Takes half an hour of processor time with the defaults. The results do not depend on the number of processes. Prints the
page; exit code 1 where a target is missed.
"""

from __future__ import annotations

import argparse
import sys

from benchmarks.accuracy.benchmark import COURSE_WHEELS, LAWS_WHEELS, RECIPES, SEED, SPLITS, WINDOWS, run, targets
from benchmarks.accuracy.page import to_markdown
from benchmarks.page import add_output_option, put_out
from benchmarks.target import exit_code


def main() -> int:
    """Measure, write the page, return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--windows", type=int, default=WINDOWS, help="windows per recipe (default %(default)s)")
    parser.add_argument("--seed", type=int, default=SEED, help="of the data sets (default %(default)s)")
    parser.add_argument("--jobs", type=int, default=2, help="processes (default %(default)s)")
    parser.add_argument("--recipes", nargs="+", choices=RECIPES, default=RECIPES, help="data sets (default: all)")
    parser.add_argument("--splits", type=int, default=SPLITS, help="random splits (default %(default)s)")
    parser.add_argument("--recipes-only", action="store_true", help="no carried states and no identified laws")
    add_output_option(parser)
    options = parser.parse_args()
    result = run(
        options.recipes,
        options.windows,
        options.seed,
        options.jobs,
        options.splits,
        courses={} if options.recipes_only else COURSE_WHEELS,
        laws_wheels=0 if options.recipes_only else LAWS_WHEELS,
    )
    size = f"--windows {options.windows} --seed {options.seed} --splits {options.splits}"
    put_out(to_markdown(result, f"python -m benchmarks.accuracy {size}"), options.output)
    return exit_code(targets(result))


if __name__ == "__main__":
    sys.exit(main())
