"""Brings recordings into the history; what it has already is left as it is."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rwa_monitor.history.store import History
from rwa_monitor.messages import Diagnosis, Discrepancy
from rwa_monitor.monitor.recording.chain import read_chain

BATCH_WINDOWS: Final = 200  # of one transaction


@dataclass(frozen=True, slots=True)
class Imported:
    """What an import did: windows found, those that were new, and what could not be read."""

    windows: int
    new: int
    problems: tuple[str, ...]


def import_recordings(history: History, path: Path) -> Imported:
    """Import a recording, or all of a folder.

    Raises
    ------
    InputError
        If there is no recording there, or one holds a diagnosis that is none.
    HistoryError
        If the database cannot be written; what was imported before stays.
    """
    windows = new = 0
    problems: list[str] = []
    for recording in read_chain(path):
        problems += [f"{recording.path.name}: {problem}" for problem in recording.problems]
        diagnoses = [
            Diagnosis.parse(message.data, f"{recording.path}: {message.topic}")
            for message in recording.messages
            if message.schema == Diagnosis.schema_name()
        ]
        for message in recording.messages:
            if message.schema == Discrepancy.schema_name():
                history.add_discrepancy(Discrepancy.parse(message.data, f"{recording.path}: {message.topic}"))
        windows += len(diagnoses)
        for begin in range(0, len(diagnoses), BATCH_WINDOWS):
            new += history.add_all(diagnoses[begin : begin + BATCH_WINDOWS])
    return Imported(windows, new, tuple(problems))
