"""`diagnose` of many windows says at its end how the friction of the wheel moves, and keeps quiet in JSON."""

from __future__ import annotations

import json

import pytest

import rwa_monitor as rwa
from rwa_monitor.telemetry.configuration import write_wheel
from rwa_monitor.telemetry.table import table_writer
from tests.program import run

GROWING = "[anomalies.viscous]\nfactor = 1.5\nonset_s = 4000.0\ngrowth_s = 6000.0\n"


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str]:
    """Ten windows of 8,000 samples in which viscous friction begins to grow in the fifth."""
    folder = tmp_path_factory.mktemp("growing")
    wheel = rwa.read_wheel()
    wheel = wheel.model_copy(update={"window": wheel.window.model_copy(update={"samples": 8_000, "hop": 8_000})})
    scenario = rwa.Scenario.from_toml(GROWING, "growing")
    table = folder / "growing.csv"
    table_writer(table)(rwa.simulate(scenario, wheel, seed=3).samples, table)
    write_wheel(wheel, folder / "wheel.toml")
    return str(table), str(folder / "wheel.toml")


def test_the_last_lines_name_the_trend(recording: tuple[str, str]) -> None:
    table, wheel = recording
    result = run("diagnose", table, "--wheel", wheel)
    assert result.exit_code == 0
    dry, viscous = result.stdout.rstrip().splitlines()[-2:]
    assert ": No trend of base dry friction in 10 windows" in dry
    assert ": Viscous friction grows by " in viscous


def test_json_holds_diagnoses_only(recording: tuple[str, str]) -> None:
    table, wheel = recording
    result = run("diagnose", table, "--wheel", wheel, "--json")
    assert [json.loads(line)["samples"] for line in result.stdout.splitlines()] == [8_000] * 10


def test_files_of_the_same_time_are_no_course(recording: tuple[str, str]) -> None:
    table, wheel = recording
    result = run("diagnose", table, table, "--wheel", wheel)
    assert result.exit_code == 0
    assert "trend" not in result.stdout
