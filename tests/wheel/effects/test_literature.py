"""The package's effects against the formulas of the literature, written a second time in `literature`."""

import inspect
import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.blind import literature
from rwa_monitor.wheel.effects.base import Channels, MeanEffect
from rwa_monitor.wheel.effects.catalogue import MEAN_EFFECTS, NOISE_EFFECTS, SWITCHING_EFFECTS
from rwa_monitor.wheel.effects.switching_base import Jumps
from tests.wheel.effects.records import DRY_NM, INERTIA_KG_M2, PERIOD_S, rich_motion

TORQUE_CONSTANT = 0.032  # N m/A
MOTION = rich_motion(1024)


def torque(name: str, channels: Channels, **values: float) -> np.ndarray:
    effect: type[MeanEffect] = MEAN_EFFECTS[name]
    return effect(**values).torque(channels)[0]


def assert_same(ours: np.ndarray, theirs: np.ndarray, rtol: float = 1e-10) -> None:
    assert np.abs(theirs).max() > 0
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=rtol * np.abs(theirs).max())


def test_the_second_writing_is_independent() -> None:
    assert "import rwa_monitor" not in inspect.getsource(literature)
    assert "from rwa_monitor" not in inspect.getsource(literature)


@pytest.mark.parametrize("delta", [1.0, 2.0])
def test_stribeck(delta: float) -> None:
    ours = torque("stribeck", MOTION, strength_Nm=8e-4, stribeck_speed_rad_s=6.0, exponent=delta)
    assert_same(ours, literature.stribeck_curve(MOTION.speed_rad_s, DRY_NM, DRY_NM + 8e-4, 6.0, delta))


@pytest.mark.parametrize("breakaway", [0.01, 0.05])
def test_presliding_is_dahl(breakaway: float) -> None:
    slow = rich_motion(1024, top_speed_rad_s=1.0)
    ours = torque("presliding", slow, strength_Nm=DRY_NM, breakaway_angle_rad=breakaway)
    theirs = literature.dahl(slow.speed_rad_s, PERIOD_S, DRY_NM, DRY_NM / breakaway)
    # The midpoint rule with 400 steps a slot, up to 0.03 of the breakaway angle each.
    assert_same(ours, theirs, rtol=2e-3)


def test_coulomb_asymmetry() -> None:
    theirs = literature.direction_dependent_coulomb(MOTION.speed_rad_s, MOTION.dry_level_Nm, 0.07)
    assert_same(torque("coulomb_asymmetry", MOTION, strength=0.07), theirs)


def test_torque_bias() -> None:
    theirs = literature.offset_current(MOTION.motor_torque_Nm / TORQUE_CONSTANT, TORQUE_CONSTANT, 0.004)
    assert_same(torque("torque_bias", MOTION, strength_Nm=0.004 * TORQUE_CONSTANT), theirs)


def test_viscous_asymmetry() -> None:
    theirs = literature.direction_dependent_viscous(MOTION.speed_rad_s, 5.5e-6, 5.1e-6)
    assert_same(torque("viscous_asymmetry", MOTION, strength_Nm_s_rad=0.2e-6), theirs)


def test_viscosity_temperature() -> None:
    theirs = literature.viscous_with_temperature(MOTION.speed_rad_s, MOTION.bearing_temperature_degC, 5.3e-6, 3500.0)
    ours = torque("viscosity_temperature", MOTION, strength_Nm_s_rad=5.3e-6, activation_temperature_K=3500.0)
    assert_same(ours, theirs)


def test_sublinear_viscous_follows_speed_and_viscosity_alike() -> None:
    theirs = literature.rolling_drag(MOTION.speed_rad_s, MOTION.bearing_temperature_degC, 4e-5, 2.0 / 3.0, 3500.0)
    shape = {"exponent": 2.0 / 3.0, "activation_temperature_K": 3500.0}
    assert_same(torque("sublinear_viscous", MOTION, strength_Nm=4e-5, **shape), theirs)


@pytest.mark.parametrize("bend", [None, 2.5])
def test_saturating_drag_is_a_film_after_cross_and_after_carreau_and_yasuda(bend: float | None) -> None:
    theirs = literature.carreau_yasuda_film(MOTION.speed_rad_s, 2e-5, 12.0, bend or 1.0)
    shape = {"saturation_speed_rad_s": 12.0} | ({"bend": bend} if bend else {})
    assert_same(torque("saturating_drag", MOTION, strength_Nm=2e-5 * 12.0, **shape), theirs)


def test_quadratic_drag() -> None:
    c_m, density, radius = 0.01, 1.2, 0.15
    ours = torque("quadratic_drag", MOTION, strength_Nm_s2_rad2=c_m * 0.5 * density * radius**5)
    assert_same(ours, literature.disc_windage(MOTION.speed_rad_s, c_m, density, radius))


def test_lubricant_lag() -> None:
    ours = torque("lubricant_lag", MOTION, strength_Nm_s_rad=1e-6, time_constant_s=7.0)
    assert_same(ours, literature.lagging_lubricant(MOTION.speed_rad_s, PERIOD_S, 1e-6, 7.0), rtol=1e-6)


@pytest.mark.parametrize("time_constant_s", [20.0, 1e9], ids=["settling", "ramp"])
def test_run_in_drift(time_constant_s: float) -> None:
    ours = torque("run_in_drift", MOTION, strength_Nm_s=-3e-7, time_constant_s=time_constant_s)
    assert_same(ours, literature.running_in(MOTION.speed_rad_s, PERIOD_S, -3e-7, time_constant_s), rtol=1e-7)


def test_load_dependence() -> None:
    theirs = literature.loaded_bearing(MOTION.speed_rad_s, MOTION.motor_torque_Nm, 0.03)
    assert_same(torque("load_dependence", MOTION, strength=0.03), theirs)


def test_inertia_error() -> None:
    assumed = 0.97 * INERTIA_KG_M2
    theirs = literature.wrong_inertia(MOTION.motor_torque_Nm, MOTION.acceleration_rad_s2, INERTIA_KG_M2, assumed)
    assert_same(torque("inertia_error", MOTION, strength_kg_m2=INERTIA_KG_M2 - assumed), theirs)


def test_torque_constant_error() -> None:
    """The channel is the assumed K_T times I: the strength is δK_T over the assumed one."""
    current = MOTION.acceleration_rad_s2 * 0.3 + 0.05
    true = 0.031
    channels = replace(MOTION, motor_torque_Nm=TORQUE_CONSTANT * current)
    theirs = literature.wrong_torque_constant(current, true, TORQUE_CONSTANT)
    ours = torque("torque_constant_error", channels, strength=(TORQUE_CONSTANT - true) / TORQUE_CONSTANT)
    assert_same(ours, theirs)


@pytest.mark.parametrize("lag_s", [0.0, 200.0])
def test_torque_constant_temperature(lag_s: float) -> None:
    current = MOTION.acceleration_rad_s2 * 0.3 + 0.05
    channels = replace(MOTION, motor_torque_Nm=TORQUE_CONSTANT * current)
    temperature = MOTION.bearing_temperature_degC
    magnets = temperature - literature.lagging_lubricant(temperature, PERIOD_S, 1.0, lag_s) if lag_s else temperature
    theirs = literature.weakening_magnets(current, magnets, TORQUE_CONSTANT, -1.1e-3)
    assert_same(torque("torque_constant_temperature", channels, strength_1_K=1.1e-3, sensor_lag_s=lag_s), theirs)


@pytest.mark.parametrize("shift_s", [0.02, -0.02])
def test_current_delay(shift_s: float) -> None:
    theirs = literature.shifted_current(MOTION.motor_torque_Nm, PERIOD_S, shift_s)
    ours = torque("current_delay", MOTION, strength_s=shift_s)
    prepared = replace(MOTION, motor_torque_rate_Nm_s=np.gradient(MOTION.motor_torque_Nm, PERIOD_S))
    exact = torque("current_delay", prepared, strength_s=shift_s)
    inner = slice(2, -2)
    # To first order: a backward difference is that of half a slot earlier, the prepared rate that of the slot.
    assert np.corrcoef(ours[inner], theirs[inner])[0, 1] > 0.95
    assert np.corrcoef(exact[inner], theirs[inner])[0, 1] > 0.98
    slope = np.sum(exact[inner] * theirs[inner]) / np.sum(theirs[inner] ** 2)
    assert slope == pytest.approx(1.0, abs=0.05)


def test_drive_lag() -> None:
    asked = literature.shifted_current(INERTIA_KG_M2 * MOTION.acceleration_rad_s2, PERIOD_S, 0.02)
    rate = np.gradient(MOTION.acceleration_rad_s2, PERIOD_S)
    exact = torque("drive_lag", replace(MOTION, acceleration_rate_rad_s3=rate), strength_kg_m2_s=0.02 * INERTIA_KG_M2)
    ours = torque("drive_lag", MOTION, strength_kg_m2_s=0.02 * INERTIA_KG_M2)
    inner = slice(2, -2)
    assert np.corrcoef(ours[inner], asked[inner])[0, 1] > 0.95  # half of a slot earlier
    assert np.sum(exact[inner] * asked[inner]) / np.sum(asked[inner] ** 2) == pytest.approx(1.0, abs=0.05)


def test_torque_ripple() -> None:
    amplitudes, phases = (3e-4, 1e-4), (0.7, -1.1)
    ours = torque(
        "torque_ripple",
        MOTION,
        harmonic=6.0,
        strength_cos_Nm=3e-4 * math.sin(0.7),
        strength_sin_Nm=3e-4 * math.cos(0.7),
        strength_double_cos_Nm=1e-4 * math.sin(-1.1),
        strength_double_sin_Nm=1e-4 * math.cos(-1.1),
    )
    assert_same(ours, literature.ripple(MOTION.angle_rad, amplitudes, phases, (6, 12)), rtol=1e-9)


def test_speed_dead_zone() -> None:
    ours = torque("speed_dead_zone", MOTION, strength_Nm=DRY_NM, dead_zone_rad_s=2.5)
    assert_same(ours, literature.speed_threshold(MOTION.speed_rad_s, DRY_NM, 2.5))


def test_coloured_noise() -> None:
    white = np.random.default_rng(0).normal(size=1024)
    ours = NOISE_EFFECTS["coloured_noise"](ar_coefficient=0.8).apply(white, MOTION, np.random.default_rng(1))
    assert_same(ours, literature.autoregressive(white, 0.8))


def test_heavy_tails_have_the_kurtosis_of_student() -> None:
    """Excess kurtosis 6/(ν - 4); with ν = 12 its estimate from 400,000 samples is good to about 0.02."""
    rng = np.random.default_rng(2)
    effect = NOISE_EFFECTS["heavy_tailed_noise"](degrees_of_freedom=12.0)
    noise = effect.apply(rng.normal(size=400_000), MOTION, rng)
    assert noise.var() == pytest.approx(1.0, abs=0.02)
    assert np.mean(noise**4) / noise.var() ** 2 - 3 == pytest.approx(6 / 8, abs=0.1)


def test_tachometer_quantisation() -> None:
    effect = NOISE_EFFECTS["tachometer_quantisation"](step_rad_s=0.05, inertia_kg_m2=INERTIA_KG_M2)
    ours = effect.apply(np.zeros(1024), MOTION, np.random.default_rng(0))
    theirs = literature.quantised_derivative(MOTION.speed_rad_s, PERIOD_S, 0.05, INERTIA_KG_M2)
    assert_same(ours[1:-1], theirs[1:-1], rtol=1e-7)


JUMPS = Jumps(np.array([100, 350, 351, 800], dtype=np.int64), np.array([5e-4, -2e-4, 1e-4, -6e-4]))


def test_decaying_jump() -> None:
    ours = SWITCHING_EFFECTS["decaying_jump"](strength=0.6, time_constant_s=9.0).torque(MOTION, JUMPS)
    theirs = literature.relaxing_jumps(
        MOTION.speed_rad_s, PERIOD_S, JUMPS.index.tolist(), JUMPS.size_Nm, share=0.6, time_constant=9.0
    )
    assert_same(ours, theirs)


def test_viscous_jump() -> None:
    ours = SWITCHING_EFFECTS["viscous_jump"](strength_s_rad=4e-3).torque(MOTION, JUMPS)
    assert_same(ours, literature.jumping_slope(MOTION.speed_rad_s, JUMPS.index.tolist(), JUMPS.size_Nm, 4e-3))
