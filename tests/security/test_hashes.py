"""Wheel, model and recording are checked by hash: a file that is not the one that was meant is noticed."""

import json
import subprocess
from pathlib import Path

import pytest

from rwa_monitor.diagnosis.model import built_in_model
from rwa_monitor.errors import InputError
from rwa_monitor.monitor.recording import read_recording
from rwa_monitor.monitor.replay import replay
from rwa_monitor.monitor.setup import Setup, read_model, read_scenario, read_wheel
from rwa_monitor.simulation.scenario import Scenario
from rwa_monitor.wheel.wheel import built_in_wheel
from tests.monitor.recordings import rewrite

REFERENCE = Path(__file__).parents[2] / "replay" / "nominal" / "rwa-000001.mcap"
FILES = {
    "wheel.toml": (read_wheel, built_in_wheel().to_toml()),
    "model.json": (read_model, built_in_model().to_json()),
    "scenario.toml": (read_scenario, Scenario().to_toml()),
}


@pytest.mark.parametrize("name", list(FILES))
def test_a_file_beside_which_its_hash_lies_must_have_it(name: str, tmp_path: Path) -> None:
    read, text = FILES[name]
    path = tmp_path / name
    path.write_text(text)
    stated = subprocess.run(["sha256sum", name], cwd=tmp_path, capture_output=True, text=True, check=True).stdout
    beside = tmp_path / f"{name}.sha256"
    beside.write_text(stated)
    assert read(path) == read(path)
    path.write_text(f"{text} ")
    with pytest.raises(InputError, match="is not the file whose hash"):
        read(path)
    for wrong in ("", "\n", "\xff", stated[1:], "x" * 20_000):
        beside.write_text(wrong, encoding="latin-1")
        with pytest.raises(InputError):
            read(path)


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("wheel.toml", (b"max_speed_rad_s = 650.0", b"max_speed_rad_s = 651.0")),
        ("model.json", (b'"windows": ', b'"windows": 1')),
    ],
)
def test_a_recording_with_another_wheel_or_model_does_not_replay(
    name: str, change: tuple[bytes, bytes], tmp_path: Path
) -> None:
    same, other = tmp_path / "same.mcap", tmp_path / "other.mcap"
    rewrite(REFERENCE, same)
    assert replay(same).equal  # the control
    assert change[0] in read_recording(REFERENCE).attachments[name]
    rewrite(REFERENCE, other, attached=lambda which, data: data.replace(*change) if which == name else data)
    report = replay(other)
    assert not report.equal
    hashed = "wheel_sha256" if name == "wheel.toml" else "model_sha256"
    assert any(hashed in field for field in report.fields), report.fields


def test_a_diagnosis_names_the_hashes_of_what_it_was_made_with() -> None:
    recording = read_recording(REFERENCE)
    diagnoses = [json.loads(m.payload) for m in recording.messages if m.schema == "rwa.Diagnosis"]
    wheel_sha256, model_sha256 = Setup.of(recording).identity_of("sat", "wheel_1")
    assert diagnoses
    assert {d["provenance"]["wheel_sha256"] for d in diagnoses} == {wheel_sha256}
    assert {d["provenance"]["model_sha256"] for d in diagnoses} == {model_sha256}
