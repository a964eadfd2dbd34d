"""The command `discrepancy` on what it cannot use or cannot separate, and on two recordings of a wheel."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rwa_monitor.wheel.wheel import Limits, built_in_wheel
from tests.discrepancy.simple import NOISE_NM, PERIOD_S, current_of, record, swing
from tests.program import run

COUNT = 1500
WHEEL = built_in_wheel()
Columns = dict[str, np.ndarray]


def columns(seed: int = 0, count: int = COUNT, speed: np.ndarray | None = None) -> Columns:
    """A plain record as the columns of a table."""
    made, _ = record(swing(count) if speed is None else speed, jumps=(700,), seed=seed)
    time = np.arange(count) * PERIOD_S
    return {"time_s": time, "speed_rad_s": made.speed_rad_s, "friction_torque_Nm": made.friction_torque_Nm}


def with_current(table: Columns) -> Columns:
    """The same measured by current instead of friction."""
    current = current_of(table["friction_torque_Nm"], table["speed_rad_s"])
    return {**{name: table[name] for name in ("time_s", "speed_rad_s")}, "motor_current_A": current}


def write(path: Path, table: Columns) -> Path:
    np.savetxt(
        path, np.column_stack([*table.values()]), delimiter=",", header=",".join(table), comments="", fmt="%.12g"
    )
    return path


def rpm(table: Columns) -> Columns:
    return {**table, "speed_rad_s": table["speed_rad_s"] * 60 / (2 * np.pi)}


def at_end_stop(torque: np.ndarray) -> np.ndarray:
    limit = 0.5 * float(np.median(np.abs(torque)))
    return np.clip(torque, -limit, limit)


@pytest.mark.parametrize(
    ("measured", "exit_code", "words"),
    [
        (lambda torque: 1e3 * torque, 2, "nominal friction on the median; wrong unit?"),  # in mN m
        (at_end_stop, 2, "friction_torque_Nm: is saturated"),  # what a sensor shows then is its range, not a law
        (np.negative, 0, "friction drives the rotation on the average; is the sign of speed or torque right?"),
    ],
)
def test_what_cannot_be_used_is_refused_and_an_opposite_sign_raises_a_question(
    measured: Callable[[np.ndarray], np.ndarray], exit_code: int, words: str, tmp_path: Path
) -> None:
    table = {**columns(), "friction_torque_Nm": measured(columns()["friction_torque_Nm"])}
    done = run("discrepancy", write(tmp_path / "t.csv", table), "--json", "--no-diagnosis")
    assert done.exit_code == exit_code
    assert bool(done.stdout) == (exit_code == 0)
    assert "t.csv: " in done.stderr.splitlines()[-1]
    assert words in done.stderr


def test_a_current_at_its_end_stop_now_and_then_is_left_out_and_reported(tmp_path: Path) -> None:
    table = with_current(columns())
    limit = float(np.quantile(np.abs(table["motor_current_A"]), 0.95))
    table["motor_current_A"] = np.clip(table["motor_current_A"], -limit, limit)
    done = run("discrepancy", write(tmp_path / "t.csv", table), "--json")
    assert done.exit_code == 0, done.stderr
    assert "motor_current_A is at its end stop in 5.0% of the samples; left out, with those among them" in done.stderr
    assert json.loads(done.stdout)["verdict"] == "adequate"


def test_a_current_mostly_at_its_end_stop_is_refused_where_friction_hangs_on_it(tmp_path: Path) -> None:
    table = with_current(columns())
    limit = float(np.quantile(np.abs(table["motor_current_A"]), 0.6))
    clipped = np.clip(table["motor_current_A"], -limit, limit)
    done = run("discrepancy", write(tmp_path / "t.csv", {**table, "motor_current_A": clipped}), "--json")
    assert done.exit_code == 2
    assert "motor_current_A: is saturated: 40% of the values" in done.stderr
    given = {**columns(), "motor_current_A": clipped}
    done = run("discrepancy", write(tmp_path / "given.csv", given), "--json")
    assert done.exit_code == 0, done.stderr
    assert "the channel is not used" in done.stderr
    untested = {entry["effect"]: entry["missing"] for entry in json.loads(done.stdout)["untested"]}
    assert untested["torque_constant_error"] == "motor_torque_Nm"


def test_unusual_friction_is_a_warning_and_two_recordings_are_one_report(tmp_path: Path) -> None:
    dry, viscous = WHEEL.nominal.dry_torque_Nm / 8, WHEEL.nominal.viscous_Nm_s_rad / 8
    weaker = WHEEL.nominal.model_copy(update={"dry_torque_Nm": dry, "viscous_Nm_s_rad": viscous})
    (tmp_path / "wheel.toml").write_text(WHEEL.model_copy(update={"nominal": weaker}).to_toml())
    files = []
    for seed in (1, 2):
        table = columns(seed, speed=swing(COUNT, period_s=90.0))
        table["friction_torque_Nm"] = table["friction_torque_Nm"] + 10 * NOISE_NM
        files.append(write(tmp_path / f"part{seed}.csv", table))
    done = run("discrepancy", *files, "--json", "--wheel", tmp_path / "wheel.toml")
    assert done.exit_code == 0, done.stderr
    assert "part1.csv: friction is" in done.stderr
    report = json.loads(done.stdout)  # one object for both
    assert report["verdict"] == "inadequate"
    first = report["effects"][0]
    assert "torque_bias" in {first["name"], *first["equivalent"]}
    assert 0 < first["p_value"] < 0.01


@pytest.mark.parametrize("how", ["given", "derived"])
def test_rpm_are_asked_about_without_limits(how: str, tmp_path: Path) -> None:
    table = columns(count=4000)
    table = rpm(table if how == "given" else with_current(table))
    wheel = WHEEL.model_copy(update={"limits": Limits()})
    (tmp_path / "wheel.toml").write_text(wheel.to_toml())
    done = run("discrepancy", write(tmp_path / "t.csv", table), "--no-diagnosis", "--wheel", tmp_path / "wheel.toml")
    assert "in rpm?" in done.stderr
    # A bearing may have changed: where friction is given that is a question; an inertia has not.
    assert done.exit_code == (0 if how == "given" else 2)
