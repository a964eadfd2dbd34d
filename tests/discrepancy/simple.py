"""Plain records for the tests of this room: a swing about zero, a few jumps, white noise."""

from collections.abc import Callable
from typing import Any

import numpy as np

from rwa_monitor.discrepancy.find import find_discrepancy
from rwa_monitor.discrepancy.result import Search
from rwa_monitor.samples import Samples
from rwa_monitor.wheel.wheel import Wheel, built_in_wheel

Array = np.ndarray[Any, np.dtype[np.float64]]
PERIOD_S, DRY_NM, VISCOUS, NOISE_NM = 0.125, 1.6e-3, 5.333e-6, 3.9e-5
WHEEL: Wheel = built_in_wheel()


def swing(count: int = 8000, top: float = 250.0, period_s: float = 600.0) -> Array:
    """Return a speed that passes zero several times [rad/s]."""
    return top * np.sin(2 * np.pi * np.arange(count) * PERIOD_S / period_s + 0.3) + 10.0


def record(
    speed: Array,
    jumps: tuple[int, ...] = (1500, 4000, 6200),
    effect: Callable[[Array, Array], Array] | None = None,
    noise: Array | None = None,
    seed: int = 0,
) -> tuple[Samples, Array]:
    """Return samples with friction given, and the true dry level."""
    rng = np.random.default_rng(seed)
    level = np.full(speed.size, DRY_NM)
    for i, at in enumerate(jumps):
        level[at:] += DRY_NM * (0.5 if i % 2 == 0 else -0.4)
    friction = np.sign(speed) * level + VISCOUS * speed
    if effect is not None:
        friction = friction + effect(speed, level)
    friction = friction + (NOISE_NM * rng.normal(size=speed.size) if noise is None else noise)
    return sampled(speed + rng.normal(0, 0.01, speed.size), friction), level


def sampled(speed: Array, friction: Array | None = None, period_s: float = PERIOD_S, **channels: Array) -> Samples:
    """Return channels as samples of an even clock."""
    time_ns = (np.arange(speed.size) * round(period_s * 1e9)).astype(np.int64)
    return Samples(time_ns, speed, friction, **channels)


def current_of(friction: Array, speed: Array) -> Array:
    """Return the current with which the built-in wheel's motor overcomes friction and follows the speed [A]."""
    torque = friction + WHEEL.inertia_kg_m2 * np.gradient(speed, PERIOD_S)
    return np.asarray(torque / WHEEL.torque_constant_Nm_A)


def search(samples: Samples, wheel: Wheel = WHEEL) -> Search:
    """Search one recording."""
    return find_discrepancy([("record", samples)], wheel)


def names(found: Search) -> list[str]:
    """Return the names of the effects that were found."""
    return [effect.name for effect in found.result.effects]
