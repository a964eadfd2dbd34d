"""The folder of results: one Parquet file for each recording, whose name identifies the inputs."""

import hashlib
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import pyarrow as pa
import pyarrow.parquet as pq

from rwa_monitor.api import diagnosis_row
from rwa_monitor.batch.tasks import Diagnose, DiagnosedFile
from rwa_monitor.errors import InputError
from rwa_monitor.messages import Diagnosis
from rwa_monitor.telemetry.files import atomic_write, display_name, opened, write_rows

FAILED: Final = "failed.csv"
KIND: Final = "diagnosis"  # prefix of the names of results
PROBLEMS: Final = b"rwa_monitor.problems"  # metadata of a Parquet file: parts of the recording that could not be read
# Hexadecimal digits used of a hash of 256 bits: results of recordings with the same name collide for one pair in 2^64.
DIGITS: Final = 16
NAME_CHARACTERS: Final = 80  # of the recording's name, so that the result's stays below the 255 bytes of a file system


@dataclass(frozen=True, slots=True)
class Store:
    """Diagnoses of recordings in one folder; it is pickled to workers, which write the results themselves.

    A result is written completely or not at all. It is valid while recording, settings and program are the same, so
    that an interrupted run continues where it ended, and a changed recording or wheel file is diagnosed again.
    """

    folder: Path
    task: Diagnose

    def __call__(self, file: Path) -> DiagnosedFile:
        """Return the result of a recording, new or stored; raises InputError if the recording cannot be used."""
        path = self.path(file)
        if path.exists():
            return _read(path)
        done = self.task(file)
        _write(path, done)
        return done

    def path(self, file: Path) -> Path:
        """Return the path of a recording's result, which may not exist."""
        with opened(file) as stream:
            content = hashlib.file_digest(stream, "sha256").hexdigest()
        key = hashlib.sha256("\n".join((self.task.identity(), str(file), content)).encode()).hexdigest()
        # Whatever the file's name is, the result is in this folder.
        name = re.sub(r"[^A-Za-z0-9._-]", "_", file.name)[:NAME_CHARACTERS]
        return self.folder / f"{KIND}-{name}-{key[:DIGITS]}.parquet"

    def write_failures(self, failures: Iterable[tuple[Path, str]]) -> None:
        """Write the list of recordings that could not be used, with reasons; it is empty where all could."""
        rows = ((str(file), reason) for file, reason in failures)
        write_rows(self.folder / FAILED, [("file", "reason"), *rows])


def read_results(folder: Path) -> pa.Table:
    """Return all results in a folder as one table, by recording and time; `to_pandas()` gives a frame.

    Raises
    ------
    InputError
        If there are none.
    """
    tables = [pq.read_table(path) for path in sorted(folder.glob(f"{KIND}-*.parquet"))]
    if not tables:
        raise InputError(display_name(folder), "holds no results")
    table = pa.concat_tables(tables, promote_options="permissive")
    return table.sort_by([("source", "ascending"), ("window_start_ns", "ascending")])


def _write(path: Path, done: DiagnosedFile) -> None:
    rows = [diagnosis_row(diagnosis) for diagnosis in done.diagnoses]
    table = pa.Table.from_pylist(rows).replace_schema_metadata({PROBLEMS: "\n".join(done.problems).encode()})
    with atomic_write(path) as part:
        pq.write_table(table, part)


def _read(path: Path) -> DiagnosedFile:
    table = pq.read_table(path)
    problems = (table.schema.metadata or {}).get(PROBLEMS, b"").decode()
    diagnoses = [Diagnosis.model_validate_json(text) for text in table["message"].to_pylist()]
    return DiagnosedFile(diagnoses, tuple(problems.split("\n")) if problems else ())
