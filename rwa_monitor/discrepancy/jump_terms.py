"""Effects of the jumps that are torques too: once there are jumps, they have columns and compete with mean effects.

Otherwise smooth mean effects would take their place: an exponential after each jump looks like a lag or a drift.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Final

import numpy as np

from rwa_monitor.physics.effects.base import Channels, Family, MeanEffect, Memory
from rwa_monitor.physics.effects.columns import known_or_nan
from rwa_monitor.physics.effects.decaying_jump import DecayingJump
from rwa_monitor.physics.effects.resolution import duration, narrowed
from rwa_monitor.physics.effects.switching_base import Jumps, SwitchingEffect
from rwa_monitor.physics.effects.viscous_jump import ViscousJump
from rwa_monitor.samples import FloatArray

SHORTEST_SLOTS: Final = 20  # of a relaxation: shorter ones are outliers beside a jump
LONGEST_SHARE: Final = 0.1  # of the record: longer ones are drifts


class _JumpTerm(MeanEffect):
    """A switching effect as columns; its jumps are those of the dry level."""

    wraps: ClassVar[type[SwitchingEffect]]
    uses_level = True

    @classmethod
    def columns(
        cls, channels: Channels, shape: Mapping[str, float], memory: Memory = None
    ) -> tuple[FloatArray, Memory]:
        del memory
        level = known_or_nan(channels.dry_level_Nm, channels)
        change = np.nan_to_num(np.diff(level))
        # Levels are differences of sums: what is smaller than rounding is no jump.
        index = np.flatnonzero(np.abs(change) > 1e-9 * np.max(np.abs(np.nan_to_num(level)), initial=1e-300)) + 1
        return cls.wraps.columns(channels, Jumps(index.astype(np.int64), change[index - 1]), shape), None

    @classmethod
    def shape_bounds(cls, channels: Channels) -> dict[str, tuple[float, float]]:
        bounds = super().shape_bounds(channels)
        if "time_constant_s" in bounds:
            low, high = SHORTEST_SLOTS * channels.sample_period_s, LONGEST_SHARE * duration(channels)
            bounds["time_constant_s"] = narrowed(bounds["time_constant_s"], low, high)
        return bounds


def _term(effect: type[SwitchingEffect]) -> type[_JumpTerm]:
    family: Family = "switching"
    shared = ("name", "title", "formula", "description", "signature", "confused_with", "separate_by", "source")
    return type(
        effect.__name__ + "Term",
        (_JumpTerm,),
        {
            **{field: getattr(effect, field) for field in shared},
            "family": family,
            "parameters": effect.parameters,
            "wraps": effect,
        },
    )


JUMP_TERMS: Final = (_term(DecayingJump), _term(ViscousJump))
