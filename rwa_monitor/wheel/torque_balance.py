"""The torque balance of the rotor, and the friction derived from it: the one module that defines the sign of friction.

J·dω/dt = K_T·I − friction, all at the wheel's axis: behind a gear K_T is the motor's times the ratio. Friction is the
*resisting* torque: positive when it opposes positive rotation (errata 1).
The difference of a real tachometer's readings is too noisy (errata 17), so dω/dt comes from a Savitzky-Golay filter.
"""

from dataclasses import replace
from typing import Final, Literal

import numpy as np

from rwa_monitor.errors import InputError
from rwa_monitor.kernels import torque_balance as kernels
from rwa_monitor.samples import FloatArray, Samples
from rwa_monitor.wheel.wheel import Derivative, Wheel

# In slots; a wider stencil is a wrong window_s, and would average the wheel's motion away.
MAX_HALF_WIDTH: Final = 5_000
MAX_VARIANCE_RATIO: Final = 2.0  # variance of a slope over a gap, to that of one without a gap
Source = Literal["friction_torque_Nm", "motor_torque_Nm", "motor_current_A"]
FRICTION_CHANNELS: Final[tuple[Source, ...]] = ("friction_torque_Nm", "motor_torque_Nm", "motor_current_A")
# Half-width of the derivative filter [slots] from which the error at a bend of the speed is known, and corrected.
WIDE_HALF: Final = 8
FEWEST_AROUND: Final = 3  # slots to either side: in fewer a bend of the speed leaves no degree of freedom
NOISE_SLOTS: Final = 24  # before a slot, from which a narrower filter estimates the noise of its torque
LEAST_ERROR: Final = 0.02  # of the nominal dry friction, or of friction itself: half of a usual noise; less is harmless


def friction_torque(motor_torque_Nm: FloatArray, acceleration_rad_s2: FloatArray, inertia_kg_m2: float) -> FloatArray:
    """Return the resisting torque K_T·I − J·dω/dt [N m], float64 (n,) (paper, section II; sign: errata 1)."""
    return motor_torque_Nm - inertia_kg_m2 * acceleration_rad_s2


def source_of(samples: Samples, wheel: Wheel, source: str = "") -> Source:
    """Return the channel that gives friction: the friction torque, else the motor torque, else the motor current.

    `source` names the samples in an error; "" for the wheel's name.

    Raises
    ------
    InputError
        If friction is not given and the wheel's constants, or the channels, do not suffice to derive it.
    """
    constants = (wheel.inertia_kg_m2, wheel.torque_constant_Nm_A)
    for needed, channel in enumerate(FRICTION_CHANNELS):  # each needs one more constant
        if getattr(samples, channel) is not None and None not in constants[:needed]:
            return channel
    raise InputError(
        source or f"wheel {wheel.name}",
        "friction_torque_Nm is missing, and friction cannot be derived: that takes motor_current_A with "
        "torque_constant_Nm_A and inertia_kg_m2 of the wheel, or motor_torque_Nm with inertia_kg_m2, or with the motor "
        "off inertia_kg_m2 and motor_off",
    )


def motor_torque(samples: Samples, wheel: Wheel) -> FloatArray | None:
    """Return the motor torque, measured or K_T·I, float64 (n,) [N m]; None where neither is there."""
    if samples.motor_torque_Nm is not None:
        return samples.motor_torque_Nm
    if samples.motor_current_A is not None and wheel.torque_constant_Nm_A is not None:
        return torque_per_ampere(samples.motor_current_A, samples.speed_rad_s, wheel) * samples.motor_current_A
    return None


def without_motor(samples: Samples, wheel: Wheel) -> Samples:
    """Return the samples with a motor torque of zero, where the motor is off and no torque is given.

    Friction is then -J dω/dt, and no torque constant is needed; a current measured nevertheless is not the motor's.

    Raises
    ------
    InputError
        If the motor torque is set to zero, and the wheel has no inertia.
    """
    given = samples.friction_torque_Nm is not None or samples.motor_torque_Nm is not None
    if not wheel.friction.motor_off or given:
        return samples
    inertia_of(wheel)
    return replace(samples, motor_torque_Nm=np.zeros(len(samples)))


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


def with_window(wheel: Wheel, window_s: float) -> Wheel:
    """Return the wheel with dω/dt estimated over another window [s]."""
    derivative = wheel.friction.derivative.model_copy(update={"window_s": window_s})
    return wheel.model_copy(update={"friction": wheel.friction.model_copy(update={"derivative": derivative})})


def slots_around(wheel: Wheel) -> tuple[int, int]:
    """Return how many slots before one and how many after it `corrected_friction` depends on."""
    half = half_width(wheel.friction.derivative, wheel.sample_period_s)
    if half >= WIDE_HALF:
        return half, half
    bend = 2 * (half + 1)  # a bend may begin or end so far away
    return NOISE_SLOTS + bend, bend + max(half, FEWEST_AROUND)


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


def weights_between(wheel: Wheel) -> FloatArray:
    """Return the weights with which the wheel's derivative averages dω/dt: between slots 0 and 1, 1 and 2, …, (h,).

    Σ c_j ω_{k+j} = Σ_i W_i a_{k+i+½}: the acceleration between slots i and i + 1 enters each tap beyond them.
    """
    taps = derivative_taps(wheel.friction.derivative, wheel.sample_period_s)
    return np.ascontiguousarray(wheel.sample_period_s * np.cumsum(taps[: taps.size // 2 : -1])[::-1])


def averaging_taps(wheel: Wheel) -> FloatArray:
    """Return the weights with which the wheel's derivative averages the torque of slots, float64 (2h + 1,), centred.

    The torque between two slots is taken as the mean of theirs.
    """
    weights = weights_between(wheel)
    return np.convolve(np.concatenate((weights[::-1], weights)), (0.5, 0.5))


def differentiate(speed_rad_s: FloatArray, derivative: Derivative, period_s: float) -> FloatArray:
    """Return dω/dt on the slot grid [rad/s²], float64 (n,); NaN where the stencil meets a missing sample or an end.

    Each slot is the same sum in the same order, so the result does not depend on where a record is cut.
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


def differentiate_over_gaps(speed_rad_s: FloatArray, derivative: Derivative, period_s: float) -> FloatArray:
    """Return dω/dt as `differentiate` does, and also where some of the stencil's samples are missing.

    There it is the slope of the least-squares parabola through the samples that are present, at slots with a sample of
    their own, where its variance is at most `MAX_VARIANCE_RATIO` times that without a gap. No sample is filled in: a
    single lost sample costs one slot, not a whole stencil of them.

    Parameters
    ----------
    speed_rad_s, derivative, period_s
        As for `differentiate`.
    """
    result = differentiate(speed_rad_s, derivative, period_s)
    half = half_width(derivative, period_s)
    if np.isnan(speed_rad_s).any() and result.size > 2 * half:
        kernels.bridge(speed_rad_s, result, half, period_s, MAX_VARIANCE_RATIO)
    return result


def rounding_error(speed_rad_s: FloatArray, motor_torque_Nm: FloatArray, wheel: Wheel) -> FloatArray:
    """Return the error of derived friction where the derivative smooths a bend of the speed.

    The motor's torque steps when a slew begins or ends, and dω/dt with it. The filter's slope does not: it is an
    average of the accelerations over its window, so that K_T·I − J·dω/dt has a pulse as large as half of the step.
    A step of torque that balances a step of friction, at a jump or a reversal, does not bend the speed and causes no
    error. So a slot has an error where two conditions hold: the torque differs from its average with the same weights
    by more than its noise, and within the window the speed bends as that torque, less its mean, bends a free rotor's
    (least squares, together with a straight line). Gradual bends are significant in the parabola through the window's
    torques only. Where friction may jump within a bend, and throughout a bend in a filter of fewer slots than
    `WIDE_HALF` to either side, whose error depends on when between two samples the torque changed, it is not known.

    Parameters
    ----------
    speed_rad_s, motor_torque_Nm
        float64 (n,), consecutive slots, NaN where missing [rad/s, N m].
    wheel
        Gives inertia, sample period, the derivative filter and the unit of torque.

    Returns
    -------
    FloatArray
        float64 (n,) [N m], to be subtracted from `derive_friction`: 0 where no error is found, and where the stencil
        meets an end of the arrays; NaN where the error is not known. Each slot depends on its window alone.

    Raises
    ------
    InputError
        If the wheel has no inertia.
    """
    taps = derivative_taps(wheel.friction.derivative, wheel.sample_period_s)
    half, inertia = taps.size // 2, inertia_of(wheel)
    narrow = half < WIDE_HALF
    error = np.zeros(speed_rad_s.size)
    kernels.rounding_error(
        speed_rad_s,
        motor_torque_Nm,
        weights_between(wheel),
        wheel.sample_period_s / inertia,
        inertia * float(np.sqrt(taps @ taps)),
        LEAST_ERROR * wheel.nominal.dry_torque_Nm if wheel.nominal else np.nan,
        LEAST_ERROR,
        max(half, FEWEST_AROUND),
        NOISE_SLOTS if narrow else half,
        narrow,
        error,
    )
    return error


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


def corrected_friction(
    speed_rad_s: FloatArray,
    motor_torque_Nm: FloatArray,
    wheel: Wheel,
    acceleration_rad_s2: FloatArray | None = None,
) -> FloatArray:
    """Return `derive_friction` less its error where the speed bends, as the monitor uses it.

    Parameters, units and errors are those of `derive_friction`; NaN also where the error is not known. dω/dt may be
    given, float64 (n,) [rad/s²], where it is known over gaps.
    """
    if acceleration_rad_s2 is None:
        acceleration_rad_s2 = differentiate(speed_rad_s, wheel.friction.derivative, wheel.sample_period_s)
    friction = friction_torque(motor_torque_Nm, acceleration_rad_s2, inertia_of(wheel))
    return friction - rounding_error(speed_rad_s, motor_torque_Nm, wheel)


def friction_of(samples: Samples, wheel: Wheel) -> FloatArray:
    """Return the friction torque of a whole table, float64 (n,) [N m], given or derived; then inaccurate around gaps.

    Raises
    ------
    InputError
        If friction is neither given nor can be derived.
    """
    samples = without_motor(samples, wheel)
    source_of(samples, wheel)
    if samples.friction_torque_Nm is not None:
        return samples.friction_torque_Nm
    torque = motor_torque(samples, wheel)
    assert torque is not None, "there is a source"
    return corrected_friction(samples.speed_rad_s, torque, wheel)


def derived_noise_variance(wheel: Wheel, speed_std_rad_s: float, current_std_A: float = 0.0) -> float:
    """Return the variance [N² m²] of the derived friction's noise when speed and current carry white noise.

    Parameters
    ----------
    wheel
        Gives inertia, torque constant, sample period and the derivative filter.
    speed_std_rad_s, current_std_A
        Standard deviations of the white noise of a single speed [rad/s] and current [A] sample.

    Raises
    ------
    InputError
        If the wheel has no inertia, or has current noise but no torque constant.
    """
    taps = inertia_of(wheel) * derivative_taps(wheel.friction.derivative, wheel.sample_period_s)
    variance = speed_std_rad_s**2 * float(np.sum(taps * taps))
    if current_std_A:
        variance += (torque_constant_of(wheel) * current_std_A) ** 2
    return variance


def inertia_of(wheel: Wheel) -> float:
    """Return the wheel's inertia [kg m²]; raises InputError where the wheel file has none."""
    if wheel.inertia_kg_m2 is None:
        raise InputError(f"wheel {wheel.name}", "is missing; friction cannot be derived without it", "inertia_kg_m2")
    return wheel.inertia_kg_m2


def torque_per_ampere(drive: FloatArray, speed_rad_s: FloatArray, wheel: Wheel) -> float | FloatArray:
    """Return the torque at the wheel's axis that an ampere gives [N m/A]: K_T, times the ratio of a gear.

    A gear with an efficiency η transmits the share η of the power: its factor on the motor's torque is η while the
    motor drives the wheel, and 1/η while the wheel drives the motor.

    Parameters
    ----------
    drive, speed_rad_s
        float64 (n,), current [A] or torque of the motor [N m], only its sign is used, and the wheel's speed [rad/s].
    wheel
        Its torque constant and gear.

    Raises
    ------
    InputError
        If the wheel has no torque constant.
    """
    constant = torque_constant_of(wheel)
    if wheel.gear_efficiency is None:
        return constant
    return constant * np.where(drive * speed_rad_s < 0.0, 1.0 / wheel.gear_efficiency, wheel.gear_efficiency)


def torque_constant_of(wheel: Wheel) -> float:
    """Return the torque constant at the wheel's axis [N m/A]; raises InputError where the wheel file has none."""
    if wheel.torque_per_ampere_Nm_A is None:
        raise InputError(
            f"wheel {wheel.name}", "is missing; no torque follows from the current without it", "torque_constant_Nm_A"
        )
    return wheel.torque_per_ampere_Nm_A
