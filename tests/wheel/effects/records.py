"""Records for tests of the effects: a rich motion with every channel, without noise."""

from dataclasses import fields, replace

import numpy as np

from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import Channels

PERIOD_S = 0.125
INERTIA_KG_M2 = 0.0117
DRY_NM, VISCOUS_NM_S_RAD = 1.6e-3, 5.333e-6


def rich_motion(slots: int, period_s: float = PERIOD_S, top_speed_rad_s: float = 120.0, seed: int = 0) -> Channels:
    """Return slews, slow and fast reversals, dwells, in both directions; temperature over 15 K; a level that jumps."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(slots) * period_s
    turn = 2 * np.pi * time_s / time_s[-1]
    speed = top_speed_rad_s * (0.7 * np.sin(3 * turn + 0.4) + 0.25 * np.sin(17 * turn) + 0.05 * np.sin(61 * turn + 1.0))
    speed = np.where((turn > 2.0) & (turn < 2.6), 0.02 * speed, speed)  # slow around zero
    smooth = np.hanning(21) / np.hanning(21).sum()
    speed = np.convolve(np.pad(speed, 10, mode="edge"), smooth, mode="valid")
    acceleration = np.gradient(speed, period_s)
    angle = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * period_s)])
    temperature = 27.0 + 7.5 * np.sin(2 * turn + 1.3)
    level = DRY_NM * (1.0 + np.cumsum((rng.random(slots) < 8 / slots) * rng.normal(0.0, 0.4, slots)).clip(-0.6, 2.0))
    friction = np.sign(speed) * level + VISCOUS_NM_S_RAD * speed
    return channels_of(
        speed,
        period_s,
        acceleration_rad_s2=acceleration,
        angle_rad=angle,
        motor_torque_Nm=INERTIA_KG_M2 * acceleration + friction,
        bearing_temperature_degC=temperature,
        dry_level_Nm=level,
    )


def channels_of(speed: FloatArray, period_s: float = PERIOD_S, **others: FloatArray | None) -> Channels:
    """Return the channels of a speed that was measured in every slot [rad/s]; those not given are zero or absent."""
    channels = {
        "direction": np.sign(speed),
        "acceleration_rad_s2": np.zeros(speed.size),
        "angle_rad": np.zeros(speed.size),
        "good": np.ones(speed.size, dtype=np.bool_),
        **others,
    }
    return Channels(time_s=np.arange(speed.size) * period_s, speed_rad_s=speed, sample_period_s=period_s, **channels)


def piece(channels: Channels, start: int, stop: int) -> Channels:
    """Return the slots [start, stop) as a record that goes on from an earlier one."""
    of_name = {one.name: getattr(channels, one.name) for one in fields(channels)}
    arrays = {name: value[start:stop].copy() for name, value in of_name.items() if isinstance(value, np.ndarray)}
    return replace(channels, **arrays)


def mirrored(channels: Channels) -> Channels:
    """Return the same motion in the other direction."""
    odd = ("speed_rad_s", "direction", "acceleration_rad_s2", "angle_rad", "motor_torque_Nm", "motor_torque_rate_Nm_s")
    flipped = {name: getattr(channels, name) for name in odd}
    return replace(channels, **{name: -values for name, values in flipped.items() if values is not None})
