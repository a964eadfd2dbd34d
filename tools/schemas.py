"""Writes the JSON Schemas of all messages to a folder, overwriting old ones: `python tools/schemas.py FOLDER`."""

import json
import sys
from pathlib import Path

from rwa_monitor.messages import MESSAGES


def schema_files() -> dict[str, str]:
    """Return the JSON Schemas of all messages as file name and text."""
    return {
        f"{message.schema_name()}.json": json.dumps(message.json_schema(), indent=2, ensure_ascii=False) + "\n"
        for message in MESSAGES
    }


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in schema_files().items():
        (folder / name).write_text(text, encoding="utf-8")
