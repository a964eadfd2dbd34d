"""What the formulas of the grammar promise: units, text, wheel files, bounds, and that a search can fit them."""

import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwa_monitor.discrepancy.base_fit import make_problem
from rwa_monitor.discrepancy.hypotheses import formulas
from rwa_monitor.discrepancy.likelihood import NoiseLaw
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.discrepancy.record import make_record
from rwa_monitor.discrepancy.score import Background
from rwa_monitor.discrepancy.shape_profile import profile, shape_limits
from rwa_monitor.errors import InputError
from rwa_monitor.monitor.setup import read_wheel
from rwa_monitor.wheel.effects.base import Channels, MeanEffect
from rwa_monitor.wheel.effects.catalogue import MEAN_EFFECTS, build, effect_class
from rwa_monitor.wheel.effects.formula import FORMULAS, Formula, parse
from rwa_monitor.wheel.wheel import EffectBlock, built_in_wheel
from tests.discrepancy.simple import WHEEL, Array, record, swing
from tests.wheel.effects.records import rich_motion

every_law = pytest.mark.parametrize("law", FORMULAS.values(), ids=lambda law: law.law)
# A quantity's dimension as powers of the units of angle and of time; temperature is an interval scale and keeps its.
DIMENSION = {"rad/s": (1, -1), "rad/s²": (1, -2), "s": (0, 1), "-": (0, 0), "K": (0, 0), "°C": (0, 0)}
BY_UNIT = ("power", "hinge")  # of the speed: the column is a power of the speed in its unit


def in_units(channels: Channels, angle: float, time: float) -> Channels:
    """Return the channels with numbers as in units of angle and time that are so many times smaller."""
    return replace(
        channels,
        time_s=channels.time_s * time,
        speed_rad_s=channels.speed_rad_s * angle / time,
        acceleration_rad_s2=channels.acceleration_rad_s2 * angle / time**2,
        sample_period_s=channels.sample_period_s * time,
    )


@every_law
@given(angle=st.floats(0.1, 10.0), time=st.floats(0.1, 10.0))
def test_other_units_with_the_constants_in_them_give_the_same_torque(
    law: type[Formula], angle: float, time: float
) -> None:
    if law.variable == "angle":
        angle = 1.0  # a radian is what an order counts
    channels, shape = rich_motion(256), law.typical().shape
    units = {parameter.name: DIMENSION[parameter.unit] for parameter in law.shape_parameters()}
    other = {name: value * angle ** units[name][0] * time ** units[name][1] for name, value in shape.items()}
    columns = law.columns(in_units(channels, angle, time), other)[0]
    power = 1.0 if law.carrier == "viscous" else 0.0
    if law.variable == "speed" and law.function in BY_UNIT:
        power += shape.get("exponent", 1.0)
    expected = law.columns(channels, shape)[0] * (angle / time) ** power
    np.testing.assert_allclose(columns, expected, rtol=1e-7, atol=1e-9 * np.abs(expected).max())


@every_law
def test_its_columns_and_names(law: type[Formula]) -> None:
    whole, _ = law.columns(rich_motion(1024), law.typical().shape)
    assert whole.shape == (1024, len(law.strength_parameters()))
    assert np.abs(whole).max() > 0
    strength, *shapes = law.parameters
    assert strength.name.endswith("_Nm_s_rad" if law.carrier == "viscous" else "_Nm")
    assert strength.unit == ("N m s/rad" if law.carrier == "viscous" else "N m")
    assert law.symbols.keys() == {parameter.name for parameter in law.parameters}
    assert pickle.loads(pickle.dumps(law)) is law
    assert effect_class(law.name) is law
    assert parse(" ".join(law.law)) is law
    assert shapes or law.function == "linear"


@pytest.mark.parametrize(
    ("law", "message"),
    [
        ("dry*tanh(sped)", r"effect formula: law: 'dry\*tanh\(sped\)' is no law .* mean 'dry\*tanh\(speed\)'\?"),
        ("__import__('os')", "is no law of the grammar"),
        ("", "is no law of the grammar"),
        ("dry*\ntanh(speed)!", "is no law of the grammar"),
        (None, "effect formula: law: is missing"),
    ],
)
def test_a_malformed_law_is_refused_with_one_line(law: str | None, message: str, tmp_path: Path) -> None:
    parameters = {"strength_Nm": 1e-4, "speed_scale_rad_s": 30.0}
    wheel = built_in_wheel().model_copy(
        update={"effect": (EffectBlock(name="formula", law=law, parameters=parameters),)}
    )
    (tmp_path / "wheel.toml").write_text(wheel.to_toml())
    with pytest.raises(InputError, match=message) as refused:
        read_wheel(tmp_path / "wheel.toml")
    assert "\n" not in str(refused.value)


def test_only_a_formula_has_a_law() -> None:
    with pytest.raises(InputError, match="quadratic_drag: law: belongs to the effect formula alone"):
        build(EffectBlock(name="quadratic_drag", law="x", parameters={"strength_Nm_s2_rad2": 1e-9}))


@pytest.mark.parametrize("law", [*FORMULAS.values(), *MEAN_EFFECTS.values()], ids=lambda law: law.name)
@given(top=st.floats(0.5, 600.0), period=st.floats(0.005, 10.0), seed=st.integers(0, 5))
def test_bounds_lie_inside_the_range_of_the_record(law: type[MeanEffect], top: float, period: float, seed: int) -> None:
    channels = rich_motion(256, period, top, seed)
    ends = {"rad/s": top, "s": 256 * period, "rad/s²": np.abs(channels.acceleration_rad_s2).max()}
    physical = {parameter.name: parameter for parameter in law.shape_parameters()}
    bounds = law.shape_bounds(channels)
    assert list(bounds) == list(physical)
    for name, (low, high) in bounds.items():
        parameter = physical[name]
        assert parameter.low <= low <= high <= parameter.high
        if not issubclass(law, Formula):
            continue
        if parameter.unit in ends:
            assert 0 < low <= high <= ends[parameter.unit]
        if parameter.unit == "°C":
            assert channels.bearing_temperature_degC.min() < low < high < channels.bearing_temperature_degC.max()
        if parameter.unit == "K":
            assert high <= max(np.ptp(channels.bearing_temperature_degC), channels.bearing_temperature_degC.max() - 20)
        columns = law.columns(channels, {**law.typical().shape, name: low})[0]
        assert np.isfinite(columns).all()


def problem_with(effect: Callable[[Array, Array], Array] | None = None, speed: Array | None = None) -> Problem:
    samples, _ = record(swing(4000) if speed is None else speed, (1500,), effect)
    return make_problem([make_record(samples, WHEEL, "one")], WHEEL)


def names(problem: Problem) -> set[str]:
    return {law.law for law in formulas(problem) if issubclass(law, Formula)}


def test_candidates_are_those_that_the_records_can_tell_apart() -> None:
    both = names(problem_with())
    assert "even*tanh(speed)" in both
    assert "dry*wave(angle)" in both
    assert not any("temperature" in law for law in both)
    one_way = names(problem_with(speed=300.0 + swing(4000)))
    assert one_way == {law for law in both if not law.startswith("even")}
    steady = np.full(4000, 100.0) + 0.1 * swing(4000, 1.0)
    for law in formulas(problem_with(speed=steady)):
        assert issubclass(law, Formula)
        assert (law.carrier, law.variable != "speed") == ("dry", True)


def test_a_scale_is_no_smaller_than_the_slowest_speed() -> None:
    problem = problem_with(speed=300.0 + swing(4000))
    low, _ = shape_limits(problem, FORMULAS["viscous*decay(speed)"])["speed_scale_rad_s"]
    assert low == pytest.approx(problem.speed.min(), rel=1e-3)


@pytest.mark.parametrize("law", ["dry*tanh(speed)", "viscous*lorentz(speed)", "even*bump(speed)"])
def test_the_profile_finds_structure_and_constants(law: str) -> None:
    truth = FORMULAS[law]
    shape = truth.typical().shape
    strength = {"dry": 4e-4, "viscous": 2e-5, "even": 4e-4}[truth.carrier]

    def hidden(speed: Array, level: Array) -> Array:
        channels = replace(rich_motion(speed.size), speed_rad_s=speed, direction=np.sign(speed))
        return np.asarray(strength * truth.columns(channels, shape)[0][:, 0])

    problem = problem_with(hidden)
    background = Background.of(problem, (), NoiseLaw(), np.array([1500]))
    candidates = [law for law in formulas(problem) if issubclass(law, Formula) and law.variable == "speed"]
    scores = {candidate: profile(background, None, candidate) for candidate in candidates}
    best = min(scores, key=lambda candidate: scores[candidate][1])
    assert best is truth
    term, _ = profile(background, None, best, around=scores[best][0])
    for name, value in shape.items():
        assert term.shape[name] == pytest.approx(value, rel=0.2)
        low, high = shape_limits(problem, best)[name]
        assert low <= term.shape[name] <= high
