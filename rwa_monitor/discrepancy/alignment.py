"""A current that is read too late or too early, estimated where the motor's torque steps.

The torque steps where a slew begins or ends, and dω/dt with it, in the same moment. Where the current is read later the
two part: friction shows a pulse as large as the step, from the one to the other. To first order in the delay, as the
catalogue has it, that is a spike of any height; but the torque of other slots than its own, put in place of it, takes
the pulse away and makes one of its own wherever it is wrong. What a filter for dω/dt rounds off, the same average of
the torque rounds off alike. Where the friction is given, the impulse of the pulse shows the delay to parts of a slot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy import stats
from scipy.ndimage import binary_dilation, correlate1d

from rwa_monitor.discrepancy.derived_friction import Motion, spread_of_differences
from rwa_monitor.samples import BoolArray, FloatArray, IntArray
from rwa_monitor.wheel import torque_balance
from rwa_monitor.wheel.wheel import Wheel

LONGEST_S: Final = 5.0  # of a delay (wheel/effects/current_delay.py)
MOST_SLOTS: Final = 40
STEP_STDS: Final = 10.0  # of what friction varies by from slot to slot: a step of the torque that shows any delay
FEWEST_STEPS: Final = 3
MOST_STEPS: Final = 0.6  # of the steps must each show a delay
CLEARLY_ROUGH: Final = 10.0  # of what noise gives around a step: such a one is informative
LEFT_SHARE: Final = 0.5  # of what a delay is to explain
LEFT_OF_HALVES: Final = 0.2  # by half a slot: the mean of two slots halves what steps at all, late or not
ROUGH: Final = 2.0  # of what noise gives: less is not to be explained
WITHIN_A_SLOT: Final = 1.0 / 12.0  # slots²: the variance of a place somewhere in a slot
LEFT_OF_IMPULSES: Final = 0.2  # of their squares, by a delay of parts of a slot
CHANCE: Final = 1e-6  # that impulses without a delay are taken for one
PULSE_REACH: Final = 2  # slots to each side of a step that hold its pulse, beside a delay of whole slots
LONGEST_STEP: Final = 5  # slots; over a ramp the slope of the torque shows a delay, to first order
BESIDE: Final = 3  # slots on each side of those, which show the friction without it
SLOPE_REACH: Final = 6  # slots to each side
STEP_MARGIN: Final = 1  # slots on each side of a step that a delay of parts of a slot leaves wrong


@dataclass(frozen=True, slots=True)
class Delay:
    """A delay of the current.

    Attributes
    ----------
    slots, part
        By how many whole slots, and what part of one more, the torque is read later than it acts on the speed; below
        zero: earlier. -½ of a slot where it is held from sample to sample.
    late_slots, std_slots
        By how much the current is read later than the speed, and its standard deviation. 0 where only the place of a
        sample within its slot is another: that is no delay.
    gain
        By how much -2 log likelihood falls with it.
    """

    slots: int
    part: float
    late_slots: float
    std_slots: float
    gain: float


def find_delay(motions: Sequence[Motion], wheel: Wheel) -> Delay | None:
    """Return the delay of the current against the speed that steps of the torque show; None where none is shown."""
    most = max(1, min(int(LONGEST_S / wheel.sample_period_s), MOST_SLOTS))
    halves = np.arange(-2 * most, 2 * most + 1)
    at = 2 * most  # no shift
    around = [of_one for motion in motions if (of_one := _roughness(motion, wheel, halves)) is not None]
    if not around:
        return None
    of_step, noise = np.concatenate([one for one, _ in around]), sum(noise for _, noise in around)
    rough = of_step.sum(axis=0)
    if of_step.shape[0] < FEWEST_STEPS or rough[at] < ROUGH * noise:
        return None
    found = _where_pulses_end(motions, wheel, halves, of_step, noise)
    slots = 0 if found is None else found.slots
    given = [motion for motion in motions if motion.torque_Nm is not None and motion.friction_Nm is not None]
    of_impulses = _by_impulse(given, PULSE_REACH + abs(slots))
    if of_impulses is None:
        return found
    late, std = of_impulses
    gain = float(rough[at] - rough.min()) if found is None else found.gain
    return Delay(slots, late - slots, late, std, gain)


def _where_pulses_end(
    motions: Sequence[Motion], wheel: Wheel, halves: IntArray, of_step: FloatArray, noise: float
) -> Delay | None:
    """Return the delay, in half slots, that takes the pulses away around most steps.

    Parameters
    ----------
    motions, wheel
        As for `find_delay`.
    halves
        int64 (m,), the shifts that are tried [half slots], from one end to the other.
    of_step, noise
        float64 (steps, m), how rough friction is around each step with each shift, and what noise gives of it in all.
    """
    at, allowed = halves.size // 2, np.where(halves % 2 == 0, LEFT_SHARE, LEFT_OF_HALVES)
    informative = of_step[of_step[:, at] > CLEARLY_ROUGH * noise / of_step.shape[0]]
    if informative.shape[0] < FEWEST_STEPS:
        return None
    # A jump of the friction that a shift takes out of sight around one step is no delay: most steps must show it.
    left = informative / informative[:, [at]]
    shown = np.count_nonzero(left < allowed, axis=0)
    explained = (shown >= max(MOST_STEPS * informative.shape[0], FEWEST_STEPS)) & (halves != 0)
    explained[[0, -1]] = False
    if not explained.any():
        return None
    best = int(np.argmin(np.where(explained, np.median(left, axis=0), np.inf)))
    rough = informative[left[:, best] < allowed[best]].sum(axis=0)
    gain = float(rough[at] - rough[best])
    curvature = float(rough[best - 1] - 2.0 * rough[best] + rough[best + 1]) / 0.25  # per slot²
    # The data determine it far better than the unknown place of a sample within its slot.
    variance = WITHIN_A_SLOT + (2.0 / curvature if curvature > 0.0 else 0.0)
    seen = 0.5 * float(halves[best])
    slots = _whole(motions, wheel, seen)
    return Delay(slots, seen - slots, float(slots), float(np.sqrt(variance)), gain)


def _by_impulse(motions: Sequence[Motion], reach: int) -> tuple[float, float] | None:
    """Return the delay and its standard deviation [slots] that impulses of given friction show; None where none.

    A torque that steps by h and is read d later leaves a pulse of impulse -d·h in the friction, wherever in a slot it
    steps and however many slots it takes: a straight line through the origin, by least squares.
    """
    parts = [_impulses(motion, reach) for motion in motions]
    impulse, step, noise = (np.concatenate([np.zeros(0), *(part[i] for part in parts)]) for i in range(3))
    if impulse.size < FEWEST_STEPS or not step.any():
        return None
    energy, late = float(step @ step), -float(impulse @ step / (step @ step))
    left = impulse + late * step
    if left @ left > LEFT_OF_IMPULSES * (impulse @ impulse):
        return None
    # Few impulses may lie on a line by chance: what the noise alone makes of them is the least that they scatter by.
    std = float(np.sqrt(max(left @ left / (impulse.size - 1), np.mean(noise**2)) / energy))
    return (late, std) if 2.0 * stats.norm.sf(abs(late), scale=std) <= CHANCE else None


def _impulses(motion: Motion, reach: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the impulse of friction beside what it is before and after each step of the torque, the step, the noise.

    float64 (steps,) each [N m slots, N m, N m slots], from so many slots to each side that hold the pulse; without
    those where the direction changes, and friction with it.
    """
    assert motion.friction_Nm is not None
    assert motion.torque_Nm is not None
    speed, friction, accelerating = motion.speed_rad_s, motion.friction_Nm, motion.torque_Nm - motion.friction_Nm
    std = spread_of_differences(friction, 1, motion.torque_step_Nm)
    stepped = binary_dilation(np.abs(np.nan_to_num(_rise(accelerating, 1))) > STEP_STDS * std, iterations=reach)
    border = np.diff(stepped.astype(np.int8), prepend=0, append=0)
    impulse, height, width = [], [], []
    for begin, end in zip(np.flatnonzero(border > 0), np.flatnonzero(border < 0), strict=True):
        around = slice(begin - BESIDE, end + BESIDE)
        if begin < BESIDE or end + BESIDE > friction.size or end - begin > LONGEST_STEP + 2 * reach:
            continue
        if np.ptp(np.sign(speed[around])) != 0:
            continue
        before, after = slice(begin - BESIDE, begin), slice(end, end + BESIDE)
        # Friction turns a corner with the speed: from one level to the other as the speed goes, not over time.
        first, last = float(speed[before].mean()), float(speed[after].mean())
        share = np.clip((speed[begin:end] - first) / (last - first), 0.0, 1.0) if last != first else 0.5
        level = friction[before].mean() * (1.0 - share) + friction[after].mean() * share
        impulse.append(float(np.sum(friction[begin:end] - level)))
        height.append(float(accelerating[after].mean() - accelerating[before].mean()))
        width.append(float(end - begin))
    known = np.isfinite(impulse) & np.isfinite(height)
    slots = np.array(width)[known]
    # Of the slots summed, and of the level beside them, a mean of BESIDE on each side.
    noise = std / np.sqrt(2.0) * np.sqrt(slots + slots**2 / (2 * BESIDE))
    return np.array(impulse)[known], np.array(height)[known], noise


def _whole(motions: Sequence[Motion], wheel: Wheel, slots: float) -> int:
    """Return the whole slots of a delay: where half a slot is seen, friction that turns with the speed shows which.

    Torque that is held from sample to sample acts half a slot late on the speed, but friction does not.
    """
    if slots == int(slots):
        return int(slots)
    below, above = int(np.trunc(slots)), int(np.trunc(slots) + np.sign(slots))
    of_below, of_above = (sum(_at_turns(motion, wheel, whole) for motion in motions) for whole in (below, above))
    return above if of_above <= of_below * (LEFT_SHARE if below == 0 else 1.0) else below


def _at_turns(motion: Motion, wheel: Wheel, slots: int) -> float:
    """Return how much s·friction changes from slot to slot where the speed changes its direction [N² m²]."""
    moved = aligned(motion, wheel, slots, 0.0)
    if moved.torque_Nm is None:
        return 0.0
    sign = np.sign(moved.speed_rad_s)
    rise = _rise(sign * (moved.torque_Nm - _accelerating(moved, wheel)[0]), 1)[_turns(moved, 1)]
    return float(np.nansum(rise**2))


def _turns(motion: Motion, lag: int) -> BoolArray:
    """Return the slots whose differences over a lag, of means over as many to each side, meet a turn; bool (n,)."""
    sign = np.sign(motion.speed_rad_s)
    turns: BoolArray = binary_dilation(np.diff(sign, append=sign[-1]) != 0, iterations=2 * lag)
    return turns


def _accelerating(motion: Motion, wheel: Wheel) -> tuple[FloatArray, int]:
    """Return the torque that accelerates the rotor [N m], float64 (n,), and the slots within which a step of it lies.

    That is the motor's torque less the friction, or the inertia's torque where friction is to be derived.
    """
    if motion.friction_Nm is not None:
        assert motion.torque_Nm is not None
        return motion.torque_Nm - motion.friction_Nm, 1
    derivative, period_s = wheel.friction.derivative, wheel.sample_period_s
    slope = torque_balance.differentiate(motion.speed_rad_s, derivative, period_s)
    return torque_balance.inertia_of(wheel) * slope, torque_balance.half_width(derivative, period_s)


def _roughness(motion: Motion, wheel: Wheel, halves: IntArray) -> tuple[FloatArray, float] | None:
    """Return how rough friction is around each step with each shift, float64 (steps, shifts), and what noise gives."""
    torque = motion.torque_Nm
    if torque is None or (motion.friction_Nm is None and wheel.inertia_kg_m2 is None):
        return None
    accelerating, lag = _accelerating(motion, wheel)
    held = 0.5 * (torque + _moved(torque, -1))
    if motion.friction_Nm is None:
        torque, held = _averages(torque, wheel)
    # Of friction as it is: a delay makes few of its differences large.
    std = spread_of_differences(torque - accelerating, lag, motion.torque_step_Nm)
    # Where friction jumps the torque steps as well, and late or early shows nothing of the speed, which stays straight.
    stepped = np.abs(np.nan_to_num(_rise(accelerating, lag))) > STEP_STDS * std
    if std == 0.0 or not stepped.any():
        return None
    near = binary_dilation(stepped, iterations=int(halves[-1]) // 2 + lag)
    moved = [_moved(held if half % 2 else torque, (int(half) + 1) // 2) for half in halves]
    differences = np.stack([_rise(late - accelerating, lag) for late in moved])
    # Friction steps where the direction changes: beside slews that are all alike it passes for the pulse of a delay.
    near &= np.isfinite(differences).all(axis=0) & ~_turns(motion, lag)
    squares = (differences[:, near] / std) ** 2 / lag
    if squares.shape[1] == 0:
        return None
    # Slots belong to the step that is nearest: steps a moment apart are one.
    first = np.flatnonzero(np.diff(stepped.astype(np.int8), prepend=0) > 0)
    first = first[np.diff(first, prepend=-np.inf) > lag + SLOPE_REACH]
    owner = np.searchsorted(0.5 * (first[1:] + first[:-1]), np.flatnonzero(near))
    of_step: FloatArray = np.stack([np.bincount(owner, row, first.size) for row in squares], axis=1)
    return of_step[np.bincount(owner, minlength=first.size) > 0], squares.shape[1] / lag


def _averages(torque: FloatArray, wheel: Wheel) -> tuple[FloatArray, FloatArray]:
    """Return the torque averaged as the derivative averages dω/dt, float64 (n,); see `torque_balance.rounding_error`.

    First with straight lines between samples, then with each held until the next, which is half a slot late.
    """
    between = torque_balance.weights_between(wheel)
    held = np.concatenate([between[::-1], between, [0.0]])  # of what lies between slots -half … half
    straight = 0.5 * (held + held[::-1])
    first, second = (correlate1d(torque, kernel, mode="constant", cval=np.nan) for kernel in (straight, held))
    return first, second


def aligned(motion: Motion, wheel: Wheel, slots: int, part: float) -> Motion:
    """Return torque, and friction that was derived from it elsewhere, as they are without a delay.

    Part of a slot is taken from the slope over several of what accelerates the rotor: a mean of two neighbours would
    colour the noise. Where that steps no slope shows it: such slots are unknown.
    """
    if motion.torque_Nm is None or (slots == 0 and part == 0.0):
        return motion
    torque, friction = _moved(motion.torque_Nm, slots), motion.friction_Nm
    if friction is not None:
        friction = friction + torque - motion.torque_Nm
    if part:
        accelerating, lag = _accelerating(motion, wheel)
        std = spread_of_differences(torque if friction is None else friction, lag, motion.torque_step_Nm)
        steps = np.abs(np.nan_to_num(_rise(accelerating, lag))) > STEP_STDS * std
        if friction is not None:  # it steps where the direction changes
            steps |= np.nan_to_num(_rise(np.sign(motion.speed_rad_s), 1)) != 0.0
        around = np.arange(-SLOPE_REACH, SLOPE_REACH + 1)
        slope = correlate1d(accelerating, around / float(around @ around), mode="constant", cval=np.nan)
        late = part * np.nan_to_num(slope)
        late[binary_dilation(steps, iterations=SLOPE_REACH)] = 0.0
        late[binary_dilation(steps, iterations=SLOPE_REACH if friction is None else STEP_MARGIN)] = np.nan
        torque, friction = torque + late, None if friction is None else friction + late
    return replace(motion, torque_Nm=torque, friction_Nm=friction)


def _rise(values: FloatArray, lag: int) -> FloatArray:
    return values - _moved(values, -lag)


def _moved(values: FloatArray, slots: int) -> FloatArray:
    """Return what is so many slots later, float64 (n,), NaN where there is none."""
    out = np.full(values.size, np.nan)
    if slots >= 0:
        out[: values.size - slots] = values[slots:]
    else:
        out[-slots:] = values[:slots]
    return out
