"""Recordings written again: what a damaged one still holds, and several as Foxglove shows them, with the layout."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Final

from rwa_monitor.errors import InputError
from rwa_monitor.messages import KEY_PREFIX, MESSAGES, SamplesMessage, dump_json
from rwa_monitor.monitor.recording.reader import (
    CHANNELS_ATTACHMENT,
    PassingRecording,
    RecordedMessage,
    read_recording,
    recordings_of,
)
from rwa_monitor.monitor.recording.writer import PROFILE, TopicWriter, message_schemas
from rwa_monitor.reporting.foxglove import Seen, Translator, layout, schemas
from rwa_monitor.words import counted, is_or_are, time_text

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
    spans
        A line for each wheel: from when to when its samples were saved, and what of them was lost between.
    """

    messages: int
    lost: tuple[str, ...]
    spans: tuple[str, ...]


def recover(source: Path, target: Path) -> Recovery:
    """Copy what `source` still holds into a whole recording `target`.

    Times, topics and bytes of messages and attachments stay as they are, and so does their order; of a large file only
    a piece is in memory. The new file holds in an attachment what it was made from and what was lost.

    Raises
    ------
    InputError
        If `source` is no MCAP file at all, or `target` exists or cannot be written.
    """
    passing, messages = PassingRecording(source), 0
    spans: dict[str, _Span] = {}
    with _new_file(target) as file:
        writer = TopicWriter(file, message_schemas(), PROFILE)
        for part in passing.parts():
            if isinstance(part, RecordedMessage):
                writer.write(part.topic, part.schema, part.data, part.log_time, part.publish_time)
                messages += 1
                _add_span(spans, part)
            elif part.name != CHANNELS_ATTACHMENT:
                writer.attach(part.name, part.data)
        finished, lost = passing.recording.finished, list(passing.recording.problems)
        if not finished and not lost:
            lost.append("the file was not closed in order: what came after its last flush is lost")
        lost = [f"{source}: {line}" for line in lost]
        writer.attach(RECOVERED_ATTACHMENT, dump_json({"source": source.name, "lost": lost}))
        writer.finish()
        file.flush()
        os.fsync(file.fileno())
    lines = (span.line(topic, finished) for topic, span in sorted(spans.items()))
    return Recovery(messages, tuple(lost), tuple(lines))


def _add_span(spans: dict[str, _Span], message: RecordedMessage) -> None:
    """Add the time that a message of samples covers to that of its wheel."""
    if message.schema != SamplesMessage.schema_name() or not message.topic.endswith(f"/{SamplesMessage.kind}"):
        return
    try:
        times_ns = SamplesMessage.parse(message.data, message.topic).time_ns
    except InputError:
        times_ns = [message.log_time]  # written by another release: its time stands beside it, too
    span = spans.setdefault(message.topic, _Span(message.sequence, times_ns[0]))
    span.add(message.sequence, times_ns[0], times_ns[-1])


class _Span:
    """Which time the saved samples of a wheel cover, and which they do not, on the wheel's own clock."""

    def __init__(self, number: int, begin_ns: int) -> None:
        self.begin_ns = begin_ns
        self.end_ns = begin_ns
        self.before = number  # messages that are lost before the first one
        self.holes: list[str] = []
        self._next = number

    def add(self, number: int, begin_ns: int, end_ns: int) -> None:
        """Take a message: its number, and the time of its first and last sample [ns]."""
        if missing := number - self._next:
            between = f"between {time_text(self.end_ns)} and {time_text(begin_ns)}"
            self.holes.append(f"{counted(missing, 'message')} {between} {is_or_are(missing)} lost")
        self._next, self.end_ns = number + 1, end_ns

    def line(self, topic: str, finished: bool) -> str:
        """Return it as a line."""
        wheel = topic.removeprefix(f"{KEY_PREFIX}/").removesuffix(f"/{SamplesMessage.kind}")
        parts = [f"{wheel}: samples of {time_text(self.begin_ns)} to {time_text(self.end_ns)} are saved"]
        if self.before:
            parts.append(f"{counted(self.before, 'message')} before that {is_or_are(self.before)} lost")
        parts += self.holes
        if not finished:
            parts.append("what came later is lost")
        return "; ".join(parts)


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
                for view in translator.translate(message.topic, message.data)
            ]
            for view in sorted(views, key=lambda view: view.time_ns):
                writer.write(view.topic, view.schema, view.payload, view.time_ns, view.time_ns)
            seen.add(views)
            messages += len(views)
        writer.finish()
        layout_path.write_bytes(layout(seen))
    return FoxgloveFile(layout_path, messages, tuple(problems))
