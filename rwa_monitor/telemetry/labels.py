"""labels.csv: which anomalies each recording of a data set holds; what `simulate dataset` writes and `train` reads.

The header is `file,dry,viscous,<names of the switching systems>`, the rest is 0 or 1. File names are relative to the
folder of the labels, or absolute, and do not lead out of that folder. A label holds for all windows of its file.
"""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rwa_monitor.errors import InputError
from rwa_monitor.telemetry.files import display_name, read_text, write_text
from rwa_monitor.wheel.wheel import RESERVED_ANOMALIES

MAX_LABELS_BYTES: Final = 100_000_000


@dataclass(frozen=True, slots=True)
class LabelledFile:
    """A recording and its anomalies: name → whether it is there."""

    path: Path
    anomalies: Mapping[str, bool]


def read_labels(path: Path) -> list[LabelledFile]:
    """Read a labels.csv; every file it names must exist.

    Raises
    ------
    InputError
        If it cannot be used; names the file, the row, the column and the reason.
    """
    source = display_name(path)
    reader = csv.reader(io.StringIO(read_text(path, MAX_LABELS_BYTES)), strict=True)
    try:
        names = _anomaly_names(next(reader, []), source)
        rows = (fields for fields in reader if fields)  # a blank line is none
        labelled = [_labelled_file(fields, names, path, f"row {reader.line_num}") for fields in rows]
    except csv.Error as error:
        raise InputError(source, f"is no CSV: {error}", f"row {reader.line_num}") from error
    if not labelled:
        raise InputError(source, "names no file")
    return labelled


def write_labels(header: Sequence[str], rows: Iterable[Sequence[str]], path: Path) -> None:
    """Write a labels.csv from its header and rows, as `simulation.datasets.label_columns` and `label_row` give them."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    write_text(path, text.getvalue())


def _anomaly_names(header: list[str], source: str) -> list[str]:
    """Check the header and return the names of the anomalies."""
    expected = ["file", *RESERVED_ANOMALIES]
    if header[: len(expected)] != expected:
        raise InputError(source, f"the header must begin with {','.join(expected)}", "row 1")
    names = header[1:]
    for name in names:
        if not name or names.count(name) > 1:
            raise InputError(source, "has no name" if not name else "is there twice", f"column {name!r}")
    return names


def _labelled_file(fields: list[str], names: list[str], labels: Path, row: str) -> LabelledFile:
    """Check one row of `labels`."""
    source = display_name(labels)
    if len(fields) != len(names) + 1:
        raise InputError(source, f"has {len(fields)} fields, the header has {len(names) + 1}", row)
    file, *flags = fields
    for name, flag in zip(names, flags, strict=True):
        if flag not in ("0", "1"):
            raise InputError(source, f"{flag[:40]!r} is neither 0 nor 1", f"{row}, column {name}")
    path = labels.parent / file
    if reason := _leads_out(file, labels.parent):
        raise InputError(source, f"{file[:40]!r} {reason}", f"{row}, column file")
    if not path.is_file():
        raise InputError(source, f"there is no file {display_name(path)}", f"{row}, column file")
    return LabelledFile(path, {name: flag == "1" for name, flag in zip(names, flags, strict=True)})


def _leads_out(file: str, folder: Path) -> str:
    """Return why a name does not stand for a file in the folder, "" where it does.

    By its text, so that a link inside the folder may still lead to where the data really lie.
    """
    path = Path(file)
    if "\x00" in file:
        return "holds a zero byte"
    if ".." in path.parts:
        return "has '..' in it, which leads out of the folder of the labels"
    real_path, real_folder = map(os.path.realpath, (path, folder))
    if not path.is_absolute() or path.is_relative_to(folder.absolute()) or Path(real_path).is_relative_to(real_folder):
        return ""
    return f"is an absolute path and not in the folder of the labels, {display_name(folder.absolute())}"
