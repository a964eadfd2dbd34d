"""The recorder: files that follow each other within limits, and a disk that fails, fills up or loses its power."""

import subprocess
import sys
import textwrap
import zlib
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rwa_monitor.messages import MAX_WHEELS, Diagnosis, EncodedMessage
from rwa_monitor.monitor.recorder import Recorder, RecordingWriter, recover
from rwa_monitor.monitor.recording import file_sha256, read_recording, recordings_of
from tests.monitor.recordings import TOPICS

Checkpoints = dict[str, Callable[[], bytes]]


def begun(folder: Path, checkpoints: Checkpoints | None = None, **options: Any) -> Recorder:
    """Return a recorder that has begun a file."""
    made = Recorder(folder, attachments={}, settings={}, predecessor=None, wall_ns=lambda: 1, **options)
    made.begin(checkpoints or {}, now_s=0.0)
    return made


def fed(writing: Recorder, messages: int, size: int, checkpoints: Checkpoints | None = None) -> Iterator[int]:
    """Record random messages, one each 1.5 s, with checkpoints of later files; yields their numbers, and ends it."""
    rng = np.random.default_rng(1)
    for number in range(messages):
        writing.write(EncodedMessage(TOPICS[0], "rwa.Samples", number.to_bytes(4, "big") + rng.bytes(size), number))
        writing.maintain(number * 1.5, lambda: checkpoints or {})
        yield number
    writing.close(messages * 1.5)


def test_a_second_is_all_that_is_not_on_the_disk(tmp_path: Path) -> None:
    writing = begun(tmp_path)
    for second in range(3):
        writing.write(EncodedMessage(TOPICS[0], "rwa.Samples", b"%d" % second, second))
        writing.maintain(second + 1.0, dict)
    writing.write(EncodedMessage(TOPICS[0], "rwa.Samples", b"late", 9))
    writing.maintain(3.5, dict)
    seen = [message.payload for message in read_recording(writing.path).messages]
    assert seen == [b"0", b"1", b"2"]
    writing.close(4.0)


def test_files_follow_each_other_with_name_and_hash(tmp_path: Path) -> None:
    writing = begun(tmp_path, {"sat/a": lambda: b'{"n":0}'}, max_file_bytes=20_000)
    assert len(list(fed(writing, 100, 1_000, {"sat/a": lambda: b'{"n":1}'}))) == 100
    files = recordings_of(tmp_path)
    assert len(files) > 3
    for before, after in pairwise(files):
        recording = read_recording(after)
        assert recording.settings()["predecessor"] == {"name": before.name, "sha256": file_sha256(before)}
        assert recording.attachments["checkpoint/sat/a.json"] == b'{"n":1}'
    assert sum(len(read_recording(path).messages) for path in files) == 100


def test_a_recording_ends_when_it_is_old_and_the_next_one_goes_on(tmp_path: Path) -> None:
    writing = begun(tmp_path)
    for hour in range(60):
        writing.write(EncodedMessage(TOPICS[0], "rwa.Samples", b"%d" % hour, hour))
        writing.maintain(3_600.0 * hour, dict)
    writing.close(3_600.0 * 60)
    held = [[int(message.payload) for message in read_recording(path).messages] for path in recordings_of(tmp_path)]
    assert held == [list(range(26)), list(range(26, 51)), list(range(51, 60))]


def test_the_oldest_files_are_deleted_to_keep_a_limit(tmp_path: Path) -> None:
    limit = 3_000_000
    writing = begun(tmp_path, max_file_bytes=200_000, max_total_bytes=limit)
    for _ in fed(writing, 400, 20_000):
        assert sum(path.stat().st_size for path in recordings_of(tmp_path)) <= limit
    kept = [message.payload for path in recordings_of(tmp_path) for message in read_recording(path).messages]
    numbers = [int.from_bytes(data[:4], "big") for data in kept]
    assert numbers == list(range(numbers[0], 400))  # the latest ones, without a hole
    assert len(numbers) > 40


def test_checkpoints_larger_than_a_file_should_be_do_not_fill_the_disk_alone(tmp_path: Path) -> None:
    checkpoints = {"sat/a": lambda: b"0" * 100_000}
    writing = begun(tmp_path, checkpoints, max_file_bytes=20_000)
    assert len(list(fed(writing, 400, 1_000, checkpoints))) == 400
    assert 2 <= len(recordings_of(tmp_path)) <= 5


def test_a_file_that_was_being_begun_when_the_power_went_is_not_in_the_way(tmp_path: Path) -> None:
    (tmp_path / "rwa-000007.mcap.part").write_bytes(b"half a header")
    writing = Recorder(tmp_path, attachments={}, settings={}, predecessor=None, wall_ns=lambda: 1)
    writing.begin({}, now_s=0.0, inherited=[EncodedMessage(TOPICS[0], Diagnosis.schema_name(), b"owed", 3)])
    writing.abandon()  # as a crash right after the beginning
    (path,) = recordings_of(tmp_path)
    assert list(tmp_path.glob("*.part")) == []
    recording = read_recording(path)
    assert [message.payload for message in recording.messages] == [b"owed"]


def test_refused_messages_on_ever_new_keys_do_not_fill_the_recording_with_topics(tmp_path: Path) -> None:
    writing = begun(tmp_path)
    for number in range(MAX_WHEELS + 200):
        writing.refused(f"rwa/x/{number}/samples", b"?")
    writing.close(1.0)
    (path,) = recordings_of(tmp_path)
    topics = {message.topic for message in read_recording(path).messages}
    assert len(topics) == MAX_WHEELS + 1
    assert "rwa/refused" in topics


def test_the_lists_of_a_fleets_topics_do_not_fill_the_recording(tmp_path: Path) -> None:
    def size(wheels: int) -> int:
        path = tmp_path / f"{wheels}.mcap"
        writer = RecordingWriter(path, (), lambda: 1)
        begin = writer.size
        for number in range(wheels):
            writer.write(EncodedMessage(f"rwa/fleet/wheel_{number:04d}/samples", "rwa.Samples", b"{}", number))
        writer.close()
        recording = read_recording(path)
        assert not recording.problems
        assert len({message.topic for message in recording.messages}) == wheels
        return path.stat().st_size - begin

    # Each new topic once listed all of them: a thousand wheels filled file after file with lists and little else.
    assert size(1_600) < 2.5 * size(800)


DISK_FULL = """
    import resource, signal, sys
    from pathlib import Path
    from rwa_monitor.messages import EncodedMessage
    from rwa_monitor.monitor.recorder import Recorder

    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, resource.RLIM_INFINITY))  # the system refuses: file too large
    folder = Path(sys.argv[1])
    recorder = Recorder(folder, attachments={}, settings={}, predecessor=None, wall_ns=lambda: 1)
    recorder.begin({}, 0.0)
    first = recorder.path
    import random
    data = random.Random(1)
    for number in range(100):
        recorder.write(EncodedMessage("rwa/a/b/samples", "rwa.Samples", data.randbytes(1_000), number))
        recorder.maintain(0.1 * number, dict)
        if recorder.error:
            break
    assert recorder.error.startswith("nothing is recorded"), recorder.error
    assert recorder.path is None
    files = sorted(folder.iterdir())
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, resource.RLIM_INFINITY))
    recorder.maintain(50.0, dict)  # in vain, and nothing half begun is left behind
    assert recorder.path is None and sorted(folder.iterdir()) == files, sorted(folder.iterdir())
    resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    recorder.maintain(100.0, lambda: {"a/b": lambda: b"{}"})  # the disk works again
    assert recorder.error == "", recorder.error
    assert recorder.path not in (None, first)
    recorder.write(EncodedMessage("rwa/a/b/samples", "rwa.Samples", b"again", 999))
    recorder.close(101.0)
    print("done")
"""


def test_a_failing_disk_is_reported_survived_and_used_again_when_it_works(tmp_path: Path) -> None:
    words = [sys.executable, "-c", textwrap.dedent(DISK_FULL), str(tmp_path)]
    result = subprocess.run(words, capture_output=True, text=True, timeout=60, check=False)
    assert result.stdout == "done\n", result.stderr
    first, second = recordings_of(tmp_path)
    assert 20 < len(read_recording(first).messages) < 60
    assert [message.payload for message in read_recording(second).messages] == [b"again"]
    assert read_recording(second).settings()["predecessor"]["name"] == first.name


KILLED = """
    import sys, time
    from itertools import count, pairwise
    from pathlib import Path
    from rwa_monitor.messages import EncodedMessage
    from rwa_monitor.monitor.recorder import Recorder

    recorder = Recorder(Path(sys.argv[1]), attachments={}, settings={}, predecessor=None, wall_ns=time.time_ns)
    recorder.begin({}, time.monotonic())
    for number in count():
        recorder.write(EncodedMessage("rwa/a/b/samples", "rwa.Samples", b"%d" % number, number))
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
            for _ in range(int(rng.integers(1, 60))):
                promised = int(child.stdout.readline())
            child.kill()
            promised = int(([str(promised), *child.stdout.read().split()])[-1])
        (path,) = recordings_of(folder)
        saved = folder / "saved.mcap"
        recover(path, saved)
        numbers = [int(message.payload) for message in read_recording(saved).messages]
        assert numbers == list(range(len(numbers)))
        assert len(numbers) >= promised
