"""All effects, found by importing every module of this package: adding an effect is adding one file."""

from __future__ import annotations

import pkgutil
from collections.abc import Iterator
from types import ModuleType
from typing import Final

from rwa_monitor.errors import InputError, did_you_mean
from rwa_monitor.wheel import effects
from rwa_monitor.wheel.effects.base import Effect, MeanEffect
from rwa_monitor.wheel.effects.formula import BLOCK, FORMULAS, Formula, parse
from rwa_monitor.wheel.effects.noise_base import NoiseEffect
from rwa_monitor.wheel.effects.switching_base import SwitchingEffect
from rwa_monitor.wheel.wheel import EffectBlock, Wheel

CATALOGUE: Final[dict[str, type[Effect]]] = {}
MEAN_EFFECTS: Final[dict[str, type[MeanEffect]]] = {}
NOISE_EFFECTS: Final[dict[str, type[NoiseEffect]]] = {}
SWITCHING_EFFECTS: Final[dict[str, type[SwitchingEffect]]] = {}


def register(effect: type[Effect]) -> type[Effect]:
    """Add an effect to the catalogue; for one that lives outside this package, as a decorator of its class.

    From then on wheel files may name it, the simulator adds it, the diagnosis removes it and the search tries it.

    Raises
    ------
    TypeError
        If another effect has its name.
    """
    if effect.name in CATALOGUE:
        raise TypeError(f"two effects have the name {effect.name}: {CATALOGUE[effect.name]} and {effect}")
    CATALOGUE[effect.name] = effect
    if issubclass(effect, MeanEffect):
        MEAN_EFFECTS[effect.name] = effect
    elif issubclass(effect, NoiseEffect):
        NOISE_EFFECTS[effect.name] = effect
    elif issubclass(effect, SwitchingEffect):
        SWITCHING_EFFECTS[effect.name] = effect
    return effect


def _effects_of(module: ModuleType) -> Iterator[type[Effect]]:
    """Yield the effects that a module defines, not those that it imports or that others are derived from."""
    for value in vars(module).values():
        is_effect = isinstance(value, type) and issubclass(value, Effect) and value.__module__ == module.__name__
        if is_effect and "name" in vars(value):  # a base class of a family has no name
            yield value


def _register_package() -> None:
    """Import all modules of the package and register their effects in the order of their names."""
    this = __name__.rpartition(".")[2]
    modules = [info.name for info in pkgutil.iter_modules(effects.__path__) if info.name != this]
    found = [effect for name in modules for effect in _effects_of(pkgutil.resolve_name(f"{effects.__name__}.{name}"))]
    for effect in sorted(found, key=lambda effect: effect.name):
        register(effect)


_register_package()


def build(block: EffectBlock) -> Effect:
    """Return the effect that a block of wheel.toml or of a scenario describes.

    Raises
    ------
    InputError
        If the name is not in the catalogue, or a parameter is unknown, missing or out of its bounds; or if
        a formula has no law of the grammar, or another effect has one.
    """
    if block.name == BLOCK:
        if block.law is None:
            raise InputError(f"effect {BLOCK}", f"is missing, such as {next(iter(FORMULAS))!r}", "law")
        return parse(block.law)(**block.parameters)
    effect = CATALOGUE.get(block.name)
    if effect is None:
        hint = did_you_mean(block.name, CATALOGUE) or f": {', '.join(CATALOGUE)}"
        raise InputError(f"effect {block.name}", f"is not in the catalogue{hint}")
    if block.law is not None:
        raise InputError(f"effect {block.name}", f"belongs to the effect {BLOCK} alone", "law")
    return effect(**block.parameters)


def effect_class(name: str) -> type[Effect]:
    """Return the effect of a name that a search gives: one of the catalogue, or a formula; raises KeyError."""
    return FORMULAS[name.removeprefix(f"{BLOCK} ")] if name.startswith(f"{BLOCK} ") else CATALOGUE[name]


def mean_effects(wheel: Wheel) -> list[MeanEffect]:
    """Return the mean effects of an extended wheel, in the order of its file; its other effects add no torque."""
    built = [build(block) for block in wheel.effect]
    return [effect for effect in built if isinstance(effect, MeanEffect)]


def to_block(effect: Effect) -> EffectBlock:
    """Return the block of wheel.toml that describes an effect; `build` gives it back."""
    if isinstance(effect, Formula):
        return EffectBlock(name=BLOCK, law=effect.law, parameters=dict(effect.values))
    return EffectBlock(name=effect.name, parameters=dict(effect.values))
