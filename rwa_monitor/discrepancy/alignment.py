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
from typing import Final, NamedTuple, Self

import numpy as np
from scipy import stats
from scipy.ndimage import binary_dilation, correlate1d, find_objects, label

from rwa_monitor.discrepancy.derived_friction import Motion, spread_of_differences
from rwa_monitor.samples import BoolArray, FloatArray, IntArray
from rwa_monitor.wheel import torque_balance
from rwa_monitor.wheel.wheel import Wheel

LONGEST_S: Final = 5.0  # longest delay that is tried (`CurrentDelay`)
MOST_SLOTS: Final = 40  # the same in slots
OF_A_SWEEP: Final = 0.25  # longest delay that is tried, of the time between two changes of direction
STEP_STDS: Final = 10.0  # standard deviations of friction's differences, above which the accelerating torque steps
FEWEST_STEPS: Final = 3  # that must be observed
MOST_STEPS: Final = 0.6  # share of the steps that must each confirm the delay
STEP_ROUGHNESS: Final = 10.0  # times the roughness due to noise, above which a step is informative
RESIDUAL_SHARE: Final = 0.5  # of the roughness of a step may remain after a shift by whole slots
RESIDUAL_SHARE_HALF: Final = 0.2  # the same by half a slot: a mean of two slots halves the roughness of any step
LEAST_ROUGHNESS: Final = 2.0  # times the roughness due to noise, below which no delay is sought
WITHIN_A_SLOT: Final = 1.0 / 12.0  # slots²: variance of a uniform position within a slot
HELD_WITHIN: Final = 0.05  # slots of -½, within which the torque is taken as held from sample to sample
HELD_STDS: Final = 3.0  # the same in standard deviations of the delay
IMPULSE_RESIDUAL: Final = 0.2  # of the sum of their squares may remain with a delay of a fraction of a slot
CHANCE: Final = 1e-6  # probability of a false alarm for impulses without a delay
PULSE_REACH: Final = 2  # slots on each side of a step that its pulse occupies, plus the whole slots of a delay
LONGEST_STEP: Final = 5  # slots; longer ramps are left to the first-order effect
REACH: Final = 3  # slots on each side, from which friction without a pulse and the slope of the torque are estimated


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


class _Balance(NamedTuple):
    """The torques of a motion, float64 (n,) [N m].

    `accelerating`: that accelerates the rotor, motor torque minus friction, or J·dω/dt where friction is to be derived;
    a step of it extends over `lag` slots. `straight` and `held`: the motor torque averaged as the derivative averages
    dω/dt, with linear interpolation between samples, and with a zero-order hold, which is half a slot late.
    """

    speed_rad_s: FloatArray
    motor: FloatArray
    quantisation_step: float
    accelerating: FloatArray
    lag: int
    straight: FloatArray
    held: FloatArray

    @classmethod
    def of(cls, motion: Motion, wheel: Wheel) -> Self | None:
        """Return the torques of a motion; None without a motor torque, or without an inertia where one is needed."""
        torque, friction, speed = motion.torque_Nm, motion.friction_Nm, motion.speed_rad_s
        if torque is None or (friction is None and wheel.inertia_kg_m2 is None):
            return None
        if friction is not None:
            held = 0.5 * (torque + _shifted(torque, -1))
            return cls(speed, torque, motion.torque_step_Nm, torque - friction, 1, torque, held)
        derivative, period_s = wheel.friction.derivative, wheel.sample_period_s
        accelerating = torque_balance.inertia_of(wheel) * torque_balance.differentiate(speed, derivative, period_s)
        lag = torque_balance.half_width(derivative, period_s)
        between = torque_balance.weights_between(wheel)  # see `torque_balance.rounding_error`
        hold = np.concatenate([between[::-1], between, [0.0]])  # weights of the intervals between slots -half … half
        straight, held = (
            correlate1d(torque, kernel, mode="constant", cval=np.nan) for kernel in (0.5 * (hold + hold[::-1]), hold)
        )
        return cls(speed, torque, motion.torque_step_Nm, accelerating, lag, straight, held)

    def steps(self, friction: FloatArray) -> tuple[BoolArray, float]:
        """Return where the accelerating torque steps, bool (n,), and the noise in the differences of a friction [N m].

        Where friction jumps, the motor's torque may step without dω/dt.
        """
        std = spread_of_differences(friction, self.lag, self.quantisation_step)
        return np.abs(np.nan_to_num(_difference(self.accelerating, self.lag))) > STEP_STDS * std, std

    def near_reversals(self, lag: int) -> BoolArray:
        """Return the slots whose differences over a lag, of means over `lag` slots each way, span a reversal; (n,)."""
        sign = np.sign(self.speed_rad_s)
        turns: BoolArray = binary_dilation(np.diff(sign, append=sign[-1]) != 0, iterations=2 * lag)
        return turns


def find_delay(motions: Sequence[Motion], wheel: Wheel) -> Delay | None:
    """Return the delay of the current relative to the speed; None where it is not found."""
    balances = [balance for motion in motions if (balance := _Balance.of(motion, wheel)) is not None]
    if not balances:
        return None
    known = [balance.speed_rad_s[np.isfinite(balance.speed_rad_s)] for balance in balances]
    turns = sum(int(np.count_nonzero(np.diff(np.sign(speed)))) for speed in known)
    between = sum(speed.size for speed in known) // (turns + 1)
    most = max(1, min(int(LONGEST_S / wheel.sample_period_s), MOST_SLOTS, int(OF_A_SWEEP * between)))
    return _by_steps(balances, most) or _by_best_fit(balances, most)


def _by_steps(balances: Sequence[_Balance], most: int) -> Delay | None:
    """Return the delay, of at most so many slots, from steps of the torque; None where they do not show one."""
    halves = np.arange(-2 * most, 2 * most + 1)
    at = 2 * most  # no shift
    around = [_roughness(balance, halves) for balance in balances]
    of_step, noise = np.concatenate([one for one, _ in around]), sum(noise for _, noise in around)
    rough = of_step.sum(axis=0)
    if of_step.shape[0] < FEWEST_STEPS or rough[at] < LEAST_ROUGHNESS * noise:
        return None
    found = _by_pulse_removal(halves, of_step, noise)
    of_impulses = _by_impulse(balances, PULSE_REACH + abs(0 if found is None else found.slots))
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


def _by_impulse(balances: Sequence[_Balance], reach: int) -> tuple[float, float] | None:
    """Return the delay and its standard deviation [slots] from impulses of the friction; None if not significant.

    A torque that steps by h and is read d later causes a pulse with impulse -d·h in the friction, independent of its
    position in a slot, of its duration, and of a filter of dω/dt. d is the slope of a line through the origin, by least
    squares.
    """
    impulse, step, noise = np.concatenate([_impulses(balance, reach) for balance in balances], axis=1)
    if impulse.size < FEWEST_STEPS or not step.any():
        return None
    energy, late = float(step @ step), -float(impulse @ step / (step @ step))
    left = impulse + late * step
    if left @ left > IMPULSE_RESIDUAL * (impulse @ impulse):
        return None
    # A few impulses may lie on a line by chance: their scatter is taken as at least that of the noise.
    std = float(np.sqrt(max(left @ left / (impulse.size - 1), np.mean(noise**2)) / energy))
    return (late, std) if 2.0 * stats.norm.sf(abs(late), scale=std) <= CHANCE else None


def _by_best_fit(balances: Sequence[_Balance], most: int) -> Delay | None:
    """Return the delay, in whole slots, with which dry and viscous friction, an offset and an inertia error fit best.

    Differences over a lag longer than all shifts are fitted, in which a jump of the friction is short. A shift that is
    off by x adds a sum of squares in proportion to x²: at twice the delay it is that at none. A part of a slot is left
    to the first-order effect.
    """
    products, size, count = np.zeros((2 * most + 5, 2 * most + 5)), 0, 0
    for balance in balances:
        speed, accelerating, lag = balance.speed_rad_s, balance.accelerating, balance.lag
        law = (np.sign(speed), speed, accelerating, np.ones(speed.size))
        shifted = (_shifted(balance.straight, slots) - accelerating for slots in range(-most, most + 1))
        rows = np.stack([_difference(row, most + 2 * lag) for row in (*law, *shifted)])
        rows = rows[:, np.isfinite(rows).all(axis=0) & ~balance.near_reversals(max(lag, most))]
        products += rows @ rows.T
        size, count = size + speed.size, count + rows.shape[1]
    if count < 0.5 * size:
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


def _impulses(balance: _Balance, reach: int) -> FloatArray:
    """Return for each step of the torque the impulse of friction relative to its surroundings, the step, and the noise.

    float64 (3, steps) [N m slots, N m, N m slots]. A pulse extends up to `reach` slots on each side of its step,
    beside the slots over which the derivative spreads it. Steps with a change of direction nearby are excluded.
    """
    speed, accelerating, lag = balance.speed_rad_s, balance.accelerating, balance.lag
    friction, reach = balance.motor - accelerating, reach + lag - 1
    stepped, std = balance.steps(friction)
    found = []
    for (pulse,) in find_objects(label(binary_dilation(stepped, iterations=reach))[0]):
        begin, end = pulse.start - REACH, pulse.stop + REACH
        slots = pulse.stop - pulse.start
        if begin < 0 or end > friction.size or slots > LONGEST_STEP + 2 * (reach + lag - 1):
            continue
        if np.ptp(np.sign(speed[begin:end])) != 0:
            continue
        before, after = slice(begin, pulse.start), slice(pulse.stop, end)
        # The friction without a pulse is interpolated over the speed, which it depends on, and not over time.
        first, last = float(speed[before].mean()), float(speed[after].mean())
        share = np.clip((speed[pulse] - first) / (last - first), 0.0, 1.0) if last != first else 0.5
        without = friction[before].mean() * (1.0 - share) + friction[after].mean() * share
        # Noise of the summed slots, and of the friction subtracted, a mean over REACH slots on each side.
        noise = std / np.sqrt(2.0) * np.sqrt(slots + slots**2 / (2 * REACH))
        step = accelerating[after].mean() - accelerating[before].mean()
        found.append((np.sum(friction[pulse] - without), step, noise))
    impulses = np.array(found, dtype=np.float64).reshape(-1, 3)
    return np.ascontiguousarray(impulses[np.isfinite(impulses[:, :2]).all(axis=1)].T)


def _roughness(balance: _Balance, halves: IntArray) -> tuple[FloatArray, float]:
    """Return the roughness of friction around each step with each shift, float64 (steps, shifts), and that of noise.

    Roughness is the sum of squared differences over a lag, divided by their noise variance and by the lag.
    """
    accelerating, lag, reach = balance.accelerating, balance.lag, int(halves[-1]) // 2
    # From friction without a shift: a delay enlarges only few of its differences.
    stepped, std = balance.steps(balance.straight - accelerating)
    if std == 0.0 or not stepped.any():
        return np.zeros((0, halves.size)), 0.0
    moved = [_shifted(balance.held if half % 2 else balance.straight, (int(half) + 1) // 2) for half in halves]
    differences = np.stack([_difference(late - accelerating, lag) for late in moved])
    # Friction steps at a reversal: shifted, that step is mistaken for the pulse of a delay.
    turning = binary_dilation(balance.near_reversals(lag), iterations=reach)
    near = binary_dilation(stepped, iterations=reach + lag) & np.isfinite(differences).all(axis=0) & ~turning
    squares = (differences[:, near] / std) ** 2 / lag
    # Each slot is assigned to the nearest step; steps that follow closely count as one.
    first = np.flatnonzero(np.diff(stepped.astype(np.int8), prepend=0) > 0)
    first = first[np.diff(first, prepend=-np.inf) > lag + REACH]
    owner = np.searchsorted(0.5 * (first[1:] + first[:-1]), np.flatnonzero(near))
    of_step: FloatArray = np.stack([np.bincount(owner, row, first.size) for row in squares], axis=1)
    return of_step[np.bincount(owner, minlength=first.size) > 0], squares.shape[1] / lag


def aligned(motion: Motion, wheel: Wheel, slots: int, part: float) -> Motion:
    """Return the motion with a delay removed from the torque, and from given friction, which was derived from it.

    A fraction of a slot is corrected by the slope of the accelerating torque over several slots, because a mean of two
    neighbours would autocorrelate the noise. Within REACH slots of its steps it is not corrected, and given friction is
    NaN beside a step; where friction is derived, steps are left out with it.
    """
    balance, friction = _Balance.of(motion, wheel), motion.friction_Nm
    if balance is None or (slots == 0 and part == 0.0):
        return motion
    torque = _shifted(balance.motor, slots)
    if friction is not None:
        friction = friction + torque - balance.motor
    if part:
        steps, _ = balance.steps(torque if friction is None else friction)
        if friction is not None:  # it steps where the direction changes
            steps |= np.nan_to_num(_difference(np.sign(motion.speed_rad_s), 1)) != 0.0
        around = np.arange(-REACH, REACH + 1)
        slope = correlate1d(balance.accelerating, around / float(around @ around), mode="constant", cval=np.nan)
        late = part * np.nan_to_num(slope)
        late[binary_dilation(steps, iterations=REACH)] = 0.0
        torque = torque + late
        if friction is not None:
            late[binary_dilation(steps)] = np.nan
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
