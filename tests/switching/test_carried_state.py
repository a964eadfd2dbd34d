"""The carried state: canonical, small, refuses what it cannot read, and follows the friction of a wheel."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwa_monitor.changepoints.stage_results import Assignment, Components
from rwa_monitor.errors import InputError
from rwa_monitor.switching.carried_state import (
    CHANGE_PER_WINDOW,
    MAX_STATE_BYTES,
    CarriedState,
    Tracked,
    follow,
    next_systems,
    probability_before,
)
from rwa_monitor.wheel.wheel import Wheel, built_in_wheel


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("", ""),
        ("[]", ""),
        ('{"windows": -1}', "windows"),
        ('{"noise_std": "NaN"}', "noise_std"),
        ('{"version": 2}', "version"),
        ('{"probability": {"dry": 1.5}}', "probability.dry"),
        ('{"base_dry": {"mean": 1.0, "std": -1.0, "windows": 1}}', "base_dry.std"),
    ],
)
def test_bad_state_is_refused_with_its_place(text: str, place: str) -> None:
    with pytest.raises(InputError) as caught:
        CarriedState.from_json(text, "state.json")
    assert caught.value.source == "state.json"
    assert caught.value.place == place


def test_state_that_is_too_large_is_refused_unread() -> None:
    with pytest.raises(InputError, match="larger"):
        CarriedState.from_json(" " * (MAX_STATE_BYTES + 1), "state.json")


# ---- the filter ------------------------------------------------------------------------------------------------------


def test_filter_of_a_constant_shrinks_to_the_steady_state_of_its_drift() -> None:
    rng = np.random.default_rng(3)
    measured_std, drift = 0.05, 0.01
    value = Tracked(mean=1.02, std=measured_std, windows=1)
    for _ in range(400):
        value = follow(value, 1.0 + measured_std * rng.standard_normal(), measured_std, known=True)
    # Steady state of the scalar Riccati equation p = (p + q) r / (p + q + r).
    q, r = drift**2, measured_std**2
    steady = math.sqrt(0.5 * (-q + math.sqrt(q * q + 4.0 * q * r)))
    assert value.std == pytest.approx(steady, rel=1e-2)
    assert abs(value.mean - 1.0) < 4.0 * value.std


def test_a_window_that_does_not_show_a_value_only_widens_it() -> None:
    before = Tracked(mean=1.0, std=0.01, windows=3)
    after = follow(before, 1.6, 0.01, known=False)
    assert after.mean == 1.0
    assert after.std > 0.01
    assert after.windows == 3
    assert after.held < 1.0


@given(st.floats(0, 1), st.floats(0.01, 0.99))
def test_the_hazard_pulls_to_the_rate_and_an_anomaly_stays_likelier_than_that(probability: float, rate: float) -> None:
    after = probability_before(probability, rate)
    assert 0.0 <= after <= max(probability, rate)  # time alone makes no anomaly
    assert after >= probability_before(0.0, rate) == pytest.approx(CHANGE_PER_WINDOW * rate)
    assert probability_before(1.0, rate) > 0.99


def test_position_at_the_next_window_is_carried_with_its_age() -> None:
    wheel = built_in_wheel()
    first = _next(CarriedState.empty(), wheel=wheel)
    assert first.fss[0].configuration == 0
    assert first.fss[0].age == 80_000 - 60_000
    assert first.fss[1].configuration == 1
    assert first.fss[1].age == 80_000
    second = _next(first, wheel=wheel)
    assert second.fss[1].age == 160_000  # one sojourn that began before both windows


@pytest.mark.parametrize(("hop", "position"), [(50_050, (1, 50)), (100_000, (None, None))], ids=["overlap", "gap"])
def test_position_is_that_at_the_next_begin_and_unknown_after_a_gap(hop: int, position: tuple[int, int]) -> None:
    wheel = built_in_wheel()
    moved = wheel.model_copy(update={"window": wheel.window.model_copy(update={"hop": hop})})
    system = _next(CarriedState.empty(), wheel=moved).fss[0]
    assert (system.configuration, system.age) == position


def test_friction_of_configurations_is_remembered_and_forgotten() -> None:
    state = CarriedState.empty()
    for _ in range(200):
        state = _next(state)
    memory = state.fss[0].friction[1]
    assert memory.mean == pytest.approx(0.45)
    assert memory.count == pytest.approx(1.0 / (1.0 - 0.95), rel=1e-3)  # the sum of a geometric series


def _next(carried: CarriedState, *, wheel: Wheel | None = None) -> CarriedState:
    """One window: fss_1 goes up at 50,000 and down at 60,000, fss_2 stays in configuration 1."""
    assignment = Assignment(
        index=np.array([50_000, 60_000]),
        system=np.array([0, 0]),
        direction=np.array([1, -1]),
        jump=np.array([0.45, -0.45]),
        jump_std=np.array([0.01, 0.01]),
        confidence=np.ones(2),
        configurations=(np.array([0, 1, 0]), np.array([1])),
        starts=(np.array([0, 50_000, 60_000]), np.array([0])),
        log_score=0.0,
        states=0,
        pruned=False,
    )
    components = Components(
        base_dry=1.0,
        base_dry_std=0.01,
        viscous=1.0,
        viscous_std=0.01,
        fss_friction=(np.array([0.0, 0.45, 0.0]), np.array([0.5])),
        fss_friction_std=(np.full(3, 0.01), np.full(1, 0.01)),
    )
    systems = next_systems(carried, wheel or built_in_wheel(), assignment, components, learn=True)
    return carried.model_copy(update={"fss": systems})
