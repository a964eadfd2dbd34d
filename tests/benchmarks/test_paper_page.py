"""`make benchmark-paper` on a few windows: every table and figure of the paper is there, and counts what it states."""

import re
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from scipy import special

from benchmarks.paper.__main__ import main
from benchmarks.paper.examine import ERROR_STEP, ORACLE, examine
from benchmarks.paper.peers import add_second_source, candidates, score
from benchmarks.speed.peers import Peer
from benchmarks.window import window_of
from rwa_monitor.simulation.datasets import LabelledWindow, generate
from rwa_monitor.simulation.record import Changepoints

SEED = 51


@pytest.fixture(scope="module")
def windows() -> list[LabelledWindow]:
    return list(generate("paper", 4, SEED))


def test_the_command_writes_every_table_and_figure(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "paper.md"
    assert main(["--quick", "--workers", "0", "--seed", str(SEED), "-o", str(file)]) == 0
    text = file.read_text(encoding="utf-8")
    assert capsys.readouterr().out == text
    for heading in (
        "All in one table",
        "Average run length",
        "Excess RMSE and survival",
        "Rejected changepoints",
        "Work of the assignment",
        "Anomalies diagnosed",
        "Number of bins",
        "Time",
        "Changepoints beside other packages",
        "FPOP as a second source",
    ):
        assert re.search(rf"^##+ {heading}", text, re.MULTILINE), heading
    assert "too few to call a target missed" in text
    for name in (
        "visible jumps right in place and system",
        "mean excess RMSE with changepoints",
        "`paper`, hard laws",
        "skchange FPOP",
        "skchange MovingWindow",
        "dummy: every 3000 samples",
    ):
        assert name in text
    shown = re.findall(r"!\[[^]]+\]\(([^)]+)\)", text)
    assert len(shown) == 6
    for picture in shown:
        root = ET.fromstring((file.parent / picture).read_text(encoding="utf-8"))
        assert root.tag == "{http://www.w3.org/2000/svg}svg"
        assert len(list(root.iter("{http://www.w3.org/2000/svg}path"))) > 3


def test_errors_are_those_of_the_noise_where_jumps_are_known(windows: list[LabelledWindow]) -> None:
    examined = [examine(window) for window in windows]
    counts = np.sum([one.fitted[ORACLE].errors for one in examined], axis=0)
    std = windows[0].telemetry.truth.noise_std_Nm / windows[0].wheel.torque_unit_Nm
    within = counts[: round(std / ERROR_STEP)].sum() / counts.sum()
    width = ERROR_STEP * round(std / ERROR_STEP) / std  # the edge of the bin beside σ
    expected = special.erf(width / np.sqrt(2.0))
    assert within == pytest.approx(expected, abs=5 * np.sqrt(expected * (1 - expected) / counts.sum()))
    for one in examined:
        # A thousandth of the noise: a window of 80,000 samples gives its σ to 1/√160,000.
        assert abs(one.fitted[ORACLE].excess_rmse) < 10 * std / np.sqrt(160_000)
        assert one.fitted["joint"].excess_rmse < one.naive_excess_rmse


def jumps(*index: int, visible: tuple[bool, ...] | None = None) -> Changepoints:
    n = len(index)
    return Changepoints(
        index=np.array(index, dtype=np.int64),
        system=np.zeros(n, dtype=np.int64),
        jump_Nm=np.ones(n),
        visible=np.ones(n, dtype=bool) if visible is None else np.array(visible),
        information=np.ones(n),
    )


@pytest.mark.parametrize(
    ("found", "truth", "expected"),
    [
        ([100, 205], jumps(100, 200), (2, 2, 0)),
        ([100, 206], jumps(100, 200), (2, 1, 1)),
        ([98, 101], jumps(100), (1, 1, 1)),  # the second one of the same jump is false
        ([100], jumps(100, 100), (1, 1, 0)),  # two at once are one
        ([100, 104], jumps(97, 103), (2, 2, 0)),  # the nearest first
        ([100], jumps(100, 300, visible=(False, True)), (1, 0, 0)),  # too small to be seen: neither right nor false
        ([], jumps(100), (1, 0, 0)),
        ([100], jumps(), (0, 0, 1)),
    ],
)
def test_changepoints_are_counted_once(found: list[int], truth: Changepoints, expected: tuple[int, int, int]) -> None:
    assert score(np.array(found, dtype=np.int64), truth) == expected


def test_a_second_source_that_knows_the_truth_recovers_all_that_ours_miss(windows: list[LabelledWindow]) -> None:
    labelled = windows[0]
    window, truth = window_of(labelled), labelled.telemetry.truth.changepoints
    kept = np.flatnonzero(window.moving)
    told = np.searchsorted(kept, np.unique(truth.index))
    added = add_second_source([labelled], Peer("truth", lambda series: told))
    visible, found, false = score(candidates(window), truth)
    assert (added.visible, added.missed, added.false_ours) == (visible, visible - found, false)
    assert added.recovered == added.missed
    assert added.false_both == added.false_ours
