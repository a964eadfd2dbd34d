"""Torque ripple: a torque that repeats with the wheel's angle."""

from typing import Final

import numpy as np

from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import Channels, MeanEffect, Memory, Parameter, Shape, begun, since_last, stack

MAX_HARMONIC: Final = 48  # [-] per turn of the wheel: six pulses per electrical turn, up to eight pole pairs
ORDERS: Final = tuple(float(h) for h in range(1, MAX_HARMONIC + 1))
LOWEST_ORDER: Final = 0.2  # [-] need not be a whole number: a cage turns at 0.35 to 0.65 of the wheel
FEWEST_PERIODS: Final = 1.5  # within the range of the angle: with fewer, a wave is not seen to repeat
MANY_TURNS: Final = 50.0  # range of the angle in turns from which lines at fractional orders are resolved separately


def angle_turned(channels: Channels, memory: Memory = None) -> tuple[FloatArray, Memory]:
    """Return the wheel's angle [rad], float64 (n,), NaN where unknown: as measured, else the speed's integral.

    The integral uses the trapezoidal rule, also across a gap, and is 0 at the first usable slot of a record. The memory
    is the angle, the last ω, and the slots since.
    """
    if channels.measured_angle_rad is not None:
        return np.where(channels.moving, channels.measured_angle_rad, np.nan), memory
    state, angle = begun(memory, 0.0, np.nan, 0.0), np.full(len(channels), np.nan)
    at, since = since_last(channels.moving, state[2:])
    if at.size:
        speed = channels.speed_rad_s[at]
        turned = 0.5 * (np.append(state[1], speed[:-1]) + speed) * channels.sample_period_s * since
        turned[0] = 0.0 if np.isnan(state[1]) else turned[0]
        angle[at] = np.cumsum(np.append(state[0], turned))[1:]
        state[:2] = angle[at[-1]], speed[-1]
    return angle, state


def angle_range_turns(channels: Channels) -> float:
    """Return the range of the wheel's angle in turns; orders nearer than one over it cannot be distinguished."""
    angle, _ = angle_turned(channels)
    return float(np.ptp(channels.known(angle))) / (2.0 * np.pi)


def half_line_width(channels: Channels) -> float:
    """Return half an order over the range of the angle in turns: the width of a line; 0 where the turns are many."""
    turns = angle_range_turns(channels)
    return 0.5 / turns if 0.0 < turns < MANY_TURNS else 0.0


def orders_shown(channels: Channels) -> tuple[float, float]:
    """Return the lowest order that repeats within the range of the angle, and the highest order."""
    turns = angle_range_turns(channels)
    return (FEWEST_PERIODS / turns if turns > 0.0 else ORDERS[-1]), ORDERS[-1]


class TorqueRipple(MeanEffect):
    """A torque that is periodic in the wheel's angle: one harmonic and its double.

    Cogging and commutation repeat with the angle of the wheel, at whole multiples of its turns: six-step commutation
    gives 6 × pole pairs per turn, cogging whole multiples of the pole pairs. Bearings do not: the cage turns at ½ (1 −
    D_b cos α / D_p), about 0.4 of the speed where the inner ring turns, and what the balls do repeats with multiples of
    that and of their own spin, as a rule no whole orders of the wheel. Behind a gear its stages add orders of their
    own. Whole orders up to 48 are searched, and any other at which the residual of one record has a line over the
    angle. Over n turns orders nearer than 1/n cannot be distinguished: in a record of fewer than 50 the order is
    fitted, and others that fit as well are reported. Sampled slowly, the ripple shows as beats at speeds where a
    multiple of the rotation meets the sampling rate. The angle is an integral of the measured speed and loses its phase
    as the noise adds up: after n slots of speed noise σ the phase is off by h·σ·Δt·√n rad, so fit in blocks where this
    is below about one.

    What shows it
    -------------
    Beats at certain speeds; the residual repeats when it is drawn against the angle.

    See Also
    --------
    speed_dependent_noise

    References
    ----------
    P. C. Krause, O. Wasynczuk, S. D. Sudhoff, Analysis of Electric Machinery (six-step drive of brushless motors: six
    pulses per electrical turn); T. A. Harris, M. N. Kotzalas, Rolling Bearing Analysis (cage and ball frequencies); W.
    Bialke, High fidelity mathematical modeling of reaction wheel performance, AAS 98-063, 1998 (ripple and cogging of
    wheels). 0.5–2 % of full torque is a working assumption.
    """

    name = "torque_ripple"
    formula = (
        r"\tau = \sum_{m = 1, 2} \left(a_m \cos(m h \theta) + b_m \sin(m h \theta)\right), \qquad \theta = \int "
        r"\omega\, dt"
    )
    separate_by = "The residual against the angle, at low speed or with faster sampling."
    parity = "none"
    of_one_recording = True
    parameters = (
        Parameter("strength_cos_Nm", "N m", -np.inf, np.inf, 1.0e-4, linear=True),
        Parameter("strength_sin_Nm", "N m", -np.inf, np.inf, 0.0, linear=True, default=0.0),
        Parameter("strength_double_cos_Nm", "N m", -np.inf, np.inf, 0.0, linear=True, default=0.0),
        Parameter("strength_double_sin_Nm", "N m", -np.inf, np.inf, 0.0, linear=True, default=0.0),
        Parameter(
            "harmonic",
            "-",
            LOWEST_ORDER,
            ORDERS[-1],
            6.0,
            choices=ORDERS,
            between=half_line_width,
            shown=orders_shown,
        ),
    )

    @classmethod
    def columns(cls, channels: Channels, shape: Shape, memory: Memory = None) -> tuple[FloatArray, Memory]:
        """Return cos and sin of h·θ and 2·h·θ, with θ integrated here from the speed.

        At 8 Hz a wheel turns many times between two samples, so that the phase depends on how the speed is integrated:
        by rectangles it is off by half a slot's angle, which changes with the speed. So simulation and search use the
        same rule, the trapezoidal one; `Channels.angle_rad` may use another. A measured angle is used as it is.
        """
        angle, memory = angle_turned(channels, memory)
        phase = shape["harmonic"] * angle
        return stack(np.cos(phase), np.sin(phase), np.cos(2.0 * phase), np.sin(2.0 * phase)), memory

    @classmethod
    def plainer_shape(cls, shape: Shape) -> dict[str, float] | None:
        """Return twice the order, which is the order where only the double harmonic is present."""
        double = 2.0 * shape["harmonic"]
        return {"harmonic": double} if double <= ORDERS[-1] else None


def coherent_slots(harmonic: float, speed_noise_rad_s: float, sample_period_s: float) -> int:
    """Return the slots after which white noise of the speed makes the phase of a harmonic drift by one radian (std)."""
    step, most = harmonic * speed_noise_rad_s * sample_period_s, int(np.iinfo(np.int32).max)
    return int(min(1.0 / step**2, most)) if step > 0 else most
