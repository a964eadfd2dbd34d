"""Pulses of a turning wheel, one or many a turn, by nothing but their times: the speed that they show.

The mean speed over a whole turn is that at its middle, but for how much the acceleration changes in a turn. Over a
whole turn unequal distances between the pulses cancel, and so does what repeats with each turn.
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
SPREADS: Final = 6.0  # robust standard deviations of the steps about the usual one, beyond which a step is not regular
LEAST_OFF: Final = 0.02  # of the usual step: less is no pulse too many, but a time that is off
MOST_OFF: Final = 0.25  # of the usual step: halfway between a regular one and half of one
LEAST_REGULAR: Final = 0.8  # of the steps: where fewer are, missed pulses and phantoms cannot be distinguished
MOST_MISSED: Final = 10.0  # pulses in a row: longer the speed is not known well enough to count them


class Turning(NamedTuple):
    """What pulses show of a wheel's turning.

    Attributes
    ----------
    samples
        The speed [rad/s], positive, at the middle of each turn, and the other channels there.
    missed, phantom
        How many pulses did not come, and how many came that are none.
    breaks
        How many times the pulses stopped for longer than their number is known.
    """

    samples: Samples
    missed: int
    phantom: int
    breaks: int

    def in_words(self, pulses: int, pulses_per_turn: int) -> str:
        """Return what was made of so many pulses."""
        odd = [f"{self.missed} missed"] * bool(self.missed) + [f"{self.phantom} phantom"] * bool(self.phantom)
        odd += [counted(self.breaks, "break")] * bool(self.breaks)
        return (
            f"{counted(pulses, 'pulse')}, {pulses_per_turn} a turn{', ' if odd else ''}{', '.join(odd)}:"
            f" {counted(len(self.samples), 'row')}, each of the mean speed over a turn at its middle"
        )


def speed_of_pulses(pulses: Samples, pulses_per_turn: int, source: str) -> Turning:
    """Return the speed of a wheel from the times of pulses.

    Steps between pulses are regular where they are about the median of those around. Between regular ones the number
    of pulses that belong there follows from the time: what came less was missed, what came more is left out. Both are
    detected where they are single, three pulses or more from each other.

    Parameters
    ----------
    pulses
        Time of each pulse, and what was measured then; the speed counts for nothing.
    pulses_per_turn
        Of the wheel, at distances that need not be equal.
    source
        Name for messages.

    Raises
    ------
    InputError
        If there are less than two turns, or pulses come too unevenly to determine which are missing.
    """
    time = (pulses.time_ns - pulses.time_ns[0]) / NANOSECONDS_PER_SECOND
    if time.size < 2 * pulses_per_turn + 1:
        raise InputError(
            source,
            f"holds {counted(time.size, 'pulse')}, less than two turns of pulses_per_turn = {pulses_per_turn}",
        )
    step = np.diff(time)
    usual = _usual(step, min(max(REACH, pulses_per_turn), step.size // 2))
    off = np.abs(step / usual - 1.0)  # regular is what differs from the usual step by no more than most do
    most_off = np.clip(SPREADS / math.sqrt(CHI_MEDIAN) * float(np.median(off)), LEAST_OFF, MOST_OFF)
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
    # Beyond a break the count goes on further away than any turn reaches.
    count = np.append(0, np.cumsum(np.where(breaks, 3 * pulses_per_turn, true))).astype(np.int64)
    once = np.append(True, np.diff(count) > 0)
    return Turning(
        _means_over_turns(pulses[sure[once]], count[once], pulses_per_turn),
        int(np.sum(odd[(odd > 0) & ~breaks])),
        -int(np.sum(odd[(odd < 0) & ~breaks])),
        int(np.count_nonzero(breaks)),
    )


def _usual(step: FloatArray, reach: int) -> FloatArray:
    """Return the median of the steps around each, `reach` to either side, beyond the ends on a robust line [s]."""

    def before(steps: FloatArray) -> FloatArray:
        first = steps[: 2 * reach + 1]
        ahead = np.arange(reach, 0, -1) + 0.5 * (first.size - 1)
        return np.median(first) - np.median(np.diff(first)) * ahead

    padded = np.concatenate([before(step), step, before(step[::-1])[::-1]])
    return median_filter(padded, 2 * reach + 1)[reach:-reach]


def _means_over_turns(pulses: Samples, count: IntArray, pulses_per_turn: int) -> Samples:
    """Return the mean speed from a pulse to that a turn later, at the middle time.

    Parameters
    ----------
    pulses
        The pulses that are none too many.
    count
        int64 (n,), number of each, with those that were missed.
    pulses_per_turn
        Of the wheel.
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
