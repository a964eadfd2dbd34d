"""A fleet of different wheels in one process: each goes by its own file, live, replayed and from the recording."""

import json
from pathlib import Path

import pytest
import zenoh

from rwa_monitor.batch.tasks import Diagnose
from rwa_monitor.messages import samples_json
from rwa_monitor.monitor.bus import BusOptions, open_session
from rwa_monitor.monitor.recording import recordings_of
from rwa_monitor.monitor.replay import replay
from rwa_monitor.monitor.searches import job_of
from rwa_monitor.monitor.setup import Setup, read_wheel_folder
from rwa_monitor.samples import Samples
from rwa_monitor.wheel.wheel import Wheel
from tests.history.support import discrepancy
from tests.monitor.processes import Listener, monitor, options, wait_for
from tests.monitor.support import WINDOW, batch_diagnoses, model, recorded, telemetry, wheel
from tests.program import run

OWN, OTHER = ("sat", "wheel_2"), ("sat", "wheel_1")
BATCH = 128


def send(session: zenoh.Session, name: str, samples: Samples, first: int) -> None:
    for row in range(0, len(samples), BATCH):
        payload = samples_json(samples[row : row + BATCH], name, first + row // BATCH)
        session.put(f"rwa/sat/{name}/samples", payload)


def run_once(record: Path, own: Wheel, parts: dict[str, Samples], first: int, received: dict[str, int]) -> list[str]:
    """Let a monitor take what is sent; returns its log."""
    own_wheels = {OWN: own, ("sat", "wheel_l"): wheel()}  # a slip of the pen
    with open_session(BusOptions()) as session:
        listener = Listener(session)
        with monitor(session, options(setup=Setup(wheel(), own_wheels, model()), record=record)) as log_lines:
            for name, samples in parts.items():
                send(session, name, samples, first)

            def counted() -> dict[str, int]:
                return {one["wheel"]: one["samples_received"] for one in map(json.loads, listener.kind("status"))}

            wait_for(lambda: counted() == received, "all samples")
    return log_lines


def test_each_wheel_goes_by_its_own_file_and_only_the_one_whose_file_changed_starts_anew(tmp_path: Path) -> None:
    half, whole = 3 * WINDOW // 2, 3 * WINDOW
    both = {name: telemetry(whole, seed) for seed, name in enumerate(("wheel_1", "wheel_2"), 1)}
    before = {name: samples[:half] for name, samples in both.items()}
    after = {name: samples[half:] for name, samples in both.items()}
    log_lines = run_once(tmp_path, wheel(WINDOW // 2), before, 0, dict.fromkeys(both, half))
    assert f"sat/wheel_1: has no wheel file of its own; it goes by {wheel().name}" in log_lines
    assert "wheel files that no wheel used: sat/wheel_l; are these the names on the bus?" in log_lines
    log_lines = run_once(tmp_path, wheel(WINDOW // 4), after, half // BATCH, {"wheel_1": whole, "wheel_2": half})
    assert not any("wheel_2: has no wheel file of its own" in line for line in log_lines)
    assert any("another wheel file or model of sat/wheel_2: begun anew" in line for line in log_lines)

    changed = [
        *batch_diagnoses(before["wheel_2"], wheel(WINDOW // 2), name="wheel_2"),
        *batch_diagnoses(after["wheel_2"], wheel(WINDOW // 4), name="wheel_2"),
    ]
    assert len(changed) == 2 + 5  # of 3 and 6 windows, the last one is closed by a sample beyond it
    assert recorded(tmp_path, name="wheel_1") == batch_diagnoses(both["wheel_1"], wheel(), name="wheel_1")
    assert recorded(tmp_path, name="wheel_2") == changed
    report = replay(tmp_path)
    assert report.equal, report.long()
    assert report.bytes_equal

    found = Diagnose()(recordings_of(tmp_path)[0]).diagnoses  # the recording holds the wheels
    hashes = {(one.wheel, one.provenance.wheel_sha256) for one in found}
    assert hashes == {("wheel_1", wheel().sha256()), ("wheel_2", wheel(WINDOW // 2).sha256())}


def test_a_search_is_repeated_with_the_wheels_own_constants() -> None:
    wheels = Setup(wheel(), {OWN: wheel(WINDOW // 2)})
    jobs = [job_of(discrepancy(0, name), [], wheels) for name in ("wheel_1", "wheel_2")]
    assert [job.constants for job in jobs] == [wheel(), wheel(WINDOW // 2)]


def test_a_folder_gives_each_wheel_its_file(tmp_path: Path) -> None:
    for spacecraft, name in (OWN, OTHER):
        (tmp_path / spacecraft).mkdir(exist_ok=True)
        (tmp_path / spacecraft / f"{name}.toml").write_text(wheel().to_toml())
    (tmp_path / "notes.txt").write_text("left alone")
    assert read_wheel_folder(tmp_path) == {OTHER: wheel(), OWN: wheel()}


@pytest.mark.parametrize(
    ("name", "text", "reason"),
    [
        (None, "", "holds no SPACECRAFT/WHEEL.toml"),
        ("sat/a wheel.toml", "", "is named after no wheel"),
        ("sat/wheel_1.toml", "x = 1", "wheel_1.toml"),
    ],
)
def test_a_folder_that_cannot_be_used_is_refused_before_anything_runs(
    tmp_path: Path, name: str | None, text: str, reason: str
) -> None:
    if name is not None:
        (tmp_path / "sat").mkdir()
        (tmp_path / name).write_text(text)
    result = run("run", "--wheel-folder", tmp_path)
    assert result.exit_code == 2
    assert reason in result.stderr
