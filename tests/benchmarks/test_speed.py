"""The speed benchmark: its peers do the same work, its ratios hold with generous slack, its results can be kept."""

import subprocess
import sys

import numpy as np
import pytest

from benchmarks.machine import peak_memory_bytes
from benchmarks.speed import detection, live, peers, search
from benchmarks.speed.race import Runner, laps
from benchmarks.speed.windows import hard_window, time_hard_window, time_windows
from benchmarks.window import Window, window_of
from rwa_monitor.diagnosis.model import built_in_model
from rwa_monitor.kernels.wglr import wglr
from rwa_monitor.paper.detection import Signal
from rwa_monitor.paper.detection import wglr as plain_wglr
from rwa_monitor.simulation.datasets import generate
from rwa_monitor.wheel.wheel import built_in_wheel

# A ratio may be so many times its target before a test fails: processor times of short runs on a shared machine.
SLACK = 5.0
SEED = 8_129


@pytest.fixture(scope="module")
def window() -> Window:
    return window_of(next(iter(generate("paper", 1, SEED))))


# ---- the same work ---------------------------------------------------------------------------------------------------


def test_the_fastest_peer_finds_what_the_truth_holds() -> None:
    pytest.importorskip("skchange", reason="no skchange: make venv")
    labelled = next(iter(generate("paper", 1, SEED)))
    truth = labelled.telemetry.truth.changepoints
    found = np.asarray(peers.skchange_fpop().search(window_of(labelled).series()))
    jumps = np.unique(truth.index[truth.visible])
    assert np.mean([np.abs(found - jump).min() <= 5 for jump in jumps]) > 0.95


# ---- ratios ----------------------------------------------------------------------------------------------------------


def test_kernels_beside_plain_numpy_and_the_limit(window: Window) -> None:
    x, z = window.x, window.z
    found = laps(
        [
            Runner("limit", "limit", detection.five_sums(x, z)),
            Runner("one", "ours", lambda: wglr(x, z, window.good, 50, 1e-4, 1.0)),
            Runner("seven", "ours", detection.seven_scales(window)),
            Runner("plain", "peer", lambda: plain_wglr(Signal(x, z, window.good), 1.0)),
        ],
        rounds=5,
    )
    least = {lap.name: lap.least_s for lap in found}
    assert least["seven"] <= SLACK * least["plain"]
    assert least["one"] <= SLACK * 6.0 * least["limit"]


def test_whole_windows_beside_the_kernel_and_the_plain_method() -> None:
    times = time_windows(generate("paper", 6, SEED), built_in_model(), None, repeats=2)
    allowed = 0.25 * np.median(times.kernel) + 0.003
    assert np.median(times.close) <= SLACK * allowed
    assert np.isfinite(times.plain).sum() == 2  # every fifth
    assert np.nanmean(times.plain) >= np.mean(times.whole) / SLACK


def test_the_incremental_step_beside_the_same_at_once(window: Window) -> None:
    of_built_in = Window(
        built_in_wheel(), window.speed_rad_s, window.torque_Nm, window.good, window.noise_std, window.slope
    )
    least = {lap.name: lap.least_s for lap in live.step_laps(of_built_in, built_in_model())}
    assert least[live.STEP_BATCH] <= SLACK * 2.0 * least[live.STEP_AT_ONCE]
    cost = live.cost_by_length(of_built_in, built_in_model(), (20_000, 200_000))
    assert cost[200_000] <= SLACK * cost[20_000]


def test_a_window_of_many_alike_jumps_is_bounded_and_reports_that_it_pruned() -> None:
    wheel = built_in_wheel()
    one, two = hard_window(wheel, np.random.default_rng(1)), hard_window(wheel, np.random.default_rng(1))
    np.testing.assert_array_equal(one.torque_Nm, two.torque_Nm)
    hard = time_hard_window(wheel, built_in_model(), SEED, repeats=1)
    assert (hard.candidates, hard.systems, hard.pruned) == (pytest.approx(200, abs=10), 3, True)
    assert hard.states < 2_000 * 5 * hard.candidates  # budget of a candidate, rounds of the search


# ---- what is kept ----------------------------------------------------------------------------------------------------


def test_the_peak_memory_of_a_process_is_not_that_of_the_one_that_started_it() -> None:
    large = np.ones(60_000_000)
    ask = "from benchmarks.machine import peak_memory_bytes; print(peak_memory_bytes())"
    child = subprocess.run([sys.executable, "-c", ask], capture_output=True, text=True, check=True)
    assert int(child.stdout) < large.nbytes < peak_memory_bytes()


def test_a_search_in_a_process_of_its_own_reports_what_it_cost() -> None:
    costs = [search.measure_apart(4000, 1, threads=2), search.measure(8000, 1, threads=1)]
    assert [cost.named for cost in costs] == [("stribeck",), ("stribeck",)]
    assert costs[0].memory_GB < 2.0
    assert search.growth(costs) < SLACK * search.MOST_GROWTH
