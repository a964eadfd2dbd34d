"""The heat of the motion as columns: what the lubricant's thinning takes off the viscous drag, by a thermal lag."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from scipy.signal import lfilter

from rwa_monitor.discrepancy.unnamed import UnnamedEffect
from rwa_monitor.physics.effects.base import Channels, Memory, Parameter
from rwa_monitor.physics.effects.resolution import duration, narrowed
from rwa_monitor.samples import FloatArray

FASTEST_S: Final = 60.0  # time constants of a bearing in its housing: minutes (its rings) to hours (the wheel's case)
SLOWEST_S: Final = 7200.0
LONGEST_SHARE: Final = 0.5  # of the record: a slower one is a drift
PALMGREN: Final = 2.0 / 3.0  # exponent of the speed where ball bearings churn; else 1 (`sublinear_viscous`)
SCALE_RAD_S: Final = 100.0  # unit of the speed, so that all strengths are torques


class HeatOfMotion(UnnamedEffect):
    """A viscous drag that falls with the heat that the motion made, after a first-order thermal lag.

    The power of the friction has a dry part, in proportion to |ω|, and a viscous one, to ω²; each heats. Viscosity is
    exponential in the temperature, to second order here. The record need not begin cold.
    """

    name = "heat_of_the_motion"
    signature = "a viscous drag that follows the heat of the motion"
    separate_by = "The bearing's temperature."
    parameters = (
        *(Parameter(f"thinning_{i}_Nm", "N m", -np.inf, 0.0, -1e-4, linear=True) for i in range(4)),
        *(Parameter(f"curvature_{i}_Nm", "N m", 0.0, np.inf, 0.0, linear=True) for i in range(2)),
        Parameter("start_Nm", "N m", -np.inf, np.inf, 0.0, linear=True),
        Parameter("time_constant_s", "s", FASTEST_S, SLOWEST_S, 1000.0),
    )

    @classmethod
    def columns(
        cls, channels: Channels, shape: Mapping[str, float], memory: Memory = None
    ) -> tuple[FloatArray, Memory]:
        """Return each drag times the heat of each power, times its square, and times what is left of the start's."""
        del memory
        known = np.isfinite(channels.speed_rad_s)
        latest = np.maximum.accumulate(np.where(known, np.arange(len(channels)), 0))
        speed = np.abs(np.nan_to_num(channels.speed_rad_s[latest])) / SCALE_RAD_S
        kept = float(np.exp(-channels.sample_period_s / shape["time_constant_s"]))
        dry, viscous = (lfilter([0.0, 1.0 - kept], [1.0, -kept], power) for power in (speed, speed**2))
        start = kept ** np.arange(len(channels), dtype=np.float64)
        newton, churning = channels.direction * speed, channels.direction * speed**PALMGREN
        thinning = (newton * dry, newton * viscous, churning * dry, churning * viscous)
        return np.stack([*thinning, newton * viscous**2, churning * viscous**2, newton * start], axis=1), None

    @classmethod
    def shape_bounds(cls, channels: Channels) -> dict[str, tuple[float, float]]:
        """Return the bounds: no time constant that is most of the record."""
        bounds = super().shape_bounds(channels)
        low, high = FASTEST_S, LONGEST_SHARE * duration(channels)
        return {**bounds, "time_constant_s": narrowed(bounds["time_constant_s"], low, high)}
