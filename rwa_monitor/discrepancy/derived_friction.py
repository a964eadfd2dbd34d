"""Friction of a record that is derived from current and speed, corrected where the derivative misses dω/dt.

The wheel's filter for dω/dt smooths bends and corners of the speed. A bend is locally a polynomial, fitted to the
neighbouring slots, from which the bias of the filter follows. At a corner no polynomial fits, and friction is unknown.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.ndimage import binary_closing, binary_dilation, correlate1d, maximum_filter, uniform_filter1d

from rwa_monitor.discrepancy.bench import LEAST_HALF
from rwa_monitor.samples import BoolArray, FloatArray, Samples
from rwa_monitor.wheel import torque_balance
from rwa_monitor.wheel.effects.tachometer import ReadZone, quantisation_step
from rwa_monitor.wheel.wheel import Wheel

# Of a step: RMS of the difference of two errors, each uniform over it (Widrow & Kollár, Quantization Noise, 2008).
RMS_OF_TWO_ROUNDINGS: Final = 6**-0.5
BIAS_REACH: Final = 20  # slots beyond the derivative filter that determine its bias, with 17 % of the filter's noise
SHORT_BIAS_REACH: Final = 12  # slots, of a second estimate of the bias
BIAS_STDS: Final = 2.0  # standard deviations of the friction, above which the bias must be known to BIAS_KNOWN_TO
BIAS_KNOWN_TO: Final = 0.05  # of the bias: at a corner of the speed the two estimates differ by more
CORNER: Final = 10.0  # standard deviations of the friction, above which the bias must be known to DISAGREEMENT_SHARE
DISAGREEMENT_SHARE: Final = 0.02  # of the largest bias nearby: on a smooth bend the two estimates differ by less
DISAGREEMENT_STDS: Final = 4.0  # standard deviations of friction between the estimates: one of them includes a corner
CORNER_REACH: Final = 4  # slots on each side of such a corner that are excluded
CORNER_EDGE: Final = 2  # slots on each side of a step of torque in which its pulse may be lost in the noise


@dataclass(frozen=True, slots=True)
class DerivedFriction:
    """Derived friction and its systematic errors.

    Attributes
    ----------
    friction_Nm
        float64 (n,), K_T·I - J·dω/dt [N m], NaN at corners of the speed and where a value is missing.
    corrected
        bool (n,), slots where the correction exceeds the noise, and their neighbours.
    corners
        Number of slots excluded as corners.
    filter_error_Nm
        float64 (n,), to be added to the mean of the friction over the filter's window
        (`torque_balance.averaging_taps`), which is then free of the torque that the filter does not follow [N m].
    """

    friction_Nm: FloatArray
    corrected: BoolArray
    corners: int
    filter_error_Nm: FloatArray


def derived_friction(speed: FloatArray, torque: FloatArray, wheel: Wheel, torque_step: float) -> DerivedFriction:
    """Derive friction from speed and motor torque.

    Parameters
    ----------
    speed, torque
        float64 (n,) on slots [rad/s, N m], NaN where unknown.
    wheel
        Its inertia and derivative filter.
    torque_step
        Quantisation step of the torque [N m], 0 for none.

    Raises
    ------
    InputError
        If the inertia is missing.
    """
    friction = derived = torque_balance.derive_friction(speed, torque, wheel)
    hole = torque_balance.derivative_taps(wheel.friction.derivative, wheel.sample_period_s).size // 2
    inertia = torque_balance.inertia_of(wheel)
    bias = inertia * _derivative_bias(speed, wheel, BIAS_REACH)
    uncertainty = np.abs(bias - inertia * _derivative_bias(speed, wheel, SHORT_BIAS_REACH))
    friction = friction + bias
    sigma = spread_of_differences(friction, 2 * hole + 1, torque_step) / np.sqrt(2.0)
    # The bias at a step of torque is not that of a bend, which a polynomial fits.
    rounding = torque_balance.rounding_error(speed, torque, wheel)
    # The torque that the filter misses. A smooth bend of the speed is one of the torque, too: they miss as much.
    missed = correlate1d(torque, torque_balance.averaging_taps(wheel), mode="constant", cval=np.nan) - torque
    stepped = (rounding != 0.0) & ~(np.abs(bias - missed) < BIAS_STDS * sigma)
    stepped = binary_dilation(stepped, iterations=CORNER_EDGE)
    # A polynomial whose slots include a corner adds a spurious bend around it: its correction is undone.
    around = hole + BIAS_REACH
    beside = np.where(stepped | np.isnan(missed), 0.0, bias)
    of_torque, of_speed = (uniform_filter1d(np.nan_to_num(one) * beside, 2 * around + 1) for one in (missed, beside))
    spurious = binary_dilation(stepped, iterations=around) & (of_torque < 0.5 * of_speed)
    spurious &= np.abs(bias) < BIAS_STDS * sigma
    friction[spurious] -= bias[spurious]
    unknown = (np.abs(bias) > BIAS_STDS * sigma) & (uncertainty > BIAS_KNOWN_TO * np.abs(bias))
    # The two estimates may agree by chance in the middle of a corner, but not everywhere around it.
    largest, most_uncertain = (maximum_filter(np.abs(values), 2 * hole + 1) for values in (bias, uncertainty))
    corner = (np.abs(bias) > CORNER * sigma) & (most_uncertain > DISAGREEMENT_SHARE * largest)
    corner |= (uncertainty > DISAGREEMENT_STDS * sigma) & (uncertainty > DISAGREEMENT_SHARE * largest)
    hidden = unknown | stepped | binary_dilation(corner, iterations=CORNER_REACH)
    hidden |= binary_closing(hidden)  # one or two samples between: the bias changes its sign, and is small by chance
    # A step of torque in the first or last samples has no slots beyond it from which to detect it.
    at = np.flatnonzero(np.isfinite(friction))
    if at.size > 2 * hole:
        for ends, inner in ((at[:hole], at[hole]), (at[-hole:], at[-hole - 1])):
            hidden[ends] |= np.abs(friction[ends] - friction[inner]) > CORNER * sigma
    corners = int(np.count_nonzero(hidden & np.isfinite(friction)))
    friction[hidden] = np.nan
    corrected = binary_dilation(np.abs(bias) > sigma, iterations=CORNER_REACH)
    # The filter averages dω/dt over its window: with the torque averaged alike, both refer to the same interval.
    averaged = correlate1d(torque - friction, torque_balance.averaging_taps(wheel), mode="constant", cval=np.nan)
    return DerivedFriction(friction, corrected, corners, averaged - (torque - derived))


def _derivative_bias(speed: FloatArray, wheel: Wheel, reach: int) -> FloatArray:
    """Return the bias of the wheel's derivative filter where dω/dt changes [rad/s²].

    A least-squares parabola smooths the acceleration of a fast slew: friction derived with it is biased by several
    standard deviations while the acceleration rises and falls. The bias is that of an odd polynomial of fifth order
    fitted to `reach` slots just outside the filter on each side, which share no noise with it; 0 near a gap or an end.
    """
    return np.nan_to_num(correlate1d(speed, _bias_taps(wheel, reach), mode="constant", cval=np.nan))


def speed_noise_taps(wheel: Wheel) -> FloatArray:
    """Return the centred filter [1/s] by which noise of the speed enters derived friction: slope plus correction."""
    taps = torque_balance.derivative_taps(wheel.friction.derivative, wheel.sample_period_s)
    return np.pad(taps, BIAS_REACH) - _bias_taps(wheel, BIAS_REACH)


def _bias_taps(wheel: Wheel, reach: int) -> FloatArray:
    """Return the centred odd filter of `_derivative_bias` [1/s]; zero within the derivative's own filter."""
    taps = torque_balance.derivative_taps(wheel.friction.derivative, wheel.sample_period_s)
    half = taps.size // 2
    j = np.arange(half + 1, half + reach + 1)
    span = float(j[-1])
    odd = np.stack([(j / span) ** power for power in (1, 3, 5)], axis=1)
    inner = np.arange(-half, half + 1) / span
    missed = np.array([float(taps @ inner**power) for power in (1, 3, 5)])
    missed[0] -= 1 / (span * wheel.sample_period_s)
    outer = missed @ np.linalg.pinv(odd) / 2
    return np.concatenate([-outer[::-1], np.zeros(2 * half + 1), outer])


def spread_of_differences(values: FloatArray, lag: int, step: float) -> float:
    """Return the standard deviation of the noise in differences, from their median; infinite where none is known.

    With quantised readings most differences are zero or one step: the result is at least that of two rounding errors.

    Parameters
    ----------
    values
        float64 (n,), NaN where unknown.
    lag
        Slots that the differences are taken over.
    step
        Quantisation step of the values, 0 for none.
    """
    differences = values[lag:] - values[:-lag]
    known = np.abs(differences[np.isfinite(differences)])
    return max(float(np.median(known)) / 0.6745, step * RMS_OF_TWO_ROUNDINGS) if known.size else np.inf


# ---- quantisation steps of the torque that friction comes from, by an analogue-to-digital converter ------------------


FEWEST_LEVELS: Final = 3  # distinct readings from which a step can be estimated


@dataclass(frozen=True, slots=True)
class Steps:
    """Quantisation steps of a channel: its name, the step in its own unit, and the equivalent torque [N m]."""

    channel: str
    size: float
    unit: str
    torque_Nm: float


def steps_of(samples: Samples, wheel: Wheel, name: torque_balance.Source) -> Steps | None:
    """Return the steps of the channel `name` that friction comes from; None where its readings are not quantised.

    A table written with seven digits is quantised too: the caller must check whether a step has any consequence.
    """
    values: FloatArray = getattr(samples, name)
    readings = np.unique(values[np.isfinite(values)])
    if readings.size < FEWEST_LEVELS or 2 * readings.size >= values.size:  # or the steps are finer than the noise
        return None
    # A converter may have an offset: only differences of readings lie on the grid.
    step = quantisation_step(readings - readings[0])
    if step is None:
        return None
    if name == "motor_current_A":
        return Steps("current", step, "A", step * (wheel.torque_per_ampere_Nm_A or 0.0))
    return Steps("friction" if name == "friction_torque_Nm" else "motor torque", step, "N m", step)


# ---- the window over which dω/dt is estimated ------------------------------------------------------------------------


WINDOWS: Final = 12  # widths that are tried, in geometric progression


@dataclass(frozen=True, slots=True)
class Motion:
    """The measured channels of a record on its slots, float64 (n,): speed [rad/s], motor torque and friction [N m].

    The torque is None where it is not measured, friction where it is to be derived. `steps` are those of the channel
    that friction comes from. In the dead `zone` of its readings the speed is unknown (NaN), and a torque that reads
    zero where `least_torque_Nm` is the smallest that is reported.
    """

    speed_rad_s: FloatArray
    torque_Nm: FloatArray | None
    friction_Nm: FloatArray | None
    steps: Steps | None = None
    zone: ReadZone | None = None
    least_torque_Nm: float | None = None

    @property
    def torque_step_Nm(self) -> float:
        """Return the quantisation step of the torque that friction comes from [N m], 0 where there is none."""
        return 0.0 if self.steps is None else self.steps.torque_Nm


def with_fitting_window(motions: Sequence[Motion], wheel: Wheel) -> Wheel:
    """Return the wheel with the widest window for dω/dt, up to its own, whose smoothing error is negligible.

    A window smooths the acceleration and, averaged alike, the motor's torque. The two losses have independent noise, so
    that the mean of their product estimates the squared error. The rest of the slope's variance is noise of the speed,
    which falls with Σ j² over the window (see `torque_balance.derivative_taps`). The widest window is taken whose sum
    of both exceeds the least sum by no more than the noise of the torque, or a small part of the friction, squared.
    """
    period_s, most = wheel.sample_period_s, torque_balance.half_width(wheel.friction.derivative, wheel.sample_period_s)
    derived = [motion for motion in motions if motion.torque_Nm is not None and motion.friction_Nm is None]
    if most <= LEAST_HALF or not derived:
        return wheel
    halves = np.unique(np.rint(np.geomspace(LEAST_HALF, most, WINDOWS)))
    wheels = [*(torque_balance.with_window(wheel, 2.0 * half * period_s) for half in halves[:-1].tolist()), wheel]
    missed = np.concatenate([_squared_errors(motion, wheels) for motion in derived], axis=1)
    if not missed.size:
        return wheel
    *square, spread, harmless = missed.mean(axis=1)
    narrow = halves * (halves + 1.0) * (2.0 * halves + 1.0)
    risk = np.maximum(square, 0.0) + max(spread - square[-1], 0.0) * narrow[0] / narrow
    return wheels[int(np.flatnonzero(risk <= risk.min() + harmless)[-1])]


def _squared_errors(motion: Motion, wheels: Sequence[Wheel]) -> FloatArray:
    """Return the squared error of each window, the squared change of the widest window's slope, the negligible square.

    float64 (windows + 2, n) at the slots where all are known [N² m²], relative to the first window.
    """
    assert motion.torque_Nm is not None
    torque = motion.torque_Nm
    friction = np.stack([torque_balance.derive_friction(motion.speed_rad_s, torque, wheel) for wheel in wheels])
    kernels = (torque_balance.averaging_taps(wheel) for wheel in wheels)
    averaged = np.stack([correlate1d(torque, taps, mode="constant", cval=np.nan) for taps in kernels])
    slope, motor = friction - friction[0], averaged[0] - averaged
    known = np.isfinite(slope * motor).all(axis=0)
    noise = spread_of_differences(np.diff(torque), 1, motion.torque_step_Nm) / np.sqrt(6.0)  # of 1, -2, 1
    size = float(np.median(np.abs((averaged[-1] - torque + friction[-1])[known]))) if known.any() else 0.0
    harmless = np.full(known.size, max(noise, torque_balance.LEAST_ERROR * size) ** 2)
    return np.vstack([slope * motor, slope[-1] ** 2, harmless])[:, known]
