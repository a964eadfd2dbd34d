"""A dead zone that shows in the readings of the speed: they rest on zero, or on the last one outside."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwa_monitor.discrepancy.extended import extend
from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.tachometer import read_zone
from tests.discrepancy.simple import DRY_NM, VISCOUS, WHEEL, current_of, sampled, search

SLOTS, NOISE, WIDTH = 4_000, 0.01, 1.0  # rad/s


def passages() -> FloatArray:
    """A speed that passes zero evenly and slowly, six times, and once in a hurry [rad/s], with noise."""
    times = [0.0, 600.0, 1200.0, 1280.0, 1900.0, 2600.0, 3400.0, 4000.0]
    turns = np.interp(np.arange(SLOTS), times, [-60.0, 50.0, -40.0, 70.0, -55.0, 45.0, -60.0, 55.0])
    return turns + NOISE * np.random.default_rng(8).standard_normal(SLOTS)


def read(speed: FloatArray, *, held: bool, width: float = WIDTH) -> FloatArray:
    """What a tachometer with a dead zone reads."""
    outside = np.abs(speed) >= width
    last = np.maximum.accumulate(np.where(outside, np.arange(speed.size), 0))
    return speed[last] if held else np.where(outside, speed, 0.0)


@pytest.mark.parametrize(
    ("held", "derived"),
    [
        (False, False),
        (True, True),
        pytest.param(False, True, marks=pytest.mark.slow),
        pytest.param(True, False, marks=pytest.mark.slow),
    ],
)
def test_zone_is_found_and_carried_over(held: bool, derived: bool) -> None:
    speed, rng = passages()[:3_713], np.random.default_rng(9)  # it ends in the zone
    friction = DRY_NM * np.sign(speed) + VISCOUS * speed + 2e-5 * rng.standard_normal(speed.size)
    channel = {"motor_current_A": current_of(friction, speed)} if derived else {"friction": friction}
    samples = sampled(read(speed, held=held), **channel)
    searched = search(samples)
    (found,) = [effect for effect in searched.result.effects if effect.family == "mean"]
    edge = found.parameters["dead_zone_rad_s"]
    assert found.name == "speed_dead_zone"
    assert abs(edge.value - WIDTH) < 4.0 * edge.std + 3.0 * NOISE
    (block,) = extend(searched).wheel.effect
    assert block.parameters == {"strength_Nm": 0.0, "dead_zone_rad_s": edge.value}
    known = WHEEL.model_copy(update={"effect": (block,)})
    assert not search(samples, known).result.effects  # and what is known is no discovery


@given(scale=st.floats(0.01, 100.0), held=st.booleans(), mirrored=st.booleans(), backwards=st.booleans())
def test_zone_does_not_depend_on_unit_or_direction(scale: float, held: bool, mirrored: bool, backwards: bool) -> None:
    speed = passages()[:: -1 if backwards else 1]
    plain = read_zone(read(speed, held=held), 0.0)
    other = read_zone(read(speed, held=held) * (-scale if mirrored else scale), 0.0)
    assert other.width_rad_s == pytest.approx(scale * plain.width_rad_s)
    assert np.array_equal(other.inside, plain.inside)
    assert other.deviance == pytest.approx(plain.deviance, rel=0.05)  # a reading may change its part


@pytest.mark.parametrize("held", [False, True])
def test_all_that_rests_in_the_zone_is_left_out_and_nothing_else(held: bool) -> None:
    speed = passages()
    zone = read_zone(read(speed, held=held), 0.0)
    assert np.array_equal(zone.inside, np.abs(speed) < WIDTH)  # the hurried passage, too


@pytest.mark.parametrize("seed", range(5))
def test_three_passages_show_it_however_their_few_readings_fall(seed: int) -> None:
    turns = np.interp(np.arange(1_600), [0.0, 400.0, 800.0, 1_200.0, 1_600.0], [-20.0, 60.0, -20.0, 60.0, 50.0])
    zone = read_zone(read(turns + 0.1 * np.random.default_rng(seed).standard_normal(turns.size), held=False), 0.0)
    assert zone.width_rad_s == pytest.approx(WIDTH, abs=3.0 * zone.std_rad_s)


def stopping() -> FloatArray:
    """A wheel that stops at zero, and reads exactly zero."""
    return np.sign(passages()) * np.maximum(np.abs(passages()) - 5.0, 0.0)


def hurrying() -> FloatArray:
    """A control that keeps away from zero, and hurries through it."""
    return passages() + 3.0 * np.sign(passages())


def dwelling() -> FloatArray:
    """A ladder of dwells with one at rest."""
    steps = np.repeat(np.tile([-20.0, -3.0, 0.0, 3.0, 20.0, 3.0, 0.0, -3.0], 5), SLOTS // 40)
    return np.where(steps != 0.0, steps + NOISE * np.random.default_rng(8).standard_normal(SLOTS), 0.0)


def on_grid() -> FloatArray:
    """Readings on a coarse grid, of which zero is one."""
    return np.rint(passages() / 0.5) * 0.5


@pytest.mark.parametrize("motion", [passages, stopping, hurrying, dwelling, on_grid])
def test_other_motions_show_none(motion: Callable[[], FloatArray]) -> None:
    speed = motion()
    assert read_zone(speed, 0.5 if motion is on_grid else 0.0) is None
