"""How the core is installed alone: its lock is part of the other, complete and hashed, and every page states it."""

import importlib.metadata
import json
import re
import signal
import subprocess
import sys
import tomllib
from collections.abc import Sequence
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from benchmarks.speed.live import free_endpoint
from rwa_monitor.cli import doctor
from tests.program import run

ROOT = Path(__file__).parents[2]
# A program that finds no package but those of a lock: what its first argument lists is not there.
WITHOUT = """
import json, sys
absent = set(json.loads(sys.argv.pop(1)))
class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in absent:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Absent())
from rwa_monitor.cli.main import main
main(prog_name="rwa-monitor")
"""
PLACES = ["README.md", "docs/onboard.md", "docker/rwa-monitor.service", "Makefile", "docker/Dockerfile"]


def _locked(name: str) -> dict[str, str]:
    """Return the whole entry, hashes included, of each package of a lock."""
    text = (ROOT / name).read_text(encoding="utf-8")
    entries = re.split(r"\n(?=\S)", "\n".join(line for line in text.splitlines() if not line.startswith("#")))
    return {canonicalize_name(re.split(r"[=\[ ]", entry)[0]): entry for entry in entries if "==" in entry}


def _names(lines: list[str]) -> set[str]:
    return {canonicalize_name(Requirement(line).name) for line in lines}


def test_the_lock_of_the_core_is_that_of_the_program_less_the_page_and_the_database() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    core, program = _locked("requirements-core.txt"), _locked("requirements.txt")
    assert core.items() <= program.items()  # the same versions and the same hashes
    assert all("--hash=sha256:" in entry for entry in core.values())
    wanted = _names(project["dependencies"])
    assert wanted | _names(extras["build"]) <= set(core)  # the backend too: nothing is fetched past the hashes
    assert set(core).isdisjoint(_names(extras["dashboard"]) | _names(extras["postgresql"]))


@pytest.mark.parametrize("place", PLACES)
def test_no_page_installs_past_the_lock(place: str) -> None:
    lines = (ROOT / place).read_text(encoding="utf-8").splitlines()
    ours = [line for line in lines if "install" in line.lower() and "--no-deps" in line]
    assert ours, place
    assert all("--no-deps --no-build-isolation" in line for line in ours), ours
    if place in PLACES[:3]:  # the unit and the pages
        assert any("pip install --require-hashes -r requirements-core.txt" in line for line in lines)


def test_the_lock_of_a_monitor_is_that_of_the_core_less_what_builds_and_trains() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    core, monitor = _locked("requirements-core.txt"), _locked("requirements-monitor.txt")
    assert monitor.items() <= core.items()  # the same versions and the same hashes
    assert set(monitor).isdisjoint(_names(project["optional-dependencies"]["build"]))
    assert _names(project["dependencies"]) - set(monitor) == doctor.NOT_ON_BOARD


@pytest.mark.parametrize(("missing", "found"), [("joblib", "ok"), ("numpy", "FAILED")])
def test_the_doctor_misses_nothing_that_a_monitor_does_without(
    missing: str, found: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor, "_missing", lambda names: [missing] if missing in names else [])
    (line,) = (line for line in run("doctor").output.splitlines() if " packages:" in line)
    assert line.startswith(found)
    assert missing in line


def _monitor_only(*words: object) -> list[str]:
    """Return the command of a program that has no package but those of requirements-monitor.txt."""
    there = {"rwa-monitor", *_locked("requirements-monitor.txt")}
    owners = importlib.metadata.packages_distributions().items()
    absent = [module for module, names in owners if there.isdisjoint(canonicalize_name(name) for name in names)]
    return [sys.executable, "-c", WITHOUT, json.dumps(absent), *(str(word) for word in words)]


def _done(words: Sequence[str]) -> str:
    done = subprocess.run(words, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_monitor_without_the_rest_replays_a_recording() -> None:
    assert "equal, byte for byte" in _done(_monitor_only("replay", "--verify", ROOT / "replay/nominal"))


def test_a_monitor_without_the_rest_diagnoses_a_table(tmp_path: Path) -> None:
    recording = tmp_path / "samples.csv"
    rows = [f"{slot / 8},{100.0 + slot % 400 / 10},{0.001 + slot % 7 * 1e-6}" for slot in range(4_000)]
    recording.write_text("\n".join(["time_s,speed_rad_s,friction_torque_Nm", *rows]) + "\n")
    assert "samples.csv" in _done(_monitor_only("diagnose", recording))


@pytest.mark.processes
def test_a_monitor_without_the_rest_monitors(tmp_path: Path) -> None:
    command = _monitor_only("run", "-l", free_endpoint(), "--record", tmp_path)
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        assert any("monitoring" in line for line in process.stderr)
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=60.0)
    assert process.returncode == 0
