"""Work on many recordings, as the commands offer it: progress, what was said of each, and the list of what failed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rwa_monitor.cli.exit_codes import UNREADABLE, WRONG_USE
from rwa_monitor.cli.options import FleetOptions
from rwa_monitor.cli.progress import track
from rwa_monitor.cli.talk import say

if TYPE_CHECKING:
    from rwa_monitor.fleet.tasks import Done, Task


class Fleet:
    """One task over many recordings.

    Attributes
    ----------
    status
        Exit code so far: 2 if a recording failed, else 3 if bytes of one could not be read, else 0.
    """

    def __init__(self, options: FleetOptions) -> None:
        self._options = options
        self._failures: list[tuple[Path, str]] = []
        self._said: set[str] = set()
        self._unreadable = False

    @property
    def status(self) -> int:
        """The exit code that what happened so far asks for."""
        if self._failures:
            return WRONG_USE
        return UNREADABLE if self._unreadable else 0

    def each(self, task: Task, files: Sequence[Path], description: str) -> Iterator[Done]:
        """Yield the results of the recordings that could be used, in order; says what is wrong with the others."""
        from rwa_monitor.fleet.cluster import each
        from rwa_monitor.formats.files import make_folder
        from rwa_monitor.formats.parquet import parquet

        results, store = self._options.results, None
        if results:
            parquet()  # raises an error that names what to install
            from rwa_monitor.fleet.store import Store

            store = Store(results, task)
            make_folder(results)
        outcomes = each(store or task, files, scheduler=self._options.scheduler, workers=self._options.workers)
        for outcome in track(outcomes, len(files), description):
            if outcome.result is None:
                self._failures.append((outcome.file, outcome.error))
                say(outcome.error)
                continue
            for note in (*outcome.result.problems, *outcome.result.notes):
                if note not in self._said:
                    say(note)
                    self._said.add(note)
            self._unreadable |= bool(outcome.result.problems)
            yield outcome.result
        if store and results:
            store.write_failures(self._failures)
            say(f"results of {len(files) - len(self._failures)} of {len(files)} recordings in {results}")
