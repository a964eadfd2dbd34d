"""What the catalogue promises of every effect, whatever its family."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwa_monitor.errors import InputError
from rwa_monitor.wheel.effects.base import Effect, MeanEffect
from rwa_monitor.wheel.effects.catalogue import CATALOGUE, MEAN_EFFECTS, build, mean_effects, register, to_block
from rwa_monitor.wheel.effects.formula import FORMULAS
from rwa_monitor.wheel.wheel import EffectBlock, Wheel, built_in_wheel

every_effect = pytest.mark.parametrize("effect", CATALOGUE.values(), ids=lambda effect: effect.name)

# The unit that each ending of a parameter's name stands for.
UNITS = {
    "_Nm_s2_rad2": "N m s²/rad²",
    "_Nm_s_rad": "N m s/rad",
    "_Nm_s": "N m/s",
    "_Nm": "N m",
    "_kg_m2_s": "kg m² s",
    "_kg_m2": "kg m²",
    "_s_rad": "s/rad",
    "_rad_s": "rad/s",
    "_rad": "rad",
    "_1_K": "1/K",
    "_K": "K",
    "_s": "s",
}


@every_effect
def test_it_explains_itself(effect: type[Effect]) -> None:
    for text in (effect.title, effect.formula, effect.description, effect.signature, effect.separate_by, effect.source):
        assert len(text.strip()) >= 5
    for text in (effect.description, effect.signature, effect.separate_by, effect.source):
        assert text.endswith("."), "sentences"
        assert "  " not in text
    others = set(effect.confused_with)
    assert others
    assert others <= CATALOGUE.keys() - {effect.name}
    assert len(others) == len(effect.confused_with)


@every_effect
def test_units_are_stated_and_agree_with_the_names(effect: type[Effect]) -> None:
    for parameter in effect.parameters:
        ending = next((ending for ending in UNITS if parameter.name.endswith(ending)), None)
        assert parameter.unit == (UNITS[ending] if ending else "-"), f"{parameter.name}: is its ending in UNITS?"
    names = [parameter.name for parameter in effect.parameters]
    assert len(set(names)) == len(names)
    if issubclass(effect, MeanEffect):
        assert effect.strength_parameters()
        assert all(parameter.name.startswith("strength") for parameter in effect.strength_parameters())


@every_effect
def test_typical_values_and_defaults_are_allowed(effect: type[Effect]) -> None:
    typical = effect.typical()
    for parameter in effect.parameters:
        assert parameter.low <= parameter.typical <= parameter.high
        assert parameter.low < parameter.high
        if parameter.linear:
            assert parameter.low <= 0 <= parameter.high, "a strength can be zero"
        else:
            assert math.isfinite(parameter.low)
    needed = {p.name: typical.values[p.name] for p in effect.parameters if p.default is None}
    effect(**needed)


@every_effect
@given(data=st.data())
def test_bounds_are_respected(effect: type[Effect], data: st.DataObject) -> None:
    parameter = data.draw(st.sampled_from(effect.parameters))
    value = data.draw(st.floats(allow_nan=True, allow_infinity=True))
    inside = math.isfinite(value) and parameter.low <= value <= parameter.high
    if inside and (not parameter.choices or parameter.between or value in parameter.choices):
        assert effect.typical(**{parameter.name: value}).values[parameter.name] == value
    else:
        with pytest.raises(InputError, match=parameter.name):
            effect.typical(**{parameter.name: value})


@every_effect
def test_unknown_and_missing_parameters_are_refused(effect: type[Effect]) -> None:
    with pytest.raises(InputError, match="unknown"):
        effect.typical(nonsense=1.0)
    for parameter in effect.parameters:
        if parameter.default is None:
            with pytest.raises(InputError, match=f"{parameter.name}: is missing"):
                effect(**{p.name: p.typical for p in effect.parameters if p is not parameter})


@pytest.mark.parametrize("effect", [*CATALOGUE.values(), *FORMULAS.values()], ids=lambda effect: effect.name)
def test_it_survives_the_way_through_a_wheel_file(effect: type[Effect]) -> None:
    block = to_block(effect.typical())
    wheel = built_in_wheel().model_copy(update={"effect": (block,)})
    again = Wheel.from_toml(wheel.to_toml(), "test")
    assert again.effect == (block,)
    assert hash(again.effect) == hash(wheel.effect)
    built = build(again.effect[0])
    assert type(built) is effect
    assert built.values == effect.typical().values
    assert [type(e) for e in mean_effects(again)] == ([effect] if effect.family == "mean" else [])


def test_an_unknown_effect_is_refused_with_the_names_there_are() -> None:
    with pytest.raises(InputError, match=r"stribek: is not in the catalogue; did you mean 'stribeck'\?"):
        build(EffectBlock(name="stribek", parameters={}))
    with pytest.raises(InputError, match=r"moonlight: is not in the catalogue: .*stribeck"):
        build(EffectBlock(name="moonlight", parameters={}))


def test_an_effect_from_outside_joins_the_catalogue_once() -> None:
    class Outside(CATALOGUE["stribeck"]):
        """An effect of somebody else's package."""

        name = "effect_of_another_package"

    try:
        assert register(Outside) is Outside
        assert isinstance(build(to_block(Outside.typical())), Outside)
        assert Outside in MEAN_EFFECTS.values()
        with pytest.raises(TypeError, match="two effects have the name effect_of_another_package"):
            register(Outside)
    finally:
        for family in (CATALOGUE, MEAN_EFFECTS):
            family.pop(Outside.name, None)
