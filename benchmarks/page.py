"""Common template of all result pages: title, sections, tables, rates with intervals; prints and writes a page."""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from scipy import stats

from benchmarks.machine import describe_machine

NONE = "–"  # in a cell: no value


def page(title: str, *parts: str) -> str:
    """Return a page of Markdown: the title, then the parts, a blank line between them."""
    return "\n\n".join((f"# {title}", *parts)) + "\n"


def section(title: str, *parts: str, level: int = 2) -> str:
    """Return a section of a page with its heading; `level` 3 is a subsection."""
    return "\n\n".join((f"{'#' * level} {title}", *parts))


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table."""
    return "\n".join("| " + " | ".join(line) + " |" for line in (header, ["---"] * len(header), *rows))


def made_at() -> str:
    """Return the footer of a page: command, commit with its date and whether the tree differed from it, and machine."""
    git = ("git", "-C", str(Path(__file__).parent))
    try:
        commit, changed = (
            subprocess.run((*git, *asked), capture_output=True, text=True, check=True).stdout.strip()
            for asked in (("log", "-1", "--format=%h of %cs"), ("status", "--porcelain", ".", "../rwa_monitor"))
        )
    except (OSError, subprocess.CalledProcessError):  # an archive, without its history
        commit, changed = "not known", ""
    words = (Path(word).name if Path(word).is_absolute() else word for word in sys.orig_argv[1:])
    command = " ".join(("python", *words))
    where = f"commit {commit}{', with changes' if changed else ''}"
    return f"\n*Made by `{command}`; {where}; {describe_machine()['processor']}.*\n"


# ---- figures ---------------------------------------------------------------------------------------------------------


def wilson(rate: float, total: float) -> tuple[float, float]:
    """Return Wilson's 95 % interval of a rate observed in `total` trials."""
    z = float(stats.norm.ppf(0.975))
    middle = (rate + z * z / (2.0 * total)) / (1.0 + z * z / total)
    half = z / (1.0 + z * z / total) * np.sqrt(rate * (1.0 - rate) / total + (z / (2.0 * total)) ** 2)
    return float(max(middle - half, 0.0)), float(min(middle + half, 1.0))


def percent(share: float) -> str:
    """Return a share as a percentage with one decimal; two where it is close to an end."""
    digits = 1 if 0.02 < share < 0.98 else 2
    return f"{100.0 * share:.{digits}f} %"


def with_interval(share: float, total: float) -> str:
    """Return a share of so many trials with its 95 % interval."""
    if total == 0.0:
        return NONE
    low, high = wilson(share, total)
    return f"{percent(share)} ({100 * low:.1f}–{100 * high:.1f})"


def counted(hits: int, total: int, digits: int = 1) -> str:
    """Return a count, its rate in percent and the 95 % interval, with so many decimals."""
    if total == 0:
        return NONE
    low, high = (f"{100 * bound:.{digits}f}" for bound in wilson(hits / total, total))
    return f"{hits} of {total} = {100 * hits / total:.{digits}f} % ({low}–{high})"


# ---- where it goes ---------------------------------------------------------------------------------------------------


def add_output_option(parser: argparse.ArgumentParser) -> None:
    """Add `-o/--output FILE`, which `put_out` takes."""
    parser.add_argument("-o", "--output", type=Path, help="file that the page is written to; it is printed too")


def put_out(text: str, output: Path | None) -> None:
    """Print a page with its footer, see `made_at`, and write it to the file, None for no file."""
    text += made_at()
    sys.stdout.write(text)
    if output is not None:
        output.write_text(text, encoding="utf-8")
