"""The wheel's motion as commanded by an attitude control system: speed and its exact derivative.

A wheel stores the momentum that disturbances put into the spacecraft, so its speed oscillates with the orbit; slews add
accelerate–hold–brake moves; the control loop adds a small band-limited activity. Every part is an analytic function of
time with an analytic derivative, so that torque and speed are consistent to rounding. All speeds are in units of the
wheel's nominal speed until the end, all randomness comes from the generator passed in.
"""

from collections.abc import Callable
from typing import Annotated, Final, Literal, NamedTuple

import numpy as np
from numpy.random import Generator
from pydantic import Field

from rwa_monitor.errors import InputError
from rwa_monitor.samples import SECONDS_PER_HOUR, FloatArray
from rwa_monitor.wheel.file_content import Strict
from rwa_monitor.wheel.wheel import Wheel

ProfileKind = Literal["orbit", "one_direction", "crossings", "rich", "constant", "from_rest"]

ORBIT_S: Final = 5400.0  # s, period of a low orbit (about 400 km)
SLEW_S: Final = (60.0, 240.0)  # s, one move of a slew: an agile spacecraft turns in minutes
ACTIVITY_PERIOD_S: Final = (20.0, 200.0)  # s, band of the attitude loop's activity: bandwidth 0.005–0.05 Hz
ACTIVITY_TONES: Final = 8  # sinusoids, enough that the activity does not repeat within a record
# A smooth rise and fall of the acceleration over the first and last fifth of a move keeps the jerk finite, as a slew
# profile does.
ROUNDED: Final = 0.2  # share of a move over which the acceleration rises, and falls
CURRENT_RESERVE: Final = 0.8  # share of the maximum current that a planned acceleration may take
SPEED_RESERVE: Final = 0.97  # share of the maximum speed that a profile may reach
ROUNDING: Final = 1.0e-12  # relative: largest residual of sums that cancel
UNLIMITED_ACCELERATION_S: Final = 30.0  # s, from rest to the nominal speed, where no maximum current is known


class SpeedProfile(Strict):
    """The commanded motion of the wheel.

    Attributes
    ----------
    kind
        "orbit": orbital momentum and slews, zero crossings in both directions. "one_direction": the same, never near
        zero. "crossings": simple zero crossings. "rich": moves at many rates, a sequence of dwells, crossings slow and
        fast, accelerating and braking both ways. "constant": one speed. "from_rest": at rest, then up and down.
    direction
        1 or -1 for profiles that have a direction ("one_direction", "constant", "from_rest"); 0 draws it.
    scale
        Largest speed aimed at, in units of the nominal speed.
    slews_per_hour
        Mean number of slews in "orbit" and "one_direction".
    activity
        RMS of the control activity, in units of the nominal speed.
    """

    kind: ProfileKind = "orbit"
    direction: Literal[-1, 0, 1] = 0
    scale: Annotated[float, Field(gt=0, le=10)] = 1.0
    slews_per_hour: Annotated[float, Field(ge=0, le=30)] = 3.0
    activity: Annotated[float, Field(ge=0, le=0.1)] = 0.001


class Motion(NamedTuple):
    """Speed and its derivative on a grid of times.

    Attributes
    ----------
    speed_rad_s, acceleration_rad_s2
        float64 (n,), ω [rad/s] and dω/dt [rad/s²].
    """

    speed_rad_s: FloatArray
    acceleration_rad_s2: FloatArray


def simulate_motion(profile: SpeedProfile, wheel: Wheel, slots: int, rng: Generator) -> Motion:
    """Draw a motion of the wheel.

    Parameters
    ----------
    profile
        What kind of motion.
    wheel
        Gives the nominal speed, the sample period and the limits that the motion respects.
    slots
        Length of the record [slots], at least 2.
    rng
        Source of all randomness.

    Returns
    -------
    Motion
        Speed and acceleration, within the wheel's limits.

    Raises
    ------
    InputError
        If the wheel has no nominal speed, or its limits leave no room for the nominal speed's profile.
    """
    if wheel.nominal is None:
        raise InputError(f"wheel {wheel.name}", "is missing; a motion needs the nominal speed", "nominal")
    unit = wheel.nominal.nominal_speed_rad_s
    time = np.arange(slots, dtype=np.float64) * wheel.sample_period_s
    plan = _Plan(time, largest_acceleration(wheel) / unit)
    _PROFILES[profile.kind](plan, profile, rng)
    limit = wheel.limits.max_speed_rad_s
    plan.shrink_to(np.inf if limit is None else SPEED_RESERVE * limit / unit)
    # Moves that add up to zero leave rounding errors; a wheel at rest has no direction.
    plan.speed[np.abs(plan.speed) < ROUNDING] = 0.0
    return Motion(plan.speed * unit, plan.acceleration * unit)


def wheel_angle(speed_rad_s: FloatArray, period_s: float) -> FloatArray:
    """Return the angle of the wheel, ∫ω dt by the trapezoidal rule.

    Parameters
    ----------
    speed_rad_s
        ω (n,), finite at every slot.
    period_s
        Slot length [s].

    Returns
    -------
    angle
        float64 (n,) [rad], 0 at the first slot.
    """
    angle = np.zeros(speed_rad_s.size)
    np.cumsum(0.5 * period_s * (speed_rad_s[1:] + speed_rad_s[:-1]), out=angle[1:])
    return angle


def largest_acceleration(wheel: Wheel) -> float:
    """Return the largest acceleration of a planned move [rad/s²], from the torque at maximum current less friction."""
    assert wheel.nominal is not None
    unit = wheel.nominal.nominal_speed_rad_s
    if wheel.limits.max_current_A is None or wheel.torque_per_ampere_Nm_A is None or wheel.inertia_kg_m2 is None:
        return unit / UNLIMITED_ACCELERATION_S
    # Three times the nominal friction at nominal speed covers switching systems and anomalies.
    friction = 3.0 * (wheel.nominal.dry_torque_Nm + wheel.nominal.viscous_Nm_s_rad * unit)
    torque = CURRENT_RESERVE * wheel.limits.max_current_A * wheel.torque_per_ampere_Nm_A - friction
    if torque <= 0:
        raise InputError(
            f"wheel {wheel.name}", "cannot overcome three times the nominal friction", "limits.max_current_A"
        )
    return min(torque / wheel.inertia_kg_m2, unit / UNLIMITED_ACCELERATION_S)


class _Plan:
    """A motion to which parts are added: speed and acceleration, in units of the nominal speed."""

    def __init__(self, time: FloatArray, fastest: float) -> None:
        self.time = time
        self.period, self.duration = float(time[1]), float(time[-1])
        self.fastest = fastest  # largest planned acceleration [1/s]
        self.speed = np.zeros(time.size)
        self.acceleration = np.zeros(time.size)

    def add_tone(self, amplitude: float, period_s: float, phase: float) -> None:
        """Add amplitude·sin(2πt/period + phase), with a longer period where it would need too much acceleration."""
        rate = 2.0 * np.pi / max(period_s, 4.0 * np.pi * abs(amplitude) / self.fastest)
        angle = rate * self.time + phase
        self.speed += amplitude * np.sin(angle)
        self.acceleration += amplitude * rate * np.cos(angle)

    def add_move(self, change: float, start_s: float, duration_s: float) -> None:
        """Change the speed by `change` from `start_s` on, by a trapezoid of acceleration with smooth flanks."""
        duration = max(duration_s, abs(change) / (self.fastest * (1.0 - ROUNDED)))
        ends = (start_s, start_s + duration)
        first, last = (int(np.clip(np.ceil(at / self.period), 0, self.time.size)) for at in ends)
        share = np.clip((self.time[first:last] - start_s) / duration, 0.0, 1.0)
        acceleration, progress = _rounded_trapezoid(share)
        self.speed[first:last] += change * progress
        self.speed[last:] += change
        self.acceleration[first:last] += change / duration * acceleration

    def add_activity(self, rms: float, rng: Generator) -> None:
        """Add the attitude loop's activity: a few tones of random period and phase."""
        if rms == 0.0:
            return
        amplitude = rms * np.sqrt(2.0 / ACTIVITY_TONES)
        for _ in range(ACTIVITY_TONES):
            self.add_tone(amplitude, np.exp(rng.uniform(*np.log(ACTIVITY_PERIOD_S))), rng.uniform(0, 2 * np.pi))

    def shrink_to(self, limit: float) -> None:
        """Scale the whole motion down if its speed exceeds `limit`, or the sum of its parts accelerates too fast."""
        fastest, steepest = (float(np.max(np.abs(part))) for part in (self.speed, self.acceleration))
        excess = max(1.0, fastest / limit, steepest / self.fastest)
        self.speed /= excess
        self.acceleration /= excess


def _rounded_trapezoid(share: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return acceleration and progress of a move from 0 to 1 at `share` of its duration (both float64 (n,))."""

    def rising(u: FloatArray) -> tuple[FloatArray, FloatArray]:
        angle = np.pi * np.minimum(u, ROUNDED) / ROUNDED
        slope = 0.5 * (1.0 - np.cos(angle))
        area = 0.5 * (np.minimum(u, ROUNDED) - ROUNDED / np.pi * np.sin(angle)) + np.maximum(u - ROUNDED, 0.0)
        return slope, area

    slope, area = rising(np.minimum(share, 1.0 - share))
    total = 1.0 - ROUNDED
    return slope / total, np.where(share <= 0.5, area, total - area) / total


def _orbit(plan: _Plan, profile: SpeedProfile, rng: Generator) -> None:
    """Add a momentum that crosses zero every half orbit, with harmonics of gravity gradient and drag, and slews."""
    swing = profile.scale * rng.uniform(0.55, 0.85)
    plan.speed += swing * rng.uniform(-0.3, 0.3)
    _add_orbits(plan, profile, rng, swing, (0.03, 0.12), 0.15)


def _one_direction(plan: _Plan, profile: SpeedProfile, rng: Generator) -> None:
    """Add the motion of an orbit with a bias that keeps the wheel away from zero: the usual way to run a wheel."""
    direction = _direction(profile, rng)
    swing = profile.scale * rng.uniform(0.15, 0.25)
    _add_orbits(plan, profile, rng, swing, (0.05, 0.15), 0.1)
    # The bias sets the lowest speed of this record to a fifth to a third of the scale, whatever was drawn above.
    slowest = profile.scale * rng.uniform(0.2, 0.33)
    plan.speed += direction * slowest - direction * float(np.min(direction * plan.speed))


def _crossings(plan: _Plan, profile: SpeedProfile, rng: Generator) -> None:
    """Add an oscillation about zero of 1.2 to 2.2 periods in the record: two to five simple crossings."""
    swing = profile.scale * rng.uniform(0.6, 0.9)
    plan.speed += swing * rng.uniform(-0.2, 0.2)
    plan.add_tone(swing, plan.duration / rng.uniform(1.2, 2.2), rng.uniform(0, 2 * np.pi))
    plan.add_activity(profile.activity, rng)


def _rich(plan: _Plan, profile: SpeedProfile, rng: Generator) -> None:
    """Add moves through a sequence of speeds in both directions, some slow and some fast, each followed by a dwell.

    The sequence includes the low speeds of boundary lubrication (1–10 % of nominal), so that dwells and slow crossings
    make effects identifiable that are not in a record of one direction.
    """
    levels = np.array([0.01, 0.03, 0.07, 0.15, 0.3, 0.5, 0.75, 1.0])
    targets = rng.permutation(np.concatenate([levels, -levels, [0.6, -0.6, 0.02, -0.02]])) * profile.scale
    # Shares of the record: moves take 55 % of it, some four times as long as others (two accelerations and more).
    moves = rng.choice([0.5, 1.0, 2.0], size=targets.size)
    dwells = rng.uniform(0.5, 1.5, size=targets.size)
    moves *= 0.55 * plan.duration / moves.sum()
    dwells *= 0.45 * plan.duration / dwells.sum()
    speed, at = float(targets[-1]), 0.0
    plan.speed += speed
    for target, move, dwell in zip(targets, moves, dwells, strict=True):
        plan.add_move(float(target) - speed, at, move)
        speed = float(target)
        at += move + dwell
    plan.add_activity(profile.activity, rng)


def _constant(plan: _Plan, profile: SpeedProfile, rng: Generator) -> None:
    plan.speed += _direction(profile, rng) * profile.scale
    plan.add_activity(profile.activity, rng)


def _from_rest(plan: _Plan, profile: SpeedProfile, rng: Generator) -> None:
    """Rest for a twentieth of the record, accelerate, dwell, brake to rest. The loop is open at rest: no activity."""
    speed = _direction(profile, rng) * profile.scale
    plan.add_move(speed, 0.05 * plan.duration, plan.duration * rng.uniform(0.25, 0.35))
    plan.add_move(-speed, 0.6 * plan.duration, plan.duration * rng.uniform(0.25, 0.35))


def _add_orbits(
    plan: _Plan,
    profile: SpeedProfile,
    rng: Generator,
    swing: float,
    share: tuple[float, float],
    largest_slew: float,
) -> None:
    """Add the orbital momentum, slews and the attitude loop's activity.

    A tone of amplitude `swing`, harmonics in the given range of shares of it, and accelerate–hold–brake moves at random
    times in both directions, up to a share of the profile's scale.
    """
    plan.add_tone(swing, ORBIT_S, rng.uniform(0, 2 * np.pi))
    for harmonic in (2, 3):
        plan.add_tone(swing * rng.uniform(*share), ORBIT_S / harmonic, rng.uniform(0, 2 * np.pi))
    largest = largest_slew * profile.scale
    for _ in range(rng.poisson(profile.slews_per_hour * plan.duration / SECONDS_PER_HOUR)):
        change = largest * rng.uniform(0.3, 1.0) * rng.choice([-1.0, 1.0])
        start = rng.uniform(0.0, plan.duration)
        move, hold = rng.uniform(*SLEW_S), rng.uniform(*SLEW_S)
        plan.add_move(change, start, move)
        plan.add_move(-change, start + move + hold, move)
    plan.add_activity(profile.activity, rng)


def _direction(profile: SpeedProfile, rng: Generator) -> float:
    drawn = float(rng.choice([-1.0, 1.0]))  # drawn always, so that a fixed direction changes nothing else
    return float(profile.direction) or drawn


_PROFILES: Final[dict[ProfileKind, Callable[[_Plan, SpeedProfile, Generator], None]]] = {
    "orbit": _orbit,
    "one_direction": _one_direction,
    "crossings": _crossings,
    "rich": _rich,
    "constant": _constant,
    "from_rest": _from_rest,
}
