"""Saves what a cut or damaged recording still holds: every whole chunk, and only true messages."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rwa_monitor.errors import InputError
from rwa_monitor.messages import KEY_PREFIX, SamplesMessage, dump_json
from rwa_monitor.monitor.recording.reader import (
    CHANNELS_ATTACHMENT,
    Attached,
    PassingRecording,
    RecordedMessage,
    Recording,
)
from rwa_monitor.monitor.recording.writer import PROFILE, TopicWriter, message_schemas
from rwa_monitor.words import counted, is_or_are, time_text

RECOVERED_ATTACHMENT: Final = "recovered.json"


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
    passing = PassingRecording(source)
    try:
        with target.open("xb") as file:
            try:
                copy = _Copy(TopicWriter(file, message_schemas(), PROFILE))
                for part in passing.parts():
                    copy.add(part)
            except InputError:
                target.unlink()
                raise
            lost = _lost(passing.recording)
            copy.finish(source.name, lost)
            file.flush()
            os.fsync(file.fileno())
    except FileExistsError as error:
        raise InputError(str(target), "exists already; nothing is overwritten", "--output") from error
    except OSError as error:
        raise InputError(str(target), f"cannot be written: {error.strerror}", "--output") from error
    spans = (span.line(topic, passing.recording.finished) for topic, span in sorted(copy.spans.items()))
    return Recovery(copy.messages, tuple(lost), tuple(spans))


def _lost(recording: Recording) -> list[str]:
    lost = list(recording.problems)
    if not recording.finished and not lost:
        lost.append("the file was not closed in order: what came after its last flush is lost")
    return [f"{recording.path}: {line}" for line in lost]


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


class _Copy:
    """Writes what is saved, and keeps in mind how many messages, and which time of each wheel."""

    def __init__(self, writer: TopicWriter) -> None:
        self.messages = 0
        self.spans: dict[str, _Span] = {}
        self._writer = writer

    def add(self, part: Attached | RecordedMessage) -> None:
        """Write an attachment or a message."""
        if isinstance(part, RecordedMessage):
            self._add_message(part)
        elif part.name != CHANNELS_ATTACHMENT:
            self._attach(part.name, part.data)

    def _add_message(self, message: RecordedMessage) -> None:
        self._writer.write(message.topic, message.schema, message.data, message.log_time, message.publish_time)
        self.messages += 1
        if message.schema == SamplesMessage.schema_name() and message.topic.endswith(f"/{SamplesMessage.kind}"):
            self._see(message)

    def _see(self, message: RecordedMessage) -> None:
        try:
            times_ns = SamplesMessage.parse(message.data, message.topic).time_ns
        except InputError:
            times_ns = [message.log_time]  # written by another release: its time stands beside it, too
        span = self.spans.setdefault(message.topic, _Span(message.sequence, times_ns[0]))
        span.add(message.sequence, times_ns[0], times_ns[-1])

    def _attach(self, name: str, data: bytes) -> None:
        self._writer.mcap.add_attachment(0, 0, name, "application/octet-stream", data)

    def finish(self, source: str, lost: list[str]) -> None:
        """Write what the file was made from and what was lost, and the file's end."""
        self._attach(RECOVERED_ATTACHMENT, dump_json({"source": source, "lost": lost}))
        self._writer.finish()
