"""`discrepancy`: what the simulation of a wheel gets wrong, from recordings of it."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rwa_monitor.cli.console import log, status_line
from rwa_monitor.cli.options import FILE, Whole, as_one, motor_off_option, wheel_option
from rwa_monitor.cli.recordings import AT_ONCE, Recordings, known_wheel, recordings_options

if TYPE_CHECKING:
    from collections.abc import Callable

    from rwa_monitor.discrepancy.finished_search import Search
    from rwa_monitor.discrepancy.mapper import Mapper
    from rwa_monitor.discrepancy.plan import Plan, PlannedManoeuvre
    from rwa_monitor.samples import Samples
    from rwa_monitor.wheel.wheel import Wheel

    Named = list[tuple[str, Samples]]  # name and samples of each recording


@dataclass(frozen=True, slots=True)
class ReportOptions:
    """What a report on one wheel is to hold, beyond the search."""

    out: Path | None = None
    bootstrap: int = 0
    held_out: tuple[Path, ...] = ()
    search_again: bool = False
    no_diagnosis: bool = False
    show_plan: bool = False


report_options = as_one(
    "wanted",
    ReportOptions,
    click.option(
        "--out", type=FILE, metavar="DIR", help="Write report.html, report.json and extended_wheel.toml there."
    ),
    click.option(
        "--bootstrap",
        type=Whole(0, 10_000),
        default=0,
        metavar="B",
        help="Take p-values from B simulated records without the effect instead of the table.",
    ),
    click.option(
        "--held-out",
        type=FILE,
        multiple=True,
        metavar="FILE",
        help="A recording to measure the gain on: nothing is searched or fitted there. May be given several times.",
    ),
    click.option(
        "--search-again",
        is_flag=True,
        help="Search a part of the data by itself, too, and measure the gain on the rest: takes half as long again.",
    ),
    click.option(
        "--no-diagnosis",
        is_flag=True,
        help="Leave out what the extension does to the diagnosis (16 simulated windows: some 6 s of processor time).",
    ),
    click.option(
        "--plan", "show_plan", is_flag=True, help="Rank the manoeuvres that would separate the leading causes."
    ),
)


@click.command(name="discrepancy", short_help="Show what the simulation gets wrong, and name the cause.")
@wheel_option
@motor_off_option
@click.option("--json", "as_json", is_flag=True, help="Print the report as one JSON object (rwa.Discrepancy).")
@report_options
@click.option("--each", is_flag=True, help="Each file is a wheel of its own: a report for each, many at once.")
@recordings_options
def command(
    wheel_file: Path | None,
    motor_off: bool,
    as_json: bool,
    wanted: ReportOptions,
    each: bool,
    recordings: Recordings,
) -> int:
    """Find what a wheel's simulation lacks: the cause by name, its size, and what adding it gains.

    Several files are recordings of one wheel and give one joint report. Where the data cannot separate causes, all
    are named, with the manoeuvre that would separate them.

    The gain is measured on blocks of the recordings that are left out in turn, or, with --held-out, on other
    recordings of the wheel. The names are those of all data; --search-again shows which are found, and what they gain,
    without the data that they are judged on.

    With --each the files are judged one by one, side by side: a line of verdict and causes, or a JSON object, for each.
    """
    wheel = known_wheel(wheel_file, motor_off=motor_off)
    if each:
        if wanted != ReportOptions():
            raise click.UsageError(
                "--each gives a short report for each file; --out, --bootstrap, --held-out, --search-again,"
                " --no-diagnosis and --plan are for the report on one wheel"
            )
        return _each(recordings, wheel, as_json)
    if recordings.at_once:
        raise click.UsageError(f"{AT_ONCE} need --each: several files are one joint report")
    from rwa_monitor.discrepancy.plan import plan
    from rwa_monitor.telemetry.files import make_folder
    from rwa_monitor.threads import cores, on_threads
    from rwa_monitor.wheel.wheel import built_in_wheel

    if wanted.out is not None:
        make_folder(wanted.out, "--out")
    samples, known = recordings.of_one_wheel(wheel)
    held_out, _ = recordings.of_one_wheel(wheel, wanted.held_out)
    found = _search(samples, held_out, known or built_in_wheel(), wanted, on_threads(cores()))
    planned = plan(found) if wanted.show_plan else None
    if wanted.out is not None:
        _write_report(found, [str(file) for file in recordings.files], wanted.out)
    _print(found, planned, as_json)
    if wanted.out is not None:
        log(f"report written to {wanted.out}")
    return recordings.status


def _search(samples: Named, held_out: Named, wheel: Wheel, wanted: ReportOptions, side_by_side: Mapper) -> Search:
    """Search the recordings, with what else the report is to hold."""
    from rwa_monitor.discrepancy.bench import as_measured
    from rwa_monitor.discrepancy.extended import viscous_in_question
    from rwa_monitor.discrepancy.find import find_discrepancy, with_search_again
    from rwa_monitor.discrepancy.plausible import end_stops_in_words, unusual

    log(*as_measured([*samples, *held_out], wheel).notes)
    with status_line("searching") as progress:
        for name, one in (*samples, *held_out):
            for words in (unusual(one, wheel), *end_stops_in_words(one)):
                if words is not None:
                    log(f"{name}: {words}")
        found = find_discrepancy(samples, wheel, progress, side_by_side, held_out)
        if wanted.search_again:
            found = with_search_again(found, samples, progress, side_by_side)
        asked = viscous_in_question(found)
        if asked is not None:
            log(asked)
        if wanted.bootstrap:
            from rwa_monitor.discrepancy.p_values import with_bootstrap

            found = with_bootstrap(found, wanted.bootstrap, progress)
        return found if wanted.no_diagnosis else _with_diagnosis_gain(found, progress)


def _print(found: Search, planned: Plan | None, as_json: bool) -> None:
    from rwa_monitor.reporting.discrepancy_report import sentence

    if as_json:
        report = found.result.to_json()
        if planned is not None:
            report["plan"] = [_plan_json(entry) for entry in planned.manoeuvres]
            report["plan_question"], report["plan_advice"] = planned.question, planned.advice
        click.echo(json.dumps(report, ensure_ascii=False, allow_nan=False))
        return
    click.echo(sentence(found.result))
    _print_details(found)
    if planned is not None:
        _print_plan(planned)


def _each(recordings: Recordings, wheel: Wheel | None, as_json: bool) -> int:
    """Judge each file by itself, and return the exit code."""
    from rwa_monitor.batch.tasks import FindDiscrepancy

    for done in recordings.each(FindDiscrepancy(wheel, recordings.decoding), "searching"):
        for row in done.rows:
            if as_json:
                click.echo(json.dumps({"source": row["source"], **json.loads(row["message"])}, ensure_ascii=False))
            else:
                causes = row["effects"] or row["unexplained"]
                click.echo(f"{row['source']}: {row['verdict']}{f': {causes}' if causes else ''}")
    return recordings.status


def _with_diagnosis_gain(found: Search, progress: Callable[[str], None]) -> Search:
    """Add what the extension does to the diagnosis, where the wheel can be simulated and classified."""
    from dataclasses import replace

    from rwa_monitor.diagnosis.model import built_in_model
    from rwa_monitor.discrepancy.diagnosis_gain import diagnosis_gain
    from rwa_monitor.monitor.core import diagnose_samples

    progress("diagnosis with and without the extension")
    model = built_in_model()
    rates = diagnosis_gain(found, lambda samples, wheel: next(diagnose_samples(samples, wheel, model)).diagnosis)
    if rates is None or found.result.gain is None:
        return found
    gain = replace(found.result.gain, diagnosis=rates)
    return replace(found, result=replace(found.result, gain=gain))


def _write_report(found: Search, sources: list[str], folder: Path) -> None:
    from rwa_monitor.build import build
    from rwa_monitor.discrepancy.extended import extend
    from rwa_monitor.reporting.discrepancy_report import html
    from rwa_monitor.telemetry.files import write_text

    report = json.dumps(found.result.to_json(), indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    write_text(folder / "report.json", report)
    write_text(folder / "extended_wheel.toml", extend(found).to_toml())
    write_text(folder / "report.html", html(found, sources, build()))


def _print_details(found: Search) -> None:
    """Print the table of effects, the gain, and what could not be tested."""
    from rich.console import Console
    from rich.table import Table

    from rwa_monitor.discrepancy.bench import SCALED_ONLY
    from rwa_monitor.discrepancy.extended import extend, laws_in_words
    from rwa_monitor.discrepancy.hypotheses import CANDIDATES
    from rwa_monitor.discrepancy.record import left_out_in_words
    from rwa_monitor.discrepancy.untested import as_a_part, not_testable
    from rwa_monitor.reporting.discrepancy_report import absent_effects, noise_gains, p_in_words, steps_in_words

    console = Console(width=None if sys.stdout.isatty() else 120)
    result = found.result
    if result.effects:
        table = Table("effect", "parameters", "gain", "p", "equivalent", "separated by", box=None)
        for effect in result.effects:
            parameters = "\n".join(f"{name} = {p.in_words()}" for name, p in effect.parameters.items())
            table.add_row(
                effect.formula.partition(",")[0] or effect.name,
                parameters,
                f"{effect.delta_deviance:.0f}",
                p_in_words(found, effect),
                ", ".join(effect.equivalent) or "-",
                effect.separate_by,
            )
        console.print(table)
    left_out = left_out_in_words(found.problem.records)
    console.print(f"{found.problem.size} samples in motion{f' ({left_out})' if left_out else ''}")
    steps = steps_in_words(found.problem)
    if steps:
        console.print(f"{steps}; taken out as far as the values show")
    gain = result.gain
    if gain is not None:
        where = ", ".join(gain.held_out) or "blocks left out in turn"
        console.print(
            f"held out ({where}): RMSE {gain.rmse_base_Nm:.4g} → {gain.rmse_extended_Nm:.4g} N m "
            f"(noise {gain.noise_std_Nm:.4g}), "
            f"log score {gain.log_score_base:.4f} → {gain.log_score_extended:.4f} per sample, "
            f"jumps {gain.changepoints_base} → {gain.changepoints_extended}"
        )
        if gain.searched_again is not None:
            console.print(gain.searched_again.in_words())
        for name, worth in noise_gains(found):
            console.print(f"{name}: no less error; the right law of noise is worth {worth:.4f} nats per sample")
        if gain.diagnosis is not None:
            before, after = gain.diagnosis.before, gain.diagnosis.after
            console.print(
                f"diagnosis of simulated windows with the effect in them: detection {before.detection:.0%} → "
                f"{after.detection:.0%}, false positives {before.false_positive:.1%} → {after.false_positive:.1%}, "
                f"false changepoints a window {before.false_changepoints:.1f} → {after.false_changepoints:.1f}"
            )
    if found.extended.terms:
        for line in laws_in_words(extend(found)):
            console.print(line)
    not_seen = [f"{entry.name} {entry.in_words()}" for entry in absent_effects(found)]
    if not_seen:
        console.print(f"tested and not seen, down to about: {'; '.join(not_seen)}")
    beyond = not_testable(found.problem, CANDIDATES, result.untested)
    for name, missing in sorted(result.untested, key=lambda entry: entry[0] in beyond):
        off = missing.startswith(SCALED_ONLY)
        why = "not testable" if off or name in beyond else "not excited"
        console.print(f"{why}: {name} ({'' if off else 'needs '}{as_a_part(missing)})")


def _print_plan(planned: Plan) -> None:
    click.echo("what to fly next:")
    for line in planned.advice:
        click.echo(f"  {line}")
    if planned.manoeuvres:
        click.echo(f"  to {planned.question}:")
    for entry in planned.manoeuvres:
        pair = " and ".join(name for name in entry.worst_pair if name)
        shows = f"; shows {', '.join(entry.shows)}" if entry.shows else ""
        worth = f"{entry.separation:10.1f} nats in {entry.duration_s / 60:.0f} min ({entry.nats_per_hour:.1f} an hour)"
        if entry.shows:
            worth = f"{len(entry.shows):4d} effects, each by {worth.lstrip()}"
        click.echo(f"  {worth}  {entry.name}: {entry.description} (hardest: {pair}{shows})")


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
