"""`diagnose`: diagnoses recordings window by window, with the same core as the live monitor."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import click

from rwa_monitor.cli import options as cli
from rwa_monitor.errors import InputError

if TYPE_CHECKING:
    from rwa_monitor.batch.tasks import CarriedStates, Diagnose
    from rwa_monitor.messages import Diagnosis, Method
    from rwa_monitor.reporting.diagnoses import EstimateRecord


class AtOnce(NamedTuple):
    """Where to diagnose many recordings at once, and where to keep the results."""

    results: Path | None = None
    scheduler: str | None = None
    workers: int | None = None


at_once_options = cli.as_one(
    "many",
    AtOnce,
    cli.option(
        "--results",
        cli.FILE,
        "DIR",
        "Keep one Parquet file for each recording there, and do again only what is not done.",
    ),
    cli.scheduler_option,
    cli.workers_option,
)


@click.command(short_help="Diagnose recordings, from tables to ROS 2 bags.")
@cli.wheel_option
@cli.model_option
@cli.method_option
@cli.flag("--json", "One JSON object for each window and line (rwa.Diagnosis).")
@cli.flag("--carry", "Start each file with what the ones before it showed of the wheel.")
@at_once_options
@cli.recordings_options
def diagnose(
    wheel: Path | None,
    model: Path | None,
    method: Method,
    json: bool,
    carry: bool,
    many: AtOnce,
    recordings: cli.Recordings,
) -> int:
    """Diagnose recordings, window by window, in the order given.

    CSV, Parquet and MCAP describe themselves; space packets need --xtce and --map, ROS 2 bags --map.

    A last window that the data does not fill is diagnosed too and marked partial. A file is read whole before anything
    is printed of it. One that cannot be used is named on stderr, the others are done all the same, and the exit code
    is 2; with --carry, where later diagnoses would miss it, the work ends there.

    With --results, --scheduler or --workers many recordings are diagnosed at once; the output is the same.

    Of eight windows of a wheel or more, the last lines report whether its dry or viscous friction grows, and when it
    will leave the nominal range; not with --json.
    """
    from rwa_monitor.batch.tasks import Diagnose
    from rwa_monitor.monitor.setup import read_model, read_wheel
    from rwa_monitor.reporting.diagnoses import estimates_of, has_too_few_samples, render
    from rwa_monitor.words import counted

    if carry and many != AtOnce():
        raise click.UsageError("--carry takes one file after the other, --results, --scheduler and --workers many")
    if many.scheduler is not None and many.workers is not None:
        raise click.UsageError("--workers is for this machine; the cluster of --scheduler has its own")
    # Wheel and model are read before any recording: a wrong option fails at once.
    task = Diagnose(
        read_wheel(wheel) if wheel else None, recordings.decoding, read_model(model) if model else None, method
    )
    console = None if json else cli.console_of_stdout()
    by_wheel: defaultdict[tuple[str, str], list[EstimateRecord]] = defaultdict(list)
    not_judged: list[str] = []
    windows = 0
    for diagnosis in _one_by_one(task, recordings, carry) if many == AtOnce() else _at_once(task, recordings, many):
        windows += 1
        if has_too_few_samples(diagnosis):
            not_judged.append(diagnosis.reason)
        if console is None:
            click.echo(diagnosis.to_json())
        else:
            console.print(render(diagnosis), "")
            by_wheel[diagnosis.spacecraft, diagnosis.wheel] += estimates_of(diagnosis)
    _print_trends(by_wheel)
    if not_judged:
        cli.log(f"{len(not_judged)} of {counted(windows, 'window')} could not be judged, the last: {not_judged[-1]}")
    return recordings.status


def _one_by_one(task: Diagnose, recordings: cli.Recordings, carry: bool) -> Iterator[Diagnosis]:
    """Diagnose one file after the other."""
    carried: CarriedStates = {}
    for file in recordings.files:
        try:
            found = task(file, carried if carry else None)
        except InputError as error:
            if carry:
                raise
            recordings.failed(file, str(error))
            continue
        carried |= found.carried
        recordings.done(found.problems, found.notes)
        yield from found.diagnoses


def _at_once(task: Diagnose, recordings: cli.Recordings, many: AtOnce) -> Iterator[Diagnosis]:
    """Diagnose many files at once."""
    from rwa_monitor.batch.tasks import map_files
    from rwa_monitor.telemetry.files import make_folder
    from rwa_monitor.telemetry.table import arrow

    store = None
    if many.results:
        arrow()  # raises an error that names what to install
        from rwa_monitor.batch.store import Store

        store = Store(many.results, task)
        make_folder(many.results)
    outcomes = map_files(store or task, recordings.files, scheduler=many.scheduler, workers=many.workers)
    for outcome in cli.track(outcomes, len(recordings.files), "diagnosing"):
        if outcome.result is None:
            recordings.failed(outcome.file, outcome.error)
            continue
        recordings.done(outcome.result.problems, outcome.result.notes)
        yield from outcome.result.diagnoses
    if store:
        store.write_failures(recordings.failures)
        given, failed = len(recordings.files), len(recordings.failures)
        cli.log(f"results of {given - failed} of {given} recordings in {many.results}")


def _print_trends(by_wheel: dict[tuple[str, str], list[EstimateRecord]]) -> None:
    """Print the friction trends of each wheel over all its windows."""
    from rwa_monitor.reporting.diagnoses import friction_trends

    for (spacecraft, wheel), estimates in by_wheel.items():
        starts = [one.window_start_ns for one in estimates if one.name == "dry"]
        if any(later <= earlier for earlier, later in pairwise(starts)):
            continue  # files overlap in time: different wheels, or one wheel twice, but not one time series
        for trend in friction_trends(estimates).values():
            click.echo(f"{spacecraft}/{wheel}: {trend.sentence()}" if spacecraft else f"{wheel}: {trend.sentence()}")
