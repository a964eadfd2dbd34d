"""Prepare recordings of test benches for the search: the motor may be off, and the clock may be uneven.

Where friction is given, or the motor is off and friction is -J dω/dt alone, every row keeps its value. The slots are
made so short that each row has its own, and the slots between stay empty. Interpolated friction would have
autocorrelated noise whose variance depends on the spacing of the rows, and the search would report both. Speed and
torque are interpolated only where friction is derived from a motor torque, as the filter for dω/dt needs neighbours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, Final

import numpy as np
from scipy.ndimage import median_filter

from rwa_monitor.errors import InputError
from rwa_monitor.samples import NANOSECONDS_PER_SECOND, TABLE_CHANNELS, FloatArray, IntArray, Samples
from rwa_monitor.wheel.effects.base import Channels, MeanEffect
from rwa_monitor.wheel.effects.torque_ripple import TorqueRipple
from rwa_monitor.wheel.torque_balance import FRICTION_CHANNELS, friction_torque, inertia_of, with_window, without_motor
from rwa_monitor.wheel.wheel import Wheel
from rwa_monitor.words import counted

OFF_A_STEP: Final = 0.05  # median steps off the nearest whole multiple: from here on the step is uneven
UNEVEN_SHARE: Final = 0.1  # of the steps, above which a clock is uneven; fewer are single late samples
FINEST: Final = 8  # slots in a median step; of closer rows that share a slot only the first is used
NEAR_PERIOD: Final = (0.8, 1.25)  # median step over the wheel's period, between which that period is kept
SEGMENT_SHARE: Final = 0.5  # of the longest segment without a lost sample: the longest window for dω/dt
LOST: Final = 1.5  # median steps, above which a sample is lost
WINDOW_SHARE: Final = 0.1  # of the recording: the longest window for dω/dt
LEAST_HALF: Final = 2  # rows on each side from which dω/dt is estimated, at least
MOST_HALF: Final = 200  # rows on each side, at most
LONGEST_BRIDGE: Final = 4.0  # median steps between two rows over which values are interpolated
MAX_GAP_FACTOR: Final = 4  # steps per sample where friction is derived: a longer gap leaves no slope of the speed
SPARSEST: Final = 64  # steps per sample: sparser recordings are wrong files
BREAK: Final = 50.0  # times the running median of the steps, above which a step is a break
STEPS_AROUND: Final = 11  # steps of that running median
SHORTEST_SEGMENT: Final = 16  # rows between two breaks; shorter segments carry no information on friction
WITHIN_A_TURN: Final = 1.001  # turns: the largest range of an angle that is wrapped to one turn
LOST_SHARE: Final = 0.5  # of the turned angle, by which a measured one may differ; more means another shaft, or degrees
SCALED_ONLY: Final = "motor off: friction is -J dω/dt, which the inertia only scales"
MEAN_OF_A_TURN: Final = "speed measured within a turn: from pulses it is the mean over each"
EVEN_CLOCK: Final = "an even clock: here the noise has the colour of slopes over several rows, or of interpolation"
NO_TORQUE: Final = f"{SCALED_ONLY}, and the motor gives no torque"


@dataclass(frozen=True, slots=True)
class Bench:
    """Recordings of one wheel that fit its grid of slots.

    Attributes
    ----------
    recordings, held_out
        Name and samples of each; a recording with breaks is split into several.
    wheel
        With the sample period that fits them.
    notes
        One sentence for each change made to them.
    noise_is_correlated
        Whether the preparation autocorrelates the noise, by slopes over several rows or by linear interpolation.
    """

    recordings: list[tuple[str, Samples]]
    wheel: Wheel
    notes: list[str]
    noise_is_correlated: bool = False
    held_out: list[tuple[str, Samples]] = field(default_factory=list)


def is_even(time_ns: IntArray, *, whole: bool = False) -> bool:
    """Return whether the clock is even: steps are the median step, or whole multiples of it where samples are lost.

    `whole`: multiples count as uneven, so that hardly any sample is lost and windows for dω/dt are complete.
    """
    if time_ns.size < 3:
        return True
    steps = np.diff(time_ns) / np.median(np.diff(time_ns))
    off = np.abs(steps - (1.0 if whole else np.maximum(np.rint(steps), 1.0))) > OFF_A_STEP
    return float(np.mean(off)) <= UNEVEN_SHARE


def as_measured(
    recordings: Sequence[tuple[str, Samples]], wheel: Wheel, held_out: Sequence[tuple[str, Samples]] = ()
) -> Bench:
    """Return recordings of a wheel on one even grid; those already on it are unchanged (idempotent).

    Parameters
    ----------
    recordings, held_out
        Name and samples of each recording to be searched, and of those held out.
    wheel
        Its constants.

    Raises
    ------
    InputError
        If the motor is off, friction is not given, and the wheel has no inertia.
    """
    (searched, notes), (others, of_others) = _segments(recordings, wheel), _segments(held_out, wheel)
    fitted = _on_one_grid([*searched, *others], _with_short_window([*searched, *others], wheel))
    count, notes = len(searched), [*notes, *of_others, *fitted.notes]
    return replace(fitted, recordings=fitted.recordings[:count], notes=notes, held_out=fitted.recordings[count:])


def _with_short_window(recordings: Sequence[tuple[str, Samples]], wheel: Wheel) -> Wheel:
    """Return the wheel with its window for dω/dt limited, unless the wheel file states a window.

    The limit is WINDOW_SHARE of the longest recording, and half of the longest segment without a lost sample.
    """
    derivative = wheel.friction.derivative
    longest_s = max((float(np.sum(_steps_s(samples))) for _, samples in recordings), default=np.inf)
    whole_s = max((_longest_complete_s(samples) for _, samples in recordings), default=np.inf)
    most_s = min(WINDOW_SHARE * longest_s, SEGMENT_SHARE * whole_s)
    if "window_s" in derivative.model_fields_set or derivative.window_s <= most_s:
        return wheel
    return with_window(wheel, most_s)


def _longest_complete_s(samples: Samples) -> float:
    """Return the duration of the longest segment without a lost sample [s]; infinite where the clock is uneven."""
    steps = _steps_s(samples)
    if steps.size == 0 or not is_even(samples.time_ns, whole=True):
        return np.inf
    times = np.append(0.0, np.cumsum(steps))
    lost = np.flatnonzero(steps > LOST * np.median(steps))
    return float(np.max(times[[*lost, -1]] - times[[0, *(lost + 1)]]))


def _on_one_grid(recordings: Sequence[tuple[str, Samples]], wheel: Wheel) -> Bench:
    """Return recordings without breaks on one even grid, as `as_measured` does."""
    even = {name: _is_on_grid(samples, wheel) for name, samples in recordings}
    if all(even.values()):
        return Bench([(name, without_motor(samples, wheel)) for name, samples in recordings], wheel, [])
    rows = [(name, samples if even[name] else _with_slope_friction(samples, wheel)) for name, samples in recordings]
    own = all(samples.friction_torque_Nm is not None for _, samples in rows)
    steps = [_steps_s(samples) for _, samples in rows]
    if own:  # every row has its own slot, except rows much closer than the median step
        period_s = min(max(float(step.min()), float(np.median(step)) / FINEST) for step in steps if step.size)
    else:
        median, (low, high) = float(np.median(np.concatenate(steps))), NEAR_PERIOD
        period_s = wheel.sample_period_s if low < median / wheel.sample_period_s < high else median
    wheel = wheel.model_copy(update={"sample_period_s": period_s})
    found, notes = [], []
    for name, samples in rows:
        fitted = samples
        if not even[name]:
            # A wrapped angle cannot be interpolated linearly from the end of one turn to the start of the next.
            fitted = _first_in_slots(samples, wheel) if own else _interpolated(with_turns(samples, name), wheel)
            notes.append(f"{name}: {_in_words(samples, fitted, period_s, own=own)}")
        found.append((name, without_motor(fitted, wheel)))
    uneven = (one for _, one in recordings if not is_even(one.time_ns, whole=True))
    return Bench(found, wheel, notes, any(one.friction_torque_Nm is None for one in uneven))


def _segments(recordings: Sequence[tuple[str, Samples]], wheel: Wheel) -> tuple[list[tuple[str, Samples]], list[str]]:
    """Return recordings split at breaks into segments, and one sentence for each recording that was split.

    Breaks of an even clock remain as empty slots if the grid has room for them, unless the motor is off: each part is
    a spin-down. Breaks of an uneven clock remain where friction is given, because only a slope of the speed must not
    extend across a break.
    """
    found, notes = [], []
    for name, samples in recordings:
        steps = np.diff(samples.time_ns)
        step_ns = min(float(np.median(steps)), wheel.period_ns) if steps.size else wheel.period_ns
        sparse = float(steps.sum()) > most_steps_per_sample(samples) * step_ns * len(samples)
        whole = sparse or wheel.friction.motor_off
        apart = whole if is_even(samples.time_ns) else samples.friction_torque_Nm is None
        after = np.zeros(0, dtype=np.int64)
        if apart and steps.size >= STEPS_AROUND:
            after = np.flatnonzero(steps > BREAK * median_filter(steps, STEPS_AROUND, mode="mirror")) + 1
        parts = [samples[begin:end] for begin, end in pairwise([0, *after.tolist(), len(samples)])]
        kept = [part for part in parts if len(part) >= SHORTEST_SEGMENT]
        if not after.size or not kept:
            found.append((name, samples))
            continue
        found += [(f"{name} ({at} of {len(kept)})", part) for at, part in enumerate(kept, start=1)]
        notes.append(
            f"{name}: {counted(after.size, 'break')}, the longest of {steps.max() / NANOSECONDS_PER_SECOND:.4g} s:"
            f" read as {counted(len(kept), 'recording')}"
        )
        if left := len(samples) - sum(map(len, kept)):
            notes[-1] += f"; {counted(left, 'row')} in stretches of fewer than {SHORTEST_SEGMENT} left out"
    return found, notes


def most_steps_per_sample(samples: Samples) -> int:
    """Return how many of its steps a recording may hold per sample: more where friction is given, or steps uneven."""
    return MAX_GAP_FACTOR if samples.friction_torque_Nm is None and is_even(samples.time_ns) else SPARSEST


def _is_on_grid(samples: Samples, wheel: Wheel) -> bool:
    """Return whether the clock is even and about the wheel's; with pulses it must have that period."""
    even = is_even(samples.time_ns, whole=samples.friction_torque_Nm is None)
    if len(samples) < 3:
        return even
    ratio = float(np.median(_steps_s(samples))) / wheel.sample_period_s
    own = NEAR_PERIOD[0] <= ratio <= MAX_GAP_FACTOR
    if wheel.pulses_per_turn is not None:
        own = abs(ratio - 1.0) <= OFF_A_STEP
    return even and own


def with_turns(samples: Samples, source: str) -> Samples:
    """Return the samples with the measured angle unwrapped along the integral of the speed.

    Raises
    ------
    InputError
        If the angle was measured unwrapped and does not follow the integral of the speed.
    """
    angle, moving = samples.angle_rad, np.isfinite(samples.speed_rad_s)
    if angle is None or not (known := np.isfinite(angle)).any() or not moving.any():
        return samples
    steps = _steps_s(samples)
    held = np.interp(samples.time_ns, samples.time_ns[moving], samples.speed_rad_s[moving])
    turned = np.append(0.0, np.cumsum(0.5 * steps * (held[1:] + held[:-1])))
    beyond = angle[known] - turned[known]
    if float(np.ptp(angle[known])) <= 2.0 * np.pi * WITHIN_A_TURN:
        beyond = np.unwrap(beyond)
    elif float(np.ptp(beyond)) > 2.0 * np.pi + LOST_SHARE * float(np.ptp(turned)):
        raise InputError(
            source,
            f"covers {float(np.ptp(angle[known])):.4g} rad where speed_rad_s turns by {float(np.ptp(turned)):.4g} rad:"
            " an angle in degrees is the column angle_deg; leave out that of another shaft",
            "angle_rad",
        )
    counted = np.full(angle.size, np.nan)
    counted[known] = turned[known] + beyond
    return replace(samples, angle_rad=counted)


def lost_without_motor(effects: Sequence[type[MeanEffect]], wheel: Wheel, channels: Channels) -> dict[str, str]:
    """Return the effects that are not identifiable with the motor off, or from pulses, each with the reason.

    Parameters
    ----------
    effects
        The effects to be tested.
    wheel
        States whether its motor is off, and how its speed is measured.
    channels
        Channels of a record; an effect that vanishes there without acceleration is only scaled by the inertia.
    """
    steady = replace(channels, acceleration_rad_s2=np.zeros(len(channels)))

    def why(effect: type[MeanEffect]) -> str | None:
        if wheel.pulses_per_turn is not None and issubclass(effect, TorqueRipple):
            return MEAN_OF_A_TURN
        if not wheel.friction.motor_off:
            return None
        if "motor_torque_Nm" in effect.needs:
            return NO_TORQUE
        shape = {parameter.name: parameter.typical for parameter in effect.shape_parameters()}
        there, gone = (np.nan_to_num(effect.columns(one, shape)[0]).any() for one in (channels, steady))
        return SCALED_ONLY if there and not gone else None

    reasons = ((effect.name, why(effect)) for effect in effects)
    return {name: reason for name, reason in reasons if reason is not None}


def _steps_s(samples: Samples) -> FloatArray:
    return np.asarray(np.diff(samples.time_ns) / NANOSECONDS_PER_SECOND)


def _first_in_slots(samples: Samples, wheel: Wheel) -> Samples:
    """Return the first row of each slot."""
    slot = np.rint((samples.time_ns - samples.time_ns[0]) / wheel.period_ns)
    return samples[np.unique(slot, return_index=True)[1]]


def _interpolated(samples: Samples, wheel: Wheel) -> Samples:
    """Return all channels linearly interpolated on an even grid; NaN where rows are far apart.

    The torque's channels are NaN, too, between rows with opposite directions: dry friction changes its sign there.
    """
    time = samples.time_ns
    grid = np.arange(time[0], time[-1] + 1, wheel.period_ns, dtype=np.int64)
    longest = LONGEST_BRIDGE * float(np.median(np.diff(time)))
    known = np.isfinite(samples.speed_rad_s)
    turns = np.diff(np.sign(samples.speed_rad_s[known]), prepend=0.0, append=0.0) != 0.0
    across = turns[np.searchsorted(time[known], grid, side="right")] & ~np.isin(grid, time[known])
    columns: dict[str, Any] = {}
    for name in TABLE_CHANNELS:
        if (values := getattr(samples, name)) is not None:
            columns[name] = _interpolate(grid, time, values, longest)
            if name in FRICTION_CHANNELS:
                columns[name][across] = np.nan
    return Samples(time_ns=grid, **columns)


def _interpolate(grid: IntArray, time: IntArray, values: FloatArray, longest: float) -> FloatArray:
    """Return values interpolated at the grid's times [ns]; NaN between rows more than `longest` [ns] apart."""
    known = np.isfinite(values)
    if not known.any():
        return np.full(grid.size, np.nan)
    at, after = time[known], np.searchsorted(time[known], grid)  # the row at that time, or the next
    near = np.diff(at, prepend=at[0], append=np.iinfo(np.int64).max)[after] <= longest
    near |= np.isin(grid, at)
    lines = np.interp(grid - time[0], at - time[0], values[known], left=np.nan, right=np.nan)
    return np.where(near, lines, np.nan)


def _with_slope_friction(samples: Samples, wheel: Wheel) -> Samples:
    """Return rows with friction -J dω/dt where the motor is off and neither friction nor motor torque is given.

    dω/dt is the slope at a row of the least-squares parabola through its neighbours at their own times.
    """
    stopped = without_motor(samples, wheel)
    if stopped is samples or stopped.motor_torque_Nm is None:
        return samples
    slope = _slopes(samples, wheel.friction.derivative.window_s)
    return replace(stopped, friction_torque_Nm=friction_torque(stopped.motor_torque_Nm, slope, inertia_of(wheel)))


def _slopes(samples: Samples, window_s: float) -> FloatArray:
    """Return dω/dt at each row [rad/s²], float64 (n,), by the parabola fitted to the rows around it.

    NaN at the ends and near missing values.
    """
    half = int(np.clip(round(window_s / float(np.median(_steps_s(samples))) / 2), LEAST_HALF, MOST_HALF))
    if len(samples) <= 2 * half:
        return np.full(len(samples), np.nan)
    time, count = (samples.time_ns - samples.time_ns[0]) / NANOSECONDS_PER_SECOND, len(samples) - 2 * half
    middle = time[half : half + count]
    scale = np.maximum(time[2 * half :] - middle, middle - time[:count])
    powers, moment = np.zeros((5, count)), np.zeros((3, count))
    for begin in range(2 * half + 1):
        offset = (time[begin : begin + count] - middle) / scale
        power = np.stack([offset**exponent for exponent in range(5)])
        powers += power
        moment += samples.speed_rad_s[begin : begin + count] * power[:3]
    gram = powers[np.add.outer(np.arange(3), np.arange(3))].T
    return np.pad(np.linalg.solve(gram, moment.T[..., None])[:, 1, 0] / scale, half, constant_values=np.nan)


def _in_words(rows: Samples, fitted: Samples, period_s: float, *, own: bool) -> str:
    """Return a text of how a recording with an uneven clock, or one of its own, was placed on the grid."""
    steps, lost = _steps_s(rows), len(rows) - len(fitted)
    if is_even(rows.time_ns, whole=True):
        return f"time steps of {np.median(steps):.4g} s are not the wheel's sample_period_s: they are used in its place"
    uneven = f"time steps are uneven ({steps.min():.3g} to {steps.max():.3g} s, median {np.median(steps):.3g} s)"
    if not own:
        done = f"interpolated by straight lines to {len(fitted)} samples, one each {period_s:.4g} s"
        return f"{uneven}: {len(rows)} rows are {done}"
    left_out = f"; {lost} closer ones are left out" if lost else ""
    return f"{uneven}: {len(fitted)} rows keep their values in slots of {period_s:.4g} s{left_out}"
