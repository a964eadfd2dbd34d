"""The exponent of a Stribeck curve is fitted where it is none of the usual two, and nothing is left for other names."""

from __future__ import annotations

import numpy as np
import pytest

from rwa_monitor.discrepancy.extended import extend
from rwa_monitor.discrepancy.find import find_discrepancy
from rwa_monitor.discrepancy.finished_search import Search
from rwa_monitor.wheel.wheel import Wheel
from tests.discrepancy.simple import NOISE_NM, WHEEL, Array, record, swing

STRENGTH_NM = 5e-4


def search(seed: int, width: float, exponent: float) -> Search:
    """Search a record with a Stribeck curve of that exponent."""

    def curve(speed: Array, _: Array) -> Array:
        return np.asarray(STRENGTH_NM * np.sign(speed) * np.exp(-((np.abs(speed) / width) ** exponent)))

    return find_discrepancy([("knee", record(swing(top=120.0), effect=curve, seed=seed)[0])], WHEEL)


@pytest.mark.parametrize(("seed", "width", "exponent"), [(50210, 6.0, 1.4), (50211, 8.0, 0.7), (50212, 12.0, 2.4)])
def test_an_exponent_is_fitted_and_told_with_its_error(seed: int, width: float, exponent: float) -> None:
    found = search(seed, width, exponent)
    (effect,) = found.result.effects  # no dead zone for what another exponent leaves
    assert effect.name == "stribeck"
    assert found.result.unexplained is None
    truth = {"strength_Nm": STRENGTH_NM, "stribeck_speed_rad_s": width, "exponent": exponent}
    for name, value in effect.parameters.items():
        assert value.std is not None
        assert abs(value.value - truth[name]) < 4.0 * value.std
    assert effect.parameters["exponent"].value not in {1.0, 2.0}
    extended = Wheel.from_toml(extend(found).to_toml(), "extended")
    assert extended.effect[0].parameters["exponent"] == effect.parameters["exponent"].value
    gain = found.result.gain
    assert gain is not None
    assert gain.simulated is not None
    assert gain.simulated.rmse_extended_Nm < 1.05 * NOISE_NM


@pytest.mark.parametrize(("seed", "exponent"), [(50213, 1.0), (50214, 2.0)])
def test_a_usual_exponent_stays_where_nothing_speaks_against_it(seed: int, exponent: float) -> None:
    (effect,) = search(seed, 8.0, exponent).result.effects
    assert effect.parameters["exponent"].value == exponent
    assert effect.parameters["exponent"].std is not None
