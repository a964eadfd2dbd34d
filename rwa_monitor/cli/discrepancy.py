"""`discrepancy`: finds what the simulation of a wheel gets wrong, from recordings of the wheel."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import click

from rwa_monitor.cli import options as cli

if TYPE_CHECKING:
    from collections.abc import Callable

    from rwa_monitor.discrepancy.plan import Plan, PlannedManoeuvre
    from rwa_monitor.discrepancy.problem import Mapper
    from rwa_monitor.discrepancy.result import Search
    from rwa_monitor.samples import Samples
    from rwa_monitor.wheel.wheel import Wheel

    Named = list[tuple[str, Samples]]  # name and samples of each recording


class ReportOptions(NamedTuple):
    """What a report on one wheel contains, beyond the search."""

    out: Path | None
    bootstrap: int
    held_out: tuple[Path, ...]
    search_again: bool
    no_diagnosis: bool
    plan: bool


report_options = cli.as_one(
    "wanted",
    ReportOptions,
    cli.option("--out", cli.FILE, "DIR", "Write report.html, report.json and extended_wheel.toml there."),
    cli.option(
        "--bootstrap",
        cli.Whole(0, 10_000),
        "B",
        "Take p-values from B simulated records without the effect instead of the table.",
        default=0,
    ),
    cli.option(
        "--held-out",
        cli.FILE,
        "FILE",
        "A recording to measure the gain on: nothing is searched or fitted there. May be given several times.",
        multiple=True,
    ),
    cli.flag(
        "--search-again",
        "Search parts of the data by themselves, too, and judge on the rest; takes up to three times as long.",
    ),
    cli.flag(
        "--no-diagnosis",
        "Leave out what the extension does to the diagnosis (16 simulated windows: some 6 s of processor time).",
    ),
    cli.flag("--plan", "Rank the manoeuvres that would separate the leading causes."),
)


@click.command(short_help="Show what the simulation gets wrong, and name the cause.")
@cli.as_one("given", cli.known_wheel, cli.wheel_option, cli.motor_off_option)
@cli.flag("--json", "Print the report as one JSON object (rwa.Discrepancy).")
@report_options
@cli.recordings_options
def discrepancy(given: Wheel | None, json: bool, wanted: ReportOptions, recordings: cli.Recordings) -> int:
    """Find what a wheel's simulation lacks: the cause by name, its size, and what adding it gains.

    Several files are recordings of one wheel and give one joint report. Where the data cannot separate causes, all
    are named, with the manoeuvre that would separate them.

    The gain is measured on blocks of the recordings that are left out in turn, or, with --held-out, on other
    recordings of the wheel. The names are those of all data; --search-again shows which are found, and what they gain,
    without the data that they are judged on.
    """
    from rwa_monitor.discrepancy.plan import plan
    from rwa_monitor.telemetry.files import make_folder
    from rwa_monitor.threads import cores, on_threads
    from rwa_monitor.wheel.wheel import built_in_wheel

    if wanted.out is not None:
        make_folder(wanted.out, "--out")
    samples, known = recordings.of_one_wheel(given)
    held_out, _ = recordings.of_one_wheel(given, wanted.held_out)
    found = _search(samples, held_out, known or built_in_wheel(), wanted, on_threads(cores()))
    planned = plan(found) if wanted.plan else None
    if wanted.out is not None:
        _write_report(found, [str(file) for file in recordings.files], wanted.out)
    _print(found, planned, json)
    if wanted.out is not None:
        cli.log(f"report written to {wanted.out}")
    return recordings.status


def _search(samples: Named, held_out: Named, wheel: Wheel, wanted: ReportOptions, side_by_side: Mapper) -> Search:
    """Search the recordings, and add what else the report contains."""
    from rwa_monitor.discrepancy.bench import as_measured
    from rwa_monitor.discrepancy.extended import speed_unit_question
    from rwa_monitor.discrepancy.find import find_discrepancy, with_search_again
    from rwa_monitor.discrepancy.plausible import measured_constants, remarks

    cli.log(*as_measured([*samples, *held_out], wheel).notes)
    with cli.status_line("searching") as progress:
        for name, one in (*samples, *held_out):
            cli.log(*(f"{name}: {words}" for words in remarks(one, wheel)))
        found = find_discrepancy(samples, wheel, progress, side_by_side, held_out)
        if wanted.search_again:
            found = with_search_again(found, samples, progress, side_by_side)
        cli.log(speed_unit_question(found) or "")
        for name, one in samples:
            cli.log(*(f"{name}: {constant.in_words()}" for constant in measured_constants(one, found.wheel)))
        if wanted.bootstrap:
            from rwa_monitor.discrepancy.p_values import with_bootstrap

            found = with_bootstrap(found, wanted.bootstrap, progress)
        return found if wanted.no_diagnosis else _with_diagnosis_gain(found, progress)


def _print(found: Search, planned: Plan | None, as_json: bool) -> None:
    from rwa_monitor.reporting.discrepancy_report import details, plan_lines, sentence

    if as_json:
        report = found.result.to_json()
        if planned is not None:
            report["plan"] = [_plan_json(entry) for entry in planned.manoeuvres]
            report["plan_question"], report["plan_advice"] = planned.question, planned.advice
        click.echo(json.dumps(report, ensure_ascii=False, allow_nan=False))
        return
    click.echo(sentence(found.result))
    console = cli.console_of_stdout()
    for part in details(found):
        console.print(part)
    for line in plan_lines(planned) if planned is not None else ():
        click.echo(line)


def _with_diagnosis_gain(found: Search, progress: Callable[[str], None]) -> Search:
    """Add the change of the diagnosis by the extension, where the wheel can be simulated and classified."""
    from dataclasses import replace

    from rwa_monitor.diagnosis.model import built_in_model
    from rwa_monitor.discrepancy.diagnosis_gain import diagnosis_gain
    from rwa_monitor.monitor.core import diagnose_samples

    progress("diagnosis with and without the extension")
    model = built_in_model()
    rates = diagnosis_gain(found, lambda samples, wheel: next(diagnose_samples(samples, wheel, model)).diagnosis)
    if rates is None or found.result.gain is None:
        return found
    gain = found.result.gain.model_copy(update={"diagnosis": rates})
    return replace(found, result=replace(found.result, gain=gain))


def _write_report(found: Search, sources: list[str], folder: Path) -> None:
    from hashlib import sha256

    from rwa_monitor import __version__
    from rwa_monitor.discrepancy.extended import extend
    from rwa_monitor.reporting.discrepancy_report import html
    from rwa_monitor.telemetry.files import write_text

    report = json.dumps(found.result.to_json(), indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    write_text(folder / "report.json", report)
    write_text(folder / "extended_wheel.toml", extend(found, sha256(report.encode()).hexdigest()).to_toml())
    write_text(folder / "report.html", html(found, sources, __version__))


def _plan_json(entry: PlannedManoeuvre) -> dict[str, object]:
    return {
        "manoeuvre": entry.name,
        "description": entry.description,
        "duration_s": entry.duration_s,
        "separation_nats": entry.separation,
        "nats_per_hour": entry.nats_per_hour,
        "shows": list(entry.shows),
        "hardest_pair": [name for name in entry.worst_pair if name],
    }
