"""`diagnose`: tables in, one diagnosis for each window out."""

import json
import os
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result

import rwa_monitor as rwa
from rwa_monitor.messages import Diagnosis
from rwa_monitor.samples import NANOSECONDS_PER_SECOND
from rwa_monitor.switching.carried_state import CarriedState
from rwa_monitor.telemetry.table import table_writer
from rwa_monitor.wheel.wheel import built_in_wheel
from tests.cli.conftest import WINDOW
from tests.cli.test_discrepancy import write
from tests.program import run

MEASURED = os.environ.get("RWA_MEASURED_DATA")


def lines(stdout: str) -> list[dict[str, Any]]:
    """Return the JSON objects, each of which must be a valid diagnosis."""
    found = []
    for line in stdout.splitlines():
        Diagnosis.parse(line.encode(), "line")
        found.append(json.loads(line))
    return found


def without_source(diagnosis: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in diagnosis.items() if name != "source"}


def test_one_line_for_each_window_and_the_last_one_marked_partial(files: Path, diagnosed: Result) -> None:
    assert (diagnosed.exit_code, diagnosed.stderr) == (0, "")
    first, second, third = lines(diagnosed.stdout)
    assert [d["samples"] for d in (first, second, third)] == [WINDOW, WINDOW, WINDOW // 2]
    assert [d["partial"] for d in (first, second, third)] == [False, False, True]
    assert first["spacecraft"] == ""
    assert first["wheel"] == "small"
    assert first["source"] == str(files / "given.csv")
    assert first["window_start_ns"] == 0
    assert first["window_end_ns"] == second["window_start_ns"] == WINDOW * NANOSECONDS_PER_SECOND // 8
    assert list(first["anomalies"]) == ["dry", "viscous", "fss_1", "fss_2"]


def test_what_was_not_used_is_reported(files: Path, tmp_path: Path) -> None:
    header, *rows = (files / "given.csv").read_text().splitlines()
    column = header.split(",").index("friction_torque_Nm")
    cells = [row.split(",") for row in rows]
    for row in range(600, 660):  # the sensor hangs
        cells[row][column] = cells[600][column]
    cells[900][column] = "nan"
    del cells[1_000:1_003]
    table = tmp_path / "broken.csv"
    table.write_text("\n".join([header, *(",".join(row) for row in cells)]) + "\n")
    result = run("diagnose", table, "--wheel", files / "wheel.toml", "--json")
    assert result.exit_code == 0
    assert f"{table}: friction_torque_Nm repeats one value, as a sensor that hangs" in result.stderr
    assert f"{table}: of {len(cells)} samples 60 were masked, 3 slots had none" in result.stderr
    assert "".join(result.stderr.split()).count("masked") == 2
    assert min(d["coverage"] for d in lines(result.stdout)) < 1.0


def test_another_sample_period_is_reported_and_what_could_not_be_judged_at_the_end(files: Path, tmp_path: Path) -> None:
    header, *rows = (files / "given.csv").read_text().splitlines()
    table = tmp_path / "slow.csv"
    table.write_text("\n".join([header, *rows[::8]]) + "\n")
    result = run("diagnose", table, "--wheel", files / "wheel.toml")
    assert result.exit_code == 0  # slots without a sample are masked, whatever the reason
    pictures = result.stdout.strip().split("\n\n")
    assert len(pictures) == 3
    for picture in pictures:
        assert "probability" not in picture
    last = result.stderr.splitlines()[-1]
    assert last.startswith("rwa-monitor: 3 of 3 windows could not be judged, the last: ")
    assert "is sample_period_s = 0.125 of the wheel file right? The samples come every 1 s" in result.stderr


def test_why_derived_friction_is_masked_is_reported(tmp_path: Path) -> None:
    wheel = built_in_wheel()
    wheel = wheel.model_copy(update={"limits": wheel.limits.model_copy(update={"max_current_A": 1.5})})
    (tmp_path / "wheel.toml").write_text(wheel.to_toml())
    count, period_s = 4000, wheel.sample_period_s
    rng = np.random.default_rng(50071)
    acceleration = np.repeat([0.0, 4.0, 0.0, -4.0, 0.0], count // 5)  # slews by steps of torque
    speed = 100.0 + np.cumsum(acceleration * period_s / 4.0)
    torque = 1.6e-3 + 5.3e-6 * speed + 3.9e-5 * rng.normal(size=count) + wheel.inertia_kg_m2 * acceleration / 4.0
    current = torque / wheel.torque_constant_Nm_A
    current[100:107] = 1.5  # at its limit, not beyond
    columns = {"time_s": np.arange(count) * period_s, "speed_rad_s": speed, "motor_current_A": current}
    result = run("diagnose", write(tmp_path / "slews.csv", columns), "--wheel", tmp_path / "wheel.toml", "--json")
    assert result.exit_code == 0
    said = re.search(
        r"of 4000 samples (\d+) were masked \((\d+) where the speed bends .*; 7 with the current at its limit or in",
        result.stderr,
    )
    assert said is not None, result.stderr
    assert int(said[1]) == int(said[2]) + 7


def test_files_are_diagnosed_alike_in_the_order_given_each_from_an_empty_state_unless_it_is_carried(
    files: Path, diagnosed: Result
) -> None:
    names = [files / "given.parquet", files / "given.csv"]
    arguments = ("diagnose", *names, "--wheel", files / "wheel.toml", "--json")
    found = lines(run(*arguments).stdout)
    assert [d["source"] for d in found] == [str(name) for name in names for _ in range(3)]
    alone = [without_source(d) for d in lines(diagnosed.stdout)]
    assert json.dumps([without_source(d) for d in found]) == json.dumps(alone * 2)  # from a CSV and from a Parquet file
    priors = [d["provenance"]["prior_sha256"] for d in found]
    assert priors[0] == CarriedState.empty().sha256()
    carried = [d["provenance"]["prior_sha256"] for d in lines(run(*arguments, "--carry").stdout)]
    assert carried[:3] == priors[:3]
    assert carried[3] not in priors


def test_a_person_reads_verdict_and_reason_first(files: Path) -> None:
    result = run("diagnose", files / "given.csv", "--wheel", files / "wheel.toml")
    assert result.exit_code == 0
    first, *_ = result.stdout.split("\n\n")
    head, verdict, *_ = first.splitlines()
    assert head.startswith(str(files / "given.csv"))
    assert verdict.startswith("ANOMALOUS  Base dry friction is ")
    assert "partial" in result.stdout


def test_the_method_of_the_paper(files: Path) -> None:
    result = run("diagnose", files / "given.csv", "--wheel", files / "wheel.toml", "--json", "--method", "paper")
    assert {d["provenance"]["method"] for d in lines(result.stdout)} == {"paper"}


def test_what_is_left_out_and_what_the_wheel_lacks_is_reported(tmp_path: Path) -> None:
    table, wheel = tmp_path / "table.csv", tmp_path / "wheel.toml"
    table.write_text("time_s,speed_rad_s,friction_torque_Nm,mode\n0,1,2,a\n0.1,1,2,b\n")
    wheel.write_text('[wheel]\nname = "bare"\nsample_period_s = 0.1\n')
    result = run("diagnose", table, "--wheel", wheel, "--json")
    assert result.exit_code == 0
    assert f"rwa-monitor: {table}: columns ignored: mode\n" in result.stderr
    assert "rwa-monitor: bare: no [nominal]: " in result.stderr
    (diagnosis,) = lines(result.stdout)
    assert (diagnosis["verdict"], diagnosis["partial"], diagnosis["samples"]) == ("inconclusive", True, 2)


def test_what_is_not_judged_has_no_probability(files: Path, tmp_path: Path) -> None:
    wheel = tmp_path / "wheel.toml"
    wheel.write_text('[wheel]\nname = "bare"\nsample_period_s = 0.125\n')
    shown = run("diagnose", files / "given.csv", "--wheel", wheel).stdout
    assert "no part of it is judged" in " ".join(shown.split())
    rows = re.findall(r"^(?:dry|viscous) +(.*?) {2,}(\S+) {2,}(\S+) {2,}", shown, re.MULTILINE)
    assert rows
    assert set(rows) == {("not judged", "–", "–")}


def test_one_sample_is_too_little_and_no_fault_of_the_telemetry(files: Path, tmp_path: Path) -> None:
    table = tmp_path / "one.csv"
    table.write_text("time_s,speed_rad_s,friction_torque_Nm\n0,100,2e-3\n")
    (diagnosis,) = lines(run("diagnose", table, "--wheel", files / "wheel.toml", "--json").stdout)
    assert diagnosis["reason"].startswith("The window holds 1 samples: too few to measure friction")
    assert "telemetry link" not in diagnosis["explanation"]


def test_a_bad_file_is_named_the_others_are_done_and_it_is_exit_2(files: Path, tmp_path: Path) -> None:
    bad = tmp_path / "bad.csv"
    bad.write_text("time_s,speed_rad_s\n0,1\n0,1\n")
    arguments = ("diagnose", files / "given.csv", bad, files / "given.csv", "--wheel", files / "wheel.toml", "--json")
    result = run(*arguments)
    assert result.exit_code == 2
    (line,) = result.stderr.splitlines()
    assert line.startswith(f"rwa-monitor: {bad}: row 3, column time_s: time does not increase (0 s after 0 s); sort")
    assert len(lines(result.stdout)) == 6
    carried = run(*arguments, "--carry")
    assert (carried.exit_code, len(lines(carried.stdout))) == (2, 3)  # it ends there


@pytest.mark.measured
@pytest.mark.skipif(MEASURED is None, reason="RWA_MEASURED_DATA does not say where the measured tables are")
@pytest.mark.parametrize("method", ["joint", "paper"])
def test_the_measured_joints_go_through_with_their_wheel(method: str) -> None:
    folder = Path(str(MEASURED)) / "tx40"
    tables = [folder / f"joint{number}.csv" for number in range(1, 7)]
    result = run("diagnose", *tables, "--wheel", folder / "wheel.toml", "--json", "--method", method)
    assert result.exit_code == 0
    diagnoses = lines(result.stdout)
    assert [d["source"] for d in diagnoses] == [str(table) for table in tables]
    # Published viscous coefficients of the six joints [N m s/rad], from the README beside the tables: the fit with dry
    # and viscous friction alone must land near them. Joint 6 is coupled to joint 5, which its table does not hold.
    for diagnosis, published in zip(diagnoses[:5], (8.05, 5.53, 1.97, 1.11, 1.86), strict=True):
        assert (diagnosis["samples"], diagnosis["partial"]) == (1760, False)
        assert diagnosis["verdict"] == "inconclusive"
        assert diagnosis["friction"]["viscous"]["value"] == pytest.approx(published, rel=0.25)


# ---- the trend over windows ------------------------------------------------------------------------------------------

GROWING = "[anomalies.viscous]\nfactor = 1.5\nonset_s = 4000.0\ngrowth_s = 6000.0\n"


def test_the_last_lines_name_the_trend_of_files_that_follow_each_other(tmp_path: Path) -> None:
    """Ten windows of 8,000 samples in which viscous friction begins to grow in the fifth."""
    wheel = rwa.read_wheel()
    wheel = wheel.model_copy(update={"window": wheel.window.model_copy(update={"samples": 8_000, "hop": 8_000})})
    table, wheel_file = tmp_path / "growing.csv", tmp_path / "wheel.toml"
    table_writer(table)(rwa.simulate(rwa.Scenario.from_toml(GROWING, "growing"), wheel, seed=3).samples, table)
    wheel_file.write_text(wheel.to_toml())
    result = run("diagnose", table, "--wheel", wheel_file)
    assert result.exit_code == 0
    dry, viscous = result.stdout.rstrip().splitlines()[-2:]
    assert ": No trend of base dry friction in 10 windows" in dry
    assert ": Viscous friction grows by " in viscous
    assert "trend" not in run("diagnose", table, table, "--wheel", wheel_file).stdout  # of the same time: no history
    result = run("diagnose", table, "--wheel", wheel_file, "--json")
    assert [json.loads(line)["samples"] for line in result.stdout.splitlines()] == [8_000] * 10
