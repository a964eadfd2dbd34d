"""The compiled loops of `evidence`: samples in, and confirmed peaks judged. Plain functions over arrays."""

from __future__ import annotations

from typing import Final, NamedTuple

import numba
import numpy as np

from rwa_monitor.diagnosis.changepoints import contrast
from rwa_monitor.diagnosis.running_sums import SumArrays
from rwa_monitor.diagnosis.wglr import COUNT_CONFIRMED, PEAK_INDEX, PEAK_SCALE, STEP, PeakArrays
from rwa_monitor.samples import BoolArray, FloatArray, IntArray

LARGEST_VALUE: Final = 1e4  # normalised speed or friction beyond is a broken word of telemetry, not a wheel's


@numba.njit(cache=True, error_model="numpy", nogil=True)
def normalise(
    speed: FloatArray,
    torque: FloatArray,
    good: BoolArray,
    speed_unit: float,
    torque_unit: float,
    x: FloatArray,
    z: FloatArray,
    is_good: BoolArray,
) -> int:
    """Write x = |ω|/unit, z = sign(ω)·torque/unit and whether the slot is good; return the number of good slots."""
    count = 0
    for k in range(speed.size):
        # Written so that NaN fails.
        is_good[k] = (
            good[k] and abs(speed[k]) <= LARGEST_VALUE * speed_unit and abs(torque[k]) <= LARGEST_VALUE * torque_unit
        )
        if is_good[k]:
            count += 1
            x[k] = abs(speed[k]) / speed_unit
            z[k] = np.sign(speed[k]) * torque[k] / torque_unit
    return count


class Judge(NamedTuple):
    """How confirmed peaks are judged again: scales, sure statistics and weights of the slope's prior, (S,); slope."""

    scales: IntArray
    sure: FloatArray
    weights: FloatArray
    slope: float


@numba.njit(cache=True, error_model="numpy", nogil=True)
def judge_confirmed(
    peaks: PeakArrays, judge: Judge, sums: SumArrays, announced: IntArray, places: IntArray, values: FloatArray
) -> int:
    """Judge the peaks that the last scan confirmed; return how many are new, and still sure by the weights given.

    Writes their scale's place and index to `places`, statistic and jump to `values`, (n, 2) each. `announced`, int64
    (STEP + 1,), are the last indices announced, in turns, and how many there were; brought up to date.
    """
    count = 0
    for row in range(peaks.counters[COUNT_CONFIRMED]):
        p = peaks.confirmed[row]
        s, index = peaks.slots[p, PEAK_SCALE], peaks.slots[p, PEAK_INDEX]
        if np.min(np.abs(announced[:STEP] - index)) <= judge.scales[s]:
            continue
        statistic, jump = contrast(index, judge.scales[s], judge.slope, judge.weights[s], sums)
        if statistic > judge.sure[s]:
            announced[announced[STEP] % STEP] = index
            announced[STEP] += 1
            places[count, 0], places[count, 1] = s, index
            values[count, 0], values[count, 1] = statistic, jump
            count += 1
    return count


@numba.njit(cache=True, error_model="numpy", nogil=True)
def mark_used(x: FloatArray, good: BoolArray, band: float, start: int, stop: int, used: BoolArray) -> None:
    """Mark the slots of [start, stop) that are good and turn faster than the dead band."""
    for k in range(start, stop):
        used[k] = good[k] & (x[k] >= band) & (x[k] > 0.0)  # without branches: several slots at once
