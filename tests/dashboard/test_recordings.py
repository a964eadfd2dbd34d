"""Recordings on the page and in the history, with one that the monitor itself made."""

import json
from pathlib import Path

from rwa_monitor.dashboard.fleet import MAX_POINTS
from rwa_monitor.dashboard.recordings import list_recordings, replay_json
from rwa_monitor.messages import Diagnosis
from rwa_monitor.monitor.recording import read_recording

RECORDING = min(Path("replay").rglob("*.mcap"), key=lambda path: path.stat().st_size)


def test_a_replay_holds_all_diagnoses_in_order_and_thinned_samples() -> None:
    content = json.loads(replay_json(RECORDING.parent, RECORDING.name))
    entries = content["entries"]
    assert content["problems"] == []
    assert entries == sorted(entries, key=lambda entry: entry["time_ns"])
    diagnoses = [entry["message"] for entry in entries if entry["key"].endswith("/diagnosis")]
    assert diagnoses
    for message in diagnoses:
        Diagnosis.parse(json.dumps(message).encode(), "replay")
    points: dict[str, int] = {}
    for entry in entries:
        if entry["key"].endswith("/samples"):
            points[entry["key"]] = points.get(entry["key"], 0) + len(entry["message"]["time_ns"])
    assert points
    assert max(points.values()) <= MAX_POINTS


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
