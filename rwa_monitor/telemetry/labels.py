"""Ground truth of recordings: labels.csv, which `simulate dataset` writes and `train` reads, events, simulated truth.

The header of the labels is `file,dry,viscous,<names of the switching systems>`, the rest is 0 or 1. File names are
relative to the folder of the labels, or absolute, and do not lead out of that folder. A label holds for all windows of
its file. A table of events, which `evaluate` reads too, has the columns `wheel,kind,start_ns,end_ns`, a row for each.

The truth of `FILE` is `FILE.truth.json` (labels, jumps, sojourns, scenario, seed) and `FILE.truth.pq` (values per
slot: motion, temperature, every part of the friction, noise). Not `.parquet`, so that a pattern that matches the
recordings of a folder does not match their truth.
"""

import csv
import io
import json
import os
import re
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, ClassVar, Final, NamedTuple, Self

import numpy as np
from pydantic import BaseModel, model_validator

from rwa_monitor.errors import InputError, MissingExtraError, did_you_mean
from rwa_monitor.messages import ClockNs, Diagnosis, Message, Name, Verdict
from rwa_monitor.simulation.datasets import LabelledWindow, truth_document
from rwa_monitor.simulation.record import Truth
from rwa_monitor.telemetry.files import companion_file, display_name, read_text, write_rows, write_text
from rwa_monitor.telemetry.scores import Interval, Timeline, union
from rwa_monitor.telemetry.table import write_parquet
from rwa_monitor.wheel.wheel import RESERVED_ANOMALIES, built_in_wheel

MAX_LABELS_BYTES: Final = 100_000_000
EVENT_COLUMNS: Final = ["wheel", "kind", "start_ns", "end_ns"]
TIME: Final = re.compile("-?[0-9]{1,19}")  # about the range of 64 bits: parsing a much longer integer takes long


class LabelledFile(NamedTuple):
    """A recording and its anomalies: name → whether it is there."""

    path: Path
    anomalies: Mapping[str, bool]


class LabelledEvent(NamedTuple):
    """An anomaly in time, [start_ns, end_ns], of a wheel: `spacecraft/wheel`, or `wheel` alone; and its row."""

    wheel: str
    kind: str
    start_ns: int
    end_ns: int
    row: str


def read_labels(path: Path, *, must_exist: bool = True) -> list[LabelledFile]:
    """Read a labels.csv; every file it names must exist, unless only its name is needed.

    Raises
    ------
    InputError
        If it cannot be used; names the file, the row, the column and the reason.
    """
    source, rows = display_name(path), _rows(path)
    _, header = next(rows)
    expected = ["file", *RESERVED_ANOMALIES]
    if header[: len(expected)] != expected:
        raise InputError(source, f"the header must begin with {','.join(expected)}", "row 1")
    for name in header:
        if not name or header.count(name) > 1:
            raise InputError(source, "is there twice" if name else "has no name", f"column {name!r}")
    labelled = [_labelled_file(fields, header[1:], path, row, must_exist=must_exist) for row, fields in rows]
    if not labelled:
        raise InputError(source, "names no file")
    return labelled


def read_events(path: Path) -> list[LabelledEvent]:
    """Read a table of events.

    Raises
    ------
    InputError
        If it cannot be used; names the file, the row, the column and the reason.
    """
    source, rows = display_name(path), _rows(path)
    if next(rows)[1] != EVENT_COLUMNS:
        raise InputError(source, f"the header must be {','.join(EVENT_COLUMNS)}", "row 1")
    return [_labelled_event(fields, source, row) for row, fields in rows]


def _rows(path: Path) -> Iterator[tuple[str, list[str]]]:
    """Yield the rows of a CSV file, each with its place; the header first, an empty one where it is missing."""
    reader = csv.reader(io.StringIO(read_text(path, MAX_LABELS_BYTES)), strict=True)
    try:
        yield "row 1", (header := next(reader, []))
        for fields in filter(None, reader):  # blank lines are skipped
            row = f"row {reader.line_num}"
            if len(fields) != len(header):
                raise InputError(display_name(path), f"has {len(fields)} fields, the header has {len(header)}", row)
            yield row, fields
    except csv.Error as error:
        raise InputError(display_name(path), f"is no CSV: {error}", f"row {reader.line_num}") from error


def write_labels(rows: Sequence[Mapping[str, str]], path: Path) -> None:
    """Write a labels.csv: a row for each file, with its name under `file` and 0 or 1 under each anomaly's name."""
    write_rows(path, [rows[0], *(row.values() for row in rows)])


def _labelled_file(fields: list[str], names: list[str], labels: Path, row: str, *, must_exist: bool) -> LabelledFile:
    """Check one row of `labels`."""
    source, (file, *flags) = display_name(labels), fields
    for name, flag in zip(names, flags, strict=True):
        if flag not in ("0", "1"):
            raise InputError(source, f"{flag[:40]!r} is neither 0 nor 1", f"{row}, column {name}")
    path = labels.parent / file
    if reason := _leads_out(file, labels.parent):
        raise InputError(source, f"{file[:40]!r} {reason}", f"{row}, column file")
    if must_exist and not os.path.isfile(path):  # noqa: PTH113 (is_file raises OSError for a name that is too long)
        raise InputError(source, f"there is no file {display_name(path)}", f"{row}, column file")
    return LabelledFile(path, {name: flag == "1" for name, flag in zip(names, flags, strict=True)})


def _labelled_event(fields: list[str], source: str, row: str) -> LabelledEvent:
    """Check one row of a table of events."""
    wheel, kind, *times = fields
    for column, time in zip(EVENT_COLUMNS[2:], times, strict=True):
        if not TIME.fullmatch(time):
            raise InputError(source, f"{time[:40]!r} is no whole number of nanoseconds", f"{row}, column {column}")
    start_ns, end_ns = map(int, times)
    if start_ns >= end_ns:
        raise InputError(source, "the event must end after it starts", f"{row}, column end_ns")
    return LabelledEvent(wheel, kind, start_ns, end_ns, row)


def _leads_out(file: str, folder: Path) -> str:
    """Return why a name does not denote a file in the folder, "" where it does.

    A relative name is judged by its text, so that a link inside the folder may lead to data outside it.
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
    """Write both files of truth next to a recording, and its wheel unless it is the built-in one.

    Parameters
    ----------
    window
        The simulated record.
    recording
        The file that its samples are in.
    **provenance
        Further fields of the JSON: how to make the recording again.

    Returns
    -------
    str
        Why the table of slots is not written, "" where it is.
    """
    if window.wheel != built_in_wheel():
        write_text(companion_file(recording, ".wheel.toml"), window.wheel.to_toml())
    document = {**truth_document(window), **provenance}
    write_text(companion_file(recording, ".truth.json"), json.dumps(document, indent=1, allow_nan=False) + "\n")
    try:
        write_parquet(slot_columns(window.telemetry.truth), companion_file(recording, ".truth.pq"))
    except MissingExtraError as error:
        return f"no table of the truth in every slot: {error}"
    return ""


def slot_columns(truth: Truth) -> dict[str, np.ndarray[Any, Any]]:
    """Return all arrays of a truth that have an entry for each slot; those of a system as `<system>.<array>`."""
    columns: dict[str, np.ndarray[Any, Any]] = {}
    for field in fields(truth):
        value = getattr(truth, field.name)
        of_systems = isinstance(value, dict)
        named = {f"{key}.{field.name}": one for key, one in value.items()} if of_systems else {field.name: value}
        columns |= {name: array for name, array in named.items() if isinstance(array, np.ndarray)}
    return columns


# ---- diagnoses compared with labels ----------------------------------------------------------------------------------


class JudgedAnomaly(BaseModel):
    """Whether an anomaly is diagnosed; see `Anomaly`."""

    active: bool


class JudgedWindow(Message):
    """What is read of a `Diagnosis` to compare it with labels."""

    kind: ClassVar[str] = Diagnosis.kind

    spacecraft: Name = ""
    wheel: Name
    source: str | None = None
    window_start_ns: ClockNs
    window_end_ns: ClockNs
    verdict: Verdict
    anomalies: dict[str, JudgedAnomaly]

    @classmethod
    def schema_name(cls) -> str:
        """Return the name of the schema that this is a part of."""
        return Diagnosis.schema_name()

    @model_validator(mode="after")
    def _takes_time(self) -> Self:
        if self.window_end_ns <= self.window_start_ns:
            raise ValueError("window_end_ns is not after window_start_ns")
        return self

    @property
    def alarms(self) -> frozenset[str]:
        """Names of the anomalies that the verdict reports: none where it is inconclusive."""
        return frozenset(name for name, one in self.anomalies.items() if one.active and self.verdict == "anomalous")


def match_labels(diagnoses: Iterable[JudgedWindow], labels: Path) -> tuple[dict[str, list[Timeline]], list[Timeline]]:
    """Match diagnosed windows with labels; return timelines of each kind of anomaly, and those of all kinds together.

    With a labels.csv each wheel of each file is a timeline, and a label an event that spans it; with a table of events
    each wheel is one timeline, whatever files its windows are from. A timeline goes from its first window to its last.
    For all kinds together, overlapping events are merged.

    Parameters
    ----------
    diagnoses
        The windows, in any order. Of several diagnoses of the same window the last one counts.
    labels
        The labels.csv, whose files need not exist, or the table of events.

    Raises
    ------
    InputError
        If the file cannot be used; if a window, a label or an event has no counterpart.
    """
    windows, source = list(diagnoses), display_name(labels)
    judged = list(dict.fromkeys(name for window in windows for name in window.anomalies))
    _, header = next(_rows(labels))
    if header[:1] == ["wheel"]:
        kinds, groups = judged, _by_wheel(windows, read_events(labels), judged, source)
    elif header[:1] == ["file"]:
        files = read_labels(labels, must_exist=False)
        kinds, groups = list(files[0].anomalies), _by_file(windows, files, labels)
    else:
        expected = f"{','.join(['file', *RESERVED_ANOMALIES])}, or be {','.join(EVENT_COLUMNS)}"
        raise InputError(source, f"the header must begin with {expected}", "row 1")
    for name in judged:
        if name not in kinds:
            raise InputError(source, f"has no column for {name!r}, which the diagnoses judge; add it", "row 1")
    for name in kinds:
        if name not in judged:
            reason = f"no diagnosis judges this anomaly{did_you_mean(name, judged)}"
            raise InputError(source, reason, f"row 1, column {name}")
    timelines = {kind: [group.timeline([kind]) for group in groups] for kind in kinds}
    together = [group.timeline(kinds) for group in groups]
    overall = [one._replace(events=union(one.events, (one.start_ns, one.end_ns))) for one in together]
    return timelines, overall


class _Group:
    """The windows of one timeline by their start, and its events by kind."""

    def __init__(self) -> None:
        self.windows: dict[int, JudgedWindow] = {}
        self.events: defaultdict[str, list[Interval]] = defaultdict(list)

    def add(self, window: JudgedWindow) -> None:
        """Add a window; raise InputError where another file has one of the same wheel with the same start."""
        known = self.windows.setdefault(window.window_start_ns, window)
        if known.source != window.source:
            reason = f"windows of {known.source} and {window.source} start at the same time; name each wheel apart"
            raise InputError(_wheel(window), reason)
        self.windows[window.window_start_ns] = window

    @property
    def whole(self) -> Interval:
        """Start of the first window and end of the last."""
        return min(self.windows), max(window.window_end_ns for window in self.windows.values())

    def timeline(self, kinds: Collection[str]) -> Timeline:
        """Return the timeline with alarms and events of any of these kinds."""
        events = [event for kind in kinds for event in self.events[kind]]
        alarms = [(at, one.window_end_ns) for at, one in self.windows.items() if not one.alarms.isdisjoint(kinds)]
        return Timeline(*self.whole, events, alarms)


def _by_file(windows: Sequence[JudgedWindow], files: Sequence[LabelledFile], labels: Path) -> list[_Group]:
    """Group windows by file and wheel; a file is matched by the end of its path, wherever it was diagnosed from."""
    source = display_name(labels)
    labelled: dict[tuple[str, ...], LabelledFile] = {}
    for file in files:
        if labelled.setdefault(Path(os.path.relpath(file.path, labels.parent)).parts, file) is not file:
            raise InputError(source, f"has two rows for {display_name(file.path)}; leave one")
    groups: defaultdict[tuple[tuple[str, ...], str], _Group] = defaultdict(_Group)
    for window in windows:
        if window.source is None:
            reason = f"its diagnoses name no file: {source} must be a table of events, {','.join(EVENT_COLUMNS)}"
            raise InputError(_wheel(window), reason)
        parts = Path(window.source).absolute().parts
        found = next((parts[k:] for k in range(len(parts)) if parts[k:] in labelled), None)
        if found is None:
            raise InputError(source, f"has no row for {window.source}, which has diagnoses; add it or leave them out")
        groups[found, _wheel(window)].add(window)
    for (name, _), group in groups.items():
        group.events.update({kind: [group.whole] for kind, is_there in labelled[name].anomalies.items() if is_there})
    diagnosed = {name for name, _ in groups}
    for name, file in labelled.items():
        if name not in diagnosed:
            raise InputError(source, f"there is no diagnosis of {display_name(file.path)}; diagnose it too")
    return list(groups.values())


def _by_wheel(
    windows: Sequence[JudgedWindow], events: Sequence[LabelledEvent], judged: Sequence[str], source: str
) -> list[_Group]:
    """Group windows by wheel."""
    groups: defaultdict[str, _Group] = defaultdict(_Group)
    for window in windows:
        groups[_wheel(window)].add(window)
    for event in events:
        for column, name, known in (("wheel", event.wheel, list(groups)), ("kind", event.kind, judged)):
            if name not in known:
                reason = f"no diagnosis is of {name[:40]!r}{did_you_mean(name, known)}"
                raise InputError(source, reason, f"{event.row}, column {column}")
        group = groups[event.wheel]
        if not union([(event.start_ns, event.end_ns)], group.whole):
            raise InputError(source, "the event lies outside of the time that was diagnosed", event.row)
        group.events[event.kind].append((event.start_ns, event.end_ns))
    return list(groups.values())


def _wheel(window: JudgedWindow) -> str:
    return f"{window.spacecraft}/{window.wheel}" if window.spacecraft else window.wheel
