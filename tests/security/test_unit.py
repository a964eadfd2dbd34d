"""The unit that systemd is given: it is one, restarts what a restart can mend, and leaves the monitor little."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from rwa_monitor.cli.options import WRONG_USE

UNIT = Path(__file__).parents[2] / "docker" / "rwa-monitor.service"


def unit(key: str) -> list[str]:
    lines = UNIT.read_text(encoding="utf-8").splitlines()
    return [line.removeprefix(f"{key}=") for line in lines if line.startswith(f"{key}=")]


def test_what_a_restart_cannot_mend_is_not_restarted() -> None:
    assert unit("Restart") == ["on-failure"]
    assert unit("RestartPreventExitStatus") == [str(WRONG_USE)]
    assert unit("Type") == ["notify"]
    assert float(unit("WatchdogSec")[0]) > 0


def test_systemd_takes_the_unit_and_finds_little_exposed(tmp_path: Path) -> None:
    analyze = shutil.which("systemd-analyze")
    if analyze is None:
        pytest.skip("no systemd-analyze: apt-get install systemd")
    (program,) = {line.split()[0] for line in unit("ExecStart")}
    installed = tmp_path / UNIT.name
    installed.write_text(UNIT.read_text(encoding="utf-8").replace(program, sys.executable), encoding="utf-8")
    checked = subprocess.run([analyze, "verify", str(installed)], capture_output=True, text=True, check=False)
    assert (checked.returncode, checked.stderr) == (0, "")
    limit = ["--offline=true", "--threshold=15"]  # tenths: 1.5 of 10, where systemd calls 2 and less OK
    exposed = subprocess.run(
        [analyze, "security", *limit, str(installed)], capture_output=True, text=True, check=False, env={}
    )
    assert exposed.returncode == 0, exposed.stdout[-200:]
