"""Effects of the jumps that are torques too: once there are jumps, they have columns and compete with mean effects.

Otherwise smooth mean effects would take their place: an exponential after each jump looks like a lag or a drift.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Final

import numpy as np

from rwa_monitor.physics.effects.base import Channels, MeanEffect, Memory
from rwa_monitor.physics.effects.columns import known_or_nan
from rwa_monitor.physics.effects.decaying_jump import DecayingJump
from rwa_monitor.physics.effects.resolution import duration, narrowed
from rwa_monitor.physics.effects.switching_base import Jumps, SwitchingEffect
from rwa_monitor.physics.effects.viscous_jump import ViscousJump
from rwa_monitor.samples import FloatArray

SHORTEST_SLOTS: Final = 20  # of a relaxation: shorter ones are outliers beside a jump
LONGEST_SHARE: Final = 0.1  # of the record: longer ones are drifts


class JumpTerm(MeanEffect):
    """A switching effect as columns; its jumps are those of the dry level.

    A subclass says which effect it `wraps`, and has its name, its words and its parameters.
    """

    wraps: ClassVar[type[SwitchingEffect]]
    family = "switching"
    uses_level = True

    def __init_subclass__(cls, wraps: type[SwitchingEffect] | None = None) -> None:
        """Take what the effect says of itself; a subclass of a subclass has it already."""
        if wraps is None:
            return
        cls.wraps, cls.parameters = wraps, wraps.parameters
        cls.name, cls.title, cls.formula, cls.description = wraps.name, wraps.title, wraps.formula, wraps.description
        cls.signature, cls.confused_with = wraps.signature, wraps.confused_with
        cls.separate_by, cls.source = wraps.separate_by, wraps.source

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


class DecayingJumpTerm(JumpTerm, wraps=DecayingJump):
    """`decaying_jump` as a column."""


class ViscousJumpTerm(JumpTerm, wraps=ViscousJump):
    """`viscous_jump` as a column."""


JUMP_TERMS: Final = (DecayingJumpTerm, ViscousJumpTerm)
