"""The torque balance of the rotor, and the friction derived from it: the one place that knows the sign.

J·dω/dt = K_T·I − friction. Friction is the *resisting* torque: positive when it opposes positive rotation (errata 1).
A plain difference of a real tachometer is useless (errata 17), so dω/dt comes from a Savitzky-Golay filter; the noise
that it leaves is coloured, and the later stages get its autocovariance from here.
"""

from __future__ import annotations

from typing import Final

import numba
import numpy as np

from rwa_monitor.errors import InputError
from rwa_monitor.physics.wheel import Derivative, Wheel
from rwa_monitor.samples import FloatArray

MAX_HALF_WIDTH: Final = (
    5_000  # slots; a wider derivative is a wrong window_s, and would see nothing of a wheel's motion
)
MAX_VARIANCE_RATIO: Final = 2.0  # of a slope over a gap to one without a gap
LEAST_ERROR: Final = 0.02  # of the nominal dry friction, or of friction itself: half of a usual noise; less is no harm
DOUBT_STDS: Final = 1.0  # of derived friction's noise: an error that is known to this much can be taken out
OVER_NOISE: Final = 4.0  # standard deviations of the torque's own noise, or of derived friction's: less is noise
FEWEST_DIFFERENCES: Final = 5  # of the torque, that tell its noise
IN_A_STEP: Final = 4  # fourth differences that a step of the torque is in
MANY_DIFFERENCES: Final = 13  # so many that those hardly move the median: a window of 17 slots
MOVES_THE_ROTOR: Final = 0.5  # share of a step of torque that must be seen in the speed: between none and all
CLEAR_STDS: Final = 3.0  # by which that share must be above none: one slot in a thousand of a noisy current


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


def differentiate_over_gaps(speed_rad_s: FloatArray, derivative: Derivative, period_s: float) -> FloatArray:
    """Return dω/dt as `differentiate` does, and also where some of the stencil's samples are missing.

    There it is the slope of the least-squares parabola through those samples that are left, at slots with a sample of
    their own, as long as that has at most `MAX_VARIANCE_RATIO` times the variance. Nothing is filled in: a single lost
    sample costs one slot, not a whole stencil of them.

    Parameters
    ----------
    speed_rad_s, derivative, period_s
        As for `differentiate`.
    """
    result = differentiate(speed_rad_s, derivative, period_s)
    half = half_width(derivative, period_s)
    if np.isnan(speed_rad_s).any() and result.size > 2 * half:
        _bridge(speed_rad_s, result, half, period_s)
    return result


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _bridge(speed: FloatArray, result: FloatArray, half: int, period_s: float) -> None:
    """Fill in `result` where the parabola through the samples that are left determines the slope well enough."""
    full = half * (half + 1) * (2 * half + 1) / 3.0  # Σ j² of a whole stencil: one over the slope's variance
    for k in range(half, speed.size - half):
        if not np.isnan(result[k]) or np.isnan(speed[k]):
            continue
        n, s1, s2, s3, s4 = 0.0, 0.0, 0.0, 0.0, 0.0
        y, jy, jjy = 0.0, 0.0, 0.0
        for j in range(-half, half + 1):
            value = speed[k + j] - speed[k]
            if not np.isnan(value):
                n, s1, s2, s3, s4 = n + 1.0, s1 + j, s2 + j * j, s3 + j**3, s4 + j**4
                y, jy, jjy = y + value, jy + j * value, jjy + j * j * value
        # Second row of the inverse of the normal equations of y = a + b·j + c·j².
        determinant = n * (s2 * s4 - s3 * s3) - s1 * (s1 * s4 - s2 * s3) + s2 * (s1 * s3 - s2 * s2)
        variance = n * s4 - s2 * s2
        if n > 2.0 and variance * full <= MAX_VARIANCE_RATIO * determinant:
            slope = ((s2 * s3 - s1 * s4) * y + variance * jy + (s1 * s2 - n * s3) * jjy) / determinant
            result[k] = slope / period_s


def rounding_error(
    speed_rad_s: FloatArray, motor_torque_Nm: FloatArray, wheel: Wheel, windows: int = 1, *, soft: bool = True
) -> FloatArray:
    """Return by how much derived friction is wrong where the derivative rounds off a bend of the speed.

    The motor's torque steps when a slew begins or ends, and dω/dt with it. The filter's slope does not: it is an
    average of the accelerations over its window, so that K_T·I − J·dω/dt shows a pulse as large as half of the step.
    A step of torque that friction asks for, at a jump or at a reversal, leaves the speed straight, and does no harm.
    So a slot is told by two things: the torque there is not what the same average makes of the torque, by more than its
    noise, and within the window the speed does bend as that torque, less its mean, bends a free rotor (least squares
    beside a straight line).

    Parameters
    ----------
    speed_rad_s, motor_torque_Nm
        float64 (n,), consecutive slots, NaN where missing [rad/s, N m].
    wheel
        Gives inertia, sample period, the derivative filter and the unit of torque.
    windows
        How many times as wide as the filter's the window is in which the speed must bend: noise in the speed hides
        steps of the torque in a narrow one.
    soft
        Whether bends count that no single torque shows, but the parabola through those of the window does, and what may
        be a jump of the friction in such a bend is not known. The search, which sees the whole record, asks polynomials
        over longer windows instead.

    Returns
    -------
    FloatArray
        float64 (n,) [N m], to be subtracted from `derive_friction`: 0 where that is right, and where the stencil meets
        an end of the arrays; NaN where it is wrong by nobody knows how much. Each slot depends on its window alone.

    Raises
    ------
    InputError
        If the wheel has no inertia.
    """
    period_s = wheel.sample_period_s
    taps = derivative_taps(wheel.friction.derivative, period_s)
    half = taps.size // 2
    # Σ c_j ω_{k+j} = Σ_i W_i a_{k+i+½}: what lies between slots i and i + 1 counts in each tap beyond it.
    weights = period_s * np.cumsum(taps[:half:-1])[::-1]
    error = np.zeros(speed_rad_s.size)
    _rounding_error(
        speed_rad_s,
        motor_torque_Nm,
        weights,
        period_s / inertia_of(wheel),
        inertia_of(wheel) * float(np.sqrt(taps @ taps)),
        LEAST_ERROR * wheel.nominal.dry_torque_Nm if wheel.nominal else np.nan,
        windows * half,
        soft,
        error,
    )
    return error


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _rounding_error(
    speed: FloatArray,
    torque: FloatArray,
    weights: FloatArray,
    per_torque: float,
    noise_gain: float,
    least: float,
    reach: int,
    soft: bool,
    error: FloatArray,
) -> None:
    """Set `error`; `per_torque` is the change of speed in a slot, `noise_gain` that of noise from speed to friction.

    `least` is NaN where the wheel's nominal friction is not known.
    """
    half = weights.size
    bend = np.zeros(2 * reach + 1)  # the speed that the torque alone would give, from the slot on [rad/s]
    for k in range(half, speed.size - half):
        if np.isnan(torque[k]) or np.isnan(speed[k]):
            continue
        off, slope = 0.0, 0.0  # the torque less its average, by trapezoids; its mean step from slot to slot
        for i in range(half):
            far, near = torque[k + i + 1] + torque[k - i - 1], torque[k + i] + torque[k - i]
            steps = torque[k + i + 1] - torque[k + i] + torque[k - i] - torque[k - i - 1]
            if not np.isnan(steps):
                off += weights[i] * (2.0 * torque[k] - 0.5 * (far + near))
                slope += weights[i] * steps
        # Where between its two samples a step of torque acts, nobody says: half a slot to either side.
        doubt = 0.0
        for i in range(half):
            right, left = torque[k + i + 1] - torque[k + i], torque[k - i] - torque[k - i - 1]
            if not np.isnan(right + left):
                doubt = max(doubt, 0.5 * weights[i] * max(abs(right - slope), abs(left - slope)))
        if np.isnan(least):
            slope_there = _share_of(bend[: 2 * half + 1], speed[k - half : k + half + 1])[3]
            enough = LEAST_ERROR * abs(torque[k] - off - slope_there / per_torque)
        else:
            enough = least
        if abs(off) + doubt <= enough:
            continue
        noise = _noise_of(torque[k - half : k + half + 1])
        sudden = abs(off) > OVER_NOISE * noise
        if not (sudden or soft):
            continue
        if not sudden:
            # A bend as long as the window shows in a parabola through the torque long before it shows in one sample.
            off, doubt = _error_of_parabola(torque[k - half : k + half + 1], weights)
            if abs(off) <= max(enough, OVER_NOISE * doubt):
                continue
        aside = min(reach, k, speed.size - 1 - k)
        bend[aside] = 0.0
        for i in range(aside):
            right = 0.5 * (torque[k + i] + torque[k + i + 1]) - torque[k]
            left = 0.5 * (torque[k - i] + torque[k - i - 1]) - torque[k]
            bend[aside + i + 1] = bend[aside + i] + (0.0 if np.isnan(right) else per_torque * right)
            bend[aside - i - 1] = bend[aside - i] - (0.0 if np.isnan(left) else per_torque * left)
        share, std, left_over, _ = _share_of(bend[: 2 * aside + 1], speed[k - aside : k + aside + 1])
        if share <= max(MOVES_THE_ROTOR, CLEAR_STDS * std):
            continue
        known = doubt <= max(enough, DOUBT_STDS * noise_gain * left_over)
        if soft and known and abs(off) > OVER_NOISE * max(noise, noise_gain * left_over):
            # Friction may jump while the torque bends smoothly. The speed follows the bend and not the jump: it shows
            # which of both is sudden by what no cubic takes up, the speed under a torque that is a parabola.
            share, std = _share_beside_cubic(bend[: 2 * aside + 1], speed[k - aside : k + aside + 1])
            known = share > max(MOVES_THE_ROTOR, CLEAR_STDS * std)
        error[k] = off if known else np.nan


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _noise_of(torque: FloatArray) -> float:
    """Return the noise of a torque from the median of its fourth differences: a step, or a bend, hardly moves it.

    In a narrow window a step is in as many of them as not: those over the largest step are left out there.
    """
    differences = np.empty(torque.size)
    narrow = torque.size - IN_A_STEP < MANY_DIFFERENCES
    largest, at = -1.0, -1
    if narrow:
        for i in range(torque.size - 1):
            step = abs(torque[i + 1] - torque[i])
            if step > largest:
                largest, at = step, i
    count, known = 0, 0
    for i in range(torque.size - 4):
        outer, inner = torque[i + 4] + torque[i], torque[i + 3] + torque[i + 1]
        difference = abs(outer - 4.0 * inner + 6.0 * torque[i + 2])
        if not np.isnan(difference):
            known += 1
            if not (narrow and i <= at < i + IN_A_STEP):
                differences[count] = difference
                count += 1
    # The variance of a fourth difference is 70σ²; the median of |N(0, 1)| is 0.6745.
    enough = known >= FEWEST_DIFFERENCES and count > 0
    return np.median(differences[:count]) / (0.6745 * np.sqrt(70.0)) if enough else 0.0


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _error_of_parabola(torque: FloatArray, weights: FloatArray) -> tuple[float, float]:
    """Return the error that the least-squares parabola through a torque makes, and its std; zeros where some is NaN.

    Of a torque c·j² at slot j the filter's average is c·Σ W_i·(i² + (i + 1)²), and its value is 0.
    """
    half, n = weights.size, torque.size
    mean_square = half * (half + 1) / 3.0  # of j
    level, slope, curvature, squares, spread, average = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(-half, half + 1):
        value, off_mean = torque[half + j] - torque[half], j * j - mean_square
        level, slope, curvature = level + value, slope + j * value, curvature + off_mean * value
        squares, spread = squares + value * value, spread + off_mean * off_mean
    for i in range(half):
        average += weights[i] * (i * i + (i + 1) * (i + 1))
    if np.isnan(curvature) or n < 5:
        return 0.0, 0.0
    left = squares - level * level / n - slope * slope / (n * mean_square) - curvature * curvature / spread
    return -average * curvature / spread, average * np.sqrt(max(left, 0.0) / (n - 3.0) / spread)


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _share_of(shape: FloatArray, speed: FloatArray) -> tuple[float, float, float, float]:
    """Return how much of a shape a speed holds beside a line, its std, that of what is left, and the line's slope."""
    middle = shape.size // 2
    n, j1, j2, s0, s1, v0, v1 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(shape.size):
        value = speed[i] - speed[middle]
        if not np.isnan(value):
            j = float(i - middle)
            n, j1, j2 = n + 1.0, j1 + j, j2 + j * j
            s0, s1 = s0 + shape[i], s1 + j * shape[i]
            v0, v1 = v0 + value, v1 + j * value
    determinant = n * j2 - j1 * j1
    if n < 4.0 or determinant <= 0.0:
        return 0.0, np.inf, 0.0, 0.0
    shape_slope, shape_level = (n * s1 - j1 * s0) / determinant, (j2 * s0 - j1 * s1) / determinant
    slope, level = (n * v1 - j1 * v0) / determinant, (j2 * v0 - j1 * v1) / determinant
    cross, energy, total = 0.0, 0.0, 0.0
    for i in range(shape.size):
        value = speed[i] - speed[middle]
        if not np.isnan(value):
            j = float(i - middle)
            bent, beside = shape[i] - shape_level - shape_slope * j, value - level - slope * j
            cross, energy, total = cross + bent * beside, energy + bent * bent, total + beside * beside
    if energy <= 0.0:
        return 0.0, np.inf, 0.0, slope
    left_over = np.sqrt(max(total - cross * cross / energy, 0.0) / (n - 3.0))
    return cross / energy, left_over / np.sqrt(energy), left_over, slope


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _share_beside_cubic(shape: FloatArray, speed: FloatArray) -> tuple[float, float]:
    """Return how much of a shape a speed holds beside a cubic, and its std."""
    there = np.flatnonzero(~np.isnan(speed))
    if there.size < 6:
        return 0.0, np.inf
    bent, beside = shape[there], speed[there] - speed[there[0]]
    place = (there - 0.5 * (shape.size - 1)) / shape.size
    powers = np.ones((4, there.size))
    for degree in range(4):
        powers[degree] = place**degree
        for lower in range(degree):
            powers[degree] -= (powers[lower] @ powers[degree]) * powers[lower]
        powers[degree] /= np.sqrt(powers[degree] @ powers[degree])
        bent = bent - (powers[degree] @ bent) * powers[degree]
        beside = beside - (powers[degree] @ beside) * powers[degree]
    energy = bent @ bent
    if energy <= 0.0:
        return 0.0, np.inf
    share = (bent @ beside) / energy
    left = beside - share * bent
    return share, np.sqrt((left @ left) / (there.size - 5) / energy)


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


def mended_friction(speed_rad_s: FloatArray, motor_torque_Nm: FloatArray, wheel: Wheel) -> FloatArray:
    """Return what `derive_friction` does, less its error where the speed bends: as the monitor sees it.

    Parameters, units and errors are those of `derive_friction`; NaN also where the error is not known.
    """
    friction = derive_friction(speed_rad_s, motor_torque_Nm, wheel)
    return friction - rounding_error(speed_rad_s, motor_torque_Nm, wheel)


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
