"""What a record can show: its speed range, its speed step near zero, its length. For `shape_bounds` of the effects."""

from __future__ import annotations

from typing import Final

import numpy as np

from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import Channels

NEAR_ZERO: Final = 0.05  # share of the largest speed that counts as near zero, where the speed step is measured


def used_speed(channels: Channels) -> FloatArray:
    """Return |ω| of the good slots [rad/s]; one zero where there are none."""
    speed = np.abs(channels.speed_rad_s[channels.good & np.isfinite(channels.speed_rad_s)])
    return speed if speed.size else np.zeros(1)


def speed_step(channels: Channels) -> float:
    """Return the usual change of speed from slot to slot near zero speed (else overall) [rad/s].

    A feature narrower than a few of these falls between samples.
    """
    change = np.abs(np.diff(channels.speed_rad_s))
    finite = np.isfinite(change)
    near = finite & (np.abs(channels.speed_rad_s[1:]) < NEAR_ZERO * used_speed(channels).max())
    moving = change[near & (change > 0)]
    if not moving.size:
        moving = change[finite & (change > 0)]
    return float(np.median(moving)) if moving.size else 0.0


def duration(channels: Channels) -> float:
    """Return the length of the record [s]."""
    return len(channels) * channels.sample_period_s


def narrowed(physical: tuple[float, float], low: float, high: float) -> tuple[float, float]:
    """Return [low, high] inside the physical bounds; a range that would be empty shrinks to its upper end."""
    high = min(max(high, physical[0]), physical[1])
    return min(max(low, physical[0]), high), high
