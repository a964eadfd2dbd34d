"""`diagnose`: recordings in, one diagnosis for each window out, through the same core as the live monitor."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from rwa_monitor.cli.exit_codes import UNREADABLE, WRONG_USE
from rwa_monitor.cli.options import (
    FILE,
    FleetOptions,
    decoding_options,
    fleet_options,
    method_option,
    model_option,
    wheel_option,
)
from rwa_monitor.cli.talk import say
from rwa_monitor.errors import InputError

if TYPE_CHECKING:
    from rwa_monitor.diagnosis.results import Method
    from rwa_monitor.fleet.tasks import CarriedStates, Diagnose
    from rwa_monitor.formats.telemetry import Decoding
    from rwa_monitor.live.trends import WindowFriction
    from rwa_monitor.messages import Diagnosis

WIDTH_IN_FILES: Final = 120  # characters of a line where no terminal says how many it has


@click.command(name="diagnose", short_help="Diagnose recordings, from tables to ROS 2 bags.")
@click.argument("files", nargs=-1, required=True, type=FILE, metavar="FILE...")
@wheel_option
@model_option
@method_option
@click.option("--json", "as_json", is_flag=True, help="One JSON object for each window and line (rwa.Diagnosis).")
@click.option("--carry", is_flag=True, help="Start each file with what the ones before it told about the wheel.")
@decoding_options
@fleet_options
@click.pass_context
def command(
    ctx: click.Context,
    files: tuple[Path, ...],
    wheel_file: Path | None,
    model_file: Path | None,
    method: Method,
    as_json: bool,
    carry: bool,
    decoding: Decoding,
    fleet: FleetOptions,
) -> None:
    """Diagnose recordings, window by window, in the order given.

    CSV, Parquet and MCAP say themselves what is in them; space packets need --xtce and --map, ROS 2 bags --map.

    A last window that the data does not fill is diagnosed too and marked partial. A file is read whole before anything
    is said about it. One that cannot be used is named on stderr, the others are done all the same, and the exit code
    is 2; with --carry, where later diagnoses would miss it, the work ends there.

    With --results, --scheduler or --workers many recordings are diagnosed at once; the output is the same.

    Of eight windows of a wheel or more, the last lines say whether its dry or viscous friction grows, and when it will
    leave the nominal range; not with --json.
    """
    from rwa_monitor.fleet.tasks import Diagnose
    from rwa_monitor.formats.model_file import read_model
    from rwa_monitor.formats.wheel_file import read_wheel

    if carry and fleet.asked_for:
        raise click.UsageError(
            "--carry takes one file after the other, --results, --scheduler and --workers many at once"
        )
    # Read before any file is: a wrong option costs nothing then.
    task = Diagnose(
        read_wheel(wheel_file) if wheel_file else None, read_model(model_file) if model_file else None, method, decoding
    )
    show = _Counted(_json_line) if as_json else _Counted(_Pictures())
    status = _one_by_one(task, files, show, carry) if not fleet.asked_for else _at_once(task, files, show, fleet)
    if isinstance(show.shown, _Pictures):
        show.shown.end()
    show.end()
    ctx.exit(status)


def _one_by_one(task: Diagnose, files: tuple[Path, ...], show: Callable[[Diagnosis], None], carry: bool) -> int:
    """Diagnose one file after the other, and return the exit code."""
    carried: CarriedStates = {}
    said: set[str] = set()
    status = 0
    for file in files:
        try:
            found = task.diagnose(file, carried if carry else None)
        except InputError as error:
            if carry:
                raise
            say(str(error))
            status = WRONG_USE
            continue
        carried |= found.carried
        for note in (*found.problems, *found.notes):
            if note not in said:
                say(note)
                said.add(note)
        status = status or (UNREADABLE if found.problems else 0)
        for diagnosis in found.diagnoses:
            show(diagnosis)
    return status


def _at_once(task: Diagnose, files: tuple[Path, ...], show: Callable[[Diagnosis], None], options: FleetOptions) -> int:
    """Diagnose many files at once, and return the exit code."""
    from rwa_monitor.cli.fleet import Fleet
    from rwa_monitor.messages import Diagnosis

    fleet = Fleet(options)
    for done in fleet.each(task, files, "diagnosing"):
        for row in done.rows:
            show(Diagnosis.model_validate_json(row["message"]))
    return fleet.status


def _json_line(diagnosis: Diagnosis) -> None:
    click.echo(diagnosis.to_json())


class _Counted:
    """Shows diagnoses, and says at the end how many windows have too few samples to be judged."""

    def __init__(self, shown: Callable[[Diagnosis], None]) -> None:
        self.shown = shown
        self._windows = self._too_few = 0
        self._reason = ""

    def __call__(self, diagnosis: Diagnosis) -> None:
        """Show a diagnosis."""
        from rwa_monitor.cli.diagnosis_view import has_too_few_samples

        self.shown(diagnosis)
        self._windows += 1
        if has_too_few_samples(diagnosis):
            self._too_few += 1
            self._reason = diagnosis.reason

    def end(self) -> None:
        """Say what could not be judged."""
        from rwa_monitor.words import counted

        if self._too_few:
            say(f"{self._too_few} of {counted(self._windows, 'window')} could not be judged, the last: {self._reason}")


class _Pictures:
    """Prints diagnoses for a person, and at the end what the windows of each wheel together say of its friction."""

    def __init__(self) -> None:
        from rich.console import Console

        self._console = Console(highlight=False)
        if not self._console.is_terminal:
            self._console.width = WIDTH_IN_FILES
        self._courses: defaultdict[tuple[str, str], list[WindowFriction]] = defaultdict(list)

    def __call__(self, diagnosis: Diagnosis) -> None:
        """Print a diagnosis."""
        from rwa_monitor.cli.diagnosis_view import print_diagnosis
        from rwa_monitor.live.trends import WindowFriction

        print_diagnosis(self._console, diagnosis)
        self._courses[diagnosis.spacecraft, diagnosis.wheel].append(WindowFriction.of(diagnosis))

    def end(self) -> None:
        """Print the trends."""
        from rwa_monitor.live.trends import wheel_trends

        for (spacecraft, wheel), windows in self._courses.items():
            starts = [window.window_start_ns for window in windows]
            if any(later <= earlier for earlier, later in pairwise(starts)):
                continue  # several files of the same time: other wheels, or the same one twice, but not one course
            for trend in wheel_trends(windows).values():
                click.echo(
                    f"{spacecraft}/{wheel}: {trend.sentence()}" if spacecraft else f"{wheel}: {trend.sentence()}"
                )
