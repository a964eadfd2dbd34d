"""Model files: trained classifiers as JSON, in and out, with their size limited before they are parsed."""

from __future__ import annotations

from pathlib import Path

from rwa_monitor.diagnosis.model import MAX_MODEL_BYTES, Model, built_in_model
from rwa_monitor.telemetry.files import display_name, read_checked_text, write_text


def read_model(path: Path | None) -> Model:
    """Read a model file; without a path, return the built-in model.

    Raises
    ------
    InputError
        If the file cannot be used; names the file, the field and the reason.
    """
    if path is None:
        return built_in_model()
    return Model.from_json(read_checked_text(path, MAX_MODEL_BYTES), display_name(path))


def write_model(model: Model, path: Path) -> None:
    """Write a model file that `read_model` gives back."""
    write_text(path, model.to_json())
