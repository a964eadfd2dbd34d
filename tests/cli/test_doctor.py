"""What `doctor` reports of the folders of a monitor and of who is on its bus."""

import shutil
from pathlib import Path
from threading import Event, Thread

import pytest

from rwa_monitor.cli.doctor import look_at_bus, look_at_recordings
from rwa_monitor.errors import RwaMonitorError
from rwa_monitor.monitor.bus import BusOptions, open_session
from rwa_monitor.monitor.recorder import locked
from tests.monitor.support import free_port

RECORDING = Path(__file__).parents[2] / "replay" / "nominal" / "rwa-000001.mcap"


def test_what_a_folder_holds_is_reported_and_none_is_made(tmp_path: Path) -> None:
    assert look_at_recordings(tmp_path / "a").endswith("is not there yet")
    assert not (tmp_path / "a").exists()
    assert "holds no recording yet" in look_at_recordings(tmp_path)
    with locked(tmp_path), pytest.raises(RwaMonitorError, match="another monitor records in it"):
        look_at_recordings(tmp_path)
    shutil.copy(RECORDING, tmp_path)
    assert look_at_recordings(tmp_path).endswith(f"goes on from {RECORDING.name}")


@pytest.mark.processes
def test_who_is_on_the_bus_is_reported() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    assert "nobody has connected" in look_at_bus(BusOptions(listen=(endpoint,)))
    stop = Event()
    with open_session(BusOptions(listen=(endpoint,))) as session:

        def speak() -> None:
            while not stop.wait(0.1):
                session.put("rwa/sat/rw1/samples", b"{}")
                session.put("rwa/sat/rw2/status", b"{}")

        thread = Thread(target=speak)
        thread.start()
        try:
            told = look_at_bus(BusOptions(connect=(endpoint,)))
        finally:
            stop.set()
            thread.join()
    assert "1 peer connected; in 3 s received telemetry of 1 wheel (sat/rw1), monitors of 1 wheel (sat/rw2)" in told
    assert told.endswith("; nobody monitors sat/rw1")
