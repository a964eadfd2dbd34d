"""Viscous jump: the viscous coefficient jumps together with the dry friction."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rwa_monitor.physics.effects.base import Channels, Parameter
from rwa_monitor.physics.effects.columns import stack
from rwa_monitor.physics.effects.likelihood import LikelihoodFit
from rwa_monitor.physics.effects.switching_base import Jumps, SwitchingEffect, SwitchingEvidence, regression_gain
from rwa_monitor.samples import FloatArray


class ViscousJump(SwitchingEffect):
    """Jumps whose size grows with the speed."""

    name = "viscous_jump"
    title = "Jumps of the viscous friction"
    formula = r"\tau = c\, \omega \sum_{t_j \le t} \Delta_j"
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
        used = int(evidence.used.sum())
        if not len(evidence.jumps) or used < 10:
            return cls.nothing_found(used)
        strength = cls.parameters[0]
        column = cls.columns(evidence.channels, evidence.jumps, {})[:, 0]
        gain, value, std = regression_gain(evidence, column, strength.low, strength.high)
        shared = LikelihoodFit({"strength_s_rad": value}, {"strength_s_rad": std}, gain, 1, used)
        return max(shared, _slope_per_segment(evidence, shared), key=lambda fit: fit.penalised_gain)


def _slope_per_segment(evidence: SwitchingEvidence, shared: LikelihoodFit) -> LikelihoodFit:
    """Return the fit with a free slope in each segment; its strength is that of the shared fit."""
    used = evidence.used
    segment = evidence.jumps.segment(used.size)[used]
    count = np.maximum(np.bincount(segment), 1)

    def centred(values: FloatArray) -> FloatArray:
        return values - (np.bincount(segment, values) / count)[segment]

    speed = centred(np.abs(evidence.channels.speed_rad_s[used]))
    target = centred((evidence.residual_Nm * evidence.channels.direction)[used])
    energy = np.bincount(segment, speed**2)
    moment = np.bincount(segment, speed * target)
    slope = np.divide(moment, energy, out=np.zeros_like(moment), where=energy > 0)
    together = float(np.sum(target**2)) - float(np.sum(moment)) ** 2 / max(float(np.sum(energy)), np.finfo(float).tiny)
    apart = float(np.sum((target - slope[segment] * speed) ** 2))
    if together <= 0.0:
        return shared
    gain = 0.5 * target.size * float(np.log(together / max(apart, np.finfo(float).eps * together)))
    return LikelihoodFit(
        shared.values, shared.std, max(gain / evidence.variance_factor, 0.0), len(evidence.jumps), shared.samples
    )
