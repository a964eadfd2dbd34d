"""Friction of a record that is derived from current and speed, corrected where the derivative misses dω/dt.

The wheel's filter for dω/dt rounds off what bends and what has a corner. A bend is a polynomial, whose neighbours give
by how much the filter is off; a corner is none, and friction is not known there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.ndimage import binary_dilation, correlate1d, maximum_filter

from rwa_monitor.discrepancy.bench import LEAST_HALF
from rwa_monitor.samples import BoolArray, FloatArray, Samples
from rwa_monitor.wheel import torque_balance
from rwa_monitor.wheel.effects.tachometer import ReadZone, quantisation_step
from rwa_monitor.wheel.wheel import Wheel

# Of a step: of the difference of two errors, each uniform over it (Widrow & Kollár, Quantization Noise, 2008).
RMS_OF_TWO_ROUNDINGS: Final = 6**-0.5
BIAS_REACH: Final = 20  # slots beyond the derivative filter that determine its bias, at 17 % of the filter's noise
SHORT_BIAS_REACH: Final = 12  # slots, of a second opinion
BENT: Final = 2.0  # standard deviations of the friction from which the bias must be known well
BIAS_KNOWN_TO: Final = 0.05  # of the bias: at a corner of the speed no polynomial agrees with the next
CORNER: Final = 10.0  # standard deviations of the friction from which a bias must be known to AGREED_TO around it
AGREED_TO: Final = 0.02  # of the largest bias around: so well do polynomials agree on a smooth bend
UNCERTAIN: Final = 4.0  # standard deviations of the friction between two estimates: one of them has a corner
CORNER_REACH: Final = 4  # slots on each side of such a corner
CORNER_EDGE: Final = 2  # slots on each side of a step of torque in which its pulse may be lost in the noise
# Half-width of a filter for dω/dt from which corners are seen whole; and what is no corner, like a ripple of the
# torque, is too often taken for one to mask more than it, or to leave the bends around it [slots].
WIDE_HALF: Final = 8
CORNER_WINDOWS: Final = 3  # derivative windows in which the speed must bend as a step of torque bends it


@dataclass(frozen=True, slots=True)
class DerivedFriction:
    """Friction that was derived, and how far it can be believed.

    Attributes
    ----------
    friction_Nm
        float64 (n,), K_T·I - J·dω/dt [N m], NaN at corners of the speed and where a value is missing.
    bent
        bool (n,), where the correction is more than the noise.
    corners
        How many slots are left out as corners.
    unfollowed_Nm
        float64 (n,), what a mean of the friction over the filter's window (`torque_balance.averaging_taps`) lacks to be
        free of the torque that the filter does not follow [N m].
    """

    friction_Nm: FloatArray
    bent: BoolArray
    corners: int
    unfollowed_Nm: FloatArray


def derived_friction(speed: FloatArray, torque: FloatArray, wheel: Wheel, torque_step: float) -> DerivedFriction:
    """Derive friction from speed and motor torque.

    Parameters
    ----------
    speed, torque
        float64 (n,) on slots [rad/s, N m], NaN where unknown.
    wheel
        Its inertia and derivative filter.
    torque_step
        Step in which the torque was read [N m], 0 for none.

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
    # What a step of torque makes of it is no bend that a polynomial follows.
    rounding = torque_balance.rounding_error(speed, torque, wheel, CORNER_WINDOWS, soft=False)
    known = np.abs(friction[np.isfinite(friction)])
    typical = wheel.nominal.dry_torque_Nm if wheel.nominal else float(np.median(known)) if known.size else 0.0
    agreed = np.abs(rounding + bias) <= max(sigma, torque_balance.LEAST_ERROR * typical)
    stepped = (rounding != 0.0) & ~agreed
    if hole < WIDE_HALF:
        stepped = binary_dilation(stepped, iterations=CORNER_EDGE)
        # Where a polynomial reaches a corner it draws a bend around it that is not there.
        smeared = binary_dilation(stepped, iterations=hole + BIAS_REACH) & (np.abs(bias) < BENT * sigma)
        friction[smeared] -= bias[smeared]
    unknown = (np.abs(bias) > BENT * sigma) & (uncertainty > BIAS_KNOWN_TO * np.abs(bias))
    # Opinions may agree by chance in the middle of a corner, but not all around it.
    largest, most_uncertain = (maximum_filter(np.abs(values), 2 * hole + 1) for values in (bias, uncertainty))
    corner = (np.abs(bias) > CORNER * sigma) & (most_uncertain > AGREED_TO * largest)
    corner |= (uncertainty > UNCERTAIN * sigma) & (uncertainty > AGREED_TO * largest)
    hidden = unknown | stepped | binary_dilation(corner, iterations=CORNER_REACH)
    # A step of torque in the first or last sample is seen by no slot outside of it.
    at = np.flatnonzero(np.isfinite(friction))
    if at.size > 2 * hole:
        for ends, inner in ((at[:hole], at[hole]), (at[-hole:], at[-hole - 1])):
            hidden[ends] |= np.abs(friction[ends] - friction[inner]) > CORNER * sigma
    corners = int(np.count_nonzero(hidden & np.isfinite(friction)))
    friction[hidden] = np.nan
    bent = binary_dilation(np.abs(bias) > sigma, iterations=CORNER_REACH)
    # The filter averages dω/dt over its window: where the torque is averaged alike, they belong together.
    averaged = correlate1d(torque - friction, torque_balance.averaging_taps(wheel), mode="constant", cval=np.nan)
    return DerivedFriction(friction, bent, corners, averaged - (torque - derived))


def _derivative_bias(speed: FloatArray, wheel: Wheel, reach: int) -> FloatArray:
    """Return by how much the wheel's derivative filter misses dω/dt where that bends [rad/s²].

    A least-squares parabola smooths the acceleration of a fast slew: friction derived with it is off by several
    standard deviations while the acceleration rises and falls. An odd polynomial of fifth order through `reach` slots
    just outside the filter, which share no noise with it, gives by how much; 0 where it meets a gap or an end.
    """
    return np.nan_to_num(correlate1d(speed, _bias_taps(wheel, reach), mode="constant", cval=np.nan))


def speed_noise_taps(wheel: Wheel) -> FloatArray:
    """Return the filter [1/s], centred, with which noise of the speed enters derived friction: slope and correction."""
    taps = torque_balance.derivative_taps(wheel.friction.derivative, wheel.sample_period_s)
    return np.pad(taps, BIAS_REACH) - _bias_taps(wheel, BIAS_REACH)


def _bias_taps(wheel: Wheel, reach: int) -> FloatArray:
    """Return the odd filter of `_derivative_bias` [1/s], centred; zero where the derivative's own filter reaches."""
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

    With quantised readings most differences are nothing, or one step: it is no less than that of two rounding errors.

    Parameters
    ----------
    values
        float64 (n,), NaN where unknown.
    lag
        Slots that the differences are taken over.
    step
        In which the values were read, 0 for none.
    """
    differences = values[lag:] - values[:-lag]
    known = np.abs(differences[np.isfinite(differences)])
    return max(float(np.median(known)) / 0.6745, step * RMS_OF_TWO_ROUNDINGS) if known.size else np.inf


# ---- steps in which the torque was read that friction comes from: quantisation by an analogue-to-digital converter ---


FEWEST_LEVELS: Final = 3  # readings, all different, of which a step can be estimated
MOST_LEVELS: Final = 0.5  # of the samples: where so many readings differ, steps are finer than the noise


@dataclass(frozen=True, slots=True)
class Steps:
    """Steps of a channel: its name in words, the step in its own unit, and what that is of torque [N m]."""

    channel: str
    size: float
    unit: str
    torque_Nm: float


def steps_of(samples: Samples, wheel: Wheel, name: torque_balance.Source) -> Steps | None:
    """Return the steps of the channel `name` that friction comes from; None where its readings are not quantised.

    A table written with seven digits is quantised too: whether a step is of any consequence is for the caller to
    see.
    """
    values: FloatArray = getattr(samples, name)
    readings = np.unique(values[np.isfinite(values)])
    if not FEWEST_LEVELS <= readings.size < MOST_LEVELS * values.size:
        return None
    # A converter's zero need not be zero: differences are on the grid.
    step = quantisation_step(readings - readings[0])
    if step is None:
        return None
    if name == "motor_current_A":
        return Steps("current", step, "A", step * (wheel.torque_per_ampere_Nm_A or 0.0))
    return Steps("friction" if name == "friction_torque_Nm" else "motor torque", step, "N m", step)


# ---- the window that dω/dt is estimated over -------------------------------------------------------------------------


WINDOWS: Final = 12  # that are tried, each the same factor wider


@dataclass(frozen=True, slots=True)
class Motion:
    """What is measured of a record on its slots, float64 (n,): speed [rad/s], motor torque and friction [N m].

    The torque is None where it is not measured, friction where it is to be derived; `steps` are those of the channel
    that friction comes from. In the `zone` where its reading rests the speed is not known.
    """

    speed_rad_s: FloatArray
    torque_Nm: FloatArray | None
    friction_Nm: FloatArray | None
    steps: Steps | None = None
    zone: ReadZone | None = None

    @property
    def torque_step_Nm(self) -> float:
        """Return the step in which the torque was read that friction comes from [N m], 0 where there is none."""
        return 0.0 if self.steps is None else self.steps.torque_Nm


def with_fitting_window(motions: Sequence[Motion], wheel: Wheel) -> Wheel:
    """Return the wheel with the widest window for dω/dt, up to its own, whose error is not seen beside other errors.

    What a window averages away of the acceleration it averages away of the motor's torque, too, and the two have noises
    of their own: the mean product of both is the square of the error. What else the slope varies by is noise of the
    speed, which falls with Σ j² over the window (see `torque_balance.derivative_taps`). No harm is what the noise of
    the torque hides, or a small part of the friction.
    """
    period_s, most = wheel.sample_period_s, torque_balance.half_width(wheel.friction.derivative, wheel.sample_period_s)
    derived = [motion for motion in motions if motion.torque_Nm is not None and motion.friction_Nm is None]
    if most <= LEAST_HALF or not derived:
        return wheel
    halves = np.unique(np.rint(np.geomspace(LEAST_HALF, most, WINDOWS)))
    wheels = [*(torque_balance.with_window(wheel, 2.0 * half * period_s) for half in halves[:-1].tolist()), wheel]
    missed = [_missed(motion, wheels) for motion in derived]
    error, spread, harmless = (np.concatenate(parts, axis=-1) for parts in zip(*missed, strict=True))
    if not harmless.size:
        return wheel
    square, narrow = error.mean(axis=1), halves * (halves + 1.0) * (2.0 * halves + 1.0)
    noise = max(float(spread.mean() - square[-1]), 0.0) * narrow[0] / narrow
    risk = np.maximum(square, 0.0) + noise
    return wheels[int(np.flatnonzero(risk <= risk.min() + harmless.mean())[-1])]


def _missed(motion: Motion, wheels: Sequence[Wheel]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the square of what each window averages away, of the widest one's slope alone, and of what is no harm.

    float64 (windows, n), (n,) and (n,) at the slots where all are known [N² m²], against the first window.
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
    harmless = np.full(np.count_nonzero(known), max(noise, torque_balance.LEAST_ERROR * size) ** 2)
    return (slope * motor)[:, known], slope[-1, known] ** 2, harmless
