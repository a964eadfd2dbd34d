"""The list of recordings and what a replay shows, with those that the monitor itself made."""

import json
from pathlib import Path

from rwa_monitor.dashboard.fleet import MAX_POINTS
from rwa_monitor.dashboard.recordings import list_recordings, replay_json
from rwa_monitor.monitor.recording import read_recording

RECORDING = min(Path("replay").rglob("*.mcap"), key=lambda path: path.stat().st_size)


def test_samples_of_a_replay_are_thinned() -> None:
    entries = json.loads(replay_json(Path("replay/two_anomalies"), "rwa-000001.mcap"))["entries"]
    shown = sum(len(entry["message"]["time_ns"]) for entry in entries if entry["key"].endswith("/samples"))
    assert MAX_POINTS // 2 < shown <= MAX_POINTS


def test_the_list_shows_which_time_a_recording_covers(tmp_path: Path) -> None:
    data = RECORDING.read_bytes()
    (tmp_path / "whole.mcap").write_bytes(data)
    (tmp_path / "cut.mcap").write_bytes(data[: len(data) * 2 // 3])
    (tmp_path / "no.mcap").write_bytes(b"no recording at all, whatever it is called")
    times = [message.time_ns for message in read_recording(RECORDING).messages]
    whole, none, cut = list_recordings(tmp_path)
    assert list_recordings(tmp_path / "none") == []
    assert (whole.first_ns, whole.last_ns) == (min(time for time in times if time), max(times))
    assert (none.first_ns, none.last_ns) == (None, None)
    assert cut.first_ns == whole.first_ns
    assert cut.last_ns < whole.last_ns
