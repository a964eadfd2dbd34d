"""Saves what a cut or damaged recording still holds: every whole chunk, and only true messages."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Final

from mcap.writer import CompressionType, Writer

from rwa_monitor.errors import InputError
from rwa_monitor.live.recording import CHANNELS_ATTACHMENT, MAX_FLEET_FILE_BYTES, Recording, read_recording
from rwa_monitor.live.recording_writer import CHUNK_BYTES, PROFILE
from rwa_monitor.messages import KEY_PREFIX, MESSAGES, SamplesMessage, dump_json
from rwa_monitor.version import SOFTWARE
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

    Times, topics and bytes of the messages stay as they are, and so does their order; attachments come first. The new
    file says in an attachment what it was made from and what was lost.

    Raises
    ------
    InputError
        If `source` is no MCAP file at all, or `target` exists or cannot be written.
    """
    recording = read_recording(source, MAX_FLEET_FILE_BYTES)
    lost = list(recording.problems)
    if not recording.finished and not lost:
        lost.append("the file was not closed in order: what came after its last flush is lost")
    lost = [f"{source}: {line}" for line in lost]
    try:
        with target.open("xb") as file:
            _write(recording, lost, Writer(file, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD))
            file.flush()
            os.fsync(file.fileno())
    except FileExistsError as error:
        raise InputError(str(target), "exists already; nothing is overwritten", "--output") from error
    except OSError as error:
        raise InputError(str(target), f"cannot be written: {error.strerror}", "--output") from error
    return Recovery(len(recording.messages), tuple(lost), tuple(_spans(recording)))


def _spans(recording: Recording) -> Iterator[str]:
    """Say of each wheel which time its saved samples cover, and which they do not, on the wheel's own clock."""
    saved: dict[str, list[tuple[int, int, int]]] = {}  # number, first and last time of each message [ns]
    for message in recording.messages:
        if message.schema == SamplesMessage.schema_name() and message.topic.endswith(f"/{SamplesMessage.kind}"):
            try:
                times_ns = SamplesMessage.parse(message.data, message.topic).time_ns
            except InputError:
                times_ns = [message.log_time]  # written by another release: its time stands beside it, too
            saved.setdefault(message.topic, []).append((message.sequence, times_ns[0], times_ns[-1]))
    for topic, messages in sorted(saved.items()):
        wheel = topic.removeprefix(f"{KEY_PREFIX}/").removesuffix(f"/{SamplesMessage.kind}")
        parts = [f"{wheel}: samples of {time_text(messages[0][1])} to {time_text(messages[-1][2])} are saved"]
        if first := messages[0][0]:
            parts.append(f"{counted(first, 'message')} before that {is_or_are(first)} lost")
        for (number, _, end_ns), (next_number, begin_ns, _) in pairwise(messages):
            if missing := next_number - number - 1:
                between = f"between {time_text(end_ns)} and {time_text(begin_ns)}"
                parts.append(f"{counted(missing, 'message')} {between} {is_or_are(missing)} lost")
        if not recording.finished:
            parts.append("what came later is lost")
        yield "; ".join(parts)


def _write(recording: Recording, lost: list[str], writer: Writer) -> None:
    writer.start(profile=PROFILE, library=SOFTWARE)
    known = {message.schema_name(): dump_json(message.json_schema()) for message in MESSAGES}
    schemas: dict[str, int] = {"": 0}
    channels: dict[tuple[str, str], int] = {}
    sequences: dict[int, int] = {}
    recovered = dump_json({"source": recording.path.name, "lost": lost})
    for name, data in (*recording.attachments.items(), (RECOVERED_ATTACHMENT, recovered)):
        if name != CHANNELS_ATTACHMENT:
            writer.add_attachment(0, 0, name, "application/octet-stream", data)
    for message in recording.messages:
        if message.schema not in schemas:
            schemas[message.schema] = writer.register_schema(
                message.schema, "jsonschema" if message.schema in known else "", known.get(message.schema, b"")
            )
        place = (message.topic, message.schema)
        if place not in channels:
            channels[place] = writer.register_channel(message.topic, "json", schemas[message.schema])
        channel = channels[place]
        sequences[channel] = sequences.get(channel, -1) + 1
        writer.add_message(channel, message.log_time, message.data, message.publish_time, sequences[channel])
    writer.finish()  # type: ignore[no-untyped-call]
