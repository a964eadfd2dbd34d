"""`rwa-monitor manoeuvre` as a user runs it."""

import json
from pathlib import Path

from rwa_monitor.wheel.wheel import Noise, built_in_wheel
from tests.program import run


def test_a_line_for_each_change_of_speed_and_the_same_in_json() -> None:
    table = run("manoeuvre", "viscous", "--speed", "200")
    assert table.exit_code == 0, table.stderr
    found = json.loads(run("manoeuvre", "viscous", "--speed", "200", "--json").stdout)
    assert (found["friction"], found["certainty"]) == ("viscous", 0.95)
    for one in found["manoeuvres"]:
        assert f"{one['duration_s']:.0f}" in table.stdout


def test_what_no_change_decides_is_exit_code_1(tmp_path: Path) -> None:
    wheel = built_in_wheel()
    (tmp_path / "noisy.toml").write_text(wheel.model_copy(update={"noise": Noise(friction_std_Nm=1.0)}).to_toml())
    noisy = run("manoeuvre", "viscous", "--wheel", tmp_path / "noisy.toml")
    assert noisy.exit_code == 1
    assert "no change of speed within the wheel's limits" in noisy.stderr


def test_a_speed_beyond_the_limit_is_refused_in_one_line() -> None:
    refused = run("manoeuvre", "dry", "--speed", "10000")
    assert (refused.exit_code, len(refused.stderr.splitlines())) == (2, 1)
    assert "limits.max_speed_rad_s" in refused.stderr
