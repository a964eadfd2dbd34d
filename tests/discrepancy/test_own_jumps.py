"""Drag that jumps at moments of its own, beside the dry friction's jumps: it relaxes, or its slope is another."""

import numpy as np
import pytest

from rwa_monitor.discrepancy.extended import extended_wheel
from tests.discrepancy.simple import DRY_NM, PERIOD_S, VISCOUS, Array, names, record, search, swing

COUNT = 4000
JUMPS = (1500, 3100)
POCKETS = (600, 1900, 2700, 3400)
SLOPES = (800, 1900, 2900)


def pockets(speed: Array, height: float, seconds: float) -> Array:
    """Return the drag of pockets of oil that are run over and squeezed out again [N m]."""
    drag = np.zeros(speed.size)
    for k, at in enumerate(POCKETS):
        drag[at:] += (1.0 + 0.2 * k) * height * np.exp(-np.arange(speed.size - at) * PERIOD_S / seconds)
    return np.asarray(drag * np.sign(speed))


@pytest.mark.parametrize(
    ("height", "seconds", "seed"), [(0.3, 25.0, 0), pytest.param(0.15, 60.0, 1, marks=pytest.mark.slow), (0.3, 8.0, 2)]
)
def test_pockets_of_oil_are_jumps_that_relax_and_no_further_system(height: float, seconds: float, seed: int) -> None:
    samples, _ = record(swing(COUNT), JUMPS, lambda speed, _: pockets(speed, height * DRY_NM, seconds), seed=seed)
    found = search(samples)
    assert names(found) == ["decaying_jump"]
    (effect,) = found.result.effects
    assert effect.parameters["time_constant_s"].value == pytest.approx(seconds, rel=0.25)
    (relaxing,) = (term for term in found.extended.terms if term.effect.name == "decaying_jump")
    heights = found.extended.strengths(found.extended.names.index("decaying_jump"))
    assert relaxing.columns.shape[1] == len(POCKETS)
    np.testing.assert_allclose(heights, height * DRY_NM * (1.0 + 0.2 * np.arange(len(POCKETS))), rtol=0.15)
    assert [block.name for block in extended_wheel(found).effect] == ["decaying_jump"]


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_a_slope_that_jumps_by_itself_is_named(seed: int) -> None:
    def sloped(speed: Array, _: Array) -> Array:
        stretch = np.searchsorted(SLOPES, np.arange(speed.size), side="right")
        return np.asarray(0.5 * VISCOUS * np.array([0.0, 1.0, 0.0, 1.0])[stretch] * speed)

    samples, _ = record(swing(COUNT), JUMPS, sloped, seed=seed)
    assert names(search(samples)) == ["viscous_jump"]


@pytest.mark.parametrize("seed", range(3))
def test_levels_alone_show_no_such_jumps(seed: int) -> None:
    named = names(search(record(swing(COUNT), (700, 1500, 2300, 3100), seed=seed)[0]))
    assert not {"decaying_jump", "viscous_jump"} & set(named)
