"""What an effect is worth in torque over a sweep of the speed: what it costs a format that cannot hold it."""

from __future__ import annotations

from typing import Final

import numpy as np

from rwa_monitor.export.model import FrictionModel, Part
from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import Channels, MeanEffect, NoiseEffect

SLOTS: Final = 20_001  # of a sweep
SWEEP_S: Final = 2_000.0  # s, up, down to the opposite speed, and back to rest
TEMPERATURE_degC: Final = 20.0  # where the catalogue's laws have their reference


def sweep(model: FrictionModel, top_rad_s: float) -> Channels:
    """Return a motion from rest to a speed, to its opposite and back, evenly accelerated, at 20 °C."""
    time = np.linspace(0.0, SWEEP_S, SLOTS)
    speed = np.interp(time, SWEEP_S * np.array([0.0, 0.25, 0.75, 1.0]), top_rad_s * np.array([0.0, 1.0, -1.0, 0.0]))
    rate = np.where(np.abs(time - 0.5 * SWEEP_S) < 0.25 * SWEEP_S, -1.0, 1.0) * 4.0 * top_rad_s / SWEEP_S
    level = np.full(SLOTS, model.nominal.dry_torque_Nm)
    base = np.sign(speed) * level + model.nominal.viscous_Nm_s_rad * speed
    inertia = model.wheel.inertia_kg_m2
    period_s = SWEEP_S / (SLOTS - 1)
    return Channels(
        time_s=time,
        speed_rad_s=speed,
        direction=np.sign(speed),
        acceleration_rad_s2=rate,
        angle_rad=np.cumsum(speed) * period_s,
        motor_torque_Nm=None if inertia is None else inertia * rate + base,
        bearing_temperature_degC=np.full(SLOTS, TEMPERATURE_degC),
        dry_level_Nm=level,
        sample_period_s=period_s,
        good=np.ones(SLOTS, dtype=np.bool_),
    )


def rms(values: FloatArray) -> float:
    """Return the root of the mean square of what is known."""
    return float(np.sqrt(np.nanmean(np.square(values))))


def cost(part: Part, model: FrictionModel) -> str:
    """Return in words what leaving out an effect costs, over a sweep to the nominal speed."""
    top = model.nominal.nominal_speed_rad_s
    over = f"over a sweep to {top:g} rad/s in {SWEEP_S / 4:g} s"
    channels = sweep(model, top)
    if isinstance(part.effect, MeanEffect):
        if channels.motor_torque_Nm is None:
            return "not known without inertia_kg_m2"
        return f"an RMSE of {rms(part.effect.torque(channels)[0]):.2g} N m {over}"
    if isinstance(part.effect, NoiseEffect):
        std = model.wheel.noise.friction_std_Nm or 0.0
        white = std * np.random.default_rng(0).standard_normal(SLOTS)
        noise = part.effect.apply(white, channels, np.random.default_rng(1))
        return f"a scatter of {rms(noise):.2g} N m {over}, beside {std:.2g} N m of white noise without it"
    return "nothing, where the caller's level jumps as the effect has it"
