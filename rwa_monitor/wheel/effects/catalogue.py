"""All effects, found by importing every module of this package: to add an effect, add a class."""

import pkgutil
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from rwa_monitor.errors import InputError, did_you_mean
from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel import effects
from rwa_monitor.wheel.effects.base import Channels, Effect, MeanEffect, Memory, NoiseEffect
from rwa_monitor.wheel.effects.formula import BLOCK, FORMULAS, Formula, parse
from rwa_monitor.wheel.effects.switching_base import SwitchingEffect
from rwa_monitor.wheel.wheel import EffectBlock, Wheel

CATALOGUE: Final[dict[str, type[Effect]]] = {}
MEAN_EFFECTS: Final[dict[str, type[MeanEffect]]] = {}
NOISE_EFFECTS: Final[dict[str, type[NoiseEffect]]] = {}
SWITCHING_EFFECTS: Final[dict[str, type[SwitchingEffect]]] = {}


def register(effect: type[Effect]) -> type[Effect]:
    """Add an effect to the catalogue; for a class outside this package, as its decorator.

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


def _register_package() -> None:
    """Import all modules of the package and register the effects that they define, in the order of their names."""
    found: list[type[Effect]] = []
    for info in pkgutil.iter_modules(effects.__path__, f"{effects.__name__}."):
        if info.name != __name__:
            for value in vars(pkgutil.resolve_name(info.name)).values():
                is_effect = isinstance(value, type) and issubclass(value, Effect) and value.__module__ == info.name
                if is_effect and "name" in vars(value):  # a base class of a family has no name
                    found.append(value)
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
    """Return the effect of a name in a search's result: one of the catalogue, or a formula; raises KeyError."""
    return FORMULAS[name.removeprefix(f"{BLOCK} ")] if name.startswith(f"{BLOCK} ") else CATALOGUE[name]


def mean_effects(wheel: Wheel) -> list[MeanEffect]:
    """Return the mean effects of an extended wheel, in the order of its file; its other effects add no torque."""
    built = [build(block) for block in wheel.effect]
    return [effect for effect in built if isinstance(effect, MeanEffect)]


def viscous_effects(wheel: Wheel) -> list[MeanEffect]:
    """Return the effects that multiply the wheel's viscous friction; none where that has no nominal value."""
    if wheel.nominal is None or not wheel.nominal.viscous_Nm_s_rad > 0.0:
        return []
    return [effect for effect in mean_effects(wheel) if effect.scales_with_viscous]


def viscous_per_K(wheel: Wheel, temperature_degC: float) -> float:
    """Return the relative change of the wheel's viscous friction per kelvin at a temperature [1/K]; 0 for none."""
    effects = viscous_effects(wheel)
    if not effects or wheel.nominal is None:
        return 0.0
    zero, one, factors = np.zeros(1), np.ones(1), []
    steady = Channels(zero, one, one, zero, zero, wheel.sample_period_s, np.ones(1, dtype=np.bool_))
    for at_degC in (temperature_degC - 0.5, temperature_degC + 0.5):
        channels = replace(steady, bearing_temperature_degC=np.array([at_degC]))
        viscous = wheel.nominal.viscous_Nm_s_rad
        _, speed, _ = effect_torque(effects, channels, one, viscous, [None] * len(effects))
        factors.append(max(float(speed[0]), LEAST_FACTOR))
    return float(np.log(factors[1] / factors[0]))


def to_block(effect: Effect) -> EffectBlock:
    """Return the block of wheel.toml that describes an effect; `build` gives it back."""
    if isinstance(effect, Formula):
        return EffectBlock(name=BLOCK, law=effect.law, parameters=dict(effect.values))
    return EffectBlock(name=effect.name, parameters=dict(effect.values))


# ---- known effects subtracted from a measured friction torque, down to the base law: shared by live and batch --------


LEAST_FACTOR: Final = 0.01  # effects that multiply the viscous friction leave at least this share of it
LEVEL_ROUNDS: Final = 4  # an asymmetry ε leaves an error of ε⁵ of the level: 1e-5 at 10 %, the largest expected


def effect_torque(
    effects: Sequence[MeanEffect],
    channels: Channels,
    friction_torque_Nm: FloatArray,
    viscous_Nm_s_rad: float,
    memories: Sequence[Memory],
) -> tuple[FloatArray, FloatArray, list[Memory]]:
    """Return the torque of known effects in a friction torque, and the speed to which viscous friction is proportional.

    Those that are shares of the viscous friction (`scales_with_viscous`) do not add a torque of their own: with f_v the
    wheel's viscous coefficient, f₀ the nominal one and φ their torque at f₀, viscous friction is f_v·(ω + φ/f₀), so
    that a fault scales the whole. Effects that scale with the dry level (`uses_level`) take it from the friction
    itself, sample by sample: its residual after the other effects and viscous friction, along the rotation. Its noise
    enters with a factor ε.

    Parameters
    ----------
    effects
        In the order of the wheel's file.
    channels
        The motion, n consecutive slots.
    friction_torque_Nm
        float64 (n,), measured.
    viscous_Nm_s_rad
        Viscous coefficient of the base law; the nominal one. Where it is 0, no effect can be a share of it, and all
        effects add.
    memories
        One for each effect, as returned for the slots just before; None at the start of a record.

    Returns
    -------
    torque
        float64 (n,), the torque of the effects that add [N m].
    viscous_speed
        float64 (n,), to which viscous friction is proportional [rad/s]: the speed where no effect multiplies it.
    memories
        After the last slot.
    """
    total = np.zeros(friction_torque_Nm.size)
    viscous_speed = channels.speed_rad_s
    after = list(memories)
    for i, effect in enumerate(effects):
        if effect.uses_level:
            continue
        torque, after[i] = effect.torque(channels, memories[i])
        if effect.scales_with_viscous and viscous_Nm_s_rad > 0.0:
            viscous_speed = viscous_speed + torque / viscous_Nm_s_rad
        else:
            total += torque
    if viscous_speed is not channels.speed_rad_s:
        least = LEAST_FACTOR * np.abs(channels.speed_rad_s)
        viscous_speed = channels.direction * np.maximum(channels.direction * viscous_speed, least)
    by_level = [(i, effect) for i, effect in enumerate(effects) if effect.uses_level]
    rest = friction_torque_Nm - total
    extra = np.zeros(rest.size)
    for _ in range(LEVEL_ROUNDS if by_level else 0):
        level = channels.direction * (rest - extra - viscous_Nm_s_rad * viscous_speed)
        extra = np.zeros(rest.size)
        for i, effect in by_level:
            torque, after[i] = effect.torque(replace(channels, dry_level_Nm=level), memories[i])
            extra += torque
    return total + extra, viscous_speed, after
