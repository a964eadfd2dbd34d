"""A second implementation of the effects from the literature: a wrong formula must not confirm itself.

Nothing here imports the package. Each function is a plain loop over samples that returns the torque *beyond* the base
law s·F_C + f_v·ω (positive when it opposes positive rotation), from quantities as the literature names them.
Differential equations are integrated by many small steps of the simplest method, not by their solution.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np

Values = Sequence[float] | np.ndarray


def sgn(value: float) -> float:
    """Return the sign of a number, 0 of 0."""
    return 1.0 if value > 0 else -1.0 if value < 0 else 0.0


# ---- static friction curves ------------------------------------------------------------------------------------------


def stribeck_curve(speed: Values, coulomb: float, static: float, stribeck_speed: float, delta: float) -> np.ndarray:
    """Armstrong-Hélouvry et al. 1994: F = [F_C + (F_S - F_C) exp(-|v/v_s|^δ)] sgn v, less F_C sgn v."""
    out = []
    for v in speed:
        friction = (coulomb + (static - coulomb) * math.exp(-(abs(v / stribeck_speed) ** delta))) * sgn(v)
        out.append(friction - coulomb * sgn(v))
    return np.array(out)


def direction_dependent_coulomb(speed: Values, level: Values, ratio: float) -> np.ndarray:
    """F_C⁺ = (1 + ε) F_C for v > 0, F_C⁻ = (1 - ε) F_C for v < 0, less the symmetric F_C sgn v."""
    out = []
    for v, dry in zip(speed, level, strict=True):
        friction = (1 + ratio) * dry if v > 0 else -(1 - ratio) * dry if v < 0 else 0.0
        out.append(friction - dry * sgn(v))
    return np.array(out)


def direction_dependent_viscous(speed: Values, forward: float, backward: float) -> np.ndarray:
    """f_v⁺ v for v > 0, f_v⁻ v for v < 0, less the mean of both times v."""
    mean = 0.5 * (forward + backward)
    return np.array([(forward if v > 0 else backward) * v - mean * v for v in speed])


def disc_windage(speed: Values, moment_coefficient: float, density: float, radius: float) -> np.ndarray:
    """Schlichting: M = C_M ½ ρ ω² R⁵ against the motion, with a constant coefficient C_M (both sides of the disc)."""
    return np.array([sgn(v) * moment_coefficient * 0.5 * density * v * v * radius**5 for v in speed])


def speed_threshold(speed: Values, coulomb: float, threshold: float) -> np.ndarray:
    """Coulomb friction by electronics that read zero speed below a threshold, less the true F_C sgn v."""
    out = []
    for v in speed:
        read = 0.0 if abs(v) < threshold else v
        out.append(coulomb * sgn(read) - coulomb * sgn(v))
    return np.array(out)


# ---- temperature -----------------------------------------------------------------------------------------------------


def andrade_viscosity(temperature_degC: float, reference_viscosity: float, b_kelvin: float) -> float:
    """Andrade 1930: ν = A exp(B/T), A such that ν(20 °C) is the reference."""
    a = reference_viscosity / math.exp(b_kelvin / 293.15)
    return a * math.exp(b_kelvin / (temperature_degC + 273.15))


def viscous_with_temperature(speed: Values, temperature_degC: Values, viscous_20: float, b_kelvin: float) -> np.ndarray:
    """f_v(T) = f_v(20 °C) ν(T)/ν(20 °C), times v, less f_v(20 °C) v."""
    out = []
    for v, temperature in zip(speed, temperature_degC, strict=True):
        out.append(viscous_20 * andrade_viscosity(temperature, 1.0, b_kelvin) * v - viscous_20 * v)
    return np.array(out)


def rolling_drag(
    speed: Values, temperature_degC: Values, at_one_20: float, exponent: float, b_kelvin: float
) -> np.ndarray:
    """Palmgren 1959: M ∝ (ν n)^(2/3), here (ν(T)/ν(20 °C) · |v|)^p of a drag known at 1 rad/s and 20 °C."""
    out = []
    for v, temperature in zip(speed, temperature_degC, strict=True):
        out.append(sgn(v) * at_one_20 * (andrade_viscosity(temperature, 1.0, b_kelvin) * abs(v)) ** exponent)
    return np.array(out)


# ---- states ----------------------------------------------------------------------------------------------------------


def dahl(speed: Values, period: float, coulomb: float, stiffness: float, steps: int = 400) -> np.ndarray:
    """Dahl 1968 (exponent 1): dF/dt = σ₀ (1 - F/F_C sgn v) v, v linear between samples, by the midpoint rule.

    Less F_C sgn v.
    """
    force = coulomb * sgn(speed[0])
    out = [force - coulomb * sgn(speed[0])]
    for before, after in itertools.pairwise(speed):
        h = period / steps
        for i in range(steps):
            v = before + (after - before) * (i + 0.5) / steps
            half = force + 0.5 * h * stiffness * (1 - force / coulomb * sgn(v)) * v
            force += h * stiffness * (1 - half / coulomb * sgn(v)) * v
        out.append(force - coulomb * sgn(after))
    return np.array(out)


def lagging_lubricant(
    speed: Values, period: float, strength: float, time_constant: float, steps: int = 50
) -> np.ndarray:
    """B (ω - ω_f), τ dω_f/dt = ω - ω_f, ω linear between samples, by the midpoint rule."""
    lagged = speed[0]
    out = [0.0]
    for before, after in itertools.pairwise(speed):
        h = period / steps
        for i in range(steps):
            omega = before + (after - before) * (i + 0.5) / steps
            half = lagged + 0.5 * h * (omega - lagged) / time_constant
            lagged += h * (omega - half) / time_constant
        out.append(strength * (after - lagged))
    return np.array(out)


def running_in(speed: Values, period: float, rate: float, time_constant: float) -> np.ndarray:
    """A level that changes at first with `rate`, the rate dying away: dL/dt = a exp(-t/τ), by Simpson's rule."""
    level, out = 0.0, []
    for k, v in enumerate(speed):
        out.append(sgn(v) * level)
        begin = k * period
        samples = [math.exp(-(begin + part * period) / time_constant) for part in (0.0, 0.5, 1.0)]
        level += rate * period * (samples[0] + 4 * samples[1] + samples[2]) / 6
    return np.array(out)


# ---- errors of the torque balance ------------------------------------------------------------------------------------
# Friction is K_T I - J dω/dt. Each function computes it twice: with the true constant and with a wrong one.


def _balance(motor_torque: float, inertia: float, acceleration: float) -> float:
    return motor_torque - inertia * acceleration


def wrong_inertia(motor_torque: Values, acceleration: Values, true: float, assumed: float) -> np.ndarray:
    """Return the difference of a torque balance with a wrong inertia from the right one."""
    pairs = zip(motor_torque, acceleration, strict=True)
    return np.array([_balance(m, assumed, a) - _balance(m, true, a) for m, a in pairs])


def wrong_torque_constant(current: Values, true: float, assumed: float) -> np.ndarray:
    """Return the difference of a torque balance with a wrong torque constant from the right one."""
    return np.array([_balance(assumed * i, 1.0, 0.0) - _balance(true * i, 1.0, 0.0) for i in current])


def weakening_magnets(
    current: Values, temperature_degC: Values, constant_20: float, flux_coefficient: float
) -> np.ndarray:
    """Magnet data sheets: K_T(T) = K_T(20 °C) [1 + α (T - 20 °C)], α < 0; computed with K_T(20 °C)."""
    out = []
    for i, temperature in zip(current, temperature_degC, strict=True):
        true = constant_20 * (1 + flux_coefficient * (temperature - 20.0)) * i
        out.append(constant_20 * i - true)
    return np.array(out)


def shifted_current(motor_torque: Values, period: float, shift: float) -> np.ndarray:
    """The motor torque of `shift` seconds later in place of that of now; shift within one sample."""
    out = [0.0]
    for k in range(1, len(motor_torque) - 1):
        if shift >= 0:
            later = motor_torque[k] + (motor_torque[k + 1] - motor_torque[k]) * shift / period
        else:
            later = motor_torque[k] + (motor_torque[k] - motor_torque[k - 1]) * shift / period
        out.append(later - motor_torque[k])
    return np.array([*out, 0.0])


def loaded_bearing(speed: Values, motor_torque: Values, coefficient: float) -> np.ndarray:
    """Palmgren's load-dependent part M₁ = μ·load with the transmitted torque as the load, against the motion."""
    return np.array([sgn(v) * coefficient * abs(m) for v, m in zip(speed, motor_torque, strict=True)])


def offset_current(current: Values, torque_constant: float, offset: float) -> np.ndarray:
    """Return the apparent torque of an offset of the measured current."""
    return np.array([torque_constant * (i + offset) - torque_constant * i for i in current])


def ripple(angle: Values, amplitudes: Values, phases: Values, harmonics: Sequence[int]) -> np.ndarray:
    """Σ A_h sin(h θ + φ_h)."""
    waves = list(zip(amplitudes, phases, harmonics, strict=True))
    return np.array([sum(a * math.sin(h * theta + p) for a, p, h in waves) for theta in angle])


# ---- noise -----------------------------------------------------------------------------------------------------------


def autoregressive(innovation: Values, phi: float) -> np.ndarray:
    """Box and Jenkins: z_t = φ z_{t-1} + a_t, scaled so that Var z is that of `innovation`, begun stationary."""
    out = [float(innovation[0])]
    for a in innovation[1:]:
        out.append(phi * out[-1] + math.sqrt(1 - phi**2) * a)
    return np.array(out)


def quantised_derivative(speed: Values, period: float, step: float, inertia: float) -> np.ndarray:
    """-J times the central difference of the rounding errors; zero at both ends, where it has none."""
    error = [round(v / step) * step - v for v in speed]
    inner = [-inertia * (after - before) / (2 * period) for before, after in zip(error[:-2], error[2:], strict=True)]
    return np.array([0.0, *inner, 0.0])


# ---- switching -------------------------------------------------------------------------------------------------------


def relaxing_jumps(
    speed: Values, period: float, places: Sequence[int], sizes: Values, share: float, time_constant: float
) -> np.ndarray:
    """Change of the drag since the last jump, where a share of the jump decays with a time constant."""
    out, size, since = [], 0.0, 0.0
    jump_at = dict(zip(places, sizes, strict=True))
    for k, v in enumerate(speed):
        if k in jump_at:
            size, since = jump_at[k], 0.0
        out.append(sgn(v) * share * (size * math.exp(-since / time_constant) - size))
        since += period
    return np.array(out)


def jumping_slope(speed: Values, places: Sequence[int], sizes: Values, per_torque: float) -> np.ndarray:
    """A viscous coefficient that changes at each jump in proportion to its size."""
    out, coefficient = [], 0.0
    jump_at = dict(zip(places, sizes, strict=True))
    for k, v in enumerate(speed):
        coefficient += per_torque * jump_at.get(k, 0.0)
        out.append(coefficient * v)
    return np.array(out)


def carreau_yasuda_film(speed: Values, slope: float, critical: float, bend: float) -> np.ndarray:
    """Yasuda and others (1981) with power index n = 0: viscosity η₀ [1 + (λγ̇)^a]^((n−1)/a), λγ̇ = |ω|/critical.

    With a = 1 Cross (1965): η₀/(1 + λγ̇).
    """
    return np.asarray(speed) * slope * (1.0 + (np.abs(speed) / critical) ** bend) ** (-1.0 / bend)
