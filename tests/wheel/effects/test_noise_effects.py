"""What every noise effect must do: simulate, be found with its parameters, not be seen where it is not."""

from dataclasses import replace

import numpy as np
import pytest

from rwa_monitor.wheel.effects.base import Channels, NoiseEffect
from rwa_monitor.wheel.effects.cage_instability import CageInstability
from rwa_monitor.wheel.effects.catalogue import NOISE_EFFECTS
from rwa_monitor.wheel.effects.tachometer import error_of_step, quantisation_step
from tests.wheel.effects.records import rich_motion

SIGMA_NM = 3.9e-5
SLOTS = 20_000
ALL = sorted(NOISE_EFFECTS.values(), key=lambda effect: effect.name)
every_noise_effect = pytest.mark.parametrize("effect", ALL, ids=lambda effect: effect.name)

# Strengths that a record of 20,000 samples shows with certainty.
CASES: dict[str, dict[str, float]] = {
    "coloured_noise": {"ar_coefficient": 0.5},
    "heavy_tailed_noise": {"degrees_of_freedom": 4.0},
    "speed_dependent_noise": {"strength_s_rad": 0.02},
    "tachometer_quantisation": {"step_rad_s": 2e-3},
    "cage_instability": {
        "strength_Nm": 6e-5,
        "noise_strength": 1.0,
        "band_speed_rad_s": 60.0,
        "band_half_width_rad_s": 10.0,
        "burst_s": 30.0,
        "quiet_s": 30.0,
    },
}


def simulate(name: str, seed: int) -> tuple[NoiseEffect, Channels, np.ndarray]:
    rng = np.random.default_rng(seed)
    channels = rich_motion(SLOTS, seed=seed)
    effect = NOISE_EFFECTS[name](**CASES[name])
    measured = replace(channels, speed_rad_s=effect.read_speed(channels.speed_rad_s))
    return effect, measured, effect.apply(SIGMA_NM * rng.normal(size=SLOTS), channels, rng)


@every_noise_effect
def test_it_is_found_in_its_own_noise_and_above_all_others(effect: type[NoiseEffect]) -> None:
    # The gain of bursts is over any law of the speed and any tails: it is compared with none, and looked for first.
    rivals = [effect] if effect.comes_and_goes else ALL
    for seed in range(5):
        _, channels, noise = simulate(effect.name, seed)
        gains = {other.name: other.fit(noise, channels, channels.good).penalised_gain for other in rivals}
        assert max(gains, key=gains.__getitem__) == effect.name, gains
        assert gains[effect.name] > 25


@every_noise_effect
def test_white_noise_shows_nothing(effect: type[NoiseEffect]) -> None:
    rng = np.random.default_rng(11)
    channels = rich_motion(SLOTS)
    # Twice the gain is χ² with one degree of freedom (more where a band is searched: a bound for the scan): 25 is the
    # acceptance threshold of the search.
    gains = [effect.fit(SIGMA_NM * rng.normal(size=SLOTS), channels, channels.good).penalised_gain for _ in range(10)]
    assert max(gains) < 10


@every_noise_effect
def test_simulate_then_fit_gives_the_parameters_back(effect: type[NoiseEffect]) -> None:
    true, channels, noise = simulate(effect.name, 3)
    fit = effect.fit(noise, channels, channels.good)
    assert set(fit.values) == {parameter.name for parameter in effect.parameters}
    for name in CASES[effect.name]:
        if name in ("burst_s", "quiet_s"):  # the fit sees the average over bursts and pauses
            continue
        tolerance = max(5 * np.nan_to_num(fit.std[name]), 0.15 * true.values[name])
        assert fit.values[name] == pytest.approx(true.values[name], abs=tolerance), name


@every_noise_effect
def test_gaps_and_short_records_do_no_harm(effect: type[NoiseEffect]) -> None:
    _, channels, noise = simulate(effect.name, 2)
    good = np.random.default_rng(0).random(SLOTS) > 0.05
    noise = np.where(good, noise, np.nan)
    assert effect.fit(noise, channels, good).penalised_gain > 25
    nothing = effect.fit(noise, channels, np.zeros(SLOTS, dtype=bool))
    assert nothing.log_likelihood_gain == 0.0
    still = effect.fit(np.zeros(SLOTS), channels, np.ones(SLOTS, dtype=bool))
    assert still.log_likelihood_gain == 0.0


@pytest.mark.parametrize("digits", [3, 6, 12])
def test_the_step_of_a_lattice_is_as_sure_as_the_digits_of_its_readings(digits: int) -> None:
    step = 2e-3 * np.pi
    read_speed = np.round(np.rint(rich_motion(SLOTS).speed_rad_s / step) * step, digits + 3)
    found = quantisation_step(read_speed)
    error = error_of_step(read_speed, found)
    assert abs(found - step) < 5.0 * error
    assert 0.0 < error < 10.0 ** -(digits + 3) / np.sqrt(np.unique(read_speed).size)


def test_readings_without_a_lattice_have_no_step() -> None:
    assert quantisation_step(rich_motion(SLOTS).speed_rad_s) is None
    assert quantisation_step(np.array([-0.004, 0.004])) is None  # half a step to either side of rest


def test_a_table_with_few_digits_is_not_taken_for_a_coarse_tachometer() -> None:
    """White noise of the speed, written with five digits: the digits are a grid, but not the cause of the noise."""
    rng = np.random.default_rng(8)
    true = rich_motion(SLOTS)
    read_speed = np.round(true.speed_rad_s + 1e-3 * rng.normal(size=SLOTS), 5)
    residual = -0.0117 * np.gradient(read_speed - true.speed_rad_s, true.sample_period_s)
    fit = NOISE_EFFECTS["tachometer_quantisation"].fit(residual, replace(true, speed_rad_s=read_speed), true.good)
    assert fit.log_likelihood_gain == 0.0


def test_a_fine_grid_over_a_wide_range_is_found_from_readings_of_few_digits() -> None:
    # 55,000 steps, one known to 2e-4 from two readings: the last multiples are known from those before them.
    true, rng = 0.00500882, np.random.default_rng(3)
    readings = np.round(true * np.rint(np.cumsum(rng.normal(0.0, 2.0, 20_000)) / true), 6)
    assert np.ptp(readings) > 250.0
    assert quantisation_step(readings) == pytest.approx(true, rel=1e-8)


# ---- bursts of a cage ------------------------------------------------------------------------------------------------


BURST_NOISE_NM = 6e-5
STRONGER = {"strength_Nm": 2.0 * BURST_NOISE_NM, "noise_strength": 1.5, "band_half_width_rad_s": 12.0}
CAGE = CageInstability(**{**CASES["cage_instability"], **STRONGER, "burst_s": 15.0, "quiet_s": 15.0})


def noise_of(channels: Channels, rng: np.random.Generator, kind: str) -> np.ndarray:
    white = BURST_NOISE_NM * rng.normal(size=SLOTS)
    if kind == "white":
        return white
    if kind == "levels":  # drag that jumps, and jumps back, but does not shake
        return white + 5 * BURST_NOISE_NM * channels.direction * (np.sin(np.arange(SLOTS) / 40.0) > 0)
    return NOISE_EFFECTS[kind](**NOISE_EFFECTS[kind].typical().values).apply(white, channels, rng)


@pytest.mark.parametrize("kind", ["white", "coloured_noise", "heavy_tailed_noise", "levels"])
def test_bursts_give_their_parameters_back_in_any_noise(kind: str) -> None:
    rng = np.random.default_rng(21)
    channels = rich_motion(SLOTS)
    fit, on = CageInstability.fit_bursts(
        CAGE.apply(noise_of(channels, rng, kind), channels, rng), channels, channels.good
    )
    assert fit.penalised_gain > 100
    assert fit.values["noise_strength"] == pytest.approx(1.5, abs=max(5 * fit.std["noise_strength"], 0.4))
    assert fit.values["band_speed_rad_s"] == pytest.approx(60.0, abs=4.0)
    assert fit.values["band_half_width_rad_s"] == pytest.approx(12.0, abs=4.0)
    assert np.all(np.abs(np.abs(channels.speed_rad_s[on]) - 60.0) < 17.0)
    if kind != "levels":
        assert fit.values["strength_Nm"] == pytest.approx(2.0 * BURST_NOISE_NM, abs=5 * fit.std["strength_Nm"])


@pytest.mark.parametrize("seed", [41, 58])
def test_a_wide_band_is_found_whole_though_bursts_are_few(seed: int) -> None:
    wide = {"band_speed_rad_s": 80.0, "band_half_width_rad_s": 30.0, "burst_s": 40.0, "quiet_s": 80.0}
    cage = CageInstability(**{**CAGE.values, **wide, "noise_strength": 0.7})
    rng, channels = np.random.default_rng(seed), rich_motion(SLOTS, seed=seed)
    fit, _ = CageInstability.fit_bursts(
        cage.apply(noise_of(channels, rng, "white"), channels, rng), channels, channels.good
    )
    assert fit.values["band_speed_rad_s"] == pytest.approx(80.0, abs=3.0)
    assert fit.values["band_half_width_rad_s"] == pytest.approx(30.0, abs=3.0)


@pytest.mark.parametrize("kind", ["white", "coloured_noise", "heavy_tailed_noise", "speed_dependent_noise", "levels"])
def test_other_noise_has_no_bursts(kind: str) -> None:
    for seed in range(3):
        rng = np.random.default_rng(seed)
        channels = rich_motion(SLOTS, seed=seed)
        fit, _ = CageInstability.fit_bursts(noise_of(channels, rng, kind), channels, channels.good)
        assert fit.penalised_gain < 10  # the search accepts from 25 on


def test_bursts_that_do_not_drag_are_no_cage() -> None:
    rng = np.random.default_rng(4)
    channels = rich_motion(SLOTS)
    braking = CAGE.apply(BURST_NOISE_NM * rng.normal(size=SLOTS), channels, rng)
    fit, on = CageInstability.fit_bursts(-braking, channels, channels.good)
    assert fit.log_likelihood_gain == 0.0
    assert not on.any()


@pytest.mark.parametrize("drags", [True, False])
def test_two_bursts_are_a_cage_if_they_drag(drags: bool) -> None:
    rng, channels = np.random.default_rng(6), rich_motion(SLOTS)
    middle = np.flatnonzero(np.abs(np.abs(channels.speed_rad_s) - 60.0) < 6.0)
    passes = np.split(middle, np.flatnonzero(np.diff(middle) > 1) + 1)
    noise, louder = noise_of(channels, rng, "levels"), 4.0 * noise_of(channels, rng, "white")
    for one in sorted(passes, key=len)[-2:]:
        noise[one] += louder[one] + drags * 4.0 * BURST_NOISE_NM * channels.direction[one]
    fit, on = CageInstability.fit_bursts(noise, channels, channels.good)
    assert (fit.penalised_gain > 25.0) == drags
    assert on.any() == drags


def test_one_speed_has_no_band() -> None:
    channels = rich_motion(SLOTS)
    channels.speed_rad_s[:] = 60.0
    rng = np.random.default_rng(5)
    fit, _ = CageInstability.fit_bursts(CAGE.apply(rng.normal(size=SLOTS), channels, rng), channels, channels.good)
    assert fit.log_likelihood_gain == 0.0
