"""Recordings on disk: written so that a crash loses little, read so that nothing false is believed."""

from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from rwa_monitor.errors import InputError
from rwa_monitor.messages import EncodedMessage
from rwa_monitor.monitor import recording as recording_module
from rwa_monitor.monitor.recorder import RecordingWriter
from rwa_monitor.monitor.recording import (
    Recording,
    read_recording,
    recordings_of,
)
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
