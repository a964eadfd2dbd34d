"""What a verdict must not claim: that a silent system ails, or that all is nominal where the numbers contradict it."""

from dataclasses import replace

import numpy as np
import pytest

from rwa_monitor.diagnosis.model import built_in_model
from rwa_monitor.monitor.core import WindowDiagnosed, diagnose_samples
from rwa_monitor.samples import Samples
from rwa_monitor.simulation.motion import SpeedProfile
from rwa_monitor.simulation.record import simulate
from rwa_monitor.simulation.scenario import Anomaly, Scenario
from rwa_monitor.wheel.durations import Uniform
from rwa_monitor.wheel.wheel import Wheel, built_in_wheel

MODEL = built_in_model()
WINDOW_S = 10_000.0
FOREVER = Uniform(low=40_000_000, high=50_000_000)


def record(seed: int, windows: float, truth: Wheel, **anomalies: Anomaly) -> Samples:
    scenario = Scenario(duration_s=windows * WINDOW_S, speed=SpeedProfile(kind="orbit"), anomalies=anomalies)
    return simulate(scenario, truth, np.random.default_rng([77, seed])).samples


def resting(*systems: str) -> Wheel:
    """The built-in wheel, of which these systems stay at rest."""
    wheel = built_in_wheel()
    fss = tuple(
        one.model_copy(update={"durations": (FOREVER, *one.durations[1:])}) if one.name in systems else one
        for one in wheel.fss
    )
    return wheel.model_copy(update={"fss": fss})


def windows_of(samples: Samples, wheel: Wheel | None = None) -> list[WindowDiagnosed]:
    return list(diagnose_samples(samples, wheel or built_in_wheel(), MODEL))


@pytest.mark.parametrize("seed", [0, 1])
def test_a_silent_system_stays_at_what_was_known_of_it(seed: int) -> None:
    found = windows_of(record(seed, 5, resting("fss_1")))
    silent = [window.diagnosis.anomalies["fss_1"] for window in found]
    assert not any(anomaly.active for anomaly in silent)
    assert silent[-1].probability < silent[0].probability + 0.05
    for window in found:
        assert window.diagnosis.verdict == "inconclusive"
        assert "does not show friction of switching system fss_1" in window.diagnosis.reason


def test_dry_friction_without_a_jump_is_never_a_switching_system_s_for_sure() -> None:
    found = windows_of(record(0, 5, resting("fss_1", "fss_2"), dry=Anomaly(factor=1.6)))
    assert {window.diagnosis.verdict for window in found} == {"inconclusive"}


@pytest.mark.parametrize("seed", [0, 1])
def test_a_wheel_that_is_failing_is_not_called_nominal_against_its_numbers(seed: int) -> None:
    samples = record(seed, 6, built_in_wheel(), dry=Anomaly(factor=1.6, onset_s=2 * WINDOW_S, growth_s=4 * WINDOW_S))
    for window in windows_of(samples):
        dry = window.diagnosis.anomalies["dry"]
        if window.diagnosis.verdict == "nominal":
            assert dry.estimate < dry.nominal_high
        if not window.diagnosis.model_adequate:
            assert "All friction is nominal" not in window.diagnosis.reason


def test_a_few_samples_are_not_called_nominal() -> None:
    # Without switching systems there is nothing else that so few samples could fail to show.
    wheel = built_in_wheel().model_copy(update={"fss": ()})
    last = windows_of(record(3, 1.0004, wheel), wheel)
    assert [window.diagnosis.verdict for window in last] == ["nominal", "inconclusive"]


def test_friction_below_nominal_asks_for_units_and_sign() -> None:
    samples = record(1, 1, built_in_wheel())
    (window,) = windows_of(replace(samples, friction_torque_Nm=0.5 * samples.friction_torque_Nm))
    assert "below nominal, so check units, sign or the wheel file" in window.diagnosis.reason
    assert "Wait for the next window" not in window.diagnosis.explanation


def test_a_wheel_file_without_nominal_friction_is_split_as_far_as_it_goes_and_sent_to_identify() -> None:
    (window,) = windows_of(record(1, 1, built_in_wheel()), Wheel(name="bare", sample_period_s=0.125))
    assert window.diagnosis.verdict == "inconclusive"
    assert "[nominal]" in window.diagnosis.reason
    assert "rwa-monitor identify" in window.diagnosis.explanation
    assert list(window.diagnosis.anomalies) == ["dry", "viscous"]
    assert window.diagnosis.friction.viscous.value == pytest.approx(5.333e-6, rel=0.02)
    assert "Wait for the next window" not in window.diagnosis.explanation


@pytest.mark.parametrize("noise_rad_s", [0.05, 0.15, 0.5])
def test_a_speed_that_is_held_calls_no_healthy_wheel_s_base_dry_friction_anomalous(noise_rad_s: float) -> None:
    # All that moves the measured speed is its noise: the slope falls to zero, and the base takes up the rest.
    true = built_in_wheel()
    viscous = true.nominal.viscous_Nm_s_rad
    for seed in (0, 1):
        samples = record(seed, 1, true)
        held = np.where(samples.speed_rad_s >= 0, 120.0, -120.0)
        noise = np.random.default_rng(seed).normal(0.0, noise_rad_s, len(samples))
        friction = samples.friction_torque_Nm + viscous * (held - samples.speed_rad_s)
        (window,) = windows_of(replace(samples, speed_rad_s=held + noise, friction_torque_Nm=friction))
        assert window.diagnosis.verdict == "inconclusive", window.diagnosis.reason
