"""Drag that decays with the angle turned since the last reversal, as of grease that channels.

A reversal throws grease back into the track; the balls push it aside again within some hundred turns (channelling).
Nothing of the catalogue decays so, and several of its effects together pass for it: jumps of the viscous friction, an
asymmetry, a lubricant that lags. Here it is a candidate of the search like any other, so that those names must do
better than it does; where it wins it is told as unexplained.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Final

import numpy as np

from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.physics.effects.base import Channels, MeanEffect, Memory, Parameter
from rwa_monitor.physics.effects.resolution import narrowed
from rwa_monitor.samples import FloatArray

FEWEST_REVERSALS: Final = 3  # of one or two the decay is a relaxation like any other
SHORTEST_RAD: Final = 60.0  # some ten turns: what decays sooner is a bristle or a film of lubricant
LONGEST_SHARE: Final = 0.5  # of the median angle from one reversal to the next: what lasts longer is a level
SCALE_RAD_S: Final = 100.0  # unit of the speed, so that both strengths are torques


class DecayAfterReversal(MeanEffect):
    """A drag, dry and viscous, that falls exponentially with the angle turned since the speed last changed sign."""

    name = "decay_after_reversal"
    title = "Decay after a reversal"
    formula = ""
    description = "A drag that falls with the angle turned since the last reversal."
    signature = "a drag that decays with the angle turned since each reversal"
    source = "none"
    separate_by = "Reversals after rests of different length, each followed by long runs at two speeds."
    parameters = (
        Parameter("strength_dry_Nm", "N m", 0.0, np.inf, 1e-4, linear=True),
        Parameter("strength_viscous_Nm", "N m", 0.0, np.inf, 0.0, linear=True),
        Parameter("angle_rad", "rad", SHORTEST_RAD, 1e6, 5e3),
    )

    @classmethod
    def columns(
        cls, channels: Channels, shape: Mapping[str, float], memory: Memory = None
    ) -> tuple[FloatArray, Memory]:
        """Return what is left of the drag, along the rotation and in proportion to the speed."""
        del memory
        angle = angle_since_reversal(np.nan_to_num(channels.speed_rad_s), channels.sample_period_s)
        left = np.exp(-angle / shape["angle_rad"])
        return np.stack([channels.direction * left, channels.speed_rad_s / SCALE_RAD_S * left], axis=1), None

    @classmethod
    def shape_bounds(cls, channels: Channels) -> dict[str, tuple[float, float]]:
        """Return the bounds: no angle that is most of the way from one reversal to the next."""
        bounds = super().shape_bounds(channels)
        travelled = angles_between_reversals(channels)
        longest = LONGEST_SHARE * float(np.median(travelled)) if travelled.size else SHORTEST_RAD
        return {**bounds, "angle_rad": narrowed(bounds["angle_rad"], SHORTEST_RAD, longest)}


def may_channel(problem: Problem) -> bool:
    """Say whether reversals are many enough, and far enough from each other, to show such a decay."""
    travelled = [angles_between_reversals(record.channels) for record in problem.records]
    far = np.concatenate(travelled) * LONGEST_SHARE > SHORTEST_RAD
    return int(np.count_nonzero(far)) >= FEWEST_REVERSALS


def angles_between_reversals(channels: Channels) -> FloatArray:
    """Return the angle turned between each change of sign of the speed and the next [rad]; noise at zero left out."""
    angle = angle_since_reversal(np.nan_to_num(channels.speed_rad_s), channels.sample_period_s)
    known = angle[np.isfinite(angle)]
    ends = known[np.append(np.flatnonzero(np.diff(known) < 0), known.size - 1)] if known.size else known
    return np.asarray(ends[ends > SHORTEST_RAD], dtype=np.float64)


def angle_since_reversal(speed_rad_s: FloatArray, period_s: float) -> FloatArray:
    """Return the angle turned since the speed last changed sign [rad], infinite before the first change, (n,)."""
    steps, moving = np.abs(speed_rad_s) * period_s, np.flatnonzero(speed_rad_s)
    reversals = moving[1:][np.diff(np.sign(speed_rad_s[moving])) != 0.0].tolist()
    angle = np.full(speed_rad_s.size, np.inf)
    for begin, end in pairwise([*reversals, speed_rad_s.size]):
        np.cumsum(steps[begin:end], out=angle[begin:end])
    return angle
