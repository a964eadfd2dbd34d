"""Drag that follows viscous self-heating is no jump of viscous friction, where nobody measured the temperature."""

import numpy as np
import pytest

from rwa_monitor.discrepancy.plan import plan
from rwa_monitor.discrepancy.result import Search
from rwa_monitor.wheel.wheel import Wheel
from tests.discrepancy import simple
from tests.discrepancy.simple import NOISE_NM, Array, names, sampled

COUNT, PERIOD_S = 6000, 0.5
DRY_NM, VISCOUS = 1.5e-3, 8e-6
WHEEL = Wheel(name="warm", sample_period_s=PERIOD_S)


def motion(rng: np.random.Generator) -> Array:
    """Return dwells at speeds of either sign, joined by ramps [rad/s]."""
    ends = np.cumsum(rng.integers(100, 500, 60))
    targets = rng.uniform(-300.0, 300.0, ends.size)
    at = np.stack([ends - 80, ends], axis=1).ravel()
    return np.interp(np.arange(COUNT), at, np.stack([np.append(0.0, targets[:-1]), targets], axis=1).ravel())


def heated(speed: Array, lag_s: float, kelvin: float) -> Array:
    """Return the viscosity of an oil that the friction's power heats, by Euler's rule, 1 where it is cold [-]."""
    viscosity, rise, power = np.empty(COUNT), 0.0, DRY_NM * np.abs(speed) + VISCOUS * speed**2
    for k in range(COUNT):
        viscosity[k] = np.exp(4500.0 * (1.0 / (rise + 293.15) - 1.0 / 293.15))
        rise += PERIOD_S / lag_s * (kelvin * power[k] / power.max() - rise)
    return viscosity


def search(viscosity: Array, speed: Array, rng: np.random.Generator) -> Search:
    friction = np.sign(speed) * DRY_NM + VISCOUS * viscosity * speed + rng.normal(0.0, NOISE_NM, COUNT)
    return simple.search(sampled(speed + rng.normal(0, 1e-3, COUNT), friction, PERIOD_S), WHEEL)


@pytest.mark.parametrize(("seed", "lag_s"), [pytest.param(53020, 1000.0, marks=pytest.mark.slow), (53021, 600.0)])
def test_a_bearing_that_warms_by_its_own_drag_asks_for_the_temperature(seed: int, lag_s: float) -> None:
    rng = np.random.default_rng(seed)
    speed = motion(rng)
    found = search(heated(speed, lag_s, 25.0), speed, rng)
    assert not found.result.effects
    assert "viscous self-heating" in found.result.unexplained.signature
    assert "record the bearing's temperature" in found.result.unexplained.signature
    assert "viscosity_temperature" in dict(found.result.untested)  # named as a possible cause, and not testable
    assert any("record the bearing's temperature" in line for line in plan(found).advice)


@pytest.mark.parametrize("seed", [53022, pytest.param(53023, marks=pytest.mark.slow)])
def test_true_jumps_of_the_viscous_friction_stay_found(seed: int) -> None:
    rng = np.random.default_rng(seed)
    speed = motion(rng)
    edges = np.linspace(0, COUNT, 8)[1:-1].astype(np.int64) + rng.integers(-100, 100, 6)
    steps = np.array([1.0, 0.75, 1.2, 0.8, 1.1, 0.7, 1.0])
    found = search(steps[np.searchsorted(edges, np.arange(COUNT), side="right")], speed, rng)
    assert "viscous_jump" in names(found)
    assert found.result.unexplained is None


@pytest.mark.parametrize("seed", [53024, pytest.param(53025, marks=pytest.mark.slow)])
def test_a_bearing_that_follows_its_housing_late_shows_by_how_much(seed: int) -> None:
    rng, lag_s = np.random.default_rng(seed), 500.0
    speed, at = motion(rng), np.arange(COUNT) * PERIOD_S
    turn = 2.0 * np.pi / 400.0
    housing = 20.0 + 8.0 * np.sin(turn * at)
    # The sine that a first-order lag makes of another, once the start is forgotten.
    delayed = np.arctan(turn * lag_s)
    bearing = 20.0 + 8.0 * np.cos(delayed) * np.sin(turn * at - delayed)
    bearing += 8.0 * np.cos(delayed) * np.sin(delayed) * np.exp(-at / lag_s)
    viscosity = np.exp(4000.0 * (1.0 / (bearing + 273.15) - 1.0 / 293.15))
    friction = np.sign(speed) * DRY_NM + VISCOUS * viscosity * speed + rng.normal(0.0, NOISE_NM, COUNT)
    samples = sampled(speed, friction, PERIOD_S, bearing_temperature_degC=housing + rng.normal(0.0, 0.02, COUNT))
    found = simple.search(samples, WHEEL)
    assert names(found) == ["viscosity_temperature"]
    lag = found.result.effects[0].parameters["sensor_lag_s"]
    assert lag.value == pytest.approx(lag_s, abs=max(3.0 * lag.std, 0.05 * lag_s))


@pytest.mark.parametrize("seed", [53026, pytest.param(53027, marks=pytest.mark.slow)])
def test_an_oil_that_is_never_as_cold_as_20_degC_shows_its_viscosity_there(seed: int) -> None:
    rng = np.random.default_rng(seed)
    speed, warm = motion(rng), 57.5 - 22.5 * np.cos(np.arange(COUNT) * PERIOD_S / 300.0)
    viscosity = np.exp(4000.0 * (1.0 / (warm + 273.15) - 1.0 / 293.15))  # 0.1 to 0.5: all friction is less than that
    friction = 10.0 * VISCOUS * viscosity * speed + rng.normal(0.0, NOISE_NM, COUNT)
    found = simple.search(sampled(speed, friction, PERIOD_S, bearing_temperature_degC=warm), WHEEL)
    assert names(found) == ["viscosity_temperature"]
    strength, activation = list(found.result.effects[0].parameters.values())[:2]
    assert strength.value == pytest.approx(10.0 * VISCOUS, rel=0.05)
    assert activation.value == pytest.approx(4000.0, rel=0.05)
