"""A small wheel and recordings simulated with it, made once for all tests of the command line."""

from pathlib import Path

import pytest
from click.testing import Result

from rwa_monitor.simulation.datasets import scaled_wheel
from rwa_monitor.wheel.wheel import Window, built_in_wheel
from tests.program import run

WINDOW = 4000  # slots: large enough for a verdict, small enough for many tests
SECONDS = 1250.0  # of a recording: two and a half windows


def simulate(scenario: Path, wheel: Path, seed: int, output: Path) -> None:
    made = run("simulate", "recording", "--scenario", scenario, "--wheel", wheel, "--seed", seed, "-o", output)
    assert (made.exit_code, made.stdout) == (0, ""), made.stderr


@pytest.fixture(scope="session")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with wheel.toml, scenario.toml, and the recording they give as given.csv and given.parquet."""
    folder = tmp_path_factory.mktemp("files")
    wheel = scaled_wheel(built_in_wheel(), WINDOW / built_in_wheel().window.samples)
    window = Window(samples=WINDOW, hop=WINDOW, dead_band_rad_s=1.0)
    (folder / "wheel.toml").write_text(wheel.model_copy(update={"name": "small", "window": window}).to_toml())
    (folder / "scenario.toml").write_text(f"[scenario]\nduration_s = {SECONDS}\n[anomalies.dry]\nfactor = 1.45\n")
    for name in ("given.csv", "given.parquet"):
        simulate(folder / "scenario.toml", folder / "wheel.toml", 5, folder / name)
    return folder


@pytest.fixture(scope="session")
def diagnosed(files: Path) -> Result:
    """What `diagnose --json` prints for given.csv."""
    return run("diagnose", files / "given.csv", "--wheel", files / "wheel.toml", "--json")
