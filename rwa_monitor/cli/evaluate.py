"""`evaluate`: scores diagnoses against labels, event by event."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from dataclasses import asdict
from json import dumps
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from rwa_monitor.cli import options as cli
from rwa_monitor.errors import InputError

if TYPE_CHECKING:
    from rwa_monitor.telemetry.labels import JudgedWindow
    from rwa_monitor.telemetry.scores import Scores, Timeline

COLUMNS: Final = {
    "events": "events",
    "detected": "detected",
    "false_alarms": "false\nalarms",
    "precision": "precision",
    "recall": "recall",
    "f_0_5": "F0.5",
    "alarming_precision": "alarming\nprecision",
    "timing": "timing",
    "affiliation_precision": "affiliation\nprecision",
    "affiliation_recall": "\nrecall",
    "affiliation_f_0_5": "\nF0.5",
}


@click.command(short_help="Score diagnoses against labels, event by event.")
@click.argument("diagnoses", type=cli.FILE, metavar="DIAGNOSES")
@click.argument("labels", type=cli.FILE, metavar="LABELS")
@cli.flag("--json", "Print one JSON object.")
def evaluate(diagnoses: Path, labels: Path, json: bool) -> int:
    """Score diagnoses against labels, event by event, as in ESA's anomaly benchmark (ESA-ADB).

    DIAGNOSES are the lines of `rwa-monitor diagnose --json`, in a file or, as -, on stdin; or a recording of the
    monitor, or a folder of them. LABELS is a labels.csv as `train` reads it (file,dry,viscous,<switching systems>; a
    label holds for all windows of its file), or a table of events (wheel,kind,start_ns,end_ns).

    A window raises an alarm of each active anomaly where its verdict is anomalous, over all of its time. The same
    scores are given for two dummies: one that alarms always and one that never does. docs/evaluate.md defines them.
    """
    from rwa_monitor.telemetry.labels import match_labels

    windows, problems = _read(diagnoses)
    cli.log(*problems)
    kinds, together = match_labels(windows, labels)
    scores = {kind: _scores(timelines) for kind, timelines in kinds.items()}
    overall = _scores(together)
    if json:
        by_kind = {kind: {name: asdict(one) for name, one in rows.items()} for kind, rows in scores.items()}
        rows = {name: asdict(one) for name, one in overall.items()}
        counts = {"windows": len(windows), "timelines": len(together)}
        click.echo(dumps({**counts, "kinds": by_kind, "overall": rows}))
    else:
        _print([*scores.items(), ("overall", overall)])
    return cli.UNREADABLE if problems else 0


def _read(diagnoses: Path) -> tuple[list[JudgedWindow], list[str]]:
    """Return the diagnoses, and a line for each part of a recording that cannot be read."""
    from rwa_monitor.monitor.recording import read_chain
    from rwa_monitor.telemetry.files import display_name
    from rwa_monitor.telemetry.labels import JudgedWindow

    name = display_name(diagnoses)
    windows, problems = list[JudgedWindow](), list[str]()
    if diagnoses.is_dir() or diagnoses.suffix == ".mcap":
        for recording in read_chain(diagnoses):
            windows += [one.model_copy(update={"source": name}) for one in recording.parsed(JudgedWindow)]
            problems += [f"{display_name(recording.path)}: {problem}" for problem in recording.problems]
    else:
        windows += _lines(diagnoses, "stdin" if name == "-" else name)
    if not windows:
        raise InputError(name, "holds no diagnosis; rwa-monitor diagnose FILE... --json makes them")
    return windows, problems


def _lines(diagnoses: Path, name: str) -> Iterator[JudgedWindow]:
    """Parse lines of JSON; reading stops one byte above the size limit of a message, which is then refused."""
    from rwa_monitor.messages import MAX_MESSAGE_BYTES
    from rwa_monitor.telemetry.files import opened
    from rwa_monitor.telemetry.labels import JudgedWindow

    with nullcontext(sys.stdin.buffer) if str(diagnoses) == "-" else opened(diagnoses) as file:
        for number, line in enumerate(iter(lambda: file.readline(MAX_MESSAGE_BYTES + 1), b""), 1):
            if line.strip():
                yield JudgedWindow.parse(line, f"{name}: line {number}")


def _scores(timelines: Sequence[Timeline]) -> dict[str, Scores]:
    from rwa_monitor.telemetry.scores import score

    return {
        "diagnoses": score(timelines),
        "always": score(timeline.always for timeline in timelines),
        "never": score(timeline.never for timeline in timelines),
    }


def _print(scores: Sequence[tuple[str, dict[str, Scores]]]) -> None:
    """Print a line for each kind and detector."""
    from rich.table import Column, Table

    from rwa_monitor.reporting.diagnoses import UNKNOWN

    def cell(value: object) -> str:
        return UNKNOWN if value is None else f"{value:.3f}" if isinstance(value, float) else str(value)

    names = [Column(name, no_wrap=True) for name in ("anomaly", "alarms of")]
    table = Table(*names, *(Column(one, justify="right") for one in COLUMNS.values()), box=None, pad_edge=False)
    table.padding = (0, 2, 0, 0)
    for kind, rows in scores:
        for name, one in rows.items():
            table.add_row(kind if name == "diagnoses" else "", name, *(cell(getattr(one, field)) for field in COLUMNS))
    cli.console_of_stdout().print(table)
