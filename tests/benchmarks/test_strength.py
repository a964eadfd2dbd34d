"""Strength of an effect: the RMS of what sign, speed and levels leave of it."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.adequacy.strength import level_columns, orthogonal_part, orthogonal_rms, strength_for
from rwa_monitor.errors import InputError
from rwa_monitor.wheel.effects.base import MeanEffect
from rwa_monitor.wheel.effects.catalogue import MEAN_EFFECTS
from tests.wheel.effects.records import rich_motion

JUMPS = np.array([700, 1500, 2900])
CHANNELS = rich_motion(4096)
LEVELS = level_columns(CHANNELS.direction, JUMPS)


@pytest.mark.parametrize("effect", MEAN_EFFECTS.values(), ids=lambda effect: effect.name)
def test_a_drawn_strength_has_the_wanted_rms_and_is_within_bounds(effect: type[MeanEffect]) -> None:
    shape = {p.name: p.typical for p in effect.shape_parameters()}
    for seed in range(5):
        drawn = strength_for(effect, shape, CHANNELS, LEVELS, 2e-5, np.random.default_rng(seed))
        torque, _ = effect(**shape, **drawn).torque(CHANNELS)
        assert orthogonal_rms(torque, CHANNELS, LEVELS) == pytest.approx(2e-5, rel=1e-9)


def test_sign_speed_and_LEVELS_leave_nothing_of_themselves() -> None:
    base = CHANNELS.direction * (1 + (np.arange(4096) >= 1500)) + 0.3 * CHANNELS.speed_rad_s
    assert orthogonal_rms(base, CHANNELS, LEVELS) < 1e-12
    assert np.abs(orthogonal_part(base, CHANNELS, LEVELS)).max() < 1e-12


def test_an_effect_that_the_base_law_takes_up_is_refused() -> None:
    channels = replace(CHANNELS, speed_rad_s=np.abs(CHANNELS.speed_rad_s) + 1.0, direction=np.ones(4096))
    levels = level_columns(channels.direction, JUMPS)
    with pytest.raises(InputError, match="base law takes it up"):
        strength_for(MEAN_EFFECTS["torque_bias"], {}, channels, levels, 1e-5, np.random.default_rng(0))


def test_a_strength_out_of_bounds_is_refused() -> None:
    with pytest.raises(InputError, match="outside"):
        strength_for(MEAN_EFFECTS["load_dependence"], {}, CHANNELS, LEVELS, 1e3, np.random.default_rng(0))
