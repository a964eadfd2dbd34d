"""The torque balance of the rotor, and the friction derived from it: the one place that knows the sign.

J·dω/dt = K_T·I − friction. Friction is the *resisting* torque: positive when it opposes positive rotation (errata 1).
A plain difference of a real tachometer is useless (errata 17), so dω/dt comes from a Savitzky-Golay filter; the noise
that it leaves is coloured, and the later stages get its autocovariance from here.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from rwa_monitor.errors import InputError
from rwa_monitor.physics.wheel import Derivative, Wheel
from rwa_monitor.samples import FloatArray

MAX_HALF_WIDTH: Final = (
    5_000  # slots; a wider derivative is a wrong window_s, and would see nothing of a wheel's motion
)


def friction_torque(motor_torque_Nm: FloatArray, acceleration_rad_s2: FloatArray, inertia_kg_m2: float) -> FloatArray:
    """Return the resisting torque K_T·I − J·dω/dt [N m], float64 (n,) (paper, section II; sign: errata 1)."""
    return motor_torque_Nm - inertia_kg_m2 * acceleration_rad_s2


def motor_torque(friction_torque_Nm: FloatArray, acceleration_rad_s2: FloatArray, inertia_kg_m2: float) -> FloatArray:
    """Return the motor torque that a motion asks for [N m], float64 (n,): the inverse of `friction_torque`."""
    return inertia_kg_m2 * acceleration_rad_s2 + friction_torque_Nm


def half_width(derivative: Derivative, period_s: float) -> int:
    """Return how many slots the derivative's stencil reaches to either side.

    A Savitzky-Golay window of `window_s` has the odd number of taps nearest to window_s / period_s + 1, at least three.

    Raises
    ------
    InputError
        If the window is longer than 10,000 slots.
    """
    if derivative.method == "central":
        return 1
    half = max(1, round(derivative.window_s / period_s / 2))
    if half > MAX_HALF_WIDTH:
        raise InputError(
            "wheel",
            f"{derivative.window_s:g} s is {derivative.window_s / period_s:.0f} slots, more than {2 * MAX_HALF_WIDTH}",
            "friction.derivative.window_s",
        )
    return half


def derivative_taps(derivative: Derivative, period_s: float) -> FloatArray:
    """Return the taps c of dω/dt_k = Σ_j c[j + h]·ω_{k+j}, j = −h … h.

    Parameters
    ----------
    derivative
        Method and window.
    period_s
        Sample period [s].

    Returns
    -------
    FloatArray
        float64 (2h + 1,) [1/s], odd about its middle. The derivative of a least-squares parabola at its midpoint is
        Σ j·ω_{k+j} / (Δt·Σ j²) (Savitzky and Golay, Analytical Chemistry 36, 1964); h = 1 is the central difference.
    """
    offsets = np.arange(-(half := half_width(derivative, period_s)), half + 1, dtype=np.float64)
    return offsets / (period_s * float(np.sum(offsets * offsets)))


def differentiate(speed_rad_s: FloatArray, derivative: Derivative, period_s: float) -> FloatArray:
    """Return dω/dt on the slot grid [rad/s²], float64 (n,); NaN where the stencil meets a missing sample or an end.

    Each slot is the same sum in the same order wherever its record was cut, so the result does not depend on the cut.
    """
    taps = derivative_taps(derivative, period_s)
    half = taps.size // 2
    result = np.full(speed_rad_s.shape, np.nan)
    inner = speed_rad_s.size - 2 * half
    if inner <= 0:
        return result
    total = np.zeros(inner)
    for j in range(1, half + 1):
        ahead = speed_rad_s[half + j : half + j + inner]
        behind = speed_rad_s[half - j : half - j + inner]
        total += taps[half + j] * (ahead - behind)
    # The middle tap is zero: a slot without a speed of its own still has no derivative.
    total[np.isnan(speed_rad_s[half : half + inner])] = np.nan
    result[half : half + inner] = total
    return result


def derive_friction(speed_rad_s: FloatArray, motor_torque_Nm: FloatArray, wheel: Wheel) -> FloatArray:
    """Return the friction torque that speed and motor torque imply, on the slot grid.

    Parameters
    ----------
    speed_rad_s, motor_torque_Nm
        float64 (n,), consecutive slots, NaN where missing [rad/s, N m].
    wheel
        Gives inertia, sample period and the derivative filter.

    Returns
    -------
    FloatArray
        float64 (n,) [N m], NaN where the derivative's stencil touches a missing sample or the record's end.

    Raises
    ------
    InputError
        If the wheel has no inertia.
    """
    acceleration = differentiate(speed_rad_s, wheel.friction.derivative, wheel.sample_period_s)
    return friction_torque(motor_torque_Nm, acceleration, inertia_of(wheel))


def derived_noise_autocovariance(wheel: Wheel, speed_std_rad_s: float, current_std_A: float = 0.0) -> FloatArray:
    """Return the autocovariance of the derived friction's noise when speed and current carry white noise.

    Parameters
    ----------
    wheel
        Gives inertia, torque constant, sample period and the derivative filter.
    speed_std_rad_s, current_std_A
        Standard deviations of the white noise of a single speed [rad/s] and current [A] sample.

    Returns
    -------
    FloatArray
        float64 (2·(2h + 1),), entries at lags 0 … 4h + 1 [N² m²]; zero beyond lag 2h.

    Raises
    ------
    InputError
        If the wheel has no inertia, or has current noise but no torque constant.
    """
    taps = inertia_of(wheel) * derivative_taps(wheel.friction.derivative, wheel.sample_period_s)
    lags = np.zeros(2 * taps.size)
    for lag in range(taps.size):
        lags[lag] = speed_std_rad_s**2 * float(np.sum(taps[lag:] * taps[: taps.size - lag]))
    if current_std_A:
        lags[0] += (torque_constant_of(wheel) * current_std_A) ** 2
    return lags


def inertia_of(wheel: Wheel) -> float:
    """Return the wheel's inertia [kg m²]; raises InputError where the wheel file has none."""
    if wheel.inertia_kg_m2 is None:
        raise InputError(f"wheel {wheel.name}", "is missing; friction cannot be derived without it", "inertia_kg_m2")
    return wheel.inertia_kg_m2


def torque_constant_of(wheel: Wheel) -> float:
    """Return the wheel's torque constant [N m/A]; raises InputError where the wheel file has none."""
    if wheel.torque_constant_Nm_A is None:
        raise InputError(f"wheel {wheel.name}", "is missing; current says nothing without it", "torque_constant_Nm_A")
    return wheel.torque_constant_Nm_A
