"""Recordings of test benches as the search takes them: a motor that is off, and clocks that do not tick evenly.

Every row keeps its own value where friction is given, or where the motor is off and friction is the inertia's torque
alone: the slots are made so short that each row has one of its own, and those between stay empty. Interpolated friction
would have coloured noise that grows where rows are sparse, and both would be found. Only where friction is derived from
a motor torque are speed and torque interpolated, as the filter for dω/dt needs neighbours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import median_filter

from rwa_monitor.errors import InputError
from rwa_monitor.samples import NANOSECONDS_PER_SECOND, TABLE_CHANNELS, FloatArray, IntArray, Samples
from rwa_monitor.wheel.effects.base import Channels, MeanEffect
from rwa_monitor.wheel.effects.torque_ripple import TorqueRipple
from rwa_monitor.wheel.torque_balance import friction_torque, inertia_of, with_window, without_motor
from rwa_monitor.wheel.wheel import Wheel
from rwa_monitor.words import counted

OFF_A_STEP: Final = 0.05  # of the median step, from the nearest whole number of them: a step of an uneven clock
UNEVEN_SHARE: Final = 0.1  # of the steps; fewer are single late samples
FINEST: Final = 8  # slots in a median step; rows that are closer still share one, and the first counts
LONGEST_BRIDGE: Final = 4.0  # median steps between two rows over which values are interpolated
NEAR_PERIOD: Final = (0.8, 1.25)  # median step over the wheel's period: so near, that period is kept
STRETCH_SHARE: Final = 0.5  # of a stretch without a lost sample
LOST: Final = 1.5  # median steps: a sample is lost
WINDOW_SHARE: Final = 0.1  # of a recording, that a slope of the speed reaches over at most
LEAST_HALF: Final = 2  # rows to each side from which dω/dt is estimated
MOST_HALF: Final = 200
MAX_GAP_FACTOR: Final = 4  # a record may hold at most this many slots per sample; sparser ones are wrong files
BREAK: Final = 50.0  # median steps around a step that is a break
STEPS_AROUND: Final = 11
SHORTEST_STRETCH: Final = 16  # rows between two breaks; fewer show nothing of friction
ROWS_AT_ONCE: Final = 10_000  # of which the neighbours are laid out: 32 MB at most, a few times
WITHIN_A_TURN: Final = 1.001  # of a turn: the range of an angle that begins anew with each
LOST_SHARE: Final = 0.5  # of what the speed turns by, that an angle may slip; more is another shaft's, or in degrees
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
        Name and samples of each; one with breaks is several.
    wheel
        With the sample period that fits them.
    notes
        What was done to them, a sentence each.
    noise_is_made
        Whether noise has the colour of what was done: of slopes over several rows, or of straight lines between them.
    """

    recordings: list[tuple[str, Samples]]
    wheel: Wheel
    notes: list[str]
    noise_is_made: bool = False
    held_out: list[tuple[str, Samples]] = field(default_factory=list)


def is_even(time_ns: IntArray, *, whole: bool = False) -> bool:
    """Return whether the clock ticks evenly: steps are the median step, or whole multiples where samples are lost.

    `whole`: and hardly any is lost, so that windows for dω/dt are whole.
    """
    if time_ns.size < 3:
        return True
    steps = np.diff(time_ns) / np.median(np.diff(time_ns))
    off = np.abs(steps - (1.0 if whole else np.maximum(np.rint(steps), 1.0))) > OFF_A_STEP
    return float(np.mean(off)) <= UNEVEN_SHARE


def as_measured(
    recordings: Sequence[tuple[str, Samples]], wheel: Wheel, held_out: Sequence[tuple[str, Samples]] = ()
) -> Bench:
    """Return recordings of a wheel on one even grid; unchanged where they are. What it returns it leaves unchanged.

    Parameters
    ----------
    recordings, held_out
        Name and samples of each, those that are searched and those that are not.
    wheel
        Its constants.

    Raises
    ------
    InputError
        If the motor is off, friction is not given, and the wheel has no inertia.
    """
    (searched, notes), (others, of_others) = _stretches(recordings, wheel), _stretches(held_out, wheel)
    fitted = _on_one_grid([*searched, *others], _with_short_window([*searched, *others], wheel))
    count, notes = len(searched), [*notes, *of_others, *fitted.notes]
    return replace(fitted, recordings=fitted.recordings[:count], notes=notes, held_out=fitted.recordings[count:])


def _with_short_window(recordings: Sequence[tuple[str, Samples]], wheel: Wheel) -> Wheel:
    """Return a wheel whose window for dω/dt, where its file states none, is a small part of the longest recording.

    And no more than half of the stretch without a lost sample that is the longest of all.
    """
    derivative = wheel.friction.derivative
    longest_s = max((float(np.sum(_steps_s(samples))) for _, samples in recordings), default=np.inf)
    whole_s = max((_longest_stretch_s(samples) for _, samples in recordings), default=np.inf)
    most_s = min(WINDOW_SHARE * longest_s, STRETCH_SHARE * whole_s)
    if "window_s" in derivative.model_fields_set or derivative.window_s <= most_s:
        return wheel
    return with_window(wheel, most_s)


def _longest_stretch_s(samples: Samples) -> float:
    """Return the longest time without a lost sample [s], as an even clock shows them."""
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
    period_s = _shortest_s([samples for _, samples in rows]) if own else _period_s([s for _, s in rows], wheel)
    wheel = wheel.model_copy(update={"sample_period_s": period_s})
    found, notes = [], []
    for name, samples in rows:
        fitted = samples
        if not even[name]:
            # Within a turn straight lines would lead back from its end to its beginning.
            fitted = _in_slots(samples, wheel) if own else _interpolated(with_turns(samples, name), wheel)
            notes.append(f"{name}: {_in_words(samples, fitted, period_s, own=own)}")
        found.append((name, without_motor(fitted, wheel)))
    made = any(samples.friction_torque_Nm is None and not even[name] for name, samples in recordings)
    return Bench(found, wheel, notes, made)


def _stretches(recordings: Sequence[tuple[str, Samples]], wheel: Wheel) -> tuple[list[tuple[str, Samples]], list[str]]:
    """Return recordings with each stretch between breaks as one of its own, and what was done, a sentence each.

    Breaks of an even clock that the grid has room for stay: they are slots without a sample. So do those of an uneven
    one where friction is given: only a slope of the speed must not reach across a break.
    """
    found, notes = [], []
    for name, samples in recordings:
        steps = np.diff(samples.time_ns)
        sparse = float(steps.sum()) > MAX_GAP_FACTOR * wheel.period_ns * len(samples)
        apart = sparse if is_even(samples.time_ns) else samples.friction_torque_Nm is None
        after = _breaks(steps) + 1 if apart else np.zeros(0, dtype=np.int64)
        parts = [samples[begin:end] for begin, end in pairwise([0, *after.tolist(), len(samples)])]
        kept = [part for part in parts if len(part) >= SHORTEST_STRETCH]
        if not after.size or not kept:
            found.append((name, samples))
            continue
        found += [(f"{name} ({at} of {len(kept)})", part) for at, part in enumerate(kept, start=1)]
        notes.append(
            f"{name}: {counted(after.size, 'break')}, the longest of {steps.max() / NANOSECONDS_PER_SECOND:.4g} s:"
            f" read as {counted(len(kept), 'recording')}"
        )
        if left := len(samples) - sum(map(len, kept)):
            notes[-1] += f"; {counted(left, 'row')} in stretches of fewer than {SHORTEST_STRETCH} left out"
    return found, notes


def _breaks(steps_ns: IntArray) -> IntArray:
    """Return the steps that are breaks: many times as long as those around."""
    if steps_ns.size < STEPS_AROUND:
        return np.zeros(0, dtype=np.int64)
    return np.flatnonzero(steps_ns > BREAK * median_filter(steps_ns, STEPS_AROUND, mode="mirror"))


def _is_on_grid(samples: Samples, wheel: Wheel) -> bool:
    """Return whether a recording is even, and where it may be of pulses also whether it has the wheel's period."""
    even = is_even(samples.time_ns, whole=samples.friction_torque_Nm is None)
    if wheel.pulses_per_turn is None or len(samples) < 3:
        return even
    ratio = float(np.median(_steps_s(samples))) / wheel.sample_period_s
    return even and abs(ratio - 1.0) <= OFF_A_STEP


def with_turns(samples: Samples, source: str) -> Samples:
    """Return the samples with a measured angle that counts on from turn to turn, by the integral of the speed.

    Raises
    ------
    InputError
        If the angle counts on as it was measured, and not as the speed's integral does.
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


def not_shown_without_motor(effects: Sequence[type[MeanEffect]], wheel: Wheel, channels: Channels) -> dict[str, str]:
    """Return the effects that no record shows while the motor is off, or of pulses, each with the reason.

    Parameters
    ----------
    effects
        To be tested.
    wheel
        Whether its motor is off, and how its speed is measured.
    channels
        Of a record: what is nothing there without acceleration, the inertia only scales.
    """
    reasons = {effect.name: _why_not_shown(effect, wheel, channels) for effect in effects}
    return {name: why for name, why in reasons.items() if why is not None}


def _why_not_shown(effect: type[MeanEffect], wheel: Wheel, moving: Channels) -> str | None:
    """Return why an effect cannot show: each turn averages it out, or it is nothing without motor or acceleration."""
    if wheel.pulses_per_turn is not None and issubclass(effect, TorqueRipple):
        return MEAN_OF_A_TURN
    if not wheel.friction.motor_off:
        return None
    if "motor_torque_Nm" in effect.needs:
        return NO_TORQUE
    shape = {parameter.name: parameter.typical for parameter in effect.shape_parameters()}
    steady = replace(moving, acceleration_rad_s2=np.zeros(len(moving)))
    there, gone = (np.nan_to_num(effect.columns(channels, shape)[0]) for channels in (moving, steady))
    return SCALED_ONLY if there.any() and not gone.any() else None


def _steps_s(samples: Samples) -> FloatArray:
    return np.asarray(np.diff(samples.time_ns) / NANOSECONDS_PER_SECOND)


def _shortest_s(recordings: Sequence[Samples]) -> float:
    """Return a period so short that every row has a slot of its own, but for rows much closer than usual [s]."""
    steps = [_steps_s(samples) for samples in recordings]
    return min(max(float(step.min()), float(np.median(step)) / FINEST) for step in steps if step.size)


def _period_s(recordings: Sequence[Samples], wheel: Wheel) -> float:
    """Return the wheel's period where it is about the median step, else that [s]."""
    median = float(np.median(np.concatenate([_steps_s(samples) for samples in recordings])))
    low, high = NEAR_PERIOD
    return wheel.sample_period_s if low < median / wheel.sample_period_s < high else median


def _in_slots(samples: Samples, wheel: Wheel) -> Samples:
    """Return the first row of each slot."""
    slot = np.rint((samples.time_ns - samples.time_ns[0]) / wheel.period_ns)
    return samples[np.unique(slot, return_index=True)[1]]


def _interpolated(samples: Samples, wheel: Wheel) -> Samples:
    """Return all channels on an even grid, by straight lines; NaN where rows are far apart."""
    time = samples.time_ns
    grid = np.arange(time[0], time[-1] + 1, wheel.period_ns, dtype=np.int64)
    longest = LONGEST_BRIDGE * float(np.median(np.diff(time)))
    columns: dict[str, Any] = {
        name: _on_lines(grid, time, values, longest)
        for name in TABLE_CHANNELS
        if (values := getattr(samples, name)) is not None
    }
    return Samples(time_ns=grid, **columns)


def _on_lines(grid: IntArray, time: IntArray, values: FloatArray, longest: float) -> FloatArray:
    """Return values at other times [ns], NaN between rows that are further apart than `longest` [ns]."""
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
    return replace(samples, friction_torque_Nm=friction_torque(stopped.motor_torque_Nm, slope, inertia_of(wheel)))


def _slopes(samples: Samples, window_s: float) -> FloatArray:
    """Return dω/dt at each row [rad/s²], float64 (n,); NaN at ends and beside missing values."""
    half = int(np.clip(round(window_s / float(np.median(_steps_s(samples))) / 2), LEAST_HALF, MOST_HALF))
    if len(samples) <= 2 * half:
        return np.full(len(samples), np.nan)
    time = (samples.time_ns - samples.time_ns[0]) / NANOSECONDS_PER_SECOND
    times, speeds = (sliding_window_view(values, 2 * half + 1) for values in (time, samples.speed_rad_s))
    parts = [slice(begin, begin + ROWS_AT_ONCE) for begin in range(0, len(times), ROWS_AT_ONCE)]
    return np.pad(
        np.concatenate([_slopes_in(times[part], speeds[part], half) for part in parts]), half, constant_values=np.nan
    )


def _slopes_in(times: FloatArray, speeds: FloatArray, middle: int) -> FloatArray:
    """Return the slope at the middle of each window, float64 (n,), from times and values (n, m)."""
    offset = times - times[:, [middle]]
    scale = np.abs(offset).max(axis=1, keepdims=True)
    offset = offset / scale
    powers = np.stack([np.sum(offset**power, axis=1) for power in range(5)], axis=1)
    gram = powers[:, np.add.outer(np.arange(3), np.arange(3))]
    moment = np.stack([np.sum(speeds * offset**power, axis=1) for power in range(3)], axis=1)
    return np.asarray(np.linalg.solve(gram, moment[..., None])[:, 1, 0] / scale[:, 0])


def _in_words(rows: Samples, fitted: Samples, period_s: float, *, own: bool) -> str:
    """Return in words what was done to a recording whose clock is uneven."""
    steps, lost = _steps_s(rows), len(rows) - len(fitted)
    uneven = f"time steps are uneven ({steps.min():.3g} to {steps.max():.3g} s, median {np.median(steps):.3g} s)"
    if not own:
        done = f"interpolated by straight lines to {len(fitted)} samples, one each {period_s:.4g} s"
        return f"{uneven}: {len(rows)} rows are {done}"
    left_out = f"; {lost} closer ones are left out" if lost else ""
    return f"{uneven}: {len(fitted)} rows keep their values in slots of {period_s:.4g} s{left_out}"
