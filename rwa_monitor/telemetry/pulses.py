"""The speed of a wheel from the times of its pulses alone, one or many per turn.

The mean speed over a whole turn equals that at its middle, except for the change of the acceleration within a turn.
Over a whole turn unequal distances between the pulses cancel, and so does everything that repeats with each turn.
"""

import math
from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np
from scipy.ndimage import median_filter

from rwa_monitor.errors import InputError
from rwa_monitor.kernels.noise import CHI_MEDIAN
from rwa_monitor.samples import NANOSECONDS_PER_SECOND, FloatArray, IntArray, Samples
from rwa_monitor.words import counted

REACH: Final = 5  # steps to each side, at least, whose median is the usual step; a turn, where that is more
SIGMAS: Final = 6.0  # robust standard deviations of the steps about the usual one, beyond which a step is not regular
MIN_TOLERANCE: Final = 0.02  # deviation over the usual step: a smaller one is a timing error, not a pulse too many
MAX_TOLERANCE: Final = 0.25  # deviation over the usual step: halfway between a regular step and half of one
LEAST_REGULAR: Final = 0.8  # share of the steps: with fewer, missed pulses and phantoms cannot be distinguished
MOST_MISSED: Final = 10.0  # pulses in a row: for more, the speed is not known well enough to count them


class Turning(NamedTuple):
    """Speed of a wheel from its pulses, and the irregularities found in them.

    Attributes
    ----------
    samples
        The speed [rad/s], positive, at the middle of each turn, and the other channels there.
    missed, phantom
        Number of missed pulses, and of spurious ones.
    breaks
        How many times the pulses stopped for so long that the missed ones cannot be counted.
    """

    samples: Samples
    missed: int
    phantom: int
    breaks: int

    def in_words(self, pulses: int, pulses_per_turn: int) -> str:
        """Return a sentence on the speed from this number of pulses, and on their irregularities."""
        odd = [f"{self.missed} missed"] * bool(self.missed) + [f"{self.phantom} phantom"] * bool(self.phantom)
        odd += [counted(self.breaks, "break")] * bool(self.breaks)
        return (
            f"{counted(pulses, 'pulse')}, {pulses_per_turn} a turn{', ' if odd else ''}{', '.join(odd)}:"
            f" {counted(len(self.samples), 'row')}, each of the mean speed over a turn at its middle"
        )


def speed_of_pulses(pulses: Samples, pulses_per_turn: int, source: str) -> Turning:
    """Return the speed of a wheel from the times of pulses.

    Steps between pulses are regular where they are close to the median of those around. Between regular steps the true
    number of pulses follows from the time: fewer mean missed pulses, surplus ones are left out. Both are detected where
    they are single, three pulses or more from each other.

    Parameters
    ----------
    pulses
        Time of each pulse, and the channels measured then; the speed is ignored.
    pulses_per_turn
        Pulses per turn of the wheel, at distances that need not be equal.
    source
        Name for messages.

    Raises
    ------
    InputError
        If there are less than two turns, or pulses are too uneven to determine which are missing.
    """
    time = (pulses.time_ns - pulses.time_ns[0]) / NANOSECONDS_PER_SECOND
    if time.size < 2 * pulses_per_turn + 1:
        raise InputError(
            source,
            f"holds {counted(time.size, 'pulse')}, less than two turns of pulses_per_turn = {pulses_per_turn}",
        )
    step = np.diff(time)
    usual = _usual(step, min(max(REACH, pulses_per_turn), step.size // 2))
    off = np.abs(step / usual - 1.0)  # a step is regular if it deviates no more than most do
    most_off = np.clip(SIGMAS / math.sqrt(CHI_MEDIAN) * float(np.median(off)), MIN_TOLERANCE, MAX_TOLERANCE)
    regular = off <= most_off
    if float(np.mean(regular)) < LEAST_REGULAR:
        raise InputError(
            source,
            f"only {100.0 * float(np.mean(regular)):.0f} % of the steps between pulses are like those around: pulses"
            " that are missing cannot be distinguished from pulses too many; give a table of time_s and speed_rad_s",
        )
    sure = np.flatnonzero(np.append(regular, False) | np.append(False, regular))
    came = np.diff(sure)
    mean = np.add.reduceat(usual[: sure[-1]], sure[:-1]) / came
    true = np.where(regular[sure[:-1]] & (came == 1), 1.0, np.diff(time[sure]) / mean)
    breaks = true > MOST_MISSED + 1.0
    true = np.where(breaks, 0.0, np.rint(true))
    odd = true - came
    # A break adds more to the count than a turn, so that no turn spans it.
    count = np.append(0, np.cumsum(np.where(breaks, 3 * pulses_per_turn, true))).astype(np.int64)
    once = np.append(True, np.diff(count) > 0)
    return Turning(
        _means_over_turns(pulses[sure[once]], count[once], pulses_per_turn),
        int(np.sum(odd[(odd > 0) & ~breaks])),
        -int(np.sum(odd[(odd < 0) & ~breaks])),
        int(np.count_nonzero(breaks)),
    )


def _usual(step: FloatArray, reach: int) -> FloatArray:
    """Return the running median of the steps, `reach` to either side, extended by a robust line at the ends [s]."""

    def before(steps: FloatArray) -> FloatArray:
        first = steps[: 2 * reach + 1]
        ahead = np.arange(reach, 0, -1) + 0.5 * (first.size - 1)
        return np.median(first) - np.median(np.diff(first)) * ahead

    padded = np.concatenate([before(step), step, before(step[::-1])[::-1]])
    return median_filter(padded, 2 * reach + 1)[reach:-reach]


def _means_over_turns(pulses: Samples, count: IntArray, pulses_per_turn: int) -> Samples:
    """Return the mean speed from a pulse to the one a turn later, at the middle time.

    Parameters
    ----------
    pulses
        The pulses without spurious ones.
    count
        int64 (n,), number of each, missed ones included.
    pulses_per_turn
        Pulses per turn of the wheel.
    """
    begin = np.arange(0, len(pulses), pulses_per_turn)
    end = np.searchsorted(count, count[begin] + pulses_per_turn)
    begin, end = begin[end < count.size], end[end < count.size]
    whole = count[end] - count[begin] <= 2 * pulses_per_turn
    begin, end = begin[whole], end[whole]
    took = pulses.time_ns[end] - pulses.time_ns[begin]
    turned = 2.0 * np.pi * (count[end] - count[begin]) / pulses_per_turn
    middle = pulses.time_ns[begin] + took // 2
    others: dict[str, Any] = {
        name: np.interp(middle - pulses.time_ns[0], pulses.time_ns - pulses.time_ns[0], values)
        for name, values in pulses.channels()
        if name not in {"time_ns", "speed_rad_s"}
    }
    return replace(pulses, time_ns=middle, speed_rad_s=turned / (took / NANOSECONDS_PER_SECOND), **others)
