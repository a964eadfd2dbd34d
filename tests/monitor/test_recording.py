"""Recordings on disk: written so that a crash loses little, read so that nothing false is believed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from rwa_monitor.errors import InputError
from rwa_monitor.messages import EncodedMessage
from rwa_monitor.monitor.recording import reader as recording_module
from rwa_monitor.monitor.recording.reader import (
    Recording,
    read_recording,
    recordings_of,
)
from rwa_monitor.monitor.recording.recorder import RecordingWriter
from tests.monitor.recordings import TOPICS


def test_a_recording_gives_back_what_was_written(whole: tuple[Path, list[bytes]]) -> None:
    path, payloads = whole
    recording = read_recording(path)
    assert recording.finished
    assert recording.problems == []
    assert recording.settings() == {"a": 1}
    assert [message.payload for message in recording.messages] == payloads
    assert recording.messages[3] == EncodedMessage(TOPICS[1], "rwa.Samples", payloads[3], 3_000, 4)


def test_other_tools_read_it_too(whole: tuple[Path, list[bytes]]) -> None:
    path, payloads = whole
    with path.open("rb") as file:
        found = [
            (schema.name, message.data) for schema, _, message in make_reader(file, validate_crcs=True).iter_messages()
        ]
    assert found == [("rwa.Samples", payload) for payload in payloads]


def test_log_times_never_go_back(tmp_path: Path) -> None:
    path = tmp_path / "times.mcap"
    writer = RecordingWriter(path, (), lambda: 7)
    for time_ns in (100, 50, 0, 200):
        writer.write(EncodedMessage(TOPICS[0], "rwa.Samples", b"x", time_ns))
    writer.close()
    assert [message.time_ns for message in read_recording(path).messages] == [100, 100, 100, 200]


def test_every_cut_gives_true_messages_in_order_and_reports_what_is_lost(whole: tuple[Path, list[bytes]]) -> None:
    path, payloads = whole
    data = path.read_bytes()
    cut = path.with_name("cut.mcap")
    saved = []
    for length in sorted({*range(8, len(data), 997), *range(len(data) - 60, len(data))}):
        cut.write_bytes(data[:length])
        recording = read_recording(cut)
        got = [message.payload for message in recording.messages]
        assert got == payloads[: len(got)]
        assert not recording.finished
        assert recording.problems or got == payloads[: len(got) // 40 * 40]
        saved.append(len(got))
    assert saved == sorted(saved)
    # Each flush ends a chunk: what was flushed is there as soon as its bytes are.
    assert saved[-1] == len(payloads)
    assert {amount % 40 for amount in saved} == {0}


def test_bit_flips_never_give_false_messages(whole: tuple[Path, list[bytes]]) -> None:
    path, payloads = whole
    data = path.read_bytes()
    rng = np.random.default_rng(8)
    places = {payload: number for number, payload in enumerate(payloads)}
    # Random bytes do not get smaller: most payloads stand in the file as they are.
    starts = [data.find(payload) for payload in payloads]
    in_payload = {start + place for start in starts if start >= 0 for place in range(len(payloads[0]))}
    damaged = path.with_name("damaged.mcap")
    noticed = 0
    for _ in range(400):
        broken = bytearray(data)
        position = int(rng.integers(8, len(data)))
        broken[position] ^= 1 << int(rng.integers(8))
        damaged.write_bytes(broken)
        recording = read_recording(damaged)
        numbers = [places[message.payload] for message in recording.messages]  # KeyError: a message that never was
        assert numbers == sorted(numbers)
        assert all(message.topic == TOPICS[places[message.payload] % 2] for message in recording.messages)
        assert len(numbers) >= len(payloads) - 40  # one flip costs one chunk at most
        if len(numbers) < len(payloads) or not recording.attachments:
            assert recording.problems
        if position in in_payload:
            assert len(numbers) < len(payloads)
            noticed += 1
    assert noticed > 100


def test_read_in_small_pieces_a_recording_is_the_same_also_cut_and_damaged(
    whole: tuple[Path, list[bytes]], monkeypatch: pytest.MonkeyPatch
) -> None:
    path, _ = whole
    data = path.read_bytes()
    rng = np.random.default_rng(50_002)
    for _ in range(60):
        broken = bytearray(data[: int(rng.integers(len(data) // 2, len(data)))])
        for position in rng.integers(8, len(broken), 2):
            broken[position] ^= 1 << int(rng.integers(8))
        path.write_bytes(broken)
        expected = read_recording(path)
        for piece_bytes in (64, 1_000):
            with monkeypatch.context() as patched:
                patched.setattr(recording_module, "PIECE_BYTES", piece_bytes)
                again = read_recording(path)
                assert (again.messages, again.problems) == (expected.messages, expected.problems)


def test_telemetry_that_is_packed_well_is_read_again_where_it_is_not_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A fleet at rest: its recording was refused after a restart, for what it unpacks to."""
    path = tmp_path / "rest.mcap"
    writer = RecordingWriter(path, (), lambda: 7)
    for number in range(1_000):
        writer.write(EncodedMessage(TOPICS[0], "rwa.Samples", number.to_bytes(4, "big") * 50, number))
    writer.close()
    monkeypatch.setattr(recording_module, "MAX_WORK_BYTES", 0)  # so that the share of the size counts
    with pytest.raises(InputError, match="asks for more than"):
        read_recording(path)
    assert sum(isinstance(part, EncodedMessage) for part in Recording(path).parts()) == 1_000


def test_a_lost_first_chunk_does_not_take_the_names_of_all_topics_along(whole: tuple[Path, list[bytes]]) -> None:
    path, payloads = whole
    data = bytearray(path.read_bytes())
    position = data.index(payloads[5][:20]) if payloads[5][:20] in data else data.index(b"\x04\x00\x00\x00zstd") + 40
    data[position] ^= 0xFF
    path.write_bytes(data)
    recording = read_recording(path)
    assert [message.payload for message in recording.messages] == payloads[40:]
    assert len(recording.problems) == 1


def test_a_damaged_attachment_is_not_believed(whole: tuple[Path, list[bytes]]) -> None:
    path, _ = whole
    data = path.read_bytes()
    path.write_bytes(data.replace(b'{"a":1}', b'{"a":2}', 1))
    recording = read_recording(path)
    assert recording.problems
    with pytest.raises(InputError, match=r"settings\.json"):
        recording.settings()


@pytest.mark.parametrize("content", [b"", b"\x89MCAP", b"time_s,speed_rad_s\n", bytes(100)])
def test_what_is_no_recording_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "no.mcap"
    path.write_bytes(content)
    with pytest.raises(InputError, match="is no MCAP file"):
        read_recording(path)
    with pytest.raises(InputError, match="does not exist"):
        recordings_of(tmp_path / "nothing")
