"""Recordings written again: what a damaged one still holds, and several as Foxglove shows them, with the layout."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Final

from rwa_monitor.errors import InputError
from rwa_monitor.messages import MESSAGES, EncodedMessage, dump_json
from rwa_monitor.monitor.recording.reader import CHANNELS_ATTACHMENT, Recording, read_recording, recordings_of
from rwa_monitor.monitor.recording.recorder import PROFILE, TopicWriter, message_schemas
from rwa_monitor.reporting.foxglove import Seen, Translator, layout, schemas

RECOVERED_ATTACHMENT: Final = "recovered.json"
CHUNK_BYTES: Final = 2**20  # for Foxglove: read at once by whoever opens the file, not written while a monitor runs
LAYOUT_SUFFIX: Final = ".layout.json"
PUBLISHED: Final = frozenset(message.schema_name() for message in MESSAGES)


@contextmanager
def _new_file(target: Path) -> Iterator[IO[bytes]]:
    """Give a new file to write to; raises InputError if it exists or cannot be written."""
    try:
        with target.open("xb") as file:
            yield file
    except InputError:
        target.unlink()  # it has no end yet
        raise
    except FileExistsError as error:
        raise InputError(str(target), "exists already; nothing is overwritten", "--output") from error
    except OSError as error:
        raise InputError(str(target), f"cannot be written: {error.strerror}", "--output") from error


# ---- what a damaged recording still holds: every whole chunk, and only true messages ---------------------------------


@dataclass(frozen=True, slots=True)
class Recovery:
    """What was saved and what was lost.

    Attributes
    ----------
    messages
        Messages saved.
    lost
        One line per part that could not be read; empty when the file was whole (exit code 0, otherwise 3).
    """

    messages: int
    lost: tuple[str, ...]


def recover(source: Path, target: Path) -> Recovery:
    """Copy what `source` still holds into a whole recording `target`.

    Times, topics and bytes of messages and attachments stay as they are, and so does their order; of a large file only
    a piece is in memory. The new file holds in an attachment what it was made from and what was lost.

    Raises
    ------
    InputError
        If `source` is no MCAP file at all, or `target` exists or cannot be written.
    """
    recording, messages = Recording(source), 0
    with _new_file(target) as file:
        writer = TopicWriter(file, message_schemas(), PROFILE)
        for part in recording.parts():
            if isinstance(part, EncodedMessage):
                writer.write(part)
                messages += 1
            elif part.name != CHANNELS_ATTACHMENT:
                writer.attach(part.name, part.data)
        lost = list(recording.problems)
        if not recording.finished and not lost:
            lost.append("the file was not closed in order: what came after its last flush is lost")
        lost = [f"{source}: {line}" for line in lost]
        writer.attach(RECOVERED_ATTACHMENT, dump_json({"source": source.name, "lost": lost}))
        writer.finish()
        file.flush()
        os.fsync(file.fileno())
    return Recovery(messages, tuple(lost))


# ---- recordings for Foxglove -----------------------------------------------------------------------------------------


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
    with _new_file(target) as stream:
        writer = TopicWriter(stream, schemas(), chunk_bytes=CHUNK_BYTES)
        for file in files:
            recording = read_recording(file)
            problems += [f"{file}: {problem}" for problem in recording.problems]
            views = [
                view
                for message in recording.messages
                if message.schema in PUBLISHED
                for view in translator.translate(message.topic, message.payload)
            ]
            for view in sorted(views, key=lambda view: view.time_ns):
                writer.write(view._replace(publish_ns=view.time_ns))
            seen.add(views)
            messages += len(views)
        writer.finish()
        layout_path.write_bytes(layout(seen))
    return FoxgloveFile(layout_path, messages, tuple(problems))
