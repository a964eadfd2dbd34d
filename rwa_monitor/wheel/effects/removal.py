"""Known effects taken out of a measured friction torque, so that the base law is left: one place for live and batch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import Channels, MeanEffect, Memory

LEVEL_ROUNDS: Final = 4  # an asymmetry ε leaves ε⁵ of the level: 1e-5 of it at 10 %, the largest expected


def effect_torque(
    effects: Sequence[MeanEffect],
    channels: Channels,
    friction_torque_Nm: FloatArray,
    viscous_Nm_s_rad: float,
    memories: Sequence[Memory],
) -> tuple[FloatArray, list[Memory]]:
    """Return the torque of known effects in a measured friction torque [N m], float64 (n,), and their memories.

    Effects that scale with the dry level (`uses_level`) take it from the friction itself, sample by sample: what is
    left of it along the rotation after the other effects and viscous friction. Its noise enters ε times.

    Parameters
    ----------
    effects
        In the order of the wheel's file.
    channels
        The motion, n consecutive slots.
    friction_torque_Nm
        float64 (n,), measured.
    viscous_Nm_s_rad
        Viscous coefficient of the base law; the nominal one.
    memories
        One for each effect: what an earlier call returned for the slots just before, None at the start of a record.
    """
    total = np.zeros(friction_torque_Nm.size)
    after = list(memories)
    for i, effect in enumerate(effects):
        if not effect.uses_level:
            torque, after[i] = effect.torque(channels, memories[i])
            total += torque
    by_level = [(i, effect) for i, effect in enumerate(effects) if effect.uses_level]
    rest = friction_torque_Nm - total
    extra = np.zeros(rest.size)
    for _ in range(LEVEL_ROUNDS if by_level else 0):
        level = channels.direction * (rest - extra - viscous_Nm_s_rad * channels.speed_rad_s)
        extra = np.zeros(rest.size)
        for i, effect in by_level:
            torque, after[i] = effect.torque(replace(channels, dry_level_Nm=level), memories[i])
            extra += torque
    return total + extra, after
