"""What an effect is worth in torque over a sweep of the speed: what it costs a format that cannot hold it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from rwa_monitor.export.model import FrictionModel, Part
from rwa_monitor.samples import FloatArray
from rwa_monitor.simulation.motion import wheel_angle
from rwa_monitor.simulation.record import couple
from rwa_monitor.wheel.effects.base import Channels, Effect, MeanEffect, NoiseEffect
from rwa_monitor.wheel.effects.formula import ORIGIN_degC

SLOTS: Final = 20_001  # of a sweep
SWEEP_S: Final = 2_000.0  # s, from rest to the largest speed, down to the opposite one, and back to rest
SWING_K: Final = 5.0  # K to both sides, over the sweep: the largest of an orbit (`simulation.record`)


def sweep(model: FrictionModel, top_rad_s: float) -> Channels:
    """Return a motion from rest to a speed, to its opposite and back, evenly accelerated; 15 to 25 °C on the way."""
    time, period_s = np.linspace(0.0, SWEEP_S, SLOTS), SWEEP_S / (SLOTS - 1)
    speed = np.interp(time, SWEEP_S * np.array([0.0, 0.25, 0.75, 1.0]), top_rad_s * np.array([0.0, 1.0, -1.0, 0.0]))
    rate = np.where(np.abs(time - 0.5 * SWEEP_S) < 0.25 * SWEEP_S, -1.0, 1.0) * 4.0 * top_rad_s / SWEEP_S
    level = np.full(SLOTS, model.nominal.dry_torque_Nm)
    inertia = model.wheel.inertia_kg_m2
    return Channels(
        time_s=time,
        speed_rad_s=speed,
        direction=np.sign(speed),
        acceleration_rad_s2=rate,
        angle_rad=wheel_angle(speed, period_s),
        motor_torque_Nm=None if inertia is None else inertia * rate + base_law(model, speed),
        bearing_temperature_degC=ORIGIN_degC + SWING_K * np.sin(2.0 * np.pi * time / SWEEP_S),
        dry_level_Nm=level,
        sample_period_s=period_s,
        good=np.ones(SLOTS, dtype=np.bool_),
    )


def base_law(model: FrictionModel, speed_rad_s: FloatArray) -> FloatArray:
    """Return dry and viscous friction without jumps and effects [N m]."""
    return np.sign(speed_rad_s) * model.nominal.dry_torque_Nm + model.nominal.viscous_Nm_s_rad * speed_rad_s


def torque(model: FrictionModel, effects: Sequence[Effect], channels: Channels) -> FloatArray:
    """Return the friction with some effects, as it is simulated, without jumps [N m]."""
    coupled = couple([effect for effect in effects if isinstance(effect, MeanEffect)], channels)
    return np.asarray(sum(coupled.values(), start=base_law(model, channels.speed_rad_s)))


def rms(values: FloatArray) -> float:
    """Return the root of the mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


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
