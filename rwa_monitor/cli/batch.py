"""Work on many recordings, as the commands offer it: progress, notes on each once, and the list of what failed."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rwa_monitor.cli.console import log, track
from rwa_monitor.cli.exit_codes import UNREADABLE, WRONG_USE
from rwa_monitor.cli.options import FleetOptions

if TYPE_CHECKING:
    from rwa_monitor.batch.tasks import Done, Task


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
