"""The speed benchmark's results: targets, JSON, and the page."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field
from typing import Any, Final

from benchmarks.machine import in_words
from benchmarks.page import page, section, table
from benchmarks.speed.race import Lap
from benchmarks.target import Target, target_table

MILLI: Final = 1e3
COMMAND: Final = "make benchmark-speed"
HOW: Final = (
    "All that is compared ran in one process on one core, in turns, so that whatever else the machine did hit all "
    "alike: the ratios are what counts. Times are processor times of the thread that worked; those of windows are the "
    "least of three runs each, those of kernels medians with their quartiles."
)


@dataclass(frozen=True, slots=True)
class Section:
    """One part of the benchmark: targets, times of the runners, and an explanation of both."""

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
        Description of the machine, with the versions of the relevant software.
    settings
        Windows, seeds.
    sections
        The parts, in order.
    missing
        Parts that were left out, and why.
    """

    machine: dict[str, str]
    settings: dict[str, int]
    sections: tuple[Section, ...]
    missing: tuple[str, ...]

    @property
    def targets(self) -> list[Target]:
        """All targets, in order."""
        return [target for part in self.sections for target in part.targets]

    def to_json(self) -> dict[str, Any]:
        """Return the report as JSON content; NaN becomes null."""
        return {
            "command": COMMAND,
            "machine": self.machine,
            "settings": self.settings,
            "missing": list(self.missing),
            "sections": [
                {
                    "title": part.title,
                    "text": part.text,
                    "targets": [_plain(asdict(target)) | {"met": target.met} for target in part.targets],
                    "laps": [lap.to_json() for lap in part.laps],
                    "figures": _plain(part.figures),
                }
                for part in self.sections
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
    return page(
        "Speed",
        f"Made by `{COMMAND}` ({in_words(report.settings)}) on: {in_words(report.machine)}.",
        HOW,
        *(f"Left out: {text}." for text in report.missing),
        section("Targets", target_table(report.targets, "g", ".3g")),
        *(_section(part) for part in report.sections),
    )


def _section(part: Section) -> str:
    parts = [part.text]
    if part.laps:
        fastest = min((lap.median_s for lap in part.laps if lap.role == "ours"), default=math.nan)
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
            for lap in part.laps
        ]
        parts.append(
            table(["what", "whose", "median [ms]", "quartiles [ms]", "least [ms]", "runs", "× our fastest"], rows)
        )
    if part.figures:
        rows = [
            [name, value if isinstance(value, str) else f"{value:.4g}"]
            for name, value in part.figures.items()
            if value is not None
        ]
        parts.append(table(["figure", "value"], rows))
    return section(part.title, *parts)
