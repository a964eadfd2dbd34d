"""Targets of benchmarks: figures compared with bounds, their table, and the exit code."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from benchmarks.page import NONE, table


@dataclass(frozen=True, slots=True)
class Target:
    """One target: a figure and its bound.

    Attributes
    ----------
    name
        What is measured.
    reached, bound
        The figure, NaN where it could not be measured, and its upper or lower bound.
    least
        Whether the bound is a lower one.
    absolute
        The underlying absolute figures, as text; may be empty.
    """

    name: str
    reached: float
    bound: float
    least: bool
    absolute: str = ""

    @property
    def met(self) -> bool | None:
        """Whether it is reached; None where it could not be measured."""
        if math.isnan(self.reached):
            return None
        return self.reached >= self.bound if self.least else self.reached <= self.bound


def at_least(name: str, reached: float, bound: float, absolute: str = "") -> Target:
    """Return a target with a lower bound."""
    return Target(name, reached, bound, True, absolute)


def at_most(name: str, reached: float, bound: float, absolute: str = "") -> Target:
    """Return a target with an upper bound."""
    return Target(name, reached, bound, False, absolute)


def target_table(targets: Sequence[Target], wanted: str = ".3f", reached: str = ".4f") -> str:
    """Return the table of targets, bounds and figures in these formats, with the underlying figures where given."""
    header = ["what", "wanted", "reached", "met", "figures"]
    rows = [
        [
            target.name,
            f"{'≥' if target.least else '≤'} {target.bound:{wanted}}",
            "not measured" if target.met is None else f"{target.reached:{reached}}",
            {True: "yes", False: "**no**", None: NONE}[target.met],
            target.absolute,
        ]
        for target in targets
    ]
    shown = len(header) if any(target.absolute for target in targets) else len(header) - 1
    return table(header[:shown], [row[:shown] for row in rows])


def exit_code(targets: Iterable[Target]) -> int:
    """Print the missed targets on stderr; return 1 where there are any, else 0."""
    missed = [target for target in targets if target.met is False]
    for target in missed:
        sys.stderr.write(f"missed: {target.name}: {target.reached:.4g}, wanted {target.bound:.4g}\n")
    return 1 if missed else 0
