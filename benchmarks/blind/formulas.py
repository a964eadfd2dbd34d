"""Torques of the hidden effects at unit strength, from the literature's formulas, never from the package's classes.

Each takes the true motion and a shape drawn for it. Formulas that `benchmarks/blind/literature.py` already has are used
from there.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import signal

from benchmarks.blind import literature

Array = np.ndarray[Any, np.dtype[np.float64]]
Shape = dict[str, float]


@dataclass(frozen=True)
class Truth:
    """The true motion of a record: arrays (n,) in SI units, and the wheel's units of speed and torque."""

    time: Array
    speed: Array
    acceleration: Array
    angle: Array
    motor_torque: Array  # without the effect
    temperature: Array
    level: Array
    period: float
    speed_unit: float
    torque_unit: float
    jump_index: np.ndarray[Any, np.dtype[np.int64]]
    jump_size: Array

    @property
    def sign(self) -> Array:
        return np.sign(self.speed)

    @property
    def length(self) -> float:
        return float(self.time.size * self.period)


def dahl_torque(truth: Truth, shape: Shape) -> Array:
    """Dahl's equation, integrated around each reversal only, where the bristle is not yet fully deflected."""
    scale = shape["breakaway_angle_rad"]
    torque = np.zeros(truth.speed.size)
    for crossing in np.flatnonzero(np.diff(truth.sign) != 0):
        begin = max(int(crossing) - 2, 0)
        travelled = np.cumsum(np.abs(truth.speed[begin:])) * truth.period
        end = begin + int(np.searchsorted(travelled, 30.0 * scale)) + 4
        speed = truth.speed[begin:end]
        # The midpoint rule is stable for steps below two breakaway angles; a tenth is accurate.
        steps = int(np.ceil(np.max(np.abs(speed)) * truth.period / scale * 10)) + 20
        torque[begin:end] = literature.dahl(speed, truth.period, 1.0, 1.0 / scale, steps)
    return torque


def delayed_current(truth: Truth, shape: Shape) -> Array:
    """Motor torque one slot later less the present one, per slot: the drawn strength is the delay."""
    del shape
    return literature.shifted_current(truth.motor_torque, truth.period, truth.period) / truth.period


def ripple(truth: Truth, shape: Shape) -> Array:
    """Two harmonics of the angle."""
    h = int(shape["harmonic"])
    second = shape["second"]
    return literature.ripple(truth.angle, [1.0, second], [shape["phase"], 2.1 * shape["phase"]], [h, 2 * h])


def lagging(truth: Truth, shape: Shape) -> Array:
    """First-order lag by an exact recursion for the mean of two neighbours (bilinear), begun in equilibrium."""
    ratio = truth.period / shape["time_constant_s"]
    b, a = [ratio / (2 + ratio)] * 2, [1.0, (ratio - 2) / (2 + ratio)]
    start = signal.lfilter_zi(b, a) * truth.speed[0]
    lagged, _ = signal.lfilter(b, a, truth.speed, zi=start)
    return np.asarray(truth.speed - lagged)


def constant(truth: Truth, _: Shape) -> Array:
    """An offset of the current, as a torque."""
    return literature.offset_current(truth.motor_torque, 1.0, 1.0)


MEAN: dict[str, Callable[[Truth, Shape], Array]] = {
    "stribeck": lambda t, s: literature.stribeck_curve(t.speed, 1.0, 2.0, s["stribeck_speed_rad_s"], s["exponent"]),
    "presliding": dahl_torque,
    "coulomb_asymmetry": lambda t, _: literature.direction_dependent_coulomb(t.speed, t.level, 1.0),
    "torque_bias": constant,
    "viscous_asymmetry": lambda t, _: literature.direction_dependent_viscous(t.speed, 1.0, -1.0),
    "viscosity_temperature": lambda t, s: literature.viscous_with_temperature(t.speed, t.temperature, 1.0, s["B"]),
    "sublinear_viscous": lambda t, s: t.sign * np.exp(s["exponent"] * np.log(np.maximum(np.abs(t.speed), 1e-12))),
    "saturating_drag": lambda t, s: t.sign * (1.0 - 1.0 / (1.0 + np.abs(t.speed) / s["saturation_speed_rad_s"])),
    "quadratic_drag": lambda t, _: literature.disc_windage(t.speed, 1.0, 2.0, 1.0),
    "lubricant_lag": lagging,
    "run_in_drift": lambda t, s: literature.running_in(t.speed, t.period, 1.0, s["time_constant_s"]),
    "load_dependence": lambda t, _: literature.loaded_bearing(t.speed, t.motor_torque, 1.0),
    "inertia_error": lambda t, _: literature.wrong_inertia(t.motor_torque, t.acceleration, 2.0, 1.0),
    "torque_constant_error": lambda t, _: literature.wrong_torque_constant(t.motor_torque, 1.0, 2.0),
    "torque_constant_temperature": lambda t, _: literature.weakening_magnets(t.motor_torque, t.temperature, 1.0, -1.0),
    "current_delay": delayed_current,
    "torque_ripple": ripple,
    "speed_dead_zone": lambda t, s: literature.speed_threshold(t.speed, 1.0, s["dead_zone_rad_s"]),
}

# Physical sign: +1 where the strength is not negative, 0 where both signs occur.
ONE_SIGN = {
    "stribeck",
    "presliding",
    "viscosity_temperature",
    "sublinear_viscous",
    "saturating_drag",
    "quadratic_drag",
    "load_dependence",
    "speed_dead_zone",
}


def draw_shape(name: str, truth: Truth, rng: np.random.Generator) -> Shape:
    """Draw an effect's shape: typical values for a wheel, as shares of the record's ranges."""
    top = float(np.max(np.abs(truth.speed)))
    slow = np.abs(truth.speed) < max(0.1 * top, 1.5 * float(np.min(np.abs(truth.speed))))
    step = float(np.median(np.abs(truth.acceleration[slow]))) * truth.period
    if name == "stribeck":
        return {
            "stribeck_speed_rad_s": float(np.exp(rng.uniform(np.log(0.012), np.log(0.08)))) * top,
            "exponent": float(rng.choice([1.0, 2.0])),
        }
    if name == "presliding":
        # Breakaway angles that take several slots at these reversals: t ≈ √(2 z/|dω/dt|).
        return {"breakaway_angle_rad": float(rng.uniform(4.0, 60.0)) * step * truth.period}
    if name == "viscosity_temperature":
        return {"B": float(rng.uniform(2500.0, 6500.0))}
    if name == "sublinear_viscous":
        return {"exponent": float(rng.choice([0.6, 2.0 / 3.0]))}
    if name == "saturating_drag":
        return {"saturation_speed_rad_s": float(np.exp(rng.uniform(np.log(0.02), np.log(0.2)))) * top}
    if name == "lubricant_lag":
        return {"time_constant_s": float(np.exp(rng.uniform(np.log(0.015), np.log(0.15)))) * truth.length}
    if name == "run_in_drift":
        return {"time_constant_s": float(rng.choice([0.2, 0.5, 20.0])) * truth.length}
    if name == "torque_ripple":
        return {
            "harmonic": float(rng.integers(1, 13)),
            "phase": float(rng.uniform(0, 6.28)),
            "second": float(rng.uniform(0, 0.5)),
        }
    if name == "speed_dead_zone":
        return {"dead_zone_rad_s": float(np.exp(rng.uniform(np.log(0.008), np.log(0.05)))) * top}
    return {}


# ---- outside the catalogue -------------------------------------------------------------------------------------------


def _centre(truth: Truth, rng: np.random.Generator) -> tuple[float, float]:
    speed = np.abs(truth.speed)
    low, high = np.quantile(speed, [0.3, 0.7])
    return float(rng.uniform(low, high)), float(rng.uniform(0.05, 0.1) * (speed.max() - speed.min()))


def bump(truth: Truth, rng: np.random.Generator) -> Array:
    """Drag in a band of speeds, as of a bearing in resonance."""
    at, width = _centre(truth, rng)
    return truth.sign * np.exp(-(((np.abs(truth.speed) - at) / width) ** 2))


def even_bump(truth: Truth, rng: np.random.Generator) -> Array:
    """A torque in a band of speeds that does not flip with the direction."""
    at, width = _centre(truth, rng)
    return np.asarray(np.exp(-(((np.abs(truth.speed) - at) / width) ** 2)))


def periodic(truth: Truth, rng: np.random.Generator) -> Array:
    """A disturbance that is periodic in time, as of a solar array's drive."""
    period = float(np.exp(rng.uniform(np.log(60), np.log(800)))) * truth.period
    return np.sin(2 * math.pi * truth.time / period + rng.uniform(0, 6.28))


def periodic_drag(truth: Truth, rng: np.random.Generator) -> Array:
    """Drag that pulsates in time, as of a cage that wobbles."""
    return truth.sign * periodic(truth, rng)


def step_in_speed(truth: Truth, rng: np.random.Generator) -> Array:
    """A step of the drag at a speed, as of another regime of lubrication."""
    at, _ = _centre(truth, rng)
    return truth.sign * (np.abs(truth.speed) > at)


def acceleration_drag(truth: Truth, rng: np.random.Generator) -> Array:
    """Drag that grows with the size of the acceleration, whatever its direction."""
    del rng
    return truth.sign * np.abs(truth.acceleration)


OUTSIDE: dict[str, Callable[[Truth, np.random.Generator], Array]] = {
    "bump": bump,
    "even_bump": even_bump,
    "periodic": periodic,
    "periodic_drag": periodic_drag,
    "step_in_speed": step_in_speed,
    "acceleration_drag": acceleration_drag,
}

# Two at once: pairs whose signatures overlap, on rich and crossing manoeuvres.
PAIRS = (
    ("stribeck", "inertia_error"),
    ("viscosity_temperature", "torque_bias"),
    ("quadratic_drag", "lubricant_lag"),
    ("sublinear_viscous", "load_dependence"),
    ("stribeck", "viscosity_temperature"),
    ("coulomb_asymmetry", "viscous_asymmetry"),
    ("torque_ripple", "torque_bias"),
    ("presliding", "quadratic_drag"),
    ("speed_dead_zone", "viscosity_temperature"),
    ("run_in_drift", "inertia_error"),
    ("lubricant_lag", "stribeck"),
    ("load_dependence", "inertia_error"),
    ("torque_constant_temperature", "viscous_asymmetry"),
    ("current_delay", "sublinear_viscous"),
    ("quadratic_drag", "speed_dependent_noise"),
    ("stribeck", "viscous_jump"),
    ("viscous_asymmetry", "cage_instability"),
    ("inertia_error", "decaying_jump"),
    ("viscosity_temperature", "lubricant_lag"),
    ("torque_bias", "extra_switching_system"),
)
