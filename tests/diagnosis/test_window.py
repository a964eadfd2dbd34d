"""Whole windows: simulated telemetry in, diagnosis out."""

from typing import Literal

import numpy as np
import pytest

from rwa_monitor.changepoints.evidence import WindowAccumulator
from rwa_monitor.diagnosis.model import Model, built_in_model
from rwa_monitor.diagnosis.window import diagnose_window
from rwa_monitor.messages import Diagnosis
from rwa_monitor.paper import method as paper
from rwa_monitor.samples import BoolArray, FloatArray
from rwa_monitor.simulation.record import simulate
from rwa_monitor.simulation.scenario import Anomaly, Scenario
from rwa_monitor.switching.carried_state import CarriedState
from rwa_monitor.wheel.durations import Uniform
from rwa_monitor.wheel.wheel import Wheel, Window, built_in_wheel
from tests.switching.assignment_windows import system

MODEL = built_in_model()
EMPTY = CarriedState.empty()


def telemetry(
    seed: int, wheel: Wheel | None = None, duration_s: float = 10_000.0, **factors: float
) -> tuple[FloatArray, FloatArray]:
    """Speed and friction torque of one window, unless it is to be longer, with anomalies by factor."""
    scenario = Scenario(
        duration_s=duration_s, anomalies={name: Anomaly(factor=factor) for name, factor in factors.items()}
    )
    samples = simulate(scenario, wheel or built_in_wheel(), np.random.default_rng(seed)).samples
    return samples.speed_rad_s, samples.friction_torque_Nm


def diagnose(
    speed: FloatArray,
    torque: FloatArray,
    *,
    wheel: Wheel | None = None,
    model: Model | None = MODEL,
    carried: CarriedState = EMPTY,
    method: Literal["joint", "paper"] = "joint",
    good: BoolArray | None = None,
) -> tuple[Diagnosis, CarriedState]:
    wheel = wheel or built_in_wheel()
    window = WindowAccumulator(wheel, speed.size)
    window.append(speed, torque, np.isfinite(speed) & np.isfinite(torque) if good is None else good)
    by_method = {"joint": diagnose_window, "paper": paper.diagnose_window}[method]
    diagnosis, _, state = by_method(window.close(), wheel, model, carried)
    return diagnosis, state


ALL = {"dry": 1.3, "viscous": 1.15, "fss_1": 1.6, "fss_2": 1.4}
ONE, TWO = [{name: factor} for name, factor in ALL.items()], [{"dry": 1.3, "fss_1": 1.6}, {"dry": 1.3, "viscous": 1.15}]


def active(diagnosis: Diagnosis) -> set[str]:
    return {name for name, anomaly in diagnosis.anomalies.items() if anomaly.active}


@pytest.mark.parametrize("factors", [{}, *ONE, *TWO, ALL])
def test_what_is_simulated_is_diagnosed(factors: dict[str, float]) -> None:
    diagnosis, state = diagnose(*telemetry(6, **factors))
    assert "never rested" not in diagnosis.explanation
    assert active(diagnosis) == set(factors)
    assert diagnosis.verdict == ("anomalous" if factors else "nominal")
    assert diagnosis.model_adequate
    assert diagnosis.coverage == 1.0
    assert state.windows == 1
    for value, truth in (
        (diagnosis.friction.base_dry, 1.6e-3 * factors.get("dry", 1.0)),
        (diagnosis.friction.viscous, 5.333e-6 * factors.get("viscous", 1.0)),
    ):
        assert abs(value.value - truth) < 4.0 * value.std
        assert value.std < 5e-3 * truth
    for name in factors:
        anomaly = diagnosis.anomalies[name]
        assert anomaly.probability > 0.9
        # The ranges of a system overlap: its highest configuration alone may look nominal, all sojourns do not.
        nominal = 0.5 * (anomaly.nominal_low + anomaly.nominal_high)
        assert anomaly.estimate > (anomaly.nominal_high if name in ("dry", "viscous") else nominal)
        assert 0.0 <= anomaly.severity < 2.0
        assert diagnosis.explanation.startswith(diagnosis.reason)


@pytest.mark.parametrize("factors", [{}, {"dry": 1.3}, {"fss_2": 1.4}])
def test_where_a_system_never_rests_the_rest_is_probability(factors: dict[str, float]) -> None:
    diagnosis, _ = diagnose(*telemetry(5, **factors))
    truth = 1.6e-3 * factors.get("dry", 1.0)
    assert abs(diagnosis.friction.base_dry.value - truth) < 3.0 * diagnosis.friction.base_dry.std
    assert active(diagnosis) == set(factors)
    suspected = diagnosis.anomalies["dry"].probability + diagnosis.anomalies["fss_2"].probability
    assert suspected == pytest.approx(1.0 if factors else 0.0, abs=0.02)  # one of the two, which is less sure
    assert all(anomaly.probability < 0.95 for anomaly in diagnosis.anomalies.values())
    assert "never rested" in diagnosis.explanation


# ---- what must change nothing ----------------------------------------------------------------------------------------


def _content(diagnosis: Diagnosis) -> dict[str, object]:
    return diagnosis.model_dump(exclude={"provenance", "explanation", "reason"})


@pytest.mark.parametrize("factors", [{}, {"dry": 1.3}, {"fss_2": 1.4}])
def test_reversing_the_direction_of_rotation_changes_nothing(factors: dict[str, float]) -> None:
    speed, torque = telemetry(8, **factors)
    forward, backward = diagnose(speed, torque)[0], diagnose(-speed, -torque)[0]
    assert _content(backward) == _content(forward)


@pytest.mark.parametrize("scale", [0.25, 4.0, 3.7])
def test_a_wheel_with_all_torques_scaled_gets_the_same_judgement(scale: float) -> None:
    """Powers of two change no digit; other scales change rounding only."""
    wheel = built_in_wheel()
    nominal = wheel.nominal.model_copy(
        update={
            "dry_torque_Nm": scale * wheel.nominal.dry_torque_Nm,
            "viscous_Nm_s_rad": scale * wheel.nominal.viscous_Nm_s_rad,
        }
    )
    noise = wheel.noise.model_copy(update={"friction_std_Nm": scale * wheel.noise.friction_std_Nm})
    scaled = wheel.model_copy(update={"nominal": nominal, "noise": noise})
    speed, torque = telemetry(9, dry=1.3)
    plain, other = diagnose(speed, torque)[0], diagnose(speed, scale * torque, wheel=scaled)[0]
    assert active(other) == active(plain) == {"dry"}
    for one, two in zip(plain.anomalies.values(), other.anomalies.values(), strict=True):
        assert two.probability == pytest.approx(one.probability, rel=1e-6, abs=1e-9)
        assert two.severity == pytest.approx(one.severity, rel=1e-6, abs=1e-9)
    assert other.friction.base_dry.value == pytest.approx(scale * plain.friction.base_dry.value, rel=1e-9)


# ---- windows and wheels that show too little -------------------------------------------------------------------------


@pytest.mark.parametrize("used", [0, 1, 10, 100])
@pytest.mark.parametrize("method", ["joint", "paper"])
def test_too_few_samples_are_inconclusive_with_the_reason(used: int, method: Literal["joint", "paper"]) -> None:
    speed, torque = telemetry(12)
    good = np.zeros(speed.size, dtype=bool)
    good[20_000 : 20_000 + used] = True
    diagnosis, state = diagnose(speed, torque, good=good, method=method)
    assert diagnosis.verdict == "inconclusive"
    assert "usable sample" in diagnosis.reason
    assert len(diagnosis.anomalies) == 4
    assert {anomaly.probability for anomaly in diagnosis.anomalies.values()} == {0.5}
    assert state.base_dry == state.viscous is None
    assert not state.probability
    if used < 16:
        assert state == EMPTY


def test_without_a_model_friction_is_split_and_nothing_is_judged() -> None:
    diagnosis, state = diagnose(*telemetry(13), model=None)
    assert diagnosis.verdict == "inconclusive"
    assert "no model" in diagnosis.reason
    assert diagnosis.provenance.model_sha256 == ""
    assert diagnosis.friction.base_dry.value == pytest.approx(1.6e-3, rel=5e-3)
    assert state.probability == {}
    assert not active(diagnosis)


def test_an_unknown_system_is_judged_by_the_wheel_file() -> None:
    wheel = built_in_wheel()
    renamed = wheel.fss[1].model_copy(update={"name": "cage"})
    wheel = wheel.model_copy(update={"fss": (wheel.fss[0], renamed)})
    healthy, _ = diagnose(*telemetry(15, wheel), wheel=wheel)
    ill, _ = diagnose(*telemetry(15, wheel, cage=1.8), wheel=wheel)
    assert healthy.verdict == "nominal"
    assert active(ill) == {"cage"}
    cage = ill.anomalies["cage"]
    # Nothing was learned to compare with: 1 lies 40 % of the healthy friction above its bound, 1.6 mN m in the middle.
    assert cage.severity == pytest.approx((cage.estimate - cage.nominal_high) / (0.4 * 1.6e-3), rel=1e-6)


CAGE = system("cage", Uniform(low=400, high=1200), Uniform(low=60, high=200))


@pytest.mark.parametrize("stated", [True, False])
def test_a_healthy_system_of_unknown_friction_stays_unjudged_however_long(stated: bool) -> None:
    """Thirty windows: what none of them shows does not add up to an anomaly."""
    truth = built_in_wheel().model_copy(update={"window": Window(samples=4000), "fss": (CAGE,)})
    wheel = truth if stated else truth.model_copy(update={"fss": (CAGE.model_copy(update={"friction": None}),)})
    speed, torque = telemetry(21, truth, 30 * 4000 * 0.125)
    state, seen = EMPTY, []
    for first in range(0, speed.size, 4000):
        part = slice(first, first + 4000)
        diagnosis, state = diagnose(speed[part], torque[part], wheel=wheel, carried=state)
        seen.append(diagnosis)
    assert {one.verdict for one in seen} == {"nominal" if stated else "inconclusive"}
    if stated:
        assert max(one.anomalies["cage"].probability for one in seen) < 0.1
    else:
        assert {one.anomalies["cage"].probability for one in seen} == {0.5}
        assert "no file states" in seen[-1].reason
        assert "cage" not in state.probability


# ---- carried state ---------------------------------------------------------------------------------------------------


def test_earlier_windows_are_named_and_used() -> None:
    first, state = diagnose(*telemetry(16))
    second, after = diagnose(*telemetry(17), carried=state)
    assert first.provenance.prior_sha256 == EMPTY.sha256()
    assert second.provenance.prior_sha256 == state.sha256()
    assert after.windows == 2
    assert state.probability["dry"] < 0.01
    assert state.base_dry.mean == pytest.approx(1.0, abs=0.01)
    assert "1 earlier window" in second.explanation


def test_a_slowly_growing_anomaly_does_not_become_the_new_normal() -> None:
    state, verdicts = EMPTY, []
    for window in range(16):
        factor = 1.0 + 0.02 * window
        diagnosis, state = diagnose(*telemetry(100 + window, dry=factor), carried=state)
        verdicts.append((factor, diagnosis.verdict, "dry" in active(diagnosis)))
    assert all(verdict == "nominal" for factor, verdict, _ in verdicts if factor <= 1.04)
    assert all(dry for factor, _, dry in verdicts if factor >= 1.2)
    assert state.base_dry.mean == pytest.approx(1.3, abs=0.03)


@pytest.mark.parametrize(("name", "factor"), [("dry", 1.2), ("dry", 1.5), ("viscous", 1.1), ("viscous", 1.3)])
def test_severity_is_that_of_the_true_coefficient_within_its_interval(name: str, factor: float) -> None:
    learned = MODEL.anomaly(name)
    levels = learned.levels[0]
    width = levels.median - levels.nominal_high
    for seed in range(40, 44):
        found = diagnose(*telemetry(seed, **{name: factor}))[0].anomalies[name]
        assert found.severity_std > 0.0
        true = max(0.0, (factor - levels.nominal_high) / width)
        # Four standard deviations: one of 16 fails by chance once in a thousand runs; the seeds are fixed.
        assert abs(found.severity - true) <= 4.0 * found.severity_std


@pytest.mark.parametrize("seed", range(3))
def test_where_a_system_shows_two_of_three_configurations_the_paths_are_weighed(seed: int) -> None:
    """fss_2 goes to and fro between two of its three configurations; with ×1.4 only one pair fits what was learned."""
    rng = np.random.default_rng(seed)
    wheel = built_in_wheel()
    slots = 60_000
    speed = 150.0 + 60.0 * np.sin(np.arange(slots) / 6_000.0)
    level = np.full(slots, 1.0)
    for start, first in ((0, 0.62), (12_000, 1.38), (24_000, 0.7), (36_000, 1.5), (48_000, 0.66)):
        level[start : start + 12_000] += first
    level[30_000:30_060] += 0.45
    nominal, noise = wheel.nominal, wheel.noise.friction_std_Nm
    torque = nominal.dry_torque_Nm * level + nominal.viscous_Nm_s_rad * speed + noise * rng.standard_normal(slots)
    diagnosis, _ = diagnose(speed, torque, wheel=wheel)
    assert diagnosis.friction.fss["fss_2"].configuration == [1, 2, 1, 2, 1]
    assert diagnosis.friction.base_dry.value == pytest.approx(nominal.dry_torque_Nm, rel=0.1)
    assert active(diagnosis) == {"fss_2"}
