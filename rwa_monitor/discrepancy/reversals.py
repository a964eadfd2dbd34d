"""Samples that are means over their interval, where the speed reverses within it.

Telemetry may be averaged on board. Dry friction flips with the speed, and a mean over an interval in which the speed
reverses is anything between both signs: a handful of such samples, tens of standard deviations off, passes for a dead
zone, for bristles or for an unknown law of speed. Whether a record is averaged its own reversals show: the speed gives
how long it turned which way in each interval, and the mean of the sign foretells the sample.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from rwa_monitor.samples import BoolArray, FloatArray

LEVEL_REACH: Final = 8  # samples on each side of a reversal that show its dry friction
STRADDLES: Final = 0.98  # of the sign, mean over the interval: what is less has a reversal in it
LEFT_SHARE: Final = 0.5  # of what points miss, that means may miss: bristles and dead zones foretell no such share


def averages_over_reversals(speed_rad_s: FloatArray, drag_Nm: FloatArray) -> BoolArray:
    """Return the samples that are means over an interval in which the speed reverses; none where samples are points.

    An interval is centred on its sample, or ends or begins with it: whichever foretells the samples best, if any does
    clearly better than that they are points in time.

    Parameters
    ----------
    speed_rad_s
        float64 (n,), on slots, NaN where unknown.
    drag_Nm
        float64 (n,), friction along the rotation; NaN where unknown.
    """
    none = np.zeros(speed_rad_s.size, dtype=np.bool_)
    sign = np.sign(speed_rad_s)
    turning = np.flatnonzero(sign[1:] * sign[:-1] < 0)
    around = np.unique(np.clip(np.concatenate([turning, turning + 1]), 1, max(speed_rad_s.size - 2, 1)))
    around = around[np.isfinite(drag_Nm[around])] if speed_rad_s.size > 2 else around[:0]
    if around.size == 0:
        return none
    level = np.array([_level(drag_Nm, int(k)) for k in around])
    along = {name: mean[around] * sign[around] for name, mean in _mean_signs(speed_rad_s).items()}
    known = np.isfinite(level) & np.all([np.isfinite(share) for share in along.values()], axis=0)

    def missed(share: FloatArray) -> float:
        return float(np.sum(np.abs(drag_Nm[around] - level * share)[known]))

    cost = {name: missed(share) for name, share in along.items()}
    best = min(cost, key=lambda name: cost[name])
    if not known.any() or cost[best] >= LEFT_SHARE * missed(np.ones(around.size)):
        return none
    none[around[np.nan_to_num(along[best], nan=1.0) < STRADDLES]] = True
    return none


def _level(drag_Nm: FloatArray, at: int) -> float:
    """Return the dry friction around a sample [N m], NaN where it is not known: most samples there are whole ones."""
    near = drag_Nm[max(at - LEVEL_REACH, 0) : at + LEVEL_REACH + 1]
    near = near[np.isfinite(near)]
    return float(np.median(near)) if near.size else np.nan


def _mean_signs(speed_rad_s: FloatArray) -> dict[str, FloatArray]:
    """Return the mean sign of a speed that is straight between samples, over each way an interval may lie, (n,)."""
    middle = 0.5 * (speed_rad_s[1:] + speed_rad_s[:-1])
    first, last = (_mean_sign(speed_rad_s[:-1], middle), _mean_sign(middle, speed_rad_s[1:]))  # halves of an interval
    before, after = np.append(np.nan, last), np.append(first, np.nan)  # of each sample
    whole = _mean_sign(speed_rad_s[:-1], speed_rad_s[1:])
    return {
        "centred": 0.5 * (before + after),
        "ending": np.append(np.nan, whole),
        "beginning": np.append(whole, np.nan),
    }


def _mean_sign(begin: FloatArray, end: FloatArray) -> FloatArray:
    """Return the mean sign of what goes straight from one value to the other, (n,)."""
    change = end - begin
    still = change == 0.0
    return np.where(still, np.sign(begin), (np.abs(end) - np.abs(begin)) / np.where(still, 1.0, change))
