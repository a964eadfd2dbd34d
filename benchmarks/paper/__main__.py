"""Every table and figure of the paper, reproduced and compared with oracles and peers: `make benchmark-paper`.

    python -m benchmarks.paper [--windows N] [--seed N] [--workers N] [--quick] [-o FILE]

Takes some minutes. Prints the page; with -o its pictures are written to pictures/ next to it. The other packages
(skchange, ruptures) are optional: missing ones are left out and named on stderr. Exit code 1 where the method joint
misses a target.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace

from benchmarks.page import add_output_option, put_out
from benchmarks.paper.benchmark import Size, paper_targets, run
from benchmarks.paper.page import to_markdown
from benchmarks.paper.pictures import pictures
from benchmarks.target import exit_code
from rwa_monitor.telemetry.files import write_text


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, write page and pictures, and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--windows", type=int, help=f"how many windows (default {Size().windows})")
    parser.add_argument("--seed", type=int, default=Size().seed, help="of the windows (default %(default)s)")
    parser.add_argument("--workers", type=int, default=2, help="processes; 0 works in this one (default %(default)s)")
    parser.add_argument("--quick", action="store_true", help="few windows and splits, and only the quick peers")
    add_output_option(parser)
    options = parser.parse_args(arguments)
    size = replace(Size(), seed=options.seed)
    if options.quick:
        size = size.quick()
    if options.windows is not None:
        size = replace(size, windows=options.windows)
    found = run(size, options.workers)
    for text in found.missing:
        sys.stderr.write(f"{text}\n")
    stem = options.output.stem if options.output else "paper"
    quick = " --quick" if options.quick else ""
    command = f"python -m benchmarks.paper{quick} --windows {size.windows} --seed {size.seed}"
    put_out(to_markdown(found, command, f"pictures/{stem}_"), options.output)
    if options.output is not None:
        folder = options.output.parent / "pictures"
        folder.mkdir(parents=True, exist_ok=True)
        for name, drawing in pictures(found).items():
            write_text(folder / f"{stem}_{name}.svg", drawing)
    return exit_code(paper_targets(found) if found.enough else [])


if __name__ == "__main__":
    sys.exit(main())
