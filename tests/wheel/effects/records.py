"""Records on which the effects are tried: a rich motion with every channel, no noise in the channels."""

from __future__ import annotations

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
    direction = np.sign(speed)
    temperature = 27.0 + 7.5 * np.sin(2 * turn + 1.3)
    level = DRY_NM * (1.0 + np.cumsum((rng.random(slots) < 8 / slots) * rng.normal(0.0, 0.4, slots)).clip(-0.6, 2.0))
    friction = direction * level + VISCOUS_NM_S_RAD * speed
    return Channels(
        time_s=time_s,
        speed_rad_s=speed,
        direction=direction,
        acceleration_rad_s2=acceleration,
        angle_rad=angle,
        motor_torque_Nm=INERTIA_KG_M2 * acceleration + friction,
        bearing_temperature_degC=temperature,
        dry_level_Nm=level,
        sample_period_s=period_s,
        good=np.ones(slots, dtype=bool),
    )


def piece(channels: Channels, start: int, stop: int) -> Channels:
    """Return the slots [start, stop) as a record that goes on from an earlier one."""

    def cut(values: FloatArray | None) -> FloatArray | None:
        return None if values is None else values[start:stop].copy()

    return Channels(
        time_s=channels.time_s[start:stop].copy(),
        speed_rad_s=channels.speed_rad_s[start:stop].copy(),
        direction=channels.direction[start:stop].copy(),
        acceleration_rad_s2=channels.acceleration_rad_s2[start:stop].copy(),
        angle_rad=channels.angle_rad[start:stop].copy(),
        motor_torque_Nm=cut(channels.motor_torque_Nm),
        bearing_temperature_degC=cut(channels.bearing_temperature_degC),
        dry_level_Nm=cut(channels.dry_level_Nm),
        sample_period_s=channels.sample_period_s,
        good=channels.good[start:stop].copy(),
        motor_torque_rate_Nm_s=cut(channels.motor_torque_rate_Nm_s),
    )


def mirrored(channels: Channels) -> Channels:
    """Return the same motion in the other direction."""

    def flip(values: FloatArray | None) -> FloatArray | None:
        return None if values is None else -values

    return Channels(
        time_s=channels.time_s,
        speed_rad_s=-channels.speed_rad_s,
        direction=-channels.direction,
        acceleration_rad_s2=-channels.acceleration_rad_s2,
        angle_rad=-channels.angle_rad,
        motor_torque_Nm=flip(channels.motor_torque_Nm),
        bearing_temperature_degC=channels.bearing_temperature_degC,
        dry_level_Nm=channels.dry_level_Nm,
        sample_period_s=channels.sample_period_s,
        good=channels.good,
        motor_torque_rate_Nm_s=flip(channels.motor_torque_rate_Nm_s),
    )
