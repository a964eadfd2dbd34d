"""Recordings on disk: written so that a crash loses little, read so that nothing false is believed."""

from __future__ import annotations

import subprocess
import sys
import textwrap
import tracemalloc
import zlib
from itertools import count, pairwise
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from rwa_monitor.cli.main import main as program
from rwa_monitor.errors import InputError
from rwa_monitor.live import file_bytes
from rwa_monitor.live import recorder as recorder_module
from rwa_monitor.live import recording as recording_module
from rwa_monitor.live.chain import file_sha256, recordings_of
from rwa_monitor.live.recorder import MAX_FILE_AGE_S, FolderLock, Predecessor, Recorder
from rwa_monitor.live.recording import PassingRecording, RecordedMessage, Recording, last_settings, read_recording
from rwa_monitor.live.recording_writer import RecordingWriter
from rwa_monitor.live.recover import recover
from rwa_monitor.live.replay import replay
from rwa_monitor.messages import samples_json
from rwa_monitor.samples import IntArray, Samples

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


@pytest.fixture
def whole(tmp_path: Path) -> tuple[Path, list[bytes]]:
    path = tmp_path / "whole.mcap"
    return path, write_file(path)


def test_a_recording_gives_back_what_was_written(whole: tuple[Path, list[bytes]]) -> None:
    path, payloads = whole
    recording = read_recording(path)
    assert recording.finished
    assert recording.problems == []
    assert recording.settings() == {"a": 1}
    assert [message.data for message in recording.messages] == payloads
    assert recording.messages[3] == RecordedMessage(TOPICS[1], "rwa.Samples", 3_000, 4, payloads[3])


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
    for time_ns in (100, 50, None, 200):
        writer.write(TOPICS[0], "rwa.Samples", b"x", time_ns)
    writer.close()
    assert [message.log_time for message in read_recording(path).messages] == [100, 100, 100, 200]


def test_every_cut_gives_true_messages_in_order_and_says_what_is_lost(whole: tuple[Path, list[bytes]]) -> None:
    path, payloads = whole
    data = path.read_bytes()
    cut = path.with_name("cut.mcap")
    saved = []
    for length in sorted({*range(8, len(data), 997), *range(len(data) - 60, len(data))}):
        cut.write_bytes(data[:length])
        recording = read_recording(cut)
        got = [message.data for message in recording.messages]
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
        numbers = [places[message.data] for message in recording.messages]  # KeyError: a message that never was
        assert numbers == sorted(numbers)
        assert all(message.topic == TOPICS[places[message.data] % 2] for message in recording.messages)
        assert len(numbers) >= len(payloads) - 40  # one flip costs one chunk at most
        if len(numbers) < len(payloads) or not recording.attachments:
            assert recording.problems
        if position in in_payload:
            assert len(numbers) < len(payloads)
            noticed += 1
    assert noticed > 100


def passed(path: Path) -> Recording:
    """Return a recording that was read piece by piece."""
    passing = PassingRecording(path)
    for part in passing.parts():
        if isinstance(part, RecordedMessage):
            passing.recording.messages.append(part)
        else:
            passing.recording.attachments[part.name] = part.data
        assert 0.0 < passing.share <= 1.0
    return passing.recording


@pytest.mark.parametrize("piece_bytes", [64, 1_000, 2**20])
def test_read_piece_by_piece_a_recording_is_the_same_also_cut_and_damaged(
    whole: tuple[Path, list[bytes]], piece_bytes: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(file_bytes, "PIECE_BYTES", piece_bytes)
    path, _ = whole
    data = path.read_bytes()
    assert passed(path) == read_recording(path)
    rng = np.random.default_rng(50_002)
    for _ in range(60):
        broken = bytearray(data[: int(rng.integers(len(data) // 2, len(data)))])
        for position in rng.integers(8, len(broken), 2):
            broken[position] ^= 1 << int(rng.integers(8))
        path.write_bytes(broken)
        assert passed(path) == read_recording(path)


def test_telemetry_that_is_packed_well_is_read_again_where_it_is_not_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A fleet at rest: its recording was refused after a restart, for what it unpacks to."""
    path = tmp_path / "rest.mcap"
    writer = RecordingWriter(path, (), lambda: 7)
    for number in range(1_000):
        writer.write(TOPICS[0], "rwa.Samples", number.to_bytes(4, "big") * 50, number)
    writer.close()
    monkeypatch.setattr(recording_module, "MAX_WORK_BYTES", 0)  # so that the share of the size counts
    with pytest.raises(InputError, match="asks for more than"):
        read_recording(path)
    assert len(passed(path).messages) == 1_000


def test_a_lost_first_chunk_does_not_take_the_names_of_all_topics_along(whole: tuple[Path, list[bytes]]) -> None:
    path, payloads = whole
    data = bytearray(path.read_bytes())
    position = data.index(payloads[5][:20]) if payloads[5][:20] in data else data.index(b"\x04\x00\x00\x00zstd") + 40
    data[position] ^= 0xFF
    path.write_bytes(data)
    recording = read_recording(path)
    assert [message.data for message in recording.messages] == payloads[40:]
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


# ---- recover ---------------------------------------------------------------------------------------------------------


def test_recover_saves_what_a_cut_file_holds(whole: tuple[Path, list[bytes]]) -> None:
    path, payloads = whole
    cut, saved = path.with_name("cut.mcap"), path.with_name("saved.mcap")
    cut.write_bytes(path.read_bytes()[:60_000])
    recovery = recover(cut, saved)
    recording = read_recording(saved)
    assert recording.finished
    assert recording.problems == []
    assert len(recovery.lost) == 1
    assert recovery.messages == len(recording.messages) == 200
    assert [message.data for message in recording.messages] == payloads[: recovery.messages]
    assert recording.messages == read_recording(cut).messages
    assert recording.settings() == {"a": 1}


def recovered_messages(source: Path, target: Path) -> tuple[list[bytes], int]:
    """Run the command; return what it saved, and its exit code."""
    code = 0
    try:
        program(["recover", str(source), "-o", str(target)], standalone_mode=True)
    except SystemExit as ended:
        code = int(ended.code or 0)
    saved = [message.data for message in read_recording(target).messages] if target.exists() else []
    target.unlink(missing_ok=True)
    return saved, code


def test_recover_on_every_cut_of_a_small_file_gives_true_messages_and_exit_3(tmp_path: Path) -> None:
    path, cut, target = tmp_path / "small.mcap", tmp_path / "cut.mcap", tmp_path / "saved.mcap"
    payloads = write_file(path, messages=4, flush_every=2)
    data = path.read_bytes()
    counts = []
    for length in range(8, len(data)):
        cut.write_bytes(data[:length])
        recording = read_recording(cut)
        got = [message.data for message in recording.messages]
        assert got == payloads[: len(got)]
        assert not recording.finished
        counts.append(len(got))
        if length % 997:
            continue
        recovery = recover(cut, target)
        assert recovery.lost
        saved = read_recording(target)
        assert saved.finished
        assert [message.data for message in saved.messages] == got
        target.unlink()
    assert counts == sorted(counts)
    assert set(counts) == {0, 2, 4}
    for length in (9, len(data) // 2, len(data) - 1):
        cut.write_bytes(data[:length])
        assert recovered_messages(cut, target) == (payloads[: counts[length - 8]], 3)
    assert recovered_messages(path, target) == (payloads, 0)


def test_recover_on_every_flipped_byte_of_a_small_file_gives_only_true_messages(tmp_path: Path) -> None:
    path, damaged, target = tmp_path / "small.mcap", tmp_path / "damaged.mcap", tmp_path / "saved.mcap"
    payloads = write_file(path, messages=4, flush_every=2)
    data = path.read_bytes()
    rng = np.random.default_rng(3)
    summary = data.index(b"rwa.Status", len(data) // 4)  # from there on it only repeats: every seventh byte will do
    for position in (*range(8, summary), *range(summary, len(data), 7)):
        broken = bytearray(data)
        broken[position] ^= 1 << int(rng.integers(8))
        damaged.write_bytes(broken)
        recording = read_recording(damaged)
        got = [message.data for message in recording.messages]
        assert got in (payloads, payloads[:2], payloads[2:])
        assert recording.problems or got == payloads
        if position % 997:
            continue
        recovery = recover(damaged, target)
        assert [message.data for message in read_recording(target).messages] == got
        assert recovery.lost or got == payloads
        target.unlink()


def test_recover_says_nothing_is_lost_when_nothing_is(whole: tuple[Path, list[bytes]]) -> None:
    path, payloads = whole
    recovery = recover(path, path.with_name("copy.mcap"))
    assert (recovery.messages, recovery.lost) == (len(payloads), ())


def test_recover_takes_the_memory_of_a_piece_however_large_a_file_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(file_bytes, "PIECE_BYTES", 2**16)

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
    monkeypatch.setattr(recording_module, "MAX_WORK_SHARE", 1)
    with pytest.raises(InputError, match="copied and unpacked"):
        read_recording(path)
    assert replay(path) == expected
    assert expected.equal
    recovery = recover(path, tmp_path / "saved.mcap")
    assert not recovery.lost
    assert replay(tmp_path / "saved.mcap").messages == expected.messages


def test_recover_leaves_nothing_behind_of_what_is_no_recording(tmp_path: Path) -> None:
    source, target = tmp_path / "table.csv", tmp_path / "saved.mcap"
    source.write_text("time_s,speed_rad_s\n")
    with pytest.raises(InputError, match="no MCAP"):
        recover(source, target)
    assert not target.exists()


def test_recover_tells_the_time_that_is_saved_and_lost(tmp_path: Path) -> None:
    path, saved, again = tmp_path / "holes.mcap", tmp_path / "saved.mcap", tmp_path / "again.mcap"
    wheels = ("rwa/sat/wheel_1/samples", "rwa/sat/wheel_2/samples")
    writer = RecordingWriter(path, {}, lambda: 4)
    second = 1_000_000_000
    for number in range(30):
        for topic, offset_s in zip(wheels, (0, 50), strict=True):  # each has a clock of its own
            times = np.array([number, number + 0.5]) * second + offset_s * second
            writer.write(topic, "rwa.Samples", samples_json(a_wheel_at(times.astype(np.int64)), "p", number), number)
        if number % 10 == 9:
            writer.sync()
    writer.close()
    data = bytearray(path.read_bytes())
    chunks = [at for at in range(len(data)) if data[at : at + 8] == b"\x04\x00\x00\x00zstd"]
    data[chunks[1] + 40] ^= 0xFF
    damaged = tmp_path / "damaged.mcap"
    damaged.write_bytes(data)
    assert recover(damaged, saved).spans == (
        "sat/wheel_1: samples of 0.000 s to 29.500 s are saved; 10 messages between 9.500 s and 20.000 s are lost",
        "sat/wheel_2: samples of 50.000 s to 79.500 s are saved; 10 messages between 59.500 s and 70.000 s are lost",
    )
    damaged.write_bytes(path.read_bytes()[: chunks[2]])
    assert recover(damaged, again).spans[0] == (
        "sat/wheel_1: samples of 0.000 s to 19.500 s are saved; what came later is lost"
    )


def a_wheel_at(time_ns: IntArray) -> Samples:
    return Samples(time_ns=time_ns, speed_rad_s=np.ones(len(time_ns)), friction_torque_Nm=np.ones(len(time_ns)))


def test_recover_overwrites_nothing(whole: tuple[Path, list[bytes]]) -> None:
    path, _ = whole
    before = path.read_bytes()
    with pytest.raises(InputError, match="exists already"):
        recover(path, path)
    assert path.read_bytes() == before


# ---- recorder --------------------------------------------------------------------------------------------------------


def recorder(folder: Path, predecessor: Predecessor | None = None, max_file_bytes: int = 10**7) -> Recorder:
    return Recorder(
        folder,
        wheel_toml="",
        model_json="",
        settings={"method": "joint"},
        predecessor=predecessor,
        wall_ns=lambda: 1,
        max_file_bytes=max_file_bytes,
    )


def test_a_second_is_all_that_is_not_on_the_disk(tmp_path: Path) -> None:
    writing = recorder(tmp_path)
    writing.begin({}, now_s=0.0)
    for second in range(3):
        writing.input(TOPICS[0], "rwa.Samples", b"%d" % second, second)
        writing.tend(second + 1.0, dict)
    writing.input(TOPICS[0], "rwa.Samples", b"late", 9)
    writing.tend(3.5, dict)
    assert writing.path is not None
    seen = [message.data for message in read_recording(writing.path).messages]
    assert seen == [b"0", b"1", b"2"]
    writing.close(4.0)


def test_files_follow_each_other_with_name_and_hash(tmp_path: Path) -> None:
    writing = recorder(tmp_path, max_file_bytes=20_000)
    writing.begin({"sat/a": lambda: b'{"n":0}'}, now_s=0.0)
    rng = np.random.default_rng(1)
    for number in range(100):
        writing.input(TOPICS[0], "rwa.Samples", rng.bytes(1_000), number)
        writing.tend(number * 1.5, lambda: {"sat/a": lambda: b'{"n":1}'})
    writing.close(200.0)
    files = recordings_of(tmp_path)
    assert len(files) > 3
    for before, after in pairwise(files):
        recording = read_recording(after)
        assert recording.settings()["predecessor"] == {"name": before.name, "sha256": file_sha256(before)}
        assert recording.attachments["checkpoint/sat/a.json"] == b'{"n":1}'
    assert sum(len(read_recording(path).messages) for path in files) == 100


def test_while_inputs_wait_the_wheels_come_over_more_slowly(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recorder_module, "MOVED_BYTES", 1)
    writing = recorder(tmp_path)
    wheels = {f"sat/{number}": lambda: b"{}" for number in range(8)}
    writing.begin(wheels, now_s=0.0)
    turns = []
    for number in range(60):
        writing.tend(MAX_FILE_AGE_S + 1.0 + 0.1 * number, lambda: wheels, busy=number < 20)
        turns.append(last_settings(recordings_of(tmp_path)[-1])["checkpoints"])
    # The first at once, then one in five turns; from the twentieth turn on one in each.
    assert turns == ["some"] * (20 + 3) + ["all"] * (60 - 23)
    writing.close(MAX_FILE_AGE_S + 10.0)


def test_a_recording_ends_when_it_is_old_and_the_next_one_goes_on(tmp_path: Path) -> None:
    writing = recorder(tmp_path)
    writing.begin({}, now_s=5.0)
    for hour in range(60):
        writing.input(TOPICS[0], "rwa.Samples", b"%d" % hour, hour)
        writing.tend(5.0 + 3_600.0 * hour, dict)
    writing.close(5.0 + 3_600.0 * 60)
    held = [[int(message.data) for message in read_recording(path).messages] for path in recordings_of(tmp_path)]
    assert held == [list(range(26)), list(range(26, 51)), list(range(51, 60))]


def test_the_oldest_files_are_deleted_to_keep_a_limit(tmp_path: Path) -> None:
    limit = 3_000_000
    writing = Recorder(
        tmp_path,
        wheel_toml="",
        model_json="",
        settings={},
        predecessor=None,
        wall_ns=lambda: 1,
        max_file_bytes=200_000,
        max_total_bytes=limit,
    )
    writing.begin({}, now_s=0.0)
    rng = np.random.default_rng(1)
    for number in range(400):
        writing.input(TOPICS[0], "rwa.Samples", number.to_bytes(4, "big") + rng.bytes(20_000), number)
        writing.tend(number * 1.5, dict)
        assert sum(path.stat().st_size for path in recordings_of(tmp_path)) <= limit
    writing.close(600.0)
    kept = [message.data for path in recordings_of(tmp_path) for message in read_recording(path).messages]
    numbers = [int.from_bytes(data[:4], "big") for data in kept]
    assert numbers == list(range(numbers[0], 400))  # the latest ones, without a hole
    assert len(numbers) > 40


def test_checkpoints_larger_than_a_file_should_be_do_not_fill_the_disk_alone(tmp_path: Path) -> None:
    writing = recorder(tmp_path, max_file_bytes=20_000)
    checkpoints = {"sat/a": lambda: b"0" * 100_000}
    writing.begin(checkpoints, now_s=0.0)
    rng = np.random.default_rng(1)
    for number in range(400):
        writing.input(TOPICS[0], "rwa.Samples", rng.bytes(1_000), number)
        writing.tend(number * 1.5, lambda: checkpoints)
    writing.close(600.0)
    assert 2 <= len(recordings_of(tmp_path)) <= 5


def test_a_file_that_was_being_begun_when_the_power_went_is_not_in_the_way(tmp_path: Path) -> None:
    (tmp_path / "rwa-000007.mcap.part").write_bytes(b"half a header")
    writing = recorder(tmp_path)
    writing.begin({}, now_s=0.0, inherited=[(TOPICS[0], "rwa.Diagnosis", b"owed", 3)])
    writing.abandon()  # as a crash right after the beginning
    (path,) = recordings_of(tmp_path)
    assert list(tmp_path.glob("*.part")) == []
    recording = read_recording(path)
    assert [message.data for message in recording.messages] == [b"owed"]
    assert recording.settings()["inherited"] == {TOPICS[0]: 1}


def test_refused_messages_on_ever_new_keys_do_not_fill_the_recording_with_topics(tmp_path: Path) -> None:
    writing = recorder(tmp_path)
    writing.begin({}, now_s=0.0)
    for number in range(1_200):
        writing.refused(f"rwa/x/{number}/samples", b"?")
    writing.close(1.0)
    (path,) = recordings_of(tmp_path)
    topics = {message.topic for message in read_recording(path).messages}
    assert len(topics) == 1_001
    assert "rwa/refused" in topics


def test_the_lists_of_a_fleets_topics_do_not_fill_the_recording(tmp_path: Path) -> None:
    def size(wheels: int) -> int:
        path = tmp_path / f"{wheels}.mcap"
        writer = RecordingWriter(path, (), lambda: 1)
        begin = writer.size
        for number in range(wheels):
            writer.write(f"rwa/fleet/wheel_{number:04d}/samples", "rwa.Samples", b"{}", number)
        writer.close()
        recording = read_recording(path)
        assert not recording.problems
        assert len({message.topic for message in recording.messages}) == wheels
        return writer.size - begin

    # Each new topic once listed all of them: a thousand wheels filled file after file with lists and little else.
    assert size(1_600) < 2.5 * size(800)


def test_two_monitors_cannot_record_in_one_folder(tmp_path: Path) -> None:
    with FolderLock(tmp_path), pytest.raises(InputError, match="another monitor"):
        FolderLock(tmp_path)
    with FolderLock(tmp_path):
        pass


def test_a_folder_that_cannot_be_made_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="--record"):
        FolderLock(tmp_path / "file" / "inside")


DISK_FULL = """
    import resource, signal, sys
    from pathlib import Path
    from rwa_monitor.live.recorder import Recorder

    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, resource.RLIM_INFINITY))  # the system says: file too large
    folder = Path(sys.argv[1])
    recorder = Recorder(folder, wheel_toml="", model_json="", settings={}, predecessor=None, wall_ns=lambda: 1)
    recorder.begin({}, 0.0)
    first = recorder.path
    import random
    data = random.Random(1)
    for number in range(100):
        recorder.input("rwa/a/b/samples", "rwa.Samples", data.randbytes(1_000), number)
        recorder.tend(0.1 * number, dict)
        if recorder.error:
            break
    assert recorder.error.startswith("nothing is recorded"), recorder.error
    assert recorder.path is None
    files = sorted(folder.iterdir())
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, resource.RLIM_INFINITY))
    recorder.tend(50.0, dict)  # in vain, and nothing half begun is left behind
    assert recorder.path is None and sorted(folder.iterdir()) == files, sorted(folder.iterdir())
    resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    recorder.tend(100.0, lambda: {"a/b": lambda: b"{}"})  # the disk works again
    assert recorder.error == "", recorder.error
    assert recorder.path not in (None, first)
    recorder.input("rwa/a/b/samples", "rwa.Samples", b"again", 999)
    recorder.close(101.0)
    print("done")
"""


def test_a_failing_disk_is_told_survived_and_used_again_when_it_works(tmp_path: Path) -> None:
    result = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(DISK_FULL), str(tmp_path)],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert result.stdout == "done\n", result.stderr
    first, second = recordings_of(tmp_path)
    assert 20 < len(read_recording(first).messages) < 60
    assert [message.data for message in read_recording(second).messages] == [b"again"]
    assert read_recording(second).settings()["predecessor"]["name"] == first.name


KILLED = """
    import sys, time
    from itertools import count, pairwise
    from pathlib import Path
    from rwa_monitor.live.recorder import Recorder

    recorder = Recorder(
        Path(sys.argv[1]), wheel_toml="", model_json="", settings={}, predecessor=None, wall_ns=time.time_ns
    )
    recorder.begin({}, time.monotonic())
    for number in count():
        recorder.input("rwa/a/b/samples", "rwa.Samples", b"%d" % number, number)
        if number % 50 == 49:
            recorder.sync(time.monotonic())
            print(number + 1, flush=True)  # promised to be on the disk
"""


@pytest.mark.processes
def test_what_was_on_the_disk_survives_a_kill_at_any_moment(tmp_path: Path) -> None:
    rng = np.random.default_rng(zlib.crc32(b"kill"))
    for trial in range(5):
        folder = tmp_path / str(trial)
        folder.mkdir()
        with subprocess.Popen(
            [sys.executable, "-c", textwrap.dedent(KILLED), str(folder)], stdout=subprocess.PIPE, text=True
        ) as child:
            assert child.stdout is not None
            for _ in range(int(rng.integers(1, 60))):
                promised = int(child.stdout.readline())
            child.kill()
            promised = int(([str(promised), *child.stdout.read().split()])[-1])
        (path,) = recordings_of(folder)
        saved = folder / "saved.mcap"
        recover(path, saved)
        numbers = [int(message.data) for message in read_recording(saved).messages]
        assert numbers == list(range(len(numbers)))
        assert len(numbers) >= promised
