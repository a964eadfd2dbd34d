"""Laws with free exponents are one effect each: fitted with their errors, and nothing is left for other names."""

from dataclasses import replace

import numpy as np
import pytest

from rwa_monitor.discrepancy.extended import extend
from rwa_monitor.discrepancy.fitting import Fitting
from rwa_monitor.discrepancy.result import Search
from rwa_monitor.discrepancy.terms import make_term
from rwa_monitor.samples import Samples
from rwa_monitor.wheel.effects.drag_laws import Stribeck
from rwa_monitor.wheel.wheel import Wheel
from tests.discrepancy.simple import NOISE_NM, PERIOD_S, Array, record, search, swing
from tests.discrepancy.smooth import problem_of

KNEE_NM = 5e-4
ROLLING_NM, ROLLING_EXPONENT = 4e-5, 2.0 / 3.0


def assert_fitted(found: Search, name: str, truth: dict[str, float]) -> dict[str, float]:
    """Ask for one effect alone, its parameters within four standard deviations; returns those of the wheel file."""
    (effect,) = found.result.effects
    assert effect.name == name
    assert found.result.unexplained is None
    assert effect.parameters.keys() == truth.keys()
    for parameter, value in effect.parameters.items():
        assert abs(value.value - truth[parameter]) < 4.0 * value.std
    assert found.result.gain.rmse_extended_Nm < 1.05 * NOISE_NM
    (block,) = Wheel.from_toml(extend(found).to_toml(), "extended").effect
    assert block.parameters == pytest.approx({one: value.value for one, value in effect.parameters.items()}, rel=1e-3)
    return block.parameters


# ---- Stribeck --------------------------------------------------------------------------------------------------------


def with_knee(
    speed: Array, width: float, exponent: float, seed: int, jumps: tuple[int, ...] = (1500, 4000, 6200)
) -> Samples:
    """Return a record with a Stribeck curve of that exponent."""
    curve = KNEE_NM * np.sign(speed) * np.exp(-((np.abs(speed) / width) ** exponent))
    return record(speed, jumps, lambda *_: curve, seed=seed)[0]


def knee(seed: int, width: float, exponent: float) -> Search:
    """Search a record with a Stribeck curve of that exponent."""
    return search(with_knee(swing(top=120.0), width, exponent, seed))


@pytest.mark.parametrize(("seed", "width", "exponent"), [(50210, 6.0, 1.4), (50211, 8.0, 0.7), (50212, 12.0, 2.4)])
def test_an_exponent_is_fitted_and_reported_with_its_error(seed: int, width: float, exponent: float) -> None:
    found = knee(seed, width, exponent)  # no dead zone for what another exponent leaves
    truth = {"strength_Nm": KNEE_NM, "stribeck_speed_rad_s": width, "exponent": exponent}
    assert assert_fitted(found, "stribeck", truth)["exponent"] not in {1.0, 2.0}
    assert found.result.gain.simulated.rmse_extended_Nm < 1.05 * NOISE_NM


@pytest.mark.parametrize(("seed", "exponent"), [(50213, 1.0), (50214, 2.0)])
def test_a_usual_exponent_stays_where_nothing_contradicts_it(seed: int, exponent: float) -> None:
    (effect,) = knee(seed, 8.0, exponent).result.effects
    assert effect.parameters["exponent"].value == exponent
    assert effect.parameters["exponent"].std is not None


@pytest.mark.parametrize("width", [0.3, 0.5])
def test_a_jump_beside_a_steep_zero_crossing_is_kept_while_the_shape_is_fitted(width: float) -> None:
    """It is within eight samples of the steps of the curve itself; without the jump no shape fits."""
    speed = swing(top=120.0)
    jumps = (1500, 4000, int(np.flatnonzero(np.diff(np.sign(speed)))[2]) + 6)
    problem = problem_of(with_knee(speed, width, 2.0, 50215, jumps))
    fitting = Fitting(problem, jumps=True)
    term = make_term(problem, Stribeck, {"stribeck_speed_rad_s": width, "exponent": 1.0}, None)
    model = fitting.refitted((term,), fitting.base(), [np.searchsorted(problem.slot, jumps)])
    assert problem.slot[model.fit.jumps].tolist() == list(jumps)
    assert model.terms[0].shape["exponent"] == 2.0
    assert model.terms[0].shape["stribeck_speed_rad_s"] == pytest.approx(width, rel=0.15)


# ---- Palmgren's rolling drag, whose viscosity follows the recorded temperature ---------------------------------------


def rolling(seed: int, b_kelvin: float) -> Search:
    """Search a record with rolling drag over an orbit's worth of temperatures."""
    speed = swing(top=200.0, period_s=230.0)
    time = np.arange(speed.size) * PERIOD_S
    temperature = 20.0 + 5.0 * np.sin(2 * np.pi * time / 870.0 + seed)

    def drag(speed: Array, _: Array) -> Array:
        viscosity = np.exp(b_kelvin * (1.0 / (temperature + 273.15) - 1.0 / 293.15))
        return np.asarray(ROLLING_NM * np.sign(speed) * (viscosity * np.abs(speed)) ** ROLLING_EXPONENT)

    samples, _ = record(speed, effect=drag, seed=seed)
    measured = temperature + np.random.default_rng([seed, 1]).normal(0.0, 0.02, speed.size)
    return search(replace(samples, bearing_temperature_degC=measured))


@pytest.mark.parametrize(("seed", "b_kelvin"), [(50300, 3500.0), pytest.param(50301, 5500.0, marks=pytest.mark.slow)])
def test_rolling_drag_that_follows_speed_and_viscosity_is_one_effect(seed: int, b_kelvin: float) -> None:
    found = rolling(seed, b_kelvin)
    truth = {"strength_Nm": ROLLING_NM, "exponent": ROLLING_EXPONENT, "activation_temperature_K": b_kelvin}
    assert_fitted(found, "sublinear_viscous", truth)
    simulated = found.result.gain.simulated
    assert simulated.rmse_extended_Nm < 0.2 * simulated.rmse_base_Nm


def test_rolling_drag_that_does_not_follow_the_temperature_needs_no_viscosity() -> None:
    (effect,) = rolling(50302, 0.0).result.effects
    assert effect.name == "sublinear_viscous"
    assert set(effect.parameters) == {"strength_Nm", "exponent"}
