"""Writes the JSON Schemas of all messages into a folder: `python -m rwa_monitor.messages.schemas [FOLDER]`."""

from __future__ import annotations

import sys
from pathlib import Path

from rwa_monitor.messages import schema_files


def write_schemas(folder: Path) -> None:
    """Write one file for each message, over those that are there."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in schema_files().items():
        (folder / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    write_schemas(Path(sys.argv[1] if len(sys.argv) > 1 else "schemas"))
