"""Writes recordings as Foxglove shows them: one MCAP file, and the layout for it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rwa_monitor.errors import InputError
from rwa_monitor.messages import MESSAGES
from rwa_monitor.monitor.recording.reader import read_recording, recordings_of
from rwa_monitor.monitor.recording.writer import TopicWriter
from rwa_monitor.reporting.foxglove import Seen, Translator, layout, schemas

CHUNK_BYTES: Final = 2**20  # read at once by whoever opens the file, not written while a monitor runs
LAYOUT_SUFFIX: Final = ".layout.json"
PUBLISHED: Final = frozenset(message.schema_name() for message in MESSAGES)


@dataclass(frozen=True, slots=True)
class FoxgloveFile:
    """What was written: the layout's path, the number of messages, and a line for each part that could not be read."""

    layout: Path
    messages: int
    problems: tuple[str, ...]


def write_foxglove(paths: Sequence[Path], target: Path) -> FoxgloveFile:
    """Write recordings (files, or folders of them) as one MCAP file for Foxglove, the layout beside it.

    The recordings are left as they are. What Foxglove has no use for is left out: refused messages and carried states.

    Raises
    ------
    InputError
        If a path is no recording, holds a message that is none of ours, or the target exists or cannot be written.
    """
    layout_path = target.with_name(target.stem + LAYOUT_SUFFIX)
    for path in (target, layout_path):
        if path.exists():
            raise InputError(str(path), "exists already; nothing is overwritten", "--output")
    files = [file for path in paths for file in recordings_of(path)]
    translator, seen = Translator(), Seen()
    messages, problems = 0, list[str]()
    try:
        with target.open("xb") as stream:
            writer = TopicWriter(stream, schemas(), chunk_bytes=CHUNK_BYTES)
            for file in files:
                recording = read_recording(file)
                problems += [f"{file}: {problem}" for problem in recording.problems]
                views = [
                    view
                    for message in recording.messages
                    if message.schema in PUBLISHED
                    for view in translator.translate(message.topic, message.data)
                ]
                for view in sorted(views, key=lambda view: view.time_ns):
                    writer.write(view.topic, view.schema, view.payload, view.time_ns, view.time_ns)
                seen.add(views)
                messages += len(views)
            writer.finish()
        layout_path.write_bytes(layout(seen))
    except InputError:
        target.unlink()  # it has no end yet
        raise
    except OSError as error:
        raise InputError(str(target), f"cannot be written: {error.strerror}", "--output") from error
    return FoxgloveFile(layout_path, messages, tuple(problems))
