"""`simulate` and `train`: the same seed gives the same bytes, the truth lies beside, and what was made can be used."""

import json
from pathlib import Path

import pyarrow.parquet as pq

import rwa_monitor as rwa
from rwa_monitor.monitor.setup import read_wheel
from tests.cli.conftest import SECONDS, simulate
from tests.program import run
from tests.telemetry.packet_writer import write_packets


def test_the_same_seed_gives_the_same_bytes_and_another_one_does_not(files: Path, tmp_path: Path) -> None:
    for seed, name in ((5, "again.csv"), (6, "other.csv")):
        simulate(files / "scenario.toml", files / "wheel.toml", seed, tmp_path / name)
    given = (files / "given.csv").read_bytes()
    assert (tmp_path / "again.csv").read_bytes() == given
    assert (tmp_path / "other.csv").read_bytes() != given


def test_truth_and_wheel_lie_beside_the_recording(files: Path) -> None:
    slots = round(SECONDS * 8)
    truth = json.loads((files / "given.csv.truth.json").read_text())
    assert truth["slots"] == slots
    assert truth["seed"] == 5
    assert truth["labels"]["dry"] is True
    every_slot = pq.read_table(files / "given.csv.truth.pq")
    assert every_slot.num_rows == slots
    assert {"speed_rad_s", "base_dry_Nm", "fss_1.configuration", "fss_2.fss_friction_Nm"} <= set(
        every_slot.column_names
    )
    assert read_wheel(files / "given.csv.wheel.toml") == read_wheel(files / "wheel.toml")


def test_packets_cut_at_the_end_are_diagnosed_and_the_exit_code_is_3(tmp_path: Path) -> None:
    packets = tmp_path / "day.ccsds"
    write_packets(rwa.simulate().samples, packets)
    packets.write_bytes(packets.read_bytes()[:100_001])
    result = run("diagnose", packets, "--xtce", f"{packets}.xtce.xml", "--map", f"{packets}.map.toml", "--json")
    assert result.exit_code == 3
    assert "are no whole packet" in result.stderr
    assert len(result.stdout.splitlines()) == 1
    refused = run("diagnose", packets)
    assert refused.exit_code == 2
    assert "--xtce gives their definition" in refused.stderr
