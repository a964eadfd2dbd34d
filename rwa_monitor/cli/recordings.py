"""Recordings as the commands read them, of one wheel or thousands: what is left out is logged, what fails is listed."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rwa_monitor.cli.console import UNREADABLE, WRONG_USE, log, track
from rwa_monitor.cli.options import FleetOptions

if TYPE_CHECKING:
    from rwa_monitor.batch.tasks import Done, Task
    from rwa_monitor.samples import Samples
    from rwa_monitor.telemetry.reader import Decoding
    from rwa_monitor.wheel.wheel import Wheel


@dataclass(frozen=True, slots=True)
class WheelRecordings:
    """Recordings of one wheel.

    Attributes
    ----------
    samples
        Name and samples of each file.
    wheel
        The first wheel that a file carries; None where none does.
    unreadable
        Whether bytes of a file could not be read.
    """

    samples: Sequence[tuple[str, Samples]]
    wheel: Wheel | None
    unreadable: bool


def with_motor_off(wheel: Wheel | None, *, motor_off: bool) -> Wheel | None:
    """Return the wheel with its motor off where that is asked for; a wheel of which nothing is known has no inertia.

    Raises
    ------
    InputError
        If it is asked for and no inertia is known.
    """
    from rwa_monitor.errors import InputError

    if not motor_off:
        return wheel
    if wheel is None or wheel.inertia_kg_m2 is None:
        raise InputError("--motor-off", "needs inertia_kg_m2 under [wheel] of the file given with --wheel")
    return wheel.model_copy(update={"friction": wheel.friction.model_copy(update={"motor_off": True})})


def read_recordings(files: Sequence[Path], decoding: Decoding) -> WheelRecordings:
    """Read files that are recordings of one wheel; with `decoding` where they do not name their channels.

    Raises
    ------
    InputError
        If a file cannot be used, or holds several wheels.
    """
    from rwa_monitor.monitor.telemetry_files import read_telemetry
    from rwa_monitor.telemetry.files import display_name
    from rwa_monitor.telemetry.reader import joined, only_wheel

    found: list[tuple[str, Samples]] = []
    wheel: Wheel | None = None
    unreadable = False
    for file in files:
        content = read_telemetry(file, decoding)
        log(*content.problems, *content.notes)
        unreadable |= bool(content.problems)
        telemetry = only_wheel(content, display_name(file))
        wheel = wheel or telemetry.constants
        found.append((str(file), joined(telemetry)))
    return WheelRecordings(found, wheel, unreadable)


# ---- many recordings ------------------------------------------------------------------------------------------------


class Fleet:
    """One task over many recordings."""

    def __init__(self, options: FleetOptions) -> None:
        self._options = options
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
        """Log what is worth a word of a recording, once of all; `problems` are bytes that could not be read."""
        new = [note for note in dict.fromkeys((*problems, *notes)) if note not in self._logged]
        log(*new)
        self._logged.update(new)
        self._unreadable |= bool(problems)

    def each(self, task: Task, files: Sequence[Path], description: str) -> Iterator[Done]:
        """Yield the results of the recordings that could be used, in order; logs what is wrong with the others."""
        from rwa_monitor.batch.cluster import each
        from rwa_monitor.telemetry.files import make_folder
        from rwa_monitor.telemetry.table import parquet

        results, store = self._options.results, None
        if results:
            parquet()  # raises an error that names what to install
            from rwa_monitor.batch.store import Store

            store = Store(results, task)
            make_folder(results)
        outcomes = each(store or task, files, scheduler=self._options.scheduler, workers=self._options.workers)
        for outcome in track(outcomes, len(files), description):
            if outcome.result is None:
                self.failed(outcome.file, outcome.error)
                continue
            self.done(outcome.result.problems, outcome.result.notes)
            yield outcome.result
        if store and results:
            store.write_failures(self._failures)
            log(f"results of {len(files) - len(self._failures)} of {len(files)} recordings in {results}")
