"""wheel.toml: round trip, and one clear sentence for each mistake."""

import copy
import re
import tomllib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rwa_monitor.errors import InputError
from rwa_monitor.wheel.durations import Geometric, Histogram, Lognormal, Uniform, Weibull
from rwa_monitor.wheel.wheel import BUILT_IN_WHEEL_TOML, EffectBlock, SwitchingSystem, Wheel, built_in_wheel

MINIMAL = '[wheel]\nname = "w"\nsample_period_s = 0.1\n'
WHEEL = built_in_wheel()


def test_minimal_wheel_reports_what_it_lacks():
    wheel = Wheel.from_toml(MINIMAL, "w.toml")
    assert (wheel.torque_unit_Nm, wheel.speed_unit_rad_s, wheel.anomalies) == (1.0, 1.0, ("dry", "viscous"))
    assert len(wheel.missing()) == 3
    run_down = Wheel.from_toml(f"{MINIMAL}inertia_kg_m2 = 1.0\n[friction]\nmotor_off = true\n", "w.toml")
    assert run_down.missing() == wheel.missing()[1:]  # without a motor, the inertia is enough


LAWS = st.one_of(
    st.builds(Uniform, low=st.integers(1, 50), high=st.integers(50, 99)),
    st.builds(Geometric, mean=st.floats(1, 1e6)),
    st.builds(Weibull, shape=st.floats(0.2, 5), scale=st.floats(0.1, 1e6)),
    st.builds(Lognormal, mu=st.floats(-3, 10), sigma=st.floats(0.01, 2)),
    st.just(Histogram(edges=(1, 5, 20), weights=(0.25, 0.75))),
)


@given(st.lists(LAWS, min_size=2, max_size=4), st.floats(1e-6, 1e3), st.text(min_size=1, max_size=20))
def test_round_trip(laws, period, name):
    system = SwitchingSystem(name="s", durations=tuple(laws), up=(0.5,) * len(laws))
    effect = EffectBlock(name="stribeck", parameters={"strength_Nm": 5e-4})
    wheel = WHEEL.model_copy(
        update={"name": name, "sample_period_s": period, "fss": (*WHEEL.fss, system), "effect": (effect,)}
    )
    again = Wheel.from_toml(wheel.to_toml(), "again")
    assert again == wheel
    assert again.sha256() == wheel.sha256()


def test_hash_is_that_of_the_meaning():
    shuffled = "# a comment\n" + BUILT_IN_WHEEL_TOML.replace("0.125", "1.25e-1")
    assert Wheel.from_toml(shuffled, "s").sha256() == WHEEL.sha256()
    assert WHEEL.model_copy(update={"inertia_kg_m2": 0.0118}).sha256() != WHEEL.sha256()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[wheel", "w.toml: is no valid TOML"),
        ("", "w.toml: name: "),
        ("[wheel]\nsample_period_s = 0.1", "w.toml: name: "),
        ('[wheel]\nname = "w"', "w.toml: sample_period_s: "),
        ('[wheel]\nname = "w"\nsample_period_s = 0', "w.toml: sample_period_s: "),
        ('[wheel]\nname = "w"\nsample_period_s = 1e-9', "w.toml: wheel: "),
        ('[wheel]\nname = "w"\nsample_period_s = "fast"', "w.toml: sample_period_s: "),
        (MINIMAL + "mass_kg = 3", "w.toml: mass_kg: "),
        (MINIMAL + "gear_efficiency = 0.9", "w.toml: wheel: Value error, gear_efficiency is that of a gear: "),
        (MINIMAL + "[nominals]", "w.toml: nominals: does not belong here"),
        (MINIMAL + "[wheel.window]", "w.toml: window: does not belong here"),
        ("inertia_kg_m2 = 1.0\n" + MINIMAL, "w.toml: inertia_kg_m2: does not belong here"),
        (MINIMAL + "[nominal]\ndry_torque_Nm = 1e-3", "w.toml: nominal.viscous_Nm_s_rad: "),
        (MINIMAL + "[noise]\nfriction_std_Nm = 0", "w.toml: noise.friction_std_Nm: "),
        (MINIMAL + '[friction]\nderivative = { method = "spline" }', "w.toml: friction.derivative.method: "),
        (MINIMAL + "[limits]\nmax_speed_rad_s = inf", "w.toml: limits.max_speed_rad_s: "),
        (MINIMAL + "[window]\nsamples = 3", "w.toml: window.samples: "),
        (MINIMAL + "[window]\nrun_length = 9e3", "w.toml: window.run_length: "),  # a run length that was not measured
        (MINIMAL + "[fss]", "w.toml: fss: "),
        (MINIMAL + '[[fss]]\nname = "a b"\ndurations = []', "w.toml: fss.0.name: "),
        (
            MINIMAL + '[[effect]]\nname = "stribeck"\nparameters = { strength_Nm = "big" }',
            "w.toml: effect.0.parameters",
        ),
    ],
)
def test_each_mistake_is_named_in_one_line(text, message):
    with pytest.raises(InputError, match=f"^{re.escape(message)}") as caught:
        Wheel.from_toml(text, "w.toml")
    assert "\n" not in str(caught.value)


def fss(**values):
    tables = tomllib.loads(BUILT_IN_WHEEL_TOML)
    tables["fss"][0].update(values)
    return tables


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        (fss(durations=[{"law": "normal"}] * 2), "fss.0.durations.0: "),
        (fss(durations=[{"uniform": {"low": 1, "high": 4}}] * 2), "fss.0.durations.0: "),
        (fss(durations=[{"law": "uniform", "low": 3, "high": 2}] * 2), "fss.0.durations.0.uniform: "),
        (fss(durations=[{"law": "uniform", "low": 1, "high": 2, "mean": 3}] * 2), "fss.0.durations.0.uniform.mean: "),
        (fss(friction=[{"low": 0.0, "high": 0.0}]), "fss.0: "),
        (fss(friction=[{"low": 1.0, "high": 0.0}] * 2), "fss.0.friction.0: "),
        (fss(up=[1.0, 2.0]), "fss.0.up.1: "),
        (fss(up=[1.0]), "fss.0: "),
        (fss(name="dry"), "fss.0: "),
        (fss(name="fss_2"), "wheel: "),
    ],
)
def test_each_mistake_in_a_switching_system_is_named(tables, message):
    with pytest.raises(InputError, match=f"^{re.escape('w: ' + message)}"):
        Wheel.from_tables(tables, "w")


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)


@settings(deadline=None, max_examples=300)
@given(st.data())
def test_whatever_stands_anywhere_gives_a_wheel_or_one_clear_error(data):
    """Replace a value anywhere in the tables by anything."""
    tables = copy.deepcopy(tomllib.loads(BUILT_IN_WHEEL_TOML))
    node, key = tables, data.draw(st.sampled_from(sorted(tables)))
    while isinstance(node[key], dict | list) and node[key] and data.draw(st.booleans()):
        node = node[key]
        key = data.draw(st.sampled_from(sorted(node) if isinstance(node, dict) else range(len(node))))
    node[key] = data.draw(VALUES)
    try:
        wheel = Wheel.from_tables(tables, "w.toml")
    except InputError as error:
        message = str(error)
    else:
        assert wheel.period_ns >= 1_000
        assert Wheel.from_tables(wheel.to_tables(), "again") == wheel
        return
    assert message.startswith("w.toml: ")
    assert "\n" not in message
