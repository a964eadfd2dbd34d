"""The truth beside a simulated recording: a readable JSON, and a Parquet table with one row for each slot.

For `FILE` they are `FILE.truth.json` (labels, jumps, sojourns, scenario, seed) and `FILE.truth.pq` (what changes from
slot to slot: motion, temperature, every part of the friction, noise). Not `.parquet`, so that a pattern that finds the
recordings of a folder does not find their truth.
"""

from __future__ import annotations

import json
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from rwa_monitor.errors import MissingExtraError
from rwa_monitor.simulation.datasets import LabelledWindow, truth_document
from rwa_monitor.simulation.record import Truth
from rwa_monitor.telemetry.files import write_text
from rwa_monitor.telemetry.parquet import parquet


def beside(recording: Path, suffix: str) -> Path:
    """Return the name of a file that belongs to a recording: its own name with a suffix added."""
    return recording.with_name(recording.name + suffix)


def write_truth(window: LabelledWindow, recording: Path, **provenance: Any) -> str:
    """Write both files of truth beside a recording; returns why one is left out, "" where none is.

    Parameters
    ----------
    window
        The simulated record.
    recording
        The file that its samples are in.
    **provenance
        What else the JSON shall say: how to make the recording again.
    """
    document = {**truth_document(window), **provenance}
    write_text(beside(recording, ".truth.json"), json.dumps(document, indent=1, allow_nan=False) + "\n")
    try:
        parquet().write_columns(slot_columns(window.telemetry.truth), beside(recording, ".truth.pq"))
    except MissingExtraError as error:
        return f"no table of the truth in every slot: {error}"
    return ""


def slot_columns(truth: Truth) -> dict[str, np.ndarray[Any, Any]]:
    """Return all arrays of a truth that have an entry for each slot; those of a system as `<system>.<array>`."""
    columns: dict[str, np.ndarray[Any, Any]] = {}
    for field in fields(truth):
        value = getattr(truth, field.name)
        if isinstance(value, np.ndarray):
            columns[field.name] = value
        elif isinstance(value, dict):
            arrays = {key: array for key, array in value.items() if isinstance(array, np.ndarray)}
            columns.update({f"{key}.{field.name}": array for key, array in arrays.items()})
    return columns
