"""The shortest change of speed that decides: it does, once it is flown, and without it the window is inconclusive."""

import json
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwa_monitor.diagnosis.manoeuvre import Manoeuvre, deciding_manoeuvres
from rwa_monitor.diagnosis.model import built_in_model
from rwa_monitor.errors import InputError
from rwa_monitor.kernels.running_sums import BLOCK
from rwa_monitor.monitor.core import diagnose_samples
from rwa_monitor.samples import FloatArray, Samples
from rwa_monitor.simulation.motion import SpeedProfile
from rwa_monitor.simulation.record import simulate
from rwa_monitor.simulation.scenario import Anomaly, Scenario
from rwa_monitor.wheel.wheel import Noise, built_in_wheel
from tests.program import run

WHEEL, MODEL = built_in_wheel(), built_in_model()
SPEED, WINDOW, BEGIN = 200.0, 80_000, 40_000  # rad/s, slots
SEEDS = range(6)
Friction = Literal["dry", "viscous"]


def change_of_speed(one: Manoeuvre) -> FloatArray:
    """The speed of a manoeuvre beyond that of the window, on slots: the first speed, then high and low in turns."""
    hold = round(one.hold_s / WHEEL.sample_period_s)
    change = np.zeros(WINDOW)
    for number in range(one.changes):  # each change has a hold before it and one after it
        at = BEGIN + 2 * hold * number
        before, after = (0.0, one.change_rad_s) if number % 2 == 0 else (one.change_rad_s, 0.0)
        change[at : at + hold], change[at + hold : at + 2 * hold] = before, after
    return change


def verdict(seed: int, name: Friction, *, failing: bool, change: FloatArray | float) -> tuple[str, float]:
    """Return the verdict of a window at one speed but for a change, and the probability of the anomaly."""
    learned = MODEL.anomaly(name)
    anomalies = {name: Anomaly(factor=learned.levels[0].median)} if failing else {}
    profile = SpeedProfile(kind="constant", direction=1, scale=SPEED / WHEEL.speed_unit_rad_s)
    scenario = Scenario(speed=profile, duration_s=WINDOW * WHEEL.sample_period_s, anomalies=anomalies)
    run = simulate(scenario, WHEEL, np.random.default_rng(seed))
    truth, speed = run.truth, run.truth.speed_rad_s + change
    level = truth.base_dry_Nm + sum(truth.fss_friction_Nm.values())
    friction = level + truth.viscous_Nm_s_rad * speed + truth.noise_Nm
    (window,) = diagnose_samples(Samples(run.samples.time_ns, speed, friction), WHEEL, MODEL)
    return window.diagnosis.verdict, window.diagnosis.anomalies[name].probability


@pytest.mark.parametrize("name", ["dry", "viscous"])
def test_what_is_flown_decides(name: Friction) -> None:
    found = deciding_manoeuvres(WHEEL, MODEL, name, 0.95, SPEED)
    assert len(found) >= 6
    for one in found[::2]:
        change = change_of_speed(one)
        healthy = [verdict(seed, name, failing=False, change=change) for seed in SEEDS]
        failing = [verdict(seed, name, failing=True, change=change) for seed in SEEDS]
        right = [found == "nominal" for found, _ in healthy]
        right += [found == "anomalous" and share > 0.5 for found, share in failing]
        assert sum(right) >= 10, one  # of 12; fewer come in 2 % of the cases at 95 %
    without = [verdict(seed, name, failing=False, change=0.0)[0] for seed in SEEDS]
    assert without == ["inconclusive"] * len(without)


def test_a_window_at_one_speed_names_the_command() -> None:
    scenario = Scenario(speed=SpeedProfile(kind="constant"), duration_s=WINDOW * WHEEL.sample_period_s)
    samples = simulate(scenario, WHEEL, np.random.default_rng(1)).samples
    (window,) = diagnose_samples(samples, WHEEL, MODEL)
    assert window.diagnosis.verdict == "inconclusive"
    assert "rwa-monitor manoeuvre" in window.diagnosis.explanation


@given(certainty=st.floats(0.6, 0.99), more=st.floats(1.0, 3.0))
def test_more_certainty_and_more_noise_take_longer(certainty: float, more: float) -> None:
    noisier = WHEEL.model_copy(update={"noise": Noise(friction_std_Nm=more * WHEEL.noise.friction_std_Nm)})
    plain = {one.change_rad_s: one for one in deciding_manoeuvres(WHEEL, MODEL, "viscous", certainty, SPEED)}
    for one in deciding_manoeuvres(noisier, MODEL, "viscous", certainty, SPEED):
        assert one.duration_s >= 0.99 * plain[one.change_rad_s].duration_s  # a hold is whole samples
    for one in deciding_manoeuvres(WHEEL, MODEL, "viscous", 0.5 + 0.5 * certainty, SPEED):
        assert one.duration_s >= 0.99 * plain[one.change_rad_s].duration_s


def test_larger_changes_are_held_shorter_but_for_a_block_of_samples() -> None:
    holds = [one.hold_s * one.changes for one in deciding_manoeuvres(WHEEL, MODEL, "viscous", 0.95, SPEED)]
    assert holds == sorted(holds, reverse=True)
    assert min(holds) == BLOCK * WHEEL.sample_period_s


def test_where_the_wheel_cannot_run_faster_it_is_slowed_down_and_beyond_its_limit_it_is_refused() -> None:
    top = WHEEL.limits.max_speed_rad_s
    assert all(one.change_rad_s <= 0.9 * top for one in deciding_manoeuvres(WHEEL, MODEL, "dry", 0.95, -0.9 * top))
    slow = deciding_manoeuvres(WHEEL, MODEL, "dry", 0.95, 0.5 * top)
    assert max(one.change_rad_s for one in slow) <= 0.5 * top
    with pytest.raises(InputError, match=r"limits\.max_speed_rad_s"):
        deciding_manoeuvres(WHEEL, MODEL, "dry", 0.95, 1.1 * top)


def test_a_wheel_without_noise_is_refused_with_what_to_do() -> None:
    with pytest.raises(InputError, match="noise: is missing: rwa-monitor identify learns it"):
        deciding_manoeuvres(WHEEL.model_copy(update={"noise": Noise()}), MODEL, "dry", 0.95, SPEED)


# ---- `rwa-monitor manoeuvre` as a user runs it -----------------------------------------------------------------------


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
