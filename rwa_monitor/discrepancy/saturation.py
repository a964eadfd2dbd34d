"""Channels at the end of their range: what they read there is the sensor's limit, and no friction law.

A measured value hardly ever repeats to the last digit; at an end stop it does. Channels that hold few values at all,
commanded torques or coarse converters, are left as they are: there a repeated largest value says nothing.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Final

import numpy as np

from rwa_monitor.errors import InputError
from rwa_monitor.samples import BoolArray, FloatArray, Samples

CHANNELS: Final = ("friction_torque_Nm", "motor_current_A", "motor_torque_Nm")
SATURATED_SHARE: Final = 0.2  # of the values at the ends of their range: too many to do without them
FEWEST_AT_END: Final = 20  # samples: fewer change nothing
LEAST_SHARE: Final = 0.005
DISTINCT_SHARE: Final = 0.5  # of the values between the ends: a measurement with noise in it


def at_end_stop(values: FloatArray, speed: FloatArray | None = None) -> BoolArray:
    """Return which values are the largest or the smallest of all, repeated to the last digit; bool (n,).

    Parameters
    ----------
    values
        float64 (n,), of a channel.
    speed
        float64 (n,) [rad/s], where values that are the same at many speeds are an end stop even if there are no others:
        friction always follows the speed. At one speed, friction without noise may well be one value.
    """
    stopped = np.zeros(values.size, dtype=bool)
    known = np.isfinite(values)
    if np.count_nonzero(known) < FEWEST_AT_END:
        return stopped
    ends = [values == np.max(values[known]), values == np.min(values[known])]
    between = values[known & ~ends[0] & ~ends[1]]
    if between.size == 0:
        return known if speed is not None and np.unique(speed).size > DISTINCT_SHARE * speed.size else stopped
    if np.unique(between).size < DISTINCT_SHARE * between.size:
        return stopped
    for end in ends:
        if np.count_nonzero(end) >= max(FEWEST_AT_END, LEAST_SHARE * np.count_nonzero(known)):
            stopped |= end
    return stopped


def without_end_stops(samples: Samples, source: str) -> Samples:
    """Return the samples with what a channel reads at its end stop taken out; unchanged where none does.

    A channel that is at its end stop most of the time is left out where friction does not hang on it.

    Raises
    ------
    InputError
        If friction is at its end stop, or what it is derived from, in more than `SATURATED_SHARE` of the samples.
    """
    for name, values, stopped in _saturated(samples):
        share = float(np.mean(stopped))
        if share <= SATURATED_SHARE:
            samples = replace(samples, **{name: np.where(stopped, np.nan, values)})
        elif name == "friction_torque_Nm" or samples.friction_torque_Nm is None:
            words = f"is saturated: {share:.0%} of the values, at many speeds, are its largest or its smallest"
            raise InputError(source, words, name)
        else:
            absent: dict[str, Any] = {name: None}
            samples = replace(samples, **absent)
    return samples


def end_stops_in_words(samples: Samples) -> list[str]:
    """Say for each channel that reads its end stop how often it does, and what becomes of it."""
    return [
        f"{name} is at its end stop in {np.mean(stopped):.1%} of the samples; "
        + ("these are left out" if np.mean(stopped) <= SATURATED_SHARE else "the channel is not used")
        for name, _, stopped in _saturated(samples)
    ]


def _saturated(samples: Samples) -> Iterator[tuple[str, FloatArray, BoolArray]]:
    """Yield name, values and the samples at an end stop of each channel that has such."""
    for name in CHANNELS:
        values: FloatArray | None = getattr(samples, name)
        if values is None:
            continue
        stopped = at_end_stop(values, samples.speed_rad_s if name == "friction_torque_Nm" else None)
        if stopped.any():
            yield name, values, stopped
