"""`diagnose`: recordings in, one diagnosis for each window out, through the same core as the live monitor."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal

import click

from rwa_monitor.cli.exit_codes import UNREADABLE, WRONG_USE
from rwa_monitor.cli.options import FILE, method_option, model_option, wheel_option
from rwa_monitor.cli.talk import say
from rwa_monitor.errors import InputError

if TYPE_CHECKING:
    from rwa_monitor.diagnosis.model import Model
    from rwa_monitor.diagnosis.state import CarriedState
    from rwa_monitor.live.telemetry_files import WheelTelemetry
    from rwa_monitor.messages import Diagnosis
    from rwa_monitor.physics.wheel import Wheel

WIDTH_IN_FILES: Final = 120  # characters of a line where no terminal says how many it has


@click.command(name="diagnose", short_help="Diagnose recordings: CSV, Parquet or MCAP.")
@click.argument("files", nargs=-1, required=True, type=FILE, metavar="FILE...")
@wheel_option
@model_option
@method_option
@click.option("--json", "as_json", is_flag=True, help="One JSON object for each window and line (rwa.Diagnosis).")
@click.option("--carry", is_flag=True, help="Start each file with what the ones before it told about the wheel.")
@click.pass_context
def command(
    ctx: click.Context,
    files: tuple[Path, ...],
    wheel_file: Path | None,
    model_file: Path | None,
    method: Literal["joint", "paper"],
    as_json: bool,
    carry: bool,
) -> None:
    """Diagnose recordings, window by window: CSV, Parquet or MCAP, in the order given.

    A last window that the data does not fill is diagnosed too and marked partial. A file is read whole before anything
    is said about it. One that cannot be used is named on stderr, the others are done all the same, and the exit code
    is 2; with --carry, where later diagnoses would miss it, the work ends there.
    """
    from rwa_monitor.formats.model_file import read_model
    from rwa_monitor.formats.wheel_file import read_wheel

    # Read before any file is: a wrong option costs nothing then.
    wheel = read_wheel(wheel_file) if wheel_file else None
    model = read_model(model_file) if model_file else None
    diagnoser = Diagnoser(wheel, model, method, carry)
    show = _json_line if as_json else _picture()
    status = 0
    for file in files:
        try:
            for diagnosis in diagnoser.diagnose(file):
                show(diagnosis)
        except InputError as error:
            if carry:
                raise
            say(str(error))
            status = WRONG_USE
    ctx.exit(status or (UNREADABLE if diagnoser.unreadable else 0))


@dataclass(slots=True)
class Diagnoser:
    """Diagnoses files one after the other, and keeps what a wheel's windows told where it is to be carried on.

    Attributes
    ----------
    wheel, model
        Those to use for every file; None for what a recording carries, or the built-in ones.
    method
        As for `WheelCore`.
    carry
        Whether a wheel starts a file with the state in which it ended the one before.
    carried
        That state, by spacecraft and wheel.
    unreadable
        Whether bytes of a file could not be read.
    """

    wheel: Wheel | None
    model: Model | None
    method: Literal["joint", "paper"]
    carry: bool
    carried: dict[tuple[str, str], CarriedState] = field(default_factory=dict, init=False)
    unreadable: bool = field(default=False, init=False)
    _noted: set[str] = field(default_factory=set, init=False)

    def diagnose(self, file: Path) -> Iterator[Diagnosis]:
        """Yield the diagnoses of a file's windows; raises InputError before the first if the file cannot be used."""
        from rwa_monitor.diagnosis.model import built_in_model
        from rwa_monitor.live.telemetry_files import read_telemetry
        from rwa_monitor.physics.wheel import built_in_wheel

        content = read_telemetry(file)
        for note in (*content.problems, *content.notes):
            say(note)
        self.unreadable |= bool(content.problems)
        wheel = self.wheel or content.wheel or built_in_wheel()
        model = self.model or content.model or built_in_model()
        self._note(wheel)
        for telemetry in content.telemetry:
            yield from self._diagnose_wheel(telemetry, wheel, model)

    def _note(self, wheel: Wheel) -> None:
        """Say what a wheel lacks, once for each."""
        for note in wheel.missing() if wheel.name not in self._noted else ():
            say(f"{wheel.name}: {note}")
        self._noted.add(wheel.name)

    def _diagnose_wheel(self, telemetry: WheelTelemetry, wheel: Wheel, model: Model) -> Iterator[Diagnosis]:
        from rwa_monitor.api import Monitor

        name = telemetry.wheel or wheel.name
        key = (telemetry.spacecraft, name)
        try:
            monitor = Monitor(
                wheel,
                model,
                method=self.method,
                spacecraft=telemetry.spacecraft,
                name=name,
                source=telemetry.source,
                carried=self.carried.get(key) if self.carry else None,
            )
            found = [
                diagnosis
                for batch in telemetry.batches
                for diagnosis in monitor.feed(batch.samples, batch.publisher, batch.batch)
            ]
        except InputError as error:
            raise InputError(telemetry.source, f"{error.source}: {error.reason}", error.place) from error
        yield from (*found, *monitor.finish())
        self.carried[key] = monitor.carried


def _json_line(diagnosis: Diagnosis) -> None:
    click.echo(diagnosis.to_json())


def _picture() -> Callable[[Diagnosis], None]:
    """Return the function that prints a diagnosis for a person."""
    from functools import partial

    from rich.console import Console

    from rwa_monitor.cli.diagnosis_view import print_diagnosis

    console = Console(highlight=False)
    if not console.is_terminal:
        console.width = WIDTH_IN_FILES
    return partial(print_diagnosis, console)
