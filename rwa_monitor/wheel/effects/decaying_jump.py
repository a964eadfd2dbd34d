"""Decaying jump: a jump of the dry friction that relaxes instead of staying."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import Channels, LikelihoodFit, Parameter, curvature_std, duration, stack
from rwa_monitor.wheel.effects.switching_base import TINY, BeyondBase, Jumps, SwitchingEffect, SwitchingEvidence

FEWEST_SLOTS: Final = 10
FEWEST_JUMPS: Final = 2
KEPT: Final = (2, 3, 4, 5, 6, 8, 10, 13, 16, 20, 25, 30)  # how many of the largest jumps are kept, in turn
GRID: Final = 10  # time constants of the coarse search
PRICE_OF_A_JUMP: Final = 1.5  # of log n: half the 3·log n that the search pays for one in units of deviance
SHARED_GAIN: Final = 5.0  # log-likelihood that the segments must gain without the best of them
SIZE_ROUNDS: Final = 3  # of fitting sizes and relaxation in turn


class DecayingJump(SwitchingEffect):
    """After each jump a part of it fades away, until the next jump."""

    name = "decaying_jump"
    title = "Jumps that relax"
    formula = (
        r"\tau = -\gamma \sum_j \Delta_j \left(1 - e^{-(t - t_j)/T}\right) \operatorname{sign}(\omega), \quad t_j "
        r"\leq t < t_{j+1}"
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
        "Pockets of oil in wheel bearings: the paper, section III, and its reference of 2015, taken to be A. Y. Lee, "
        "E. K. Wang, In-flight performance of Cassini reaction wheel bearing drag in 1997–2013, Journal of Spacecraft "
        "and Rockets 52(2), 2015. That their drag relaxes exponentially is a working assumption."
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
        """Fit share and time constant, with the found jumps thinned out to those that then are still needed.

        A segmentation follows a relaxation by a staircase of small jumps. So the largest 1, 2, … jumps are kept in
        turn, and what is scored is the sum of squares together with the price of the jumps that can go.
        """
        everything = BeyondBase(evidence)
        used, count = everything.target.size, len(evidence.jumps)
        rss = float(np.sum(everything.target**2))
        if count < FEWEST_JUMPS or used < FEWEST_SLOTS or rss == 0.0:
            return cls.nothing_found(used)
        scale = 2.0 * rss / used * evidence.variance_factor
        # Friction less base law: the jumps are put back, so that some of them can be left out.
        torque = evidence.residual_Nm + evidence.channels.direction * evidence.jumps.total(len(evidence.channels))
        order = np.argsort(-np.abs(evidence.jumps.size_Nm), kind="stable")
        best, best_gain = None, 0.0
        size = np.abs(evidence.jumps.size_Nm[order])
        # Where sizes fall off most, jumps end and the steps of their staircases begin.
        cliff = 1 + int(np.argmax(size[:-1] / np.maximum(size[1:], TINY)))
        for keep in sorted({keep for keep in (cliff, *KEPT) if FEWEST_JUMPS <= keep < count} | {count}):
            chosen = np.sort(order[:keep])
            jumps = Jumps(evidence.jumps.index[chosen], evidence.jumps.size_Nm[chosen])
            relaxing = _Relaxing(replace(evidence, residual_Nm=torque, jumps=jumps))
            price = PRICE_OF_A_JUMP * float(np.log(used)) * (count - keep)
            if (rss - relaxing.rss) / scale + price > best_gain:
                best, best_gain = relaxing, (rss - relaxing.rss) / scale + price
        if best is None:
            return cls.nothing_found(used)
        coarse_rss = best.rss
        best.refine()
        best_gain += (coarse_rss - best.rss) / scale
        if best.shared_gain(scale) < SHARED_GAIN:
            return cls.nothing_found(used)
        return LikelihoodFit(
            values={"strength": best.share, "time_constant_s": best.time_constant_s},
            std={"strength": best.share_std, "time_constant_s": best.time_constant_std(scale)},
            log_likelihood_gain=best_gain,
            parameters=2,
            samples=used,
        )


class _Relaxing:
    """Levels, slope and one relaxation fitted together for given jumps; their sizes are those of the fit itself."""

    def __init__(self, evidence: SwitchingEvidence) -> None:
        self._channels = evidence.channels
        self._base = BeyondBase(evidence)
        self._jumps = evidence.jumps
        period_s = evidence.channels.sample_period_s
        # From two slots (shorter: an outlier) to a tenth of the record (longer: a drift).
        longest = max(0.1 * duration(evidence.channels), 4 * period_s)
        self._search(np.linspace(np.log(2 * period_s), np.log(longest), GRID))

    def refine(self) -> None:
        """Fit time constant and sizes of the jumps in turn, beginning from where the coarse search ended."""
        from scipy import optimize

        for _ in range(SIZE_ROUNDS):
            self._jumps = self._resized()
            self._search(np.linspace(self._log_time - 0.6, self._log_time + 0.6, 9))
        at = self._log_time
        found = optimize.minimize_scalar(
            lambda x: self._solve(float(x))[0],
            bounds=(at - 0.15, at + 0.15),
            method="bounded",
            options={"xatol": 1e-3},
        )
        self._search(np.array([float(found.x)]))

    def _search(self, log_times: FloatArray) -> None:
        """Take the best of some time constants."""
        solved = [self._solve(float(log_time)) for log_time in log_times]
        at = int(np.argmin([rss for rss, _, _ in solved]))
        self._log_time = float(log_times[at])
        self.rss, self.share, self.share_std = solved[at]

    @property
    def time_constant_s(self) -> float:
        """The time constant [s]."""
        return float(np.exp(self._log_time))

    def time_constant_std(self, scale: float) -> float:
        """Return its standard deviation from the curvature of the sum of squares, `scale` = 2·variance."""
        return self.time_constant_s * curvature_std(lambda x: -self._solve(x)[0] / scale, self._log_time, 0.02)

    def shared_gain(self, scale: float) -> float:
        """Return the log-likelihood gain of all segments but the one that gains most: one jump alone proves nothing."""
        regressor = self._base.left_of(self._column(self._log_time))
        less = self._base.target**2 - (self._base.target - self.share * regressor) ** 2
        by_segment = np.bincount(self._base.segment, less)
        return float(by_segment.sum() - by_segment.max()) / scale

    def _column(self, log_time: float) -> FloatArray:
        return DecayingJump.columns(self._channels, self._jumps, {"time_constant_s": float(np.exp(log_time))})[:, 0]

    def _solve(self, log_time: float) -> tuple[float, float, float]:
        """Return sum of squares, share and its standard deviation for a time constant."""
        low, high = DecayingJump.parameters[0].low, DecayingJump.parameters[0].high
        column = self._column(log_time)
        _, share, std = self._base.gain(column, low, high)
        left = self._base.target - share * self._base.left_of(column)
        return float(np.sum(left**2)), share, std

    def _resized(self) -> Jumps:
        """Return the jumps with the sizes that the fitted levels have: a staircase underrates its first step."""
        level = self._base.level(self.share * self._column(self._log_time))
        return Jumps(self._jumps.index, level[self._jumps.index] - level[self._jumps.index - 1])
