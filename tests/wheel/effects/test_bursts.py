"""Bursts of a cage: found in noise that comes and goes, and in nothing else."""

import numpy as np
import pytest

from rwa_monitor.wheel.effects.base import Channels
from rwa_monitor.wheel.effects.cage_instability import CageInstability
from rwa_monitor.wheel.effects.catalogue import NOISE_EFFECTS
from tests.wheel.effects.records import rich_motion

SLOTS = 20_000
SIGMA_NM = 6e-5
CAGE = CageInstability(
    strength_Nm=2.0 * SIGMA_NM,
    noise_strength=1.5,
    band_speed_rad_s=60.0,
    band_half_width_rad_s=12.0,
    burst_s=15.0,
    quiet_s=15.0,
)


def noise_of(channels: Channels, rng: np.random.Generator, kind: str) -> np.ndarray:
    white = SIGMA_NM * rng.normal(size=SLOTS)
    if kind == "white":
        return white
    if kind == "levels":  # drag that jumps, and jumps back, but does not shake
        return white + 5 * SIGMA_NM * channels.direction * (np.sin(np.arange(SLOTS) / 40.0) > 0)
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
        assert fit.values["strength_Nm"] == pytest.approx(2.0 * SIGMA_NM, abs=5 * fit.std["strength_Nm"])


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
    braking = CAGE.apply(SIGMA_NM * rng.normal(size=SLOTS), channels, rng)
    fit, on = CageInstability.fit_bursts(-braking, channels, channels.good)
    assert fit.log_likelihood_gain == 0.0
    assert not on.any()


def test_one_speed_has_no_band() -> None:
    channels = rich_motion(SLOTS)
    channels.speed_rad_s[:] = 60.0
    rng = np.random.default_rng(5)
    fit, _ = CageInstability.fit_bursts(CAGE.apply(rng.normal(size=SLOTS), channels, rng), channels, channels.good)
    assert fit.log_likelihood_gain == 0.0
