"""Speed of this package compared with peers and lower limits, in one run: `make benchmark-speed`.

    python -m benchmarks.speed [--windows N] [--seed N] [--json FILE] [--from FILE] [-o FILE]

Takes about eight minutes with all peers, which are optional packages (skchange, ruptures, river): missing ones are left
out and named on stderr. Prints the page; exit code 1 where a target is missed.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from benchmarks.page import add_output_option, put_out
from benchmarks.speed.benchmark import SEED, WINDOWS, run
from benchmarks.speed.report import SpeedReport, to_markdown
from benchmarks.target import exit_code


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, or read earlier results; write the page and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--windows", type=int, default=WINDOWS, help="how many windows (default %(default)s)")
    parser.add_argument("--seed", type=int, default=SEED, help="of the windows (default %(default)s)")
    parser.add_argument("--json", type=Path, help="file that the results are kept in")
    parser.add_argument("--from", dest="kept", type=Path, help="measure nothing: show the results kept in this file")
    add_output_option(parser)
    options = parser.parse_args(arguments)
    if options.kept is None:
        report = run(options.windows, options.seed)
    else:
        report = SpeedReport.from_json(json.loads(options.kept.read_text(encoding="utf-8")))
    for text in report.missing:
        sys.stderr.write(f"{text}\n")
    if options.json is not None:
        content = json.dumps(report.to_json(), indent=1, ensure_ascii=False)
        options.json.write_text(content + "\n", encoding="utf-8")
    put_out(to_markdown(report), options.output)
    return exit_code(report.targets)


if __name__ == "__main__":
    sys.exit(main())
