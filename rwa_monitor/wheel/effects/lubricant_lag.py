"""Lubricant lag: the drag relaxes after each change of speed."""

from __future__ import annotations

from typing import Final

import numpy as np

from rwa_monitor.kernels.effects import first_order_lag
from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import Channels, MeanEffect, Memory, Parameter, Shape, begun, follow, stack

MOST_TRAILING: Final = 5.0  # of the viscous friction: a working assumption
FASTEST_S: Final = 10.0  # of a lubricant, see `source`; what is faster is the drive's


def _shown_time(channels: Channels) -> tuple[float, float]:
    """From 10 s, or ten slots (shorter: like dω/dt), to the record's length (longer: like ω and a drift)."""
    return max(10.0 * channels.sample_period_s, FASTEST_S), channels.duration_s


class LubricantLag(MeanEffect):
    """Drag that depends on how long ago the speed changed.

    After a change of speed the lubricant needs time to redistribute and to reach its new temperature: the drag
    overshoots (b > 0) or trails (b < 0) and relaxes with a time constant. At constant speed it vanishes.

    What shows it
    -------------
    An exponential relaxation after each slew, in proportion to the change of speed.

    See Also
    --------
    viscosity_temperature, inertia_error, run_in_drift

    References
    ----------
    That lubricant distribution governs the drag of wheels in flight: the paper, section III, and its reference of 2015,
    taken to be A. Y. Lee, E. K. Wang, In-flight performance of Cassini reaction wheel bearing drag in 1997–2013,
    Journal of Spacecraft and Rockets 52(2), 2015. The first-order form and its range, 10 s to 30 min, are working
    assumptions; what relaxes within a second is the drive's or a filter's, not a lubricant's.
    """

    name = "lubricant_lag"
    title = "Lubricant lag"
    follows_acceleration = True
    formula = r"\tau = b\, (\omega - \omega_f), \qquad T_f\, \dot\omega_f = \omega - \omega_f"
    separate_by = "Speed steps after dwells of different length."
    parameters = (
        Parameter("strength_Nm_s_rad", "N m s/rad", -np.inf, np.inf, 1.0e-6, linear=True),
        Parameter("time_constant_s", "s", 1.0, 1.0e4, 120.0, shown=_shown_time),
    )

    @classmethod
    def columns(cls, channels: Channels, shape: Shape, memory: Memory = None) -> tuple[FloatArray, Memory]:
        speed, state = channels.speed_rad_s, begun(memory, np.nan, np.nan)
        time_constant_s, period_s = shape["time_constant_s"], channels.sample_period_s
        lagged = follow(first_order_lag, speed, channels.moving, period_s, time_constant_s, state)
        return stack(speed - lagged), state

    @classmethod
    def is_possible(cls, strengths: FloatArray, viscous_Nm_s_rad: float) -> bool:
        """What trails is a part of the viscous friction, or little more: drag hardly falls while the speed rises."""
        return float(strengths[0]) >= -MOST_TRAILING * viscous_Nm_s_rad
