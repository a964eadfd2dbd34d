"""Datasets: the statistics that their recipes promise, labels and truth."""

import itertools
import json
from dataclasses import replace

import numpy as np
import pytest

from rwa_monitor.errors import InputError
from rwa_monitor.simulation.datasets import (
    BASE_CUT,
    BASE_DRY_STD,
    MILD_SEVERITIES,
    PAPER_JUMP_RATE,
    PAPER_SEVERITIES,
    RECIPES,
    generate,
    scaled_law,
    truth_document,
)
from rwa_monitor.simulation.record import simulate
from rwa_monitor.simulation.scenario import Scenario
from rwa_monitor.wheel.durations import Geometric, Histogram, Lognormal, Uniform, Weibull
from rwa_monitor.wheel.wheel import Wheel, built_in_wheel


def test_paper_has_26_changepoints_plus_minus_10_in_either_direction():
    """150 windows: the mean's spread is 10/√150 = 0.8, that of the standard deviation 0.6; bounds are three of them."""
    truths = [window.telemetry.truth for window in generate("paper", 150, 23)]
    counts = [int(truth.changepoints.visible.sum()) for truth in truths]
    assert np.mean(counts) == pytest.approx(26.0, abs=2.5)
    assert np.std(counts) == pytest.approx(10.0, abs=1.8)
    # The share of positive speed is symmetric about one half; of 150 windows its mean has a spread of at most 0.04.
    assert np.mean([np.mean(truth.speed_rad_s > 0) for truth in truths]) == pytest.approx(0.5, abs=0.12)


def test_paper_and_mild_have_the_papers_noise_and_statuses():
    for recipe, severities in (("paper", PAPER_SEVERITIES), ("mild", MILD_SEVERITIES)):
        windows = list(generate(recipe, 10, 17))
        assert {window.status for window in windows} == {"nominal", *severities}
        directions = set()
        for window in windows:
            truth = window.telemetry.truth
            assert truth.noise_std_Nm / window.wheel.nominal.dry_torque_Nm == pytest.approx(0.024, abs=0.001)
            assert len(window.telemetry.samples) == 80_000
            assert sum(window.labels.values()) <= 1
            for name, active in window.labels.items():
                assert truth.factors[name] == (severities[name] if active else 1.0)
            base = truth.base_dry_Nm[0] / window.wheel.nominal.dry_torque_Nm / truth.factors["dry"]
            assert abs(base - 1.0) <= BASE_CUT * BASE_DRY_STD + 1e-12
            directions |= set(np.sign(truth.speed_rad_s[truth.used]))
        assert directions == {-1.0, 1.0}


def test_each_wheel_has_its_own_laws_and_its_file_states_them():
    windows = list(generate("paper", 8, 17))
    assert all(Wheel.from_toml(window.wheel.to_toml(), "wheel.toml") == window.wheel for window in windows)
    factors = {window.wheel.fss[1].durations[0].low / built_in_wheel().fss[1].durations[0].low for window in windows}
    assert len(factors) == 8
    assert 1 / PAPER_JUMP_RATE[1] - 1e-3 < min(factors) < max(factors) < 1 / PAPER_JUMP_RATE[0] + 1e-3


def test_hard_is_hard():
    statuses = set()
    for window in generate(replace(RECIPES["hard"], windows=2), 48, 17):
        statuses.add(window.status)
        truth, wheel = window.telemetry.truth, window.wheel
        assert len(wheel.fss) == 3
        noise = truth.noise_Nm - truth.noise_Nm.mean()
        assert np.mean(noise[1:] * noise[:-1]) / np.mean(noise**2) == pytest.approx(0.5, abs=0.03)
        assert truth.faulty.any()  # every window of a life has its gaps
        assert len(window.telemetry.samples) < 80_000
        assert np.any(truth.speed_rad_s[1:] * truth.speed_rad_s[:-1] < 0)
        jumps = np.abs(truth.changepoints.jump_Nm) / wheel.noise.friction_std_Nm
        factor = np.array([truth.factors[fss.name] for fss in wheel.fss])[truth.changepoints.system]
        healthy = jumps[factor == 1.0]
        assert np.all((healthy > 3.0 - 1e-9) & (healthy < 6.0 + 1e-9))
    assert "nominal" in statuses
    assert any("+" in status for status in statuses)


def test_derived_has_no_friction_but_all_it_takes():
    for window in generate("derived", 3, 17):
        samples = window.telemetry.samples
        assert samples.friction_torque_Nm is None
        error = samples.speed_rad_s - window.telemetry.truth.speed_rad_s
        assert error.std() == pytest.approx(0.01, rel=0.05)
        assert samples.motor_current_A is not None


def test_fleet_is_one_life_cut_into_windows():
    windows = list(generate(replace(RECIPES["fleet"], windows=6), 12, 5))[6:]  # the second wheel has an anomaly
    assert len({window.wheel.name for window in windows}) == 1
    assert [window.name[-3:] for window in windows] == [f"{k:03d}" for k in range(6)]
    ends = [window.telemetry.samples.time_ns[[0, -1]] for window in windows]
    for before, after in itertools.pairwise(ends):
        assert after[0] - before[1] == windows[0].wheel.period_ns
    factors = [window.telemetry.truth.factors["dry"] for window in windows]
    assert np.all(np.diff(factors) >= 0)
    assert factors[-1] > 1.3
    assert not windows[0].labels["dry"]
    assert windows[-1].labels["dry"]
    assert all(not active for window in windows for name, active in window.labels.items() if name != "dry")


def test_a_record_depends_on_seed_and_number_only():
    few, many = list(generate("mild", 2, 7)), list(generate("mild", 4, 7))
    for a, b in zip(few, many, strict=False):
        assert a.telemetry.samples.friction_torque_Nm.tobytes() == b.telemetry.samples.friction_torque_Nm.tobytes()
        assert a.wheel == b.wheel
    assert many[0].wheel != many[1].wheel
    assert next(generate("mild", 1, 8)).wheel != many[0].wheel
    assert list(generate("mild", 0, 7)) == []


def test_flown_is_as_measured():
    spreads, tails = [], []
    for window in generate("flown", 20, 17):
        truth, wheel, scenario = window.telemetry.truth, window.wheel, window.scenario
        slots = np.flatnonzero(truth.used)
        quantum = scenario.sensors.friction_quantum_Nm
        steps = window.telemetry.samples.friction_torque_Nm / quantum
        assert np.nanmax(np.abs(steps - np.rint(steps))) < 1e-6
        assert 0.1 < quantum / wheel.noise.friction_std_Nm < 1.01
        speed = np.abs(truth.speed_rad_s)
        fast, slow = (truth.noise_Nm[slots][at[slots]] for at in (speed > 200.0, speed < 50.0))
        if min(fast.size, slow.size) > 5_000:
            spreads.append(fast.std() / slow.std())
        tails.append(np.mean(np.abs(truth.noise_Nm) > 5.0 * truth.noise_std_Nm))
        drift = np.ptp(truth.base_dry_Nm) / wheel.nominal.dry_torque_Nm
        assert drift < 0.08
        assert len(window.telemetry.samples) < 80_000
        assert sum(window.labels.values()) <= 1
    assert min(spreads) < 1.5
    assert 2.0 < max(spreads) < 3.2
    assert np.mean(tails) > 100 * 5.7e-7  # a hundred times as many as of Gaussian noise


def test_drift_is_a_random_walk_of_the_stated_size():
    wheel = built_in_wheel()
    ends = []
    for number in range(40):
        still = {"duration_s": 3600.0, "base": {"dry_drift_per_sqrt_h": 0.01}}
        truth = simulate(Scenario.model_validate(still), wheel, np.random.default_rng([5, number])).truth
        ends.append(truth.base_dry_Nm[-1] / wheel.nominal.dry_torque_Nm - 1.0)
    assert np.std(ends) == pytest.approx(0.01, rel=0.35)  # three standard errors of forty


def test_labels_and_truth_can_be_written():
    window = list(generate("hard", 3, 2))[2]
    assert list(window.labels) == ["dry", "viscous", "fss_1", "fss_2", "fss_3"]
    document = json.loads(json.dumps(truth_document(window), allow_nan=False))
    truth = window.telemetry.truth
    assert [jump["index"] for jump in document["changepoints"]] == truth.changepoints.index.tolist()
    assert {jump["fss"] for jump in document["changepoints"]} <= {"fss_1", "fss_2", "fss_3"}
    for name, system in document["components"]["fss"].items():
        level = np.zeros(80_000)
        for start, friction in zip(system["start_index"], system["friction_Nm"], strict=True):
            level[start:] = friction
        assert np.array_equal(level, truth.fss_friction_Nm[name])


@pytest.mark.parametrize(
    "law",
    [
        Uniform(low=100, high=300),
        Geometric(mean=200.0),
        Weibull(shape=1.5, scale=200.0),
        Lognormal(mu=5.0, sigma=0.5),
        Histogram(edges=(10, 100, 400), weights=(1.0, 2.0)),
    ],
)
def test_scaling_a_law_scales_its_mean(law):
    for factor in (0.4, 1.0, 3.0):
        assert scaled_law(law, factor).mean() == pytest.approx(factor * law.mean(), rel=0.01)
    assert scaled_law(law, 1e-9).mean() == pytest.approx(1.0, abs=1.0)


def test_wrong_use_is_named():
    with pytest.raises(InputError, match=r"'soft' is none of paper, mild, hard, flown, derived, orbit, fleet"):
        next(generate("soft", 1, 1))
    for bad in ({"count": -1, "seed": 0}, {"count": 1, "seed": -1}):
        with pytest.raises(InputError, match="none may be negative"):
            next(generate("mild", **bad))
