"""Recordings of random messages, for the tests that cut, flip, recover and follow them; or written again."""

import struct
from collections.abc import Callable
from itertools import count
from pathlib import Path

import numpy as np
from mcap.opcode import Opcode
from mcap.writer import Writer

from rwa_monitor.messages import EncodedMessage
from rwa_monitor.monitor.recorder import RecordingWriter
from rwa_monitor.monitor.recording import file_sha256, read_recording

TOPICS = ("rwa/sat/a/samples", "rwa/sat/b/samples")


def write_file(path: Path, messages: int = 400, flush_every: int = 40) -> list[bytes]:
    """Write a recording of random messages that do not compress; return them."""
    rng = np.random.default_rng(messages)
    ticks = count(1)
    writer = RecordingWriter(path, [("settings.json", b'{"a":1}'), ("wheel.toml", b"# w")], lambda: next(ticks))
    payloads = []
    for number in range(messages):
        payloads.append(rng.bytes(200) + number.to_bytes(4, "big"))
        writer.write(EncodedMessage(TOPICS[number % 2], "rwa.Samples", payloads[-1], 1_000 * number))
        if number % flush_every == flush_every - 1:
            writer.sync()
    writer.close()
    assert writer.sha256 == file_sha256(path)
    return payloads


def rewrite(
    source: Path,
    target: Path,
    change: Callable[[EncodedMessage], bytes | None] = lambda message: message.payload,
    attached: Callable[[str, bytes], bytes] = lambda name, data: data,
) -> None:
    """Write a recording again, every checksum right, with messages changed, or left out (None), and attachments."""
    recording = read_recording(source)
    with target.open("wb") as file:
        writer = Writer(file)
        writer.start()
        for name, data in recording.attachments.items():
            writer.add_attachment(0, 0, name, "", attached(name, data))
        channels: dict[tuple[str, str], int] = {}
        for message in recording.messages:
            data = change(message)
            if data is None:
                continue
            place = (message.topic, message.schema)
            if place not in channels:
                schema = writer.register_schema(message.schema, "", b"")
                channels[place] = writer.register_channel(message.topic, "json", schema)
            writer.add_message(channels[place], message.time_ns, data, message.publish_ns)
        writer.finish()  # type: ignore[no-untyped-call]


def record(opcode: int, content: bytes) -> bytes:
    """Return a record of an MCAP file, made by hand."""
    return struct.pack("<BQ", opcode, len(content)) + content


def chunk(data: bytes, size: int, compression: bytes = b"zstd", crc: int = 0) -> bytes:
    """Return a chunk that states what it likes of packed data."""
    head = struct.pack("<QQQII", 0, 0, size, crc, len(compression)) + compression
    return record(Opcode.CHUNK, head + struct.pack("<Q", len(data)) + data)
