"""Writes the JSON Schemas of all messages over those in a folder: `python tools/schemas.py FOLDER`."""

import sys
from pathlib import Path

from rwa_monitor.messages import schema_files

if __name__ == "__main__":
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in schema_files().items():
        (folder / name).write_text(text, encoding="utf-8")
