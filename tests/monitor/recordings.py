"""Recordings of random messages, for the tests that cut, flip, recover and follow them."""

from __future__ import annotations

from itertools import count
from pathlib import Path

import numpy as np

from rwa_monitor.monitor.recording.chain import file_sha256
from rwa_monitor.monitor.recording.writer import RecordingWriter

TOPICS = ("rwa/sat/a/samples", "rwa/sat/b/samples")


def write_file(path: Path, messages: int = 400, flush_every: int = 40) -> list[bytes]:
    """Write a recording of random messages that do not compress; return them."""
    rng = np.random.default_rng(messages)
    ticks = count(1)
    writer = RecordingWriter(path, [("settings.json", b'{"a":1}'), ("wheel.toml", b"# w")], lambda: next(ticks))
    payloads = []
    for number in range(messages):
        payloads.append(rng.bytes(200) + number.to_bytes(4, "big"))
        writer.write(TOPICS[number % 2], "rwa.Samples", payloads[-1], 1_000 * number)
        if number % flush_every == flush_every - 1:
            writer.sync()
    writer.close()
    assert writer.sha256 == file_sha256(path)
    return payloads
