"""Three causes that a record confuses; the manoeuvre that the plan puts first, flown, leaves the true one alone."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.ndimage import uniform_filter1d

from rwa_monitor.discrepancy.find import find_discrepancy
from rwa_monitor.discrepancy.plan import DECIDES, MANOEUVRES, UNINFORMATIVE, plan
from tests.discrepancy.simple import DRY_NM, PERIOD_S, WHEEL, Array, record

TOP_RAD_S, OFFSET_NM = 150.0, 1e-5  # a quarter of the noise
CONFUSED: dict[str, Callable[[Array, Array], Array]] = {
    "torque_bias": lambda speed, level: np.full(speed.size, OFFSET_NM),
    "coulomb_asymmetry": lambda speed, level: 2 * OFFSET_NM / DRY_NM * level,
    "viscous_asymmetry": lambda speed, level: OFFSET_NM / TOP_RAD_S * np.abs(speed),
}


def to_and_fro() -> Array:
    """One speed, forwards and backwards, 25 s each, without a jump: all three are one constant."""
    time = np.arange(8000) * PERIOD_S
    return np.asarray(uniform_filter1d(np.where((time // 25.0) % 2 == 0, TOP_RAD_S, -TOP_RAD_S), 8))


@pytest.mark.parametrize(
    "truth", [pytest.param("torque_bias", marks=pytest.mark.slow), "coulomb_asymmetry", "viscous_asymmetry"]
)
def test_the_planned_manoeuvre_leaves_one_of_three_confused_causes(truth: str) -> None:
    effect = CONFUSED[truth]
    before = find_discrepancy([("confused", record(to_and_fro(), (), effect)[0])], WHEEL)
    named = before.result.effects[0]
    assert {named.name, *named.equivalent} == set(CONFUSED)

    first, *others = plan(before).manoeuvres
    assert first.name == "two speeds in both directions, across a jump"
    assert first.separation > DECIDES > max((entry.separation for entry in others), default=0.0)
    assert min(entry.separation for entry in (first, *others)) >= UNINFORMATIVE

    manoeuvre = next(entry for entry in MANOEUVRES if entry.name == first.name)
    time = np.arange(0.0, manoeuvre.duration_s, PERIOD_S)
    speed = np.asarray(uniform_filter1d(manoeuvre.speed(time, TOP_RAD_S), 160))
    flown, _ = record(speed, (int(manoeuvre.jump_at * speed.size),), effect, seed=5)
    after = find_discrepancy([("flown", flown)], WHEEL).result.effects
    assert [(found.name, found.equivalent) for found in after] == [(truth, ())]
