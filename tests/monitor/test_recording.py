"""Recordings on disk: written so that a crash loses little, read so that nothing false is believed."""

import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from rwa_monitor.errors import InputError
from rwa_monitor.messages import EncodedMessage
from rwa_monitor.monitor import recording as recording_module
from rwa_monitor.monitor.recorder import RecordingWriter, recover
from rwa_monitor.monitor.recording import (
    read_recording,
    recordings_of,
)
from rwa_monitor.monitor.replay import replay
from tests.monitor.recordings import TOPICS, write_file
from tests.program import run


def test_a_recording_gives_back_what_was_written(whole: tuple[Path, list[bytes]]) -> None:
    path, payloads = whole
    recording = read_recording(path)
    assert recording.finished
    assert recording.problems == []
    assert recording.settings() == {"a": 1}
    assert [message.payload for message in recording.messages] == payloads
    assert recording.messages[3] == EncodedMessage(TOPICS[1], "rwa.Samples", payloads[3], 3_000, 4)
    with path.open("rb") as file:  # and to other tools
        read = [(kind.name, sent.data) for kind, _, sent in make_reader(file, validate_crcs=True).iter_messages()]
    assert read == [("rwa.Samples", payload) for payload in payloads]


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


@pytest.mark.parametrize("content", [b"", b"\x89MCAP", b"time_s,speed_rad_s\n", bytes(100)])
def test_what_is_no_recording_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "no.mcap"
    path.write_bytes(content)
    with pytest.raises(InputError, match="is no MCAP file"):
        read_recording(path)
    with pytest.raises(InputError, match="does not exist"):
        recordings_of(tmp_path / "nothing")


# ---- recover ---------------------------------------------------------------------------------------------------------


def recovered_messages(source: Path, target: Path) -> tuple[list[bytes], int]:
    """Run the command; return what it saved, and its exit code."""
    code = run("recover", source, "-o", target).exit_code
    saved = [message.payload for message in read_recording(target).messages] if target.exists() else []
    target.unlink(missing_ok=True)
    return saved, code


# Of the places in a file, every so many: `make test` takes a share of them, `make test-all` each.
each_place = pytest.mark.parametrize("step", [13, pytest.param(1, marks=pytest.mark.slow)])


@each_place
def test_recover_on_every_cut_of_a_small_file_gives_true_messages_and_exit_3(tmp_path: Path, step: int) -> None:
    path, cut, target = tmp_path / "small.mcap", tmp_path / "cut.mcap", tmp_path / "saved.mcap"
    payloads = write_file(path, messages=4, flush_every=2)
    data = path.read_bytes()
    counts = {}
    for number, length in enumerate(sorted({*range(8, len(data), step), *range(len(data) - 60, len(data))})):
        cut.write_bytes(data[:length])
        recording = read_recording(cut)
        got = [message.payload for message in recording.messages]
        assert got == payloads[: len(got)]
        assert not recording.finished
        counts[length] = len(got)
        if number % 97:
            continue
        recovery = recover(cut, target)
        assert recovery.problems
        saved = read_recording(target)
        assert saved.finished
        assert [message.payload for message in saved.messages] == got
        target.unlink()
    assert list(counts.values()) == sorted(counts.values())
    assert set(counts.values()) == {0, 2, 4}
    for length in (8, list(counts)[len(counts) // 2], len(data) - 1):
        cut.write_bytes(data[:length])
        assert recovered_messages(cut, target) == (payloads[: counts[length]], 3)
    assert recovered_messages(path, target) == (payloads, 0)


@each_place
def test_recover_on_every_flipped_byte_of_a_small_file_gives_only_true_messages(tmp_path: Path, step: int) -> None:
    path, damaged, target = tmp_path / "small.mcap", tmp_path / "damaged.mcap", tmp_path / "saved.mcap"
    payloads = write_file(path, messages=4, flush_every=2)
    data, attached = path.read_bytes(), {"settings.json": b'{"a":1}', "wheel.toml": b"# w"}
    rng = np.random.default_rng(3)
    summary = int.from_bytes(data[-28:-20], "little")  # from there on it only repeats: every seventh byte will do
    for number, position in enumerate((*range(8, summary, step), *range(summary, len(data), 7 * step))):
        broken = bytearray(data)
        broken[position] ^= 1 << int(rng.integers(8))
        damaged.write_bytes(broken)
        recording = read_recording(damaged)
        got = [message.payload for message in recording.messages]
        assert got in (payloads, payloads[:2], payloads[2:])
        kept = {name: data for name, data in recording.attachments.items() if name in attached}
        assert kept.items() <= attached.items()
        assert recording.problems or (got == payloads and kept == attached)
        if number % 97:
            continue
        recovery = recover(damaged, target)
        assert [message.payload for message in read_recording(target).messages] == got
        assert recovery.problems or got == payloads
        target.unlink()


def test_recover_takes_the_memory_of_a_piece_however_large_a_file_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recording_module, "PIECE_BYTES", 2**16)

    def peak(messages: int) -> int:
        path = tmp_path / f"{messages}.mcap"
        payloads = write_file(path, messages, flush_every=50)
        tracemalloc.start()
        assert recover(path, path.with_suffix(".saved")).messages == len(payloads)
        found = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return found

    peak(10)  # what is made once
    assert peak(4_000) < 1.5 * peak(1_000)


def test_a_recording_too_large_to_be_read_whole_is_replayed_and_recovered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = Path("replay") / "nominal" / "rwa-000001.mcap"
    expected = replay(path)
    monkeypatch.setattr(recording_module, "MAX_WORK_BYTES", 0)
    with pytest.raises(InputError, match="copied and unpacked"):
        read_recording(path)
    assert replay(path) == expected
    assert expected.equal
    recovery = recover(path, tmp_path / "saved.mcap")
    assert not recovery.problems
    assert replay(tmp_path / "saved.mcap").messages == expected.messages
