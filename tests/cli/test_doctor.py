"""What `doctor` says of the folders of a monitor and of who is on its bus."""

from __future__ import annotations

import shutil
from pathlib import Path
from threading import Event, Thread

import pytest

from rwa_monitor.cli.doctor import look_at_bus, look_at_recordings, look_at_wheel_folder
from rwa_monitor.diagnosis.model import built_in_model
from rwa_monitor.errors import RwaMonitorError
from rwa_monitor.monitor.bus import BusOptions, open_session
from rwa_monitor.monitor.recording.reader import read_recording
from rwa_monitor.monitor.recording.recorder import FolderLock
from rwa_monitor.monitor.setup import Setup, WheelSet
from rwa_monitor.wheel.wheel import built_in_wheel
from tests.monitor.support import free_port
from tests.program import run

RECORDING = Path(__file__).parents[2] / "replay" / "nominal" / "rwa-000001.mcap"
SETUP = Setup(WheelSet(built_in_wheel()), built_in_model(), "joint")


def test_a_folder_that_can_be_made_is_told_and_not_made(tmp_path: Path) -> None:
    folder = tmp_path / "a" / "b"
    assert f"{folder} is not there yet; " in look_at_recordings(folder, SETUP)
    assert not (tmp_path / "a").exists()
    (tmp_path / "file").touch()
    with pytest.raises(RwaMonitorError, match="cannot be made in"):
        look_at_recordings(tmp_path / "file" / "b", SETUP)


def test_a_folder_that_another_monitor_holds_is_told(tmp_path: Path) -> None:
    assert "holds no recording yet" in look_at_recordings(tmp_path, SETUP)
    with FolderLock(tmp_path), pytest.raises(RwaMonitorError, match="another monitor records in it"):
        look_at_recordings(tmp_path, SETUP)


def test_a_recording_with_another_wheel_file_is_told(tmp_path: Path) -> None:
    shutil.copy(RECORDING, tmp_path)
    assert look_at_recordings(tmp_path, Setup.of(read_recording(RECORDING))).endswith(f"goes on from {RECORDING.name}")
    told = look_at_recordings(tmp_path, SETUP)
    assert "made with another wheel file, model or method of reference/wheel_1: begun anew" in told


def test_wheel_files_in_the_wrong_place_are_named(tmp_path: Path) -> None:
    (tmp_path / "sat").mkdir()
    (tmp_path / "sat" / "rw1.toml").write_text(built_in_wheel().to_toml())
    (tmp_path / "rw2.toml").write_text(built_in_wheel().to_toml())
    told = look_at_wheel_folder(tmp_path)
    assert told == "1 wheel (sat/rw1); no wheel's: rw2.toml, the place is SPACECRAFT/WHEEL.toml; complete"


@pytest.mark.processes
def test_who_is_on_the_bus_is_told() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    assert "nobody has connected" in look_at_bus(BusOptions(listen=(endpoint,)), set())
    stop = Event()
    with open_session(BusOptions(listen=(endpoint,))) as session:

        def speak() -> None:
            while not stop.wait(0.1):
                session.put("rwa/sat/rw1/samples", b"{}")
                session.put("rwa/sat/rw2/status", b"{}")

        thread = Thread(target=speak)
        thread.start()
        try:
            told = look_at_bus(BusOptions(connect=(endpoint,)), {("sat", "rw1"), ("sat", "rw3")})
        finally:
            stop.set()
            thread.join()
    assert "1 peer connected; in 2 s received telemetry of 1 wheel (sat/rw1), monitors of 1 wheel (sat/rw2)" in told
    assert "; nobody monitors sat/rw1" in told
    assert told.endswith("; wheel files of wheels without messages: sat/rw3")


def test_the_model_is_not_judged_by_a_wheel_file_that_cannot_be_read(tmp_path: Path) -> None:
    done = run("doctor", "--wheel", tmp_path / "none.toml")
    assert done.exit_code == 1
    assert "FAILED  wheel: " in done.stdout
    assert "–       model: not checked before wheel" in done.stdout
    assert "FAILED  model" not in done.stdout
