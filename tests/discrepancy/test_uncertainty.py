"""Stated errors hold: strengths and shapes of simulated effects, over seeds."""

from dataclasses import replace

import numpy as np
import pytest

from rwa_monitor.discrepancy.fitting import Fitting
from rwa_monitor.discrepancy.found_effects import described
from rwa_monitor.discrepancy.result import ParameterValue
from rwa_monitor.simulation.motion import SpeedProfile
from rwa_monitor.simulation.record import simulate
from rwa_monitor.simulation.scenario import Scenario
from rwa_monitor.wheel.effects.catalogue import MEAN_EFFECTS
from rwa_monitor.wheel.wheel import EffectBlock, Wheel, built_in_wheel
from tests.discrepancy.simple import sampled, search
from tests.discrepancy.smooth import problem_of

SEEDS = range(3000, 3020)
TRUTH = {
    "sublinear_viscous": {"strength_Nm": 2.0e-5, "exponent": 0.667},
    "stribeck": {"strength_Nm": 6.0e-4, "stribeck_speed_rad_s": 10.0, "exponent": 2.0},
    "lubricant_lag": {"strength_Nm_s_rad": 2.0e-6, "time_constant_s": 60.0},
    "presliding": {"strength_Nm": 1.6e-3, "breakaway_angle_rad": 0.2},
}


WAVE_S = 100.0  # several periods between two jumps: levels do not follow


def fitted(name: str, seed: int, wave: float = 0.0, **changes: float) -> dict[str, ParameterValue]:
    """Simulate 750 s with one effect and a slow wave of drag of that rms [σ], and fit the effect, jumps unknown."""
    wheel = built_in_wheel()
    block = EffectBlock(name=name, parameters={**TRUTH[name], **changes})
    scenario = Scenario(duration_s=750.0, speed=SpeedProfile(kind="rich"), effect=(block,))
    rng = np.random.default_rng(seed)
    samples = simulate(scenario, wheel, rng).samples
    if wave:
        phase = 2 * np.pi * (1e-9 * samples.time_ns / WAVE_S + rng.uniform())
        drag = wave * np.sqrt(2.0) * 3.9e-5 * np.sin(phase) * np.sign(samples.speed_rad_s)
        samples = replace(samples, friction_torque_Nm=samples.friction_torque_Nm + drag)
    problem = problem_of(samples)
    fitting = Fitting(problem, jumps=True)
    model = fitting.extensions(fitting.base(), [MEAN_EFFECTS[name]])[0]
    return described(problem, model, 0)


@pytest.mark.parametrize("name", TRUTH)
def test_truth_lies_within_three_stated_errors(name: str) -> None:
    off: dict[str, list[float]] = {}
    for seed in SEEDS:
        for parameter, value in fitted(name, seed).items():
            if value.std is not None and (name, parameter) != ("stribeck", "exponent"):  # a usual value is kept
                off.setdefault(parameter, []).append((value.value - TRUTH[name][parameter]) / value.std)
    assert set(off) == {parameter for parameter in TRUTH[name] if (name, parameter) != ("stribeck", "exponent")}
    for sigmas in off.values():
        assert len(sigmas) == len(SEEDS)
        assert np.mean(np.abs(sigmas) <= 3.0) >= 0.9
        # And no wider than they must be: the root mean square of 20 normal deviates is above 0.54 in 99.9 %.
        assert np.sqrt(np.mean(np.square(sigmas))) > 0.54


@pytest.mark.parametrize("name", ["stribeck", "lubricant_lag"])
def test_stated_errors_hold_what_the_model_lacks(name: str) -> None:
    # A wave of drag as large as the noise, that no effect explains: the noise alone would give a third of the errors.
    within = [
        abs(value.value - TRUTH[name][parameter]) <= 3.0 * value.std
        for seed in range(50000, 50012)
        for parameter, value in fitted(name, seed, wave=1.0).items()
        if value.std is not None
    ]
    assert len(within) >= 18
    assert np.mean(within) >= 0.9


def test_a_shape_that_the_record_does_not_determine_has_no_error_and_states_so() -> None:
    # A fifth of the strength: the drag is seen to bend, but hardly how.
    exponent = fitted("sublinear_viscous", 3000, strength_Nm=4.0e-6)["exponent"]
    assert exponent.std is None
    assert "not determined" in exponent.in_words()


@pytest.mark.parametrize(
    ("value", "std", "limits", "words"),
    [
        (0.3, 0.1, (0.3, 0.9), "at its bound 0.3: not determined"),
        (1500.0, float("nan"), (1500.0, 8000.0), "at its bound 1500: not determined"),
        (0.49, 0.01, (-0.5, 0.5), "not distinguishable from its bound 0.5: not determined"),
        (0.0, 0.1, (0.0, float("inf")), "at its bound 0: not determined"),
        (0.6, 0.1, (0.3, 0.9), ""),
        (1e-6, 6e-7, (0.0, float("inf")), ""),  # beside zero its error shows it
        (1e-6, 1e-9, (0.0, 1.0), ""),  # small is not zero
    ],
)
def test_a_value_at_its_bound_is_not_determined(
    value: float, std: float, limits: tuple[float, float], words: str
) -> None:
    stated = ParameterValue.of(value, std, "-", *limits)
    assert stated.note == words
    assert (stated.std is None) == bool(words)
    assert words in stated.in_words()
    assert stated.to_json().get("note", "") == words


def test_a_part_of_the_viscous_friction_is_no_more_than_the_whole() -> None:
    # Fifteen kelvin, two speeds in turn: the product of strength and activation temperature shows, hardly either.
    time = np.arange(0.0, 3600.0, 0.125)
    speed = 150.0 + 100.0 * np.sin(2 * np.pi * time / 600.0)
    kelvin = 15.0 * (1.0 - np.exp(-time / 1500.0)) - 5.0
    friction = 1.6e-3 + 5.3e-6 * np.exp(-0.03 * kelvin) * speed
    rng = np.random.default_rng(50060)
    samples = sampled(speed, friction + 3.9e-5 * rng.normal(size=time.size), bearing_temperature_degC=20.0 + kelvin)
    (effect,) = search(samples, Wheel(name="w", sample_period_s=0.125)).result.effects
    strength, activation = effect.parameters.values()
    assert strength.std is None
    assert "more than the whole viscous friction, 5.3" in strength.note
    assert activation.std is None
    assert "not determined" in activation.note
    # What is known: the slope by temperature, 3 % of the whole per kelvin at 20 °C.
    assert strength.value * activation.value / 293.15**2 == pytest.approx(0.03 * 5.3e-6, rel=0.05)
