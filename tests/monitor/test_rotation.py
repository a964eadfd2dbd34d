"""From one recording to the next, wheel by wheel: a crash at any moment of it loses nothing.

What a killed process leaves is what it had written: here the folder is copied while the monitor goes on. A power cut
may take the end of the file that is being begun, too.
"""

import shutil
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np
import pytest

from rwa_monitor.messages import samples_json
from rwa_monitor.monitor import recorder as recorder_module
from rwa_monitor.monitor.backfill import Arrival
from rwa_monitor.monitor.recorder import MAX_FILE_AGE_S
from rwa_monitor.monitor.recording import read_chain, read_recording, recordings_of
from rwa_monitor.monitor.replay import replay
from tests.monitor.processes import Driven
from tests.monitor.support import WINDOW, batch_diagnoses, recorded, telemetry, wheel

WHEELS: Final = ("wheel_1", "wheel_2", "wheel_3", "wheel_4")
BATCH: Final = 128  # samples of a message
SLOTS: Final = 3 * WINDOW
TICK_S: Final = 1.0  # of the monitor's clock, between two messages


@cache
def messages() -> list[tuple[str, bytes]]:
    """Return the messages of all wheels, in turns; each wheel is in another place of its window."""
    return [
        (
            f"rwa/sat/{name}/samples",
            samples_json(telemetry(SLOTS, place)[BATCH * turn : BATCH * (turn + 1)], name, turn),
        )
        for late in range(SLOTS // BATCH + 2 * len(WHEELS))
        for place, name in enumerate(WHEELS)
        if 0 <= (turn := late - 2 * place) < SLOTS // BATCH
    ]


@cache
def expected(name: str) -> list[bytes]:
    """Return the diagnoses of the messages of a wheel."""
    return batch_diagnoses(telemetry(SLOTS, WHEELS.index(name)), wheel(), name=name)


class Run(Driven):
    """One run of the monitor; its clock goes on with each message."""

    def take(self, sent: list[tuple[str, bytes]]) -> None:
        """Take messages."""
        for key, payload in sent:
            self.monitor.receive(Arrival(key, payload))
            self.now_s += TICK_S
            self.monitor.tick()

    def rotate(self, begun: int, stop: int, start: int = 0) -> None:
        """Take messages up to `begun`, with which the recording is so old that the next one is begun, and to `stop`."""
        self.take(messages()[start:begun])
        self.now_s += MAX_FILE_AGE_S
        self.take(messages()[begun:stop])

    def killed(self, name: str) -> Path:
        """Return a folder with what is on the disk now; this run goes on."""
        return Path(shutil.copytree(self.folder, self.folder.with_name(name)))


@pytest.fixture
def start(monkeypatch: pytest.MonkeyPatch) -> Iterator[type[Run]]:
    """Return what starts a monitor that brings one wheel over at a time; all of them end with the test."""
    monkeypatch.setattr(recorder_module, "PIECE_BYTES", 1)
    runs: list[Run] = []

    class Started(Run):
        def __post_init__(self) -> None:
            super().__post_init__()
            runs.append(self)

    yield Started
    for run in runs:
        run.recorder.abandon()


def is_between(folder: Path) -> bool:
    """Return whether the wheels are being brought over into the last recording."""
    return bool(read_recording(recordings_of(folder)[-1]).settings()["checkpoints"] == "some")


def check(folder: Path) -> None:
    """Check that a chain holds each diagnosis once, as `diagnose` gives it, and that each recording replays."""
    for name in WHEELS:
        assert recorded(folder, name=name) == expected(name)
    report = replay(folder)
    assert report.equal, report.long()
    assert report.bytes_equal
    for path in recordings_of(folder):
        alone = replay(path)
        assert not alone.differences, alone.long()
        assert alone.bytes_equal


def go_on(run: Run) -> Run:
    """Let a monitor that was started again take what publishers have kept, which is all, and then the rest."""
    run.take(messages())
    run.monitor.close()
    return run


@pytest.mark.parametrize("begun", [21, 58])
def test_a_kill_while_the_wheels_come_over_loses_nothing(tmp_path: Path, start: type[Run], begun: int) -> None:
    run = start(tmp_path / "run")
    run.rotate(begun, begun)
    crashed = []
    for place in range(begun, begun + len(WHEELS) + 1):
        run.take(messages()[place : place + 1])
        if place % 2:
            run.recorder.sync(run.now_s)
        crashed.append(run.killed(f"killed at {place}"))
    assert [is_between(folder) for folder in crashed] == [True, True, True, False, False]
    for folder in crashed:
        assert go_on(start(folder)).log_lines[0].startswith("going on from")
        check(folder)


def test_a_second_kill_while_the_wheels_come_over_loses_nothing(tmp_path: Path, start: type[Run]) -> None:
    run = start(tmp_path / "run")
    run.rotate(30, 32)
    run = start(run.killed("once"))
    run.rotate(33, 36)
    twice = run.killed("twice")
    assert is_between(twice)
    go_on(start(twice))
    check(twice)
    assert len(recordings_of(twice)) == 5


def test_a_stop_while_the_wheels_come_over_leaves_two_files_that_go_together(tmp_path: Path, start: type[Run]) -> None:
    run = start(tmp_path / "run")
    run.rotate(50, 52)
    run.monitor.close()
    assert is_between(run.folder)
    assert all(recording.finished for recording in read_chain(run.folder))
    started = start(run.folder)
    assert started.log_lines[0].endswith(f"{len(WHEELS)} wheels, 52 messages")
    started.take(messages()[52:])
    started.monitor.close()
    check(run.folder)


def test_what_a_power_cut_takes_of_the_file_that_is_begun_comes_again(tmp_path: Path, start: type[Run]) -> None:
    run = start(tmp_path / "run")
    run.rotate(45, 46)
    begun = recordings_of(run.folder)[-1].stat().st_size
    run.take(messages()[46:48])
    run.recorder.sync(run.now_s)
    size = recordings_of(run.folder)[-1].stat().st_size
    rng = np.random.default_rng(50_007)
    for trial, stays in enumerate(rng.integers(begun, size, 3).tolist()):
        folder = run.killed(f"cut {trial}")
        with recordings_of(folder)[-1].open("r+b") as file:
            file.truncate(stays)
        go_on(start(folder))
        assert recorded(folder, name="wheel_1") == expected("wheel_1")
        assert not replay(folder).differences


def test_a_checkpoint_damaged_while_the_wheels_come_over_costs_nothing(tmp_path: Path, start: type[Run]) -> None:
    run = start(tmp_path / "run")
    run.rotate(45, 48)
    run.recorder.sync(run.now_s)
    path = recordings_of(run.folder)[-1]
    data = bytearray(path.read_bytes())
    data[data.index(b'"reported_missing"')] ^= 1
    folder = run.killed("damaged")
    (folder / path.name).write_bytes(data)
    assert "cannot be read" in go_on(start(folder)).log_lines[0]
    for name in WHEELS:
        assert recorded(folder, name=name) == expected(name)


def test_the_file_before_stays_until_all_wheels_have_come_over(tmp_path: Path, start: type[Run]) -> None:
    run = start(tmp_path / "run", max_record_bytes=1)  # as few files as may be
    for number in range(4):
        run.rotate(20 * number + 18, 20 * number + 20, 20 * number)
        assert is_between(run.folder)
        assert len(recordings_of(run.folder)) == 2
    left = run.killed("left")
    killed = start(left)  # it begins a file with the state of all wheels: before that the two are needed
    assert len(recordings_of(left)) == 3
    assert f": {len(WHEELS)} wheels," in killed.log_lines[0]
