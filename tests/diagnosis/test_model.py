"""The model file: readable, exact, refused when bad."""

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import integrate

from rwa_monitor.diagnosis.model import (
    Band,
    Model,
    built_in_model,
    from_stated_friction,
    models_for,
)
from rwa_monitor.errors import InputError
from rwa_monitor.wheel.wheel import FrictionRange, built_in_wheel


def _broken(path: str, value: object) -> str:
    content = json.loads(built_in_model().to_json())
    at = content
    *parents, last = path.split(".")
    for key in parents:
        at = at[int(key)] if isinstance(at, list) else at[key]
    if value is None:
        del at[last]
    else:
        at[last] = value
    return json.dumps(content)


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("", ""),
        ("not JSON", ""),
        (_broken("version", 2), "version"),
        (_broken("surprise", 1), "surprise"),
        (_broken("anomalies.0.rate", 1.5), "anomalies.0.rate"),
        (_broken("anomalies.0.rate", "high"), "anomalies.0.rate"),
        (_broken("anomalies.0.levels.0.nominal.soft", 0), "anomalies.0.levels.0.nominal.soft"),
        (_broken("anomalies.0.levels.0.nominal.low", 5), "anomalies.0.levels.0.nominal"),
        (_broken("anomalies.0.name", "viscous"), ""),
        (_broken("anomalies.2.svm.bins", 41), "anomalies.2.svm"),
        (_broken("simultaneous", [1.0, 1.0]), ""),
        (_broken("undecided", [0.6, 0.7]), ""),
    ],
)
def test_bad_model_is_refused_with_file_place_and_reason(text: str, place: str) -> None:
    with pytest.raises(InputError) as caught:
        Model.from_json(text, "model.json")
    assert caught.value.source == "model.json"
    if place:
        assert caught.value.place == place
    assert caught.value.reason


# ---- bands -----------------------------------------------------------------------------------------------------------


@given(
    low=st.floats(-2, 2),
    width=st.just(0.0) | st.floats(1e-4, 3),
    soft=st.floats(1e-3, 0.5),
    std=st.just(0.0) | st.floats(1e-4, 1.0),
)
def test_density_of_a_band_integrates_to_one(low: float, width: float, soft: float, std: float) -> None:
    band = Band(low=low, high=low + width, soft=soft)
    sigma = math.hypot(soft, std)
    mass, _ = integrate.quad(
        lambda x: float(band.density(np.array([x]), np.array([std]))[0]),
        low - 10 * sigma,
        low + width + 10 * sigma,
        points=[low, low + width],
        limit=400,
    )
    assert mass == pytest.approx(1.0, abs=1e-6)


def test_density_keeps_its_digits_far_from_the_band() -> None:
    band = Band(low=0.0, high=1.0, soft=0.1)
    below, above = band.density(np.array([-2.0]), np.zeros(1)), band.density(np.array([3.0]), np.zeros(1))
    assert below[0] == pytest.approx(above[0], rel=1e-9)
    assert 0.0 < above[0] < 1e-80


# ---- wheels other than the one trained for ---------------------------------------------------------------------------


def test_a_wheel_without_nominal_values_has_no_model() -> None:
    wheel = built_in_wheel().model_copy(update={"nominal": None})
    assert models_for(wheel, built_in_model()) == [None] * 4


def test_a_system_of_the_same_name_with_other_friction_is_not_taken_for_the_learned_one() -> None:
    wheel = built_in_wheel()
    rest, active = FrictionRange(low=0.0, high=0.0), FrictionRange(low=2.0, high=3.0)
    other = wheel.fss[0].model_copy(update={"friction": (rest, active)})
    learned = built_in_model().anomaly("fss_1")
    assert learned.serves(wheel.fss[0])
    assert not learned.serves(other)
    assert not learned.serves(wheel.fss[1])
    assert from_stated_friction(other.model_copy(update={"friction": (rest, rest)})) is None
