"""Decaying jump: a jump of the dry friction that relaxes instead of staying."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from scipy import optimize

from rwa_monitor.physics.effects.base import Channels, Parameter
from rwa_monitor.physics.effects.columns import stack
from rwa_monitor.physics.effects.likelihood import LikelihoodFit, curvature_std
from rwa_monitor.physics.effects.resolution import duration
from rwa_monitor.physics.effects.switching_base import BeyondBase, Jumps, SwitchingEffect, SwitchingEvidence
from rwa_monitor.samples import FloatArray

FEWEST_SLOTS: Final = 10


class DecayingJump(SwitchingEffect):
    """After each jump a part of it fades away, until the next jump."""

    name = "decaying_jump"
    title = "Jumps that relax"
    formula = (
        r"\tau = -\gamma \sum_j \Delta_j \left(1 - e^{-(t - t_j)/T}\right) \operatorname{sign}(\omega), \quad t_j "
        r"\le t < t_{j+1}"
    )
    description = (
        "A pocket of oil that is run over is squeezed out again: the drag jumps and then relaxes by a share of the "
        "jump. What has relaxed is forgotten at the next jump, so that the level always lies between its two "
        "neighbours."
    )
    signature = "An exponential in the residual after each jump, in proportion to the jump, of one time constant."
    confused_with = ("extra_switching_system", "lubricant_lag")
    separate_by = "Constant speed: a lag of the lubricant rests then, jumps still relax."
    source = (
        "Pockets of oil in wheel bearings: the paper, section III, and Lee 2015 cited there. That their drag "
        "relaxes exponentially is a working assumption."
    )
    parameters = (
        Parameter("strength", "-", 0.0, 1.0, 0.5, linear=True),
        Parameter("time_constant_s", "s", 1e-3, 1e5, 60.0),
    )

    @classmethod
    def columns(cls, channels: Channels, jumps: Jumps, shape: Mapping[str, float]) -> FloatArray:
        slots = len(channels)
        segment = jumps.segment(slots)
        begin = np.concatenate([[0], jumps.index])[segment]
        size = np.concatenate([[0.0], jumps.size_Nm])[segment]
        since_s = (np.arange(slots) - begin) * channels.sample_period_s
        return stack(channels.direction * size * np.expm1(-since_s / shape["time_constant_s"]))

    @classmethod
    def fit(cls, evidence: SwitchingEvidence) -> LikelihoodFit:
        """Fit the share by least squares beside levels and slope, the time constant by its profile."""
        base = BeyondBase(evidence)
        used = base.target.size
        if not len(evidence.jumps) or used < FEWEST_SLOTS:
            return cls.nothing_found(used)
        strength = cls.parameters[0]
        period_s = evidence.channels.sample_period_s

        def solve(log_time: float) -> tuple[float, float, float]:
            column = cls.columns(evidence.channels, evidence.jumps, {"time_constant_s": float(np.exp(log_time))})[:, 0]
            return base.gain(column, strength.low, strength.high)

        # From two slots (shorter: an outlier) to a tenth of the record (longer: a drift).
        grid = np.linspace(np.log(2 * period_s), np.log(max(0.1 * duration(evidence.channels), 4 * period_s)), 25)
        at = int(np.argmax([solve(float(x))[0] for x in grid]))
        bounds = (float(grid[max(at - 1, 0)]), float(grid[min(at + 1, grid.size - 1)]))
        found = optimize.minimize_scalar(lambda x: -solve(float(x))[0], bounds=bounds, method="bounded")
        log_time = float(found.x)
        gain, share, share_std = solve(log_time)
        time_constant_s = float(np.exp(log_time))
        return LikelihoodFit(
            values={"strength": share, "time_constant_s": time_constant_s},
            std={
                "strength": share_std,
                "time_constant_s": time_constant_s * curvature_std(lambda x: solve(x)[0], log_time, 0.02),
            },
            log_likelihood_gain=gain,
            parameters=2,
            samples=used,
        )
