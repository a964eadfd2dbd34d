"""What is known of simulated recordings: labels.csv, which `simulate dataset` writes and `train` reads, and the truth.

The header of the labels is `file,dry,viscous,<names of the switching systems>`, the rest is 0 or 1. File names are
relative to the folder of the labels, or absolute, and do not lead out of that folder. A label holds for all windows of
its file.

The truth of `FILE` is `FILE.truth.json` (labels, jumps, sojourns, scenario, seed) and `FILE.truth.pq` (what changes
from slot to slot: motion, temperature, every part of the friction, noise). Not `.parquet`, so that a pattern that finds
the recordings of a folder does not find their truth.
"""

from __future__ import annotations

import csv
import io
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Final

import numpy as np

from rwa_monitor.errors import InputError, MissingExtraError
from rwa_monitor.simulation.datasets import LabelledWindow, truth_document
from rwa_monitor.simulation.record import Truth
from rwa_monitor.telemetry.files import beside, display_name, read_text, write_text
from rwa_monitor.telemetry.table import write_parquet
from rwa_monitor.wheel.wheel import RESERVED_ANOMALIES, built_in_wheel

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


def write_labels(rows: Sequence[Mapping[str, str]], path: Path) -> None:
    """Write a labels.csv: a row for each file, with its name under `file` and 0 or 1 under each anomaly's name."""
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
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


# ---- the truth -------------------------------------------------------------------------------------------------------


def write_truth(window: LabelledWindow, recording: Path, **provenance: Any) -> str:
    """Write both files of truth beside a recording, and its wheel unless it is the built-in one.

    Parameters
    ----------
    window
        The simulated record.
    recording
        The file that its samples are in.
    **provenance
        What else the JSON shall hold: how to make the recording again.

    Returns
    -------
    str
        Why the table of every slot is left out, "" where it is not.
    """
    if window.wheel != built_in_wheel():
        write_text(beside(recording, ".wheel.toml"), window.wheel.to_toml())
    document = {**truth_document(window), **provenance}
    write_text(beside(recording, ".truth.json"), json.dumps(document, indent=1, allow_nan=False) + "\n")
    try:
        write_parquet(slot_columns(window.telemetry.truth), beside(recording, ".truth.pq"))
    except MissingExtraError as error:
        return f"no table of the truth in every slot: {error}"
    return ""


def slot_columns(truth: Truth) -> dict[str, np.ndarray[Any, Any]]:
    """Return all arrays of a truth that have an entry for each slot; those of a system as `<system>.<array>`."""
    columns: dict[str, np.ndarray[Any, Any]] = {}
    for field in fields(truth):
        value = getattr(truth, field.name)
        of_systems = {f"{key}.{field.name}": array for key, array in value.items()} if isinstance(value, dict) else {}
        named = of_systems or {field.name: value}
        columns |= {name: array for name, array in named.items() if isinstance(array, np.ndarray)}
    return columns
