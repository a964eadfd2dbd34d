"""Options from file, environment and command line: one precedence, and no mistyped name without a message."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from rwa_monitor.cli.main import main
from tests.monitor.support import free_port
from tests.program import run


def tuned(monkeypatch: pytest.MonkeyPatch, *words: str, **environment: str) -> str:
    """Return what `tune` prints; it has numbers as options and needs no file."""
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    result = run(*words)
    assert result.exit_code == 0, result.stderr
    return result.stdout


@pytest.fixture
def settings(tmp_path: Path) -> Path:
    file = tmp_path / "settings.toml"
    file.write_text("[tune]\nmissed = 0.002\nrun-length = 2e6\njump = 9.0\n")
    return file


def test_the_command_line_goes_before_the_environment_before_the_file(
    settings: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def plain(jump: str) -> str:
        return tuned(monkeypatch, "tune", "--missed", "0.002", "--run-length", "2e6", "--jump", jump)

    nine, eight, seven = plain("9"), plain("8"), plain("7")
    assert len({nine, eight, seven}) == 3
    assert tuned(monkeypatch, "--settings", str(settings), "tune") == nine
    monkeypatch.setenv("RWA_MONITOR_SETTINGS", str(settings))
    assert tuned(monkeypatch, "tune") == nine
    assert tuned(monkeypatch, "tune", RWA_MONITOR_TUNE_JUMP="8") == eight
    assert tuned(monkeypatch, "tune", "--jump", "7") == seven


def test_a_wrong_value_in_the_environment_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RWA_MONITOR_TUNE_JUMP", "large")
    result = run("tune", "--missed", "0.002", "--run-length", "2e6")
    assert (result.exit_code, result.stdout) == (2, "")
    assert "'large' is not a valid float" in result.stderr


def test_doctor_does_not_take_an_empty_line_for_a_bus() -> None:
    told = run("doctor", "-e", f"tcp/127.0.0.1:{free_port()}")
    assert told.exit_code == 1
    assert "FAILED  bus: nothing answers at tcp/127.0.0.1:" in told.stdout


def test_bash_completes_commands_and_options(monkeypatch: pytest.MonkeyPatch) -> None:
    def completed(words: str, number: int) -> set[str]:
        environment: dict[str, Any] = {
            "_RWA_MONITOR_COMPLETE": "bash_complete", "COMP_WORDS": words, "COMP_CWORD": str(number)
        }  # fmt: skip
        result = CliRunner().invoke(main, [], env=environment, prog_name="rwa-monitor", standalone_mode=True)
        return {line.partition(",")[2] for line in result.stdout.splitlines()}

    assert {"diagnose", "discrepancy"} <= completed("rwa-monitor di", 1)
    assert completed("rwa-monitor diagnose --met", 2) == {"--method"}
