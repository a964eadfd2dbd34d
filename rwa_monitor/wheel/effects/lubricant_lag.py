"""Lubricant lag: the drag relaxes after each change of speed."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from rwa_monitor.samples import BoolArray, FloatArray
from rwa_monitor.wheel.effects.base import Channels, MeanEffect, Memory, Parameter, Shape, begun, duration, stack

MOST_TRAILING: Final = 5.0  # of the viscous friction: a working assumption
FASTEST_S: Final = 10.0  # of a lubricant, see `source`; what is faster is the drive's


def _shown_time(channels: Channels) -> tuple[float, float]:
    """From 10 s, or ten slots (shorter: like dω/dt), to the record's length (longer: like ω and a drift)."""
    return max(10.0 * channels.sample_period_s, FASTEST_S), duration(channels)


class LubricantLag(MeanEffect):
    """Drag that depends on how long ago the speed changed."""

    name = "lubricant_lag"
    title = "Lubricant lag"
    follows_acceleration = True
    formula = r"\tau = b\, (\omega - \omega_f), \qquad T_f\, \dot\omega_f = \omega - \omega_f"
    description = (
        "After a change of speed the lubricant needs time to redistribute and to reach its new temperature: the "
        "drag overshoots (b > 0) or trails (b < 0) and relaxes with a time constant. At constant speed it vanishes."
    )
    signature = "An exponential relaxation after each slew, in proportion to the change of speed."
    confused_with = ("viscosity_temperature", "inertia_error", "run_in_drift")
    separate_by = "Speed steps after dwells of different length."
    source = (
        "That lubricant distribution governs the drag of wheels in flight: the paper, section III, and its reference "
        "of 2015, taken to be A. Y. Lee, E. K. Wang, In-flight performance of Cassini reaction wheel bearing drag in "
        "1997–2013, Journal of Spacecraft and Rockets 52(2), 2015. The first-order form and its range, 10 s to 30 "
        "min, are working assumptions; what relaxes within a second is the drive's or a filter's, not a lubricant's."
    )
    parameters = (
        Parameter("strength_Nm_s_rad", "N m s/rad", -np.inf, np.inf, 1.0e-6, linear=True),
        Parameter("time_constant_s", "s", 1.0, 1.0e4, 120.0, shown=_shown_time),
    )

    @classmethod
    def columns(cls, channels: Channels, shape: Shape, memory: Memory = None) -> tuple[FloatArray, Memory]:
        speed, state = channels.speed_rad_s, begun(memory, np.nan, np.nan)
        lagged = first_order_lag(speed, channels.moving, channels.sample_period_s, shape["time_constant_s"], state)
        return stack(speed - lagged), state

    @classmethod
    def is_possible(cls, strengths: FloatArray, viscous_Nm_s_rad: float) -> bool:
        """What trails is a part of the viscous friction, or little more: drag hardly falls while the speed rises."""
        return float(strengths[0]) >= -MOST_TRAILING * viscous_Nm_s_rad


def first_order_lag(
    values: FloatArray, usable: BoolArray, period_s: float, time_constant_s: float, state: FloatArray
) -> FloatArray:
    """Follow `values` with a first-order lag, dx/dt = (u - x)/τ, exact for values that are linear between slots.

    At the start of a record x equals u: the wheel has run at that speed for long. At a slot that is not usable the
    state is held, as if no time had passed. A record cut into pieces gives the same bits.

    Parameters
    ----------
    values, usable, period_s, time_constant_s
        u, float64 (n,), and where it counts, bool (n,); from slot to slot [s], and τ [s].
    state
        float64 (2,), x and the last u, NaN at the start; changed in place.

    Returns
    -------
    x, float64 (n,), NaN before the first usable slot.
    """
    from scipy import signal

    before, u = state[0], values[usable]
    if u.size == 0:
        return np.full(values.size, before)
    if math.isnan(before):
        state[:] = u[0]
    ratio = period_s / time_constant_s
    keep, mean_weight = math.exp(-ratio), -math.expm1(-ratio) / ratio
    taps = [1.0 - mean_weight, mean_weight - keep]
    lagged, _ = signal.lfilter(taps, [1.0, -keep], u, zi=[keep * state[0] + taps[1] * state[1]])
    state[:] = lagged[-1], u[-1]
    return np.asarray(np.append(before, lagged)[np.cumsum(usable)])
