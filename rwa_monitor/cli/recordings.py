"""The recordings given to a command, of one wheel or thousands: what is left out is logged, what fails is listed."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from rwa_monitor.cli.console import UNREADABLE, WRONG_USE, log, track
from rwa_monitor.cli.options import FILE, as_one, map_option, scheduler_option, workers_option, xtce_option
from rwa_monitor.errors import InputError

if TYPE_CHECKING:
    from rwa_monitor.batch.tasks import Done, Task
    from rwa_monitor.samples import Samples
    from rwa_monitor.wheel.wheel import Wheel

AT_ONCE: Final = "--results, --scheduler and --workers"  # the options for many recordings at once


class Recordings:
    """Recordings, how they are read, and what has become of them so far.

    Attributes
    ----------
    files
        Where they are.
    decoding
        What files are read with that do not name their channels.
    at_once
        Whether an option for many recordings at once was given.
    """

    def __init__(
        self,
        files: tuple[Path, ...],
        map_file: Path | None,
        xtce_file: Path | None,
        results: Path | None,
        scheduler: str | None,
        workers: int | None,
    ) -> None:
        from rwa_monitor.telemetry.reader import read_decoding

        if scheduler is not None and workers is not None:
            raise click.UsageError("--workers is for this machine; the cluster of --scheduler has its own")
        self.files = files
        self.decoding = read_decoding(map_file, xtce_file)
        self.at_once = any(option is not None for option in (results, scheduler, workers))
        self._results, self._scheduler, self._workers = results, scheduler, workers
        self._failures: list[tuple[Path, str]] = []
        self._logged: set[str] = set()
        self._unreadable = False

    @property
    def status(self) -> int:
        """Exit code so far: 2 if a recording failed, else 3 if bytes of one could not be read, else 0."""
        if self._failures:
            return WRONG_USE
        return UNREADABLE if self._unreadable else 0

    def failed(self, file: Path, error: str) -> None:
        """Log why a recording cannot be used."""
        self._failures.append((file, error))
        log(error)

    def done(self, problems: Sequence[str], notes: Iterable[str]) -> None:
        """Log what is to be noted of a recording, each line once; `problems` are bytes that could not be read."""
        new = [note for note in dict.fromkeys((*problems, *notes)) if note not in self._logged]
        log(*new)
        self._logged.update(new)
        self._unreadable |= bool(problems)

    def of_one_wheel(
        self, wheel: Wheel | None, others: Sequence[Path] | None = None
    ) -> tuple[list[tuple[str, Samples]], Wheel | None]:
        """Read the files as recordings of one wheel, or `others` as these are.

        Returns
        -------
        samples
            Name and samples of each file.
        wheel
            What was given, else the first wheel that a file carries; None where none does.

        Raises
        ------
        InputError
            If a file cannot be used, or holds several wheels.
        """
        from rwa_monitor.monitor.telemetry_files import read_telemetry
        from rwa_monitor.telemetry.files import display_name
        from rwa_monitor.telemetry.reader import joined, only_wheel

        found: list[tuple[str, Samples]] = []
        decoding = self.decoding.of_wheel(wheel)
        for file in self.files if others is None else others:
            content = read_telemetry(file, decoding)
            self.done(content.problems, content.notes)
            telemetry = only_wheel(content, display_name(file))
            wheel = wheel or telemetry.constants
            found.append((str(file), joined(telemetry)))
        return found, wheel

    def each(self, task: Task, description: str) -> Iterator[Done]:
        """Yield the results of the recordings that could be used, in order; logs what is wrong with the others."""
        from rwa_monitor.batch.cluster import each
        from rwa_monitor.telemetry.files import make_folder
        from rwa_monitor.telemetry.table import parquet

        store = None
        if self._results:
            parquet()  # raises an error that names what to install
            from rwa_monitor.batch.store import Store

            store = Store(self._results, task)
            make_folder(self._results)
        outcomes = each(store or task, self.files, scheduler=self._scheduler, workers=self._workers)
        for outcome in track(outcomes, len(self.files), description):
            if outcome.result is None:
                self.failed(outcome.file, outcome.error)
                continue
            self.done(outcome.result.problems, outcome.result.notes)
            yield outcome.result
        if store:
            store.write_failures(self._failures)
            given, failed = len(self.files), len(self._failures)
            log(f"results of {given - failed} of {given} recordings in {self._results}")


recordings_options = as_one(
    "recordings",
    Recordings,
    click.argument("files", nargs=-1, required=True, type=FILE, metavar="FILE..."),
    map_option,
    xtce_option,
    click.option(
        "--results",
        type=FILE,
        metavar="DIR",
        help="Keep one Parquet file for each recording there, and do again only what is not done.",
    ),
    scheduler_option,
    workers_option,
)


def known_wheel(wheel_file: Path | None, *, motor_off: bool) -> Wheel | None:
    """Return the wheel of a file, with its motor off where that is asked for; None where there is no file.

    Raises
    ------
    InputError
        If the file cannot be used; if the motor shall be off and no inertia is known.
    """
    from rwa_monitor.telemetry.configuration import read_wheel

    wheel = read_wheel(wheel_file) if wheel_file else None
    if not motor_off:
        return wheel
    if wheel is None or wheel.inertia_kg_m2 is None:
        raise InputError("--motor-off", "needs inertia_kg_m2 under [wheel] of the file given with --wheel")
    return wheel.model_copy(update={"friction": wheel.friction.model_copy(update={"motor_off": True})})
