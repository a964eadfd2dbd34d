"""Viscous jump: the viscous coefficient jumps together with the dry friction."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import Channels, LikelihoodFit, Parameter, stack
from rwa_monitor.wheel.effects.switching_base import BeyondBase, Jumps, SwitchingEffect, SwitchingEvidence

FEWEST_SLOTS: Final = 10


class ViscousJump(SwitchingEffect):
    """Jumps whose size grows with the speed."""

    name = "viscous_jump"
    title = "Jumps of the viscous friction"
    formula = r"\tau = c\, \omega \sum_{t_j \leq t} \Delta_j"
    description = (
        "Where lubricant moves in or out of the contact, the viscous coefficient jumps along with the dry friction: "
        "the jump is larger at high speed by the factor 1 + c|ω|."
    )
    signature = "Another slope after each jump; sizes of the same jump grow with |ω|."
    confused_with = ("speed_triggered_jumps", "sublinear_viscous")
    separate_by = "Change the speed between two jumps: the slope of each segment shows by itself."
    source = (
        "The paper keeps the viscous coefficient constant between jumps (section III-A); that a change of the "
        "lubricant distribution changes it is a working assumption without a verified size."
    )
    parameters = (Parameter("strength_s_rad", "s/rad", -1.0, 1.0, 3.0e-3, linear=True),)

    @classmethod
    def columns(cls, channels: Channels, jumps: Jumps, shape: Mapping[str, float]) -> FloatArray:
        del shape
        return stack(jumps.total(len(channels)) * channels.speed_rad_s)

    @classmethod
    def fit(cls, evidence: SwitchingEvidence) -> LikelihoodFit:
        """Fit a slope in proportion to the level, and a slope of its own for each segment; return the better one."""
        base = BeyondBase(evidence)
        used = base.target.size
        if not len(evidence.jumps) or used < FEWEST_SLOTS:
            return cls.nothing_found(used)
        strength = cls.parameters[0]
        column = cls.columns(evidence.channels, evidence.jumps, {})[:, 0]
        gain, value, std = base.gain(column, strength.low, strength.high)
        shared = LikelihoodFit({"strength_s_rad": value}, {"strength_s_rad": std}, gain, 1, used)
        return max(shared, _slope_per_segment(base, shared, len(evidence.jumps)), key=lambda fit: fit.penalised_gain)


def _slope_per_segment(base: BeyondBase, shared: LikelihoodFit, jumps: int) -> LikelihoodFit:
    """Return the fit with a free slope in each segment, one more for each jump; its strength is the shared fit's."""
    energy = np.bincount(base.segment, base.speed**2)
    moment = np.bincount(base.segment, base.speed * base.along)
    slope = np.divide(moment, energy, out=np.zeros_like(moment), where=energy > 0)
    together = float(np.sum(base.target**2))
    if together == 0.0:
        return shared
    apart = float(np.sum((base.along - slope[base.segment] * base.speed) ** 2))
    return LikelihoodFit(shared.values, shared.std, base.gain_of(together, apart), jumps, shared.samples)
