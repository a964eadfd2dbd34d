"""Where the page of a benchmark goes: it is printed, and written to a file where one is named."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path


def add_output_option(parser: argparse.ArgumentParser) -> None:
    """Add `-o/--output FILE`, which `put_out` takes."""
    parser.add_argument("-o", "--output", type=Path, help="file that the page is written to; it is printed too")


def put_out(page: str, output: Path | None) -> None:
    """Print a page, and write it to the file, None for no file."""
    sys.stdout.write(page)
    if output is not None:
        output.write_text(page, encoding="utf-8")
