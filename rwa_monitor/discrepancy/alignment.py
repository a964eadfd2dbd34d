"""A current that is read too late or too early, estimated where the motor's torque steps.

Torque and dω/dt step simultaneously where a slew begins or ends. If the current is read later, friction has a pulse as
large as the step, as long as the delay. The catalogue's effect, of first order in the delay, can give a spike of any
height there. Shifting the torque by whole or half slots instead removes the pulse at the right delay, and adds pulses
at a wrong one. Before it is compared with a filtered dω/dt, the torque is averaged in the same way. The impulse of the
pulses determines the delay to a fraction of a slot. In a motion without such steps, the shift is taken that lets a law
of speed and acceleration fit best.
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

LONGEST_S: Final = 5.0  # longest delay that is tried (wheel/effects/current_delay.py)
MOST_SLOTS: Final = 40  # the same in slots
OF_A_SWEEP: Final = 0.25  # longest delay that is tried, of the time between two changes of direction
STEP_STDS: Final = 10.0  # standard deviations of friction's differences, above which the accelerating torque steps
FEWEST_STEPS: Final = 3  # that must be observed
MOST_STEPS: Final = 0.6  # share of the steps that must each confirm the delay
STEP_ROUGHNESS: Final = 10.0  # times the roughness due to noise, above which a step is informative
RESIDUAL_SHARE: Final = 0.5  # of the roughness of a step may remain after a shift by whole slots
RESIDUAL_SHARE_HALF: Final = 0.2  # the same by half a slot: a mean of two slots halves the roughness of any step
LEAST_ROUGHNESS: Final = 2.0  # times the roughness due to noise, below which no delay is sought
LEAST_COVERED: Final = 0.5  # of the slots, whose differences a best fit must contain
WITHIN_A_SLOT: Final = 1.0 / 12.0  # slots²: variance of a uniform position within a slot
HELD_WITHIN: Final = 0.05  # slots of -½, within which the torque is taken as held from sample to sample
HELD_STDS: Final = 3.0  # the same in standard deviations of the delay
IMPULSE_RESIDUAL: Final = 0.2  # of the sum of their squares may remain with a delay of a fraction of a slot
CHANCE: Final = 1e-6  # probability of a false alarm for impulses without a delay
PULSE_REACH: Final = 2  # slots on each side of a step that its pulse occupies, plus the whole slots of a delay
LONGEST_STEP: Final = 5  # slots; longer ramps are left to the first-order effect
BASELINE_REACH: Final = 3  # slots on each side of the pulse, from which the friction without it is estimated
SLOPE_REACH: Final = 3  # slots on each side from which the slope of the torque is estimated
STEP_MARGIN: Final = 1  # slots on each side of a step that a delay of a fraction of a slot affects


@dataclass(frozen=True, slots=True)
class Delay:
    """A delay of the current.

    Attributes
    ----------
    slots, part
        Whole slots, and the fraction of a further one, by which the torque is read after it acts on the speed; negative
        if before. -½ slot where it is held from sample to sample.
    late_slots, std_slots
        Delay of the current's reading after that of the speed, and its standard deviation [slots]. 0 if only the
        position within a slot differs, which is no delay.
    gain
        Decrease of -2 log likelihood due to the delay.
    """

    slots: int
    part: float
    late_slots: float
    std_slots: float
    gain: float


def find_delay(motions: Sequence[Motion], wheel: Wheel) -> Delay | None:
    """Return the delay of the current relative to the speed; None where it is not found."""
    known = [motion.speed_rad_s[np.isfinite(motion.speed_rad_s)] for motion in motions]
    turns = sum(int(np.count_nonzero(np.diff(np.sign(speed)))) for speed in known)
    between = sum(speed.size for speed in known) // (turns + 1)
    most = max(1, min(int(LONGEST_S / wheel.sample_period_s), MOST_SLOTS, int(OF_A_SWEEP * between)))
    return _by_steps(motions, wheel, most) or _by_best_fit(motions, wheel, most)


def _by_steps(motions: Sequence[Motion], wheel: Wheel, most: int) -> Delay | None:
    """Return the delay, of at most so many slots, from steps of the torque; None where they do not show one."""
    halves = np.arange(-2 * most, 2 * most + 1)
    at = 2 * most  # no shift
    around = [of_one for motion in motions if (of_one := _roughness(motion, wheel, halves)) is not None]
    if not around:
        return None
    of_step, noise = np.concatenate([one for one, _ in around]), sum(noise for _, noise in around)
    rough = of_step.sum(axis=0)
    if of_step.shape[0] < FEWEST_STEPS or rough[at] < LEAST_ROUGHNESS * noise:
        return None
    found = _by_pulse_removal(halves, of_step, noise)
    slots = 0 if found is None else found.slots
    of_impulses = _by_impulse([one for one in motions if one.torque_Nm is not None], wheel, PULSE_REACH + abs(slots))
    if of_impulses is None:
        return found
    late, std = of_impulses
    gain = float(rough[at] - rough.min()) if found is None else found.gain
    if abs(late + 0.5) < max(HELD_WITHIN, HELD_STDS * std):
        return Delay(0, -0.5, 0.0, std, gain)
    return Delay(round(late), late - round(late), late, std, gain)


def _by_pulse_removal(halves: IntArray, of_step: FloatArray, noise: float) -> Delay | None:
    """Return the delay, in half slots, that removes the pulses around most steps; None where there is none.

    Parameters
    ----------
    halves
        int64 (m,), the shifts that are tried [half slots], increasing and symmetric about 0.
    of_step, noise
        float64 (steps, m), roughness of friction around each step with each shift, and its expected sum due to noise.
    """
    at, allowed = halves.size // 2, np.where(halves % 2 == 0, RESIDUAL_SHARE, RESIDUAL_SHARE_HALF)
    informative = of_step[of_step[:, at] > STEP_ROUGHNESS * noise / of_step.shape[0]]
    if informative.shape[0] < FEWEST_STEPS:
        return None
    # A shift may also cancel a jump of the friction near one step: most steps must confirm a delay.
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
    # The unknown position of a sample within its slot dominates the uncertainty.
    variance = WITHIN_A_SLOT + (2.0 / curvature if curvature > 0.0 else 0.0)
    slots = int(0.5 * halves[best])
    return Delay(slots, 0.5 * float(halves[best]) - slots, float(slots), float(np.sqrt(variance)), gain)


def _by_impulse(motions: Sequence[Motion], wheel: Wheel, reach: int) -> tuple[float, float] | None:
    """Return the delay and its standard deviation [slots] from impulses of the friction; None if not significant.

    A torque that steps by h and is read d later causes a pulse with impulse -d·h in the friction, independent of its
    position in a slot, of its duration, and of a filter of dω/dt. d is the slope of a line through the origin, by least
    squares.
    """
    parts = [_impulses(motion, wheel, reach) for motion in motions]
    impulse, step, noise = (np.concatenate([np.zeros(0), *(part[i] for part in parts)]) for i in range(3))
    if impulse.size < FEWEST_STEPS or not step.any():
        return None
    energy, late = float(step @ step), -float(impulse @ step / (step @ step))
    left = impulse + late * step
    if left @ left > IMPULSE_RESIDUAL * (impulse @ impulse):
        return None
    # A few impulses may lie on a line by chance: their scatter is taken as at least that of the noise.
    std = float(np.sqrt(max(left @ left / (impulse.size - 1), np.mean(noise**2)) / energy))
    return (late, std) if 2.0 * stats.norm.sf(abs(late), scale=std) <= CHANCE else None


def _by_best_fit(motions: Sequence[Motion], wheel: Wheel, most: int) -> Delay | None:
    """Return the delay, in whole slots, with which dry and viscous friction, an offset and an inertia error fit best.

    Differences over a lag longer than all shifts are fitted, in which a jump of the friction is short. A shift that is
    off by x adds a sum of squares in proportion to x²: at twice the delay it is that at none. A part of a slot is left
    to the first-order effect.
    """
    products, size, count = np.zeros((2 * most + 5, 2 * most + 5)), 0, 0
    for motion in motions:
        if motion.torque_Nm is None or (motion.friction_Nm is None and wheel.inertia_kg_m2 is None):
            return None
        accelerating, lag = _accelerating(motion, wheel)
        torque = motion.torque_Nm if motion.friction_Nm is not None else _averaged_torque(motion.torque_Nm, wheel)[0]
        speed = motion.speed_rad_s
        law = (np.sign(speed), speed, accelerating, np.ones(speed.size))
        shifted = (_shifted(torque, slots) - accelerating for slots in range(-most, most + 1))
        rows = np.stack([_difference(row, most + 2 * lag) for row in (*law, *shifted)])
        rows = rows[:, np.isfinite(rows).all(axis=0) & ~_near_reversals(motion, max(lag, most))]
        products += rows @ rows.T
        size, count = size + speed.size, count + rows.shape[1]
    if count < LEAST_COVERED * size:
        return None
    across = products[:4, 4:]
    left = products.diagonal()[4:] - np.sum(across * np.linalg.lstsq(products[:4, :4], across)[0], axis=0)
    best = int(np.argmin(left))
    if not 0 < best < 2 * most or left[best] > RESIDUAL_SHARE * left[most]:
        return None
    curvature = float(left[best - 1] - 2.0 * left[best] + left[best + 1])
    late = best - most + float(left[best - 1] - left[best + 1]) / (2.0 * curvature)
    mirrored = most + round(2.0 * late)
    if not 0 <= mirrored <= 2 * most or left[mirrored] < RESIDUAL_SHARE * left[most]:
        return None
    gain = count * float(np.log(left[most] / left[best]))
    return Delay(best - most, 0.0, float(best - most), float(np.sqrt(WITHIN_A_SLOT)), gain)


def _impulses(motion: Motion, wheel: Wheel, reach: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return for each step of the torque the impulse of friction relative to its surroundings, the step, and the noise.

    float64 (steps,) each [N m slots, N m, N m slots]. A pulse extends up to `reach` slots on each side of its step,
    beside the slots over which the derivative spreads it. Steps with a change of direction nearby are excluded.
    """
    assert motion.torque_Nm is not None
    speed, (accelerating, lag) = motion.speed_rad_s, _accelerating(motion, wheel)
    friction, reach = motion.torque_Nm - accelerating, reach + lag - 1
    longest = LONGEST_STEP + 2 * (reach + lag - 1)
    std = spread_of_differences(friction, lag, motion.torque_step_Nm)
    stepped = binary_dilation(np.abs(np.nan_to_num(_difference(accelerating, lag))) > STEP_STDS * std, iterations=reach)
    border = np.diff(stepped.astype(np.int8), prepend=0, append=0)
    impulse, height, width = [], [], []
    for begin, end in zip(np.flatnonzero(border > 0), np.flatnonzero(border < 0), strict=True):
        around = slice(begin - BASELINE_REACH, end + BASELINE_REACH)
        if begin < BASELINE_REACH or end + BASELINE_REACH > friction.size or end - begin > longest:
            continue
        if np.ptp(np.sign(speed[around])) != 0:
            continue
        before, after = slice(begin - BASELINE_REACH, begin), slice(end, end + BASELINE_REACH)
        # The friction without a pulse is interpolated over the speed, which it depends on, and not over time.
        first, last = float(speed[before].mean()), float(speed[after].mean())
        share = np.clip((speed[begin:end] - first) / (last - first), 0.0, 1.0) if last != first else 0.5
        level = friction[before].mean() * (1.0 - share) + friction[after].mean() * share
        impulse.append(float(np.sum(friction[begin:end] - level)))
        height.append(float(accelerating[after].mean() - accelerating[before].mean()))
        width.append(float(end - begin))
    known = np.isfinite(impulse) & np.isfinite(height)
    slots = np.array(width)[known]
    # Noise of the summed slots, and of the level subtracted, a mean over BASELINE_REACH slots on each side.
    noise = std / np.sqrt(2.0) * np.sqrt(slots + slots**2 / (2 * BASELINE_REACH))
    return np.array(impulse)[known], np.array(height)[known], noise


def _near_reversals(motion: Motion, lag: int) -> BoolArray:
    """Return the slots whose differences over a lag, of means over `lag` slots each way, span a reversal; bool (n,)."""
    sign = np.sign(motion.speed_rad_s)
    turns: BoolArray = binary_dilation(np.diff(sign, append=sign[-1]) != 0, iterations=2 * lag)
    return turns


def _accelerating(motion: Motion, wheel: Wheel) -> tuple[FloatArray, int]:
    """Return the torque that accelerates the rotor [N m], float64 (n,), and the slots over which a step of it extends.

    It is motor torque minus friction, or J·dω/dt where friction is to be derived.
    """
    if motion.friction_Nm is not None:
        assert motion.torque_Nm is not None
        return motion.torque_Nm - motion.friction_Nm, 1
    derivative, period_s = wheel.friction.derivative, wheel.sample_period_s
    slope = torque_balance.differentiate(motion.speed_rad_s, derivative, period_s)
    return torque_balance.inertia_of(wheel) * slope, torque_balance.half_width(derivative, period_s)


def _roughness(motion: Motion, wheel: Wheel, halves: IntArray) -> tuple[FloatArray, float] | None:
    """Return the roughness of friction around each step with each shift, float64 (steps, shifts), and that of noise.

    Roughness is the sum of squared differences over a lag, divided by their noise variance and by the lag. None without
    a torque, an inertia where one is needed, or steps.
    """
    torque = motion.torque_Nm
    if torque is None or (motion.friction_Nm is None and wheel.inertia_kg_m2 is None):
        return None
    accelerating, lag = _accelerating(motion, wheel)
    held = 0.5 * (torque + _shifted(torque, -1))
    if motion.friction_Nm is None:
        torque, held = _averaged_torque(torque, wheel)
    # From friction without a shift: a delay enlarges only few of its differences.
    std = spread_of_differences(torque - accelerating, lag, motion.torque_step_Nm)
    # Only steps of the accelerating torque are used: where friction jumps, the torque may step without dω/dt.
    stepped = np.abs(np.nan_to_num(_difference(accelerating, lag))) > STEP_STDS * std
    if std == 0.0 or not stepped.any():
        return None
    near = binary_dilation(stepped, iterations=int(halves[-1]) // 2 + lag)
    moved = [_shifted(held if half % 2 else torque, (int(half) + 1) // 2) for half in halves]
    differences = np.stack([_difference(late - accelerating, lag) for late in moved])
    # Friction steps at a reversal: shifted, that step is mistaken for the pulse of a delay.
    turning = binary_dilation(_near_reversals(motion, lag), iterations=int(halves[-1]) // 2)
    near &= np.isfinite(differences).all(axis=0) & ~turning
    squares = (differences[:, near] / std) ** 2 / lag
    if squares.shape[1] == 0:
        return None
    # Each slot is assigned to the nearest step; steps that follow closely count as one.
    first = np.flatnonzero(np.diff(stepped.astype(np.int8), prepend=0) > 0)
    first = first[np.diff(first, prepend=-np.inf) > lag + SLOPE_REACH]
    owner = np.searchsorted(0.5 * (first[1:] + first[:-1]), np.flatnonzero(near))
    of_step: FloatArray = np.stack([np.bincount(owner, row, first.size) for row in squares], axis=1)
    return of_step[np.bincount(owner, minlength=first.size) > 0], squares.shape[1] / lag


def _averaged_torque(torque: FloatArray, wheel: Wheel) -> tuple[FloatArray, FloatArray]:
    """Return the torque averaged as the derivative averages dω/dt, float64 (n,); see `torque_balance.rounding_error`.

    The first assumes linear interpolation between samples, the second a zero-order hold, which is half a slot late.
    """
    between = torque_balance.weights_between(wheel)
    held = np.concatenate([between[::-1], between, [0.0]])  # weights of the intervals between slots -half … half
    straight = 0.5 * (held + held[::-1])
    first, second = (correlate1d(torque, kernel, mode="constant", cval=np.nan) for kernel in (straight, held))
    return first, second


def aligned(motion: Motion, wheel: Wheel, slots: int, part: float) -> Motion:
    """Return the motion with a delay removed from the torque, and from given friction, which was derived from it.

    A fraction of a slot is corrected by the slope of the accelerating torque over several slots, because a mean of two
    neighbours would autocorrelate the noise. Within SLOPE_REACH of its steps slots are not corrected, and given
    friction is NaN within STEP_MARGIN; where friction is derived, steps are left out with it.
    """
    if motion.torque_Nm is None or (slots == 0 and part == 0.0):
        return motion
    torque, friction = _shifted(motion.torque_Nm, slots), motion.friction_Nm
    if friction is not None:
        friction = friction + torque - motion.torque_Nm
    if part:
        accelerating, lag = _accelerating(motion, wheel)
        std = spread_of_differences(torque if friction is None else friction, lag, motion.torque_step_Nm)
        steps = np.abs(np.nan_to_num(_difference(accelerating, lag))) > STEP_STDS * std
        if friction is not None:  # it steps where the direction changes
            steps |= np.nan_to_num(_difference(np.sign(motion.speed_rad_s), 1)) != 0.0
        around = np.arange(-SLOPE_REACH, SLOPE_REACH + 1)
        slope = correlate1d(accelerating, around / float(around @ around), mode="constant", cval=np.nan)
        late = part * np.nan_to_num(slope)
        late[binary_dilation(steps, iterations=SLOPE_REACH)] = 0.0
        torque = torque + late
        if friction is not None:
            late[binary_dilation(steps, iterations=STEP_MARGIN)] = np.nan
            friction = friction + late
    return replace(motion, torque_Nm=torque, friction_Nm=friction)


def _difference(values: FloatArray, lag: int) -> FloatArray:
    return values - _shifted(values, -lag)


def _shifted(values: FloatArray, slots: int) -> FloatArray:
    """Return the values `slots` later, float64 (n,), NaN beyond the ends."""
    out = np.full(values.size, np.nan)
    if slots >= 0:
        out[: values.size - slots] = values[slots:]
    else:
        out[-slots:] = values[:slots]
    return out
