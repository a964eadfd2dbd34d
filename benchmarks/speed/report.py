"""The speed benchmark's results: targets, JSON, and the page made of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Final

from benchmarks.accuracy.page import table
from benchmarks.speed.race import Lap

MILLI: Final = 1e3
COMMAND: Final = "rwa-monitor benchmark speed"
HOW: Final = (
    "All that is compared ran in one process on one core, in turns, so that whatever else the machine did hit all "
    "alike: the ratios are what counts. Times are processor times of the thread that worked; those of windows are the "
    "least of three runs each, those of kernels medians with their quartiles."
)


@dataclass(frozen=True, slots=True)
class Target:
    """One line of the table of targets.

    Attributes
    ----------
    name
        What is measured.
    reached, bound
        The figure, and what it may be at most or must be at least; NaN where it could not be measured.
    least
        Whether the bound is a lower one.
    absolute
        The figures behind it, in words.
    """

    name: str
    reached: float
    bound: float
    least: bool
    absolute: str

    @property
    def met(self) -> bool | None:
        """Whether it is reached; None where it could not be measured."""
        if math.isnan(self.reached):
            return None
        return self.reached >= self.bound if self.least else self.reached <= self.bound


@dataclass(frozen=True, slots=True)
class Section:
    """One part of the benchmark: targets, times of runners side by side, and what to know about both."""

    title: str
    text: str
    targets: tuple[Target, ...]
    laps: tuple[Lap, ...] = ()
    figures: dict[str, float | str | None] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class SpeedReport:
    """All results of one run.

    Attributes
    ----------
    machine
        What it ran on, with the versions of everything that counts.
    settings
        Windows, seeds.
    sections
        The parts, in order.
    missing
        What was left out, and why.
    """

    machine: dict[str, str]
    settings: dict[str, int]
    sections: tuple[Section, ...]
    missing: tuple[str, ...]

    @property
    def targets(self) -> list[Target]:
        """All targets, in order."""
        return [target for section in self.sections for target in section.targets]

    def to_json(self) -> dict[str, Any]:
        """Return the report as plain content; NaN becomes null."""
        return {
            "command": COMMAND,
            "machine": self.machine,
            "settings": self.settings,
            "missing": list(self.missing),
            "sections": [
                {
                    "title": section.title,
                    "text": section.text,
                    "targets": [_plain(asdict(target)) | {"met": target.met} for target in section.targets],
                    "laps": [lap.to_json() for lap in section.laps],
                    "figures": _plain(section.figures),
                }
                for section in self.sections
            ],
        }

    @classmethod
    def from_json(cls, content: dict[str, Any]) -> SpeedReport:
        """Return the report that `to_json` wrote."""
        sections = [
            Section(
                title=part["title"],
                text=part["text"],
                targets=tuple(
                    Target(
                        entry["name"],
                        math.nan if entry["reached"] is None else entry["reached"],
                        entry["bound"],
                        entry["least"],
                        entry["absolute"],
                    )
                    for entry in part["targets"]
                ),
                laps=tuple(Lap(**entry) for entry in part["laps"]),
                figures=part["figures"],
            )
            for part in content["sections"]
        ]
        return cls(content["machine"], content["settings"], tuple(sections), tuple(content["missing"]))


def _plain(content: dict[str, Any]) -> dict[str, Any]:
    return {
        name: None if isinstance(value, float) and not math.isfinite(value) else value
        for name, value in content.items()
    }


# ---- the page --------------------------------------------------------------------------------------------------------


def to_markdown(report: SpeedReport) -> str:
    """Write the page."""
    machine = ", ".join(f"{name} {value}" for name, value in report.machine.items())
    settings = ", ".join(f"{name} {value}" for name, value in report.settings.items())
    parts = [
        "# Speed",
        f"Made by `{COMMAND}` ({settings}) on: {machine}.",
        HOW,
        *(f"Left out: {text}." for text in report.missing),
        "## Targets\n\n" + target_table(report.targets),
        *(_section(section) for section in report.sections),
    ]
    return "\n\n".join(parts) + "\n"


def target_table(targets: Sequence[Target]) -> str:
    """Write the table of targets."""
    rows = [
        [
            target.name,
            f"{'≥' if target.least else '≤'} {target.bound:g}",
            "not measured" if target.met is None else f"{target.reached:.3g}",
            {True: "yes", False: "**no**", None: "–"}[target.met],
            target.absolute,
        ]
        for target in targets
    ]
    return table(["what", "wanted", "reached", "met", "figures"], rows)


def _section(section: Section) -> str:
    parts = [f"## {section.title}", section.text]
    if section.laps:
        fastest = min((lap.median_s for lap in section.laps if lap.role == "ours"), default=math.nan)
        rows = [
            [
                lap.name,
                lap.role,
                f"{MILLI * lap.median_s:.3g}",
                f"{MILLI * lap.low_s:.3g} – {MILLI * lap.high_s:.3g}",
                f"{MILLI * lap.least_s:.3g}",
                str(lap.runs),
                f"{lap.median_s / fastest:.2f}",
            ]
            for lap in section.laps
        ]
        parts.append(
            table(["what", "whose", "median [ms]", "quartiles [ms]", "least [ms]", "runs", "× our fastest"], rows)
        )
    if section.figures:
        rows = [
            [name, value if isinstance(value, str) else f"{value:.4g}"]
            for name, value in section.figures.items()
            if value is not None
        ]
        parts.append(table(["figure", "value"], rows))
    return "\n\n".join(parts)
