"""Effects with memory: sequential recursions over slots, compiled, with a state that goes on from piece to piece.

Rule for gaps: at a slot without a good, finite input the state is *held*, as if the wheel had not moved and no time had
passed; the next good slot goes on from there. An input that is not finite gives NaN at its own slot and nowhere else.
Each kernel goes through the slots one by one in order, so that a record cut into pieces gives the same bits.
"""

from __future__ import annotations

import numba
import numpy as np

from rwa_monitor.samples import BoolArray, FloatArray


@numba.njit(cache=True)
def first_order_lag(
    values: FloatArray, usable: BoolArray, period_s: float, time_constant_s: float, state: FloatArray
) -> FloatArray:
    """Follow `values` with a first-order lag, exact for values that are linear between slots.

    Solves dx/dt = (u - x)/τ. At the start of a record x equals u: the wheel has run at that speed for long.

    Parameters
    ----------
    values, usable
        Input u (n,), and bool (n,), where it counts.
    period_s, time_constant_s
        Slot length and τ [s].
    state
        float64 (2,), x and the last u; NaN at the start. Changed in place.

    Returns
    -------
    lagged
        float64 (n,), x; NaN before the first usable slot.
    """
    ratio = period_s / time_constant_s
    keep = np.exp(-ratio)
    mean_weight = -np.expm1(-ratio) / ratio
    lagged = np.empty(values.size)
    for k in range(values.size):
        if usable[k]:
            if np.isnan(state[0]):
                state[0] = values[k]
            else:
                state[0] = keep * state[0] + (mean_weight - keep) * state[1] + (1.0 - mean_weight) * values[k]
            state[1] = values[k]
        lagged[k] = state[0]
    return lagged


@numba.njit(cache=True)
def slide(bristle: float, angle_rad: float, scale_rad: float) -> float:
    """Return the bristle's deflection, in units of the breakaway angle, after sliding by an angle in one direction."""
    side = np.sign(angle_rad)
    return float(side + (bristle - side) * np.exp(-np.abs(angle_rad) / scale_rad))


@numba.njit(cache=True)
def dahl_bristle(
    speed_rad_s: FloatArray, usable: BoolArray, period_s: float, scale_rad: float, state: FloatArray
) -> FloatArray:
    """Integrate Dahl's bristle dz/dt = ω - |ω| z / z_c by its exact step in angle; ω is linear between slots.

    Explicit Euler steps would be unstable as soon as one slot turns the wheel by more than 2 z_c, which is always so at
    speed. In angle the solution is an exponential, and a slot in which ω changes sign is two of them.

    Parameters
    ----------
    speed_rad_s, usable
        ω (n,), and bool (n,), where it counts.
    period_s
        Slot length [s].
    scale_rad
        Breakaway angle z_c [rad].
    state
        float64 (2,), z/z_c and the last ω; NaN at the start, when the bristle is taken as fully deflected. Changed in
        place.

    Returns
    -------
    bristle
        float64 (n,), z/z_c in [-1, 1]; NaN before the first usable slot.
    """
    bristle = np.empty(speed_rad_s.size)
    for k in range(speed_rad_s.size):
        if usable[k]:
            after = speed_rad_s[k]
            before = state[1]
            if np.isnan(state[0]):
                state[0] = np.sign(after)
            elif before * after < 0.0:
                crossing_s = period_s * before / (before - after)
                state[0] = slide(state[0], 0.5 * before * crossing_s, scale_rad)
                state[0] = slide(state[0], 0.5 * after * (period_s - crossing_s), scale_rad)
            else:
                state[0] = slide(state[0], 0.5 * (before + after) * period_s, scale_rad)
            state[1] = after
        bristle[k] = state[0]
    return bristle


@numba.njit(cache=True)
def turned_angle(speed_rad_s: FloatArray, usable: BoolArray, period_s: float, state: FloatArray) -> FloatArray:
    """Integrate the speed by the trapezoidal rule; across a gap as if the speed had changed evenly.

    The one recursion that does not hold its state through gaps: the wheel turns on while nobody looks.

    Parameters
    ----------
    speed_rad_s, usable
        ω (n,), and bool (n,), where it counts.
    period_s
        Slot length [s].
    state
        float64 (3,), angle, the last ω (NaN at the start), and the slots since. Changed in place.

    Returns
    -------
    angle
        float64 (n,) [rad], 0 at the first usable slot of a record; NaN where not usable.
    """
    angle = np.empty(speed_rad_s.size)
    for k in range(speed_rad_s.size):
        state[2] += 1.0
        if usable[k]:
            if not np.isnan(state[1]):
                state[0] += 0.5 * (state[1] + speed_rad_s[k]) * period_s * state[2]
            state[1] = speed_rad_s[k]
            state[2] = 0.0
            angle[k] = state[0]
        else:
            angle[k] = np.nan
    return angle


@numba.njit(cache=True)
def backward_difference(values: FloatArray, usable: BoolArray, period_s: float, state: FloatArray) -> FloatArray:
    """Return the rate of change since the last usable slot; 0 at the first usable slot of a record.

    Parameters
    ----------
    values, usable
        (n,), and bool (n,), where they count.
    period_s
        Slot length [s].
    state
        float64 (2,), the last value (NaN at the start) and the slots since. Changed in place.

    Returns
    -------
    rate
        float64 (n,); NaN where not usable.
    """
    rate = np.empty(values.size)
    for k in range(values.size):
        state[1] += 1.0
        if usable[k]:
            rate[k] = 0.0 if np.isnan(state[0]) else (values[k] - state[0]) / (state[1] * period_s)
            state[0] = values[k]
            state[1] = 0.0
        else:
            rate[k] = np.nan
    return rate


def start_state() -> FloatArray:
    """Return the state of a recursion at the start of a record."""
    return np.array([np.nan, 0.0])
