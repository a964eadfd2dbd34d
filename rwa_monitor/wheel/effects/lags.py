"""Drag that depends on the past: it lags the speed, or the sign of the speed, or drifts with time."""

from typing import Final

import numpy as np

from rwa_monitor.kernels.effects import dahl_bristle, first_order_lag
from rwa_monitor.samples import SECONDS_PER_HOUR, FloatArray
from rwa_monitor.wheel.effects.base import Channels, MeanEffect, Memory, Parameter, Shape, follow, stack
from rwa_monitor.wheel.effects.tachometer import SpeedDeadZone

MOST_TRAILING: Final = 5.0  # of the viscous friction: a working assumption
FASTEST_S: Final = 10.0  # of a lubricant, see `source`; faster lags are the drive's


def _shown_lag(channels: Channels) -> tuple[float, float]:
    """Return 10 s, or ten slots (shorter mimics dω/dt), and the record's length (longer mimics ω and a drift)."""
    return max(10.0 * channels.sample_period_s, FASTEST_S), channels.duration_s


class LubricantLag(MeanEffect):
    """Drag that depends on how long ago the speed changed.

    After a change of speed the lubricant needs time to redistribute and to reach its new temperature: the drag
    overshoots (b > 0) or trails (b < 0) and relaxes with a time constant. At constant speed it vanishes.

    What shows it
    -------------
    An exponential relaxation after each slew, in proportion to the change of speed.

    See Also
    --------
    viscosity_temperature, inertia_error, run_in_drift

    References
    ----------
    That lubricant distribution governs the drag of wheels in flight: the paper, section III, and its reference of 2015,
    taken to be A. Y. Lee, E. K. Wang, In-flight performance of Cassini reaction wheel bearing drag in 1997–2013,
    Journal of Spacecraft and Rockets 52(2), 2015. The first-order form and its range, 10 s to 30 min, are working
    assumptions; what relaxes within a second is the drive's or a filter's, not a lubricant's.
    """

    name = "lubricant_lag"
    follows_acceleration = True
    formula = r"\tau = b\, (\omega - \omega_f), \qquad T_f\, \dot\omega_f = \omega - \omega_f"
    separate_by = "Speed steps after dwells of different length."
    parameters = (
        Parameter("strength_Nm_s_rad", "N m s/rad", -np.inf, np.inf, 1.0e-6, linear=True),
        Parameter("time_constant_s", "s", 1.0, 1.0e4, 120.0, shown=_shown_lag),
    )

    @classmethod
    def columns(cls, channels: Channels, shape: Shape, memory: Memory = None) -> tuple[FloatArray, Memory]:
        speed, period_s = channels.speed_rad_s, channels.sample_period_s
        lagged, state = follow(first_order_lag, speed, channels.moving, period_s, shape["time_constant_s"], memory)
        return stack(speed - lagged), state

    @classmethod
    def is_possible(cls, strengths: FloatArray, dry_Nm: float, viscous_Nm_s_rad: float) -> bool:
        """Return whether trailing drag (b < 0) is at most a few times the viscous friction."""
        return float(strengths[0]) >= -MOST_TRAILING * viscous_Nm_s_rad


SEEN_SLOTS: Final = 3  # after a reversal: fewer do not determine a shape


def _slot_at_reversal(channels: Channels) -> float:
    """Return half the angle that a slot at a reversal covers, |dω/dt|·Δt²/2 [rad]."""
    return 0.5 * channels.speed_step_rad_s * channels.sample_period_s


def _shown_angle(channels: Channels) -> tuple[float, float]:
    return _slot_at_reversal(channels), 0.1 * float(channels.used_speed_rad_s.mean()) * channels.duration_s


class Presliding(MeanEffect):
    """Drag that lags the sign of the speed by a fixed angle, as an elastic bristle does.

    Contacts are elastic before they slide: after a reversal the Coulomb friction does not change sign at once but while
    the wheel turns by a few breakaway angles. The base law already holds the sign, so the effect is the difference.

    What shows it
    -------------
    After each reversal the drag lags the sign, by a fixed angle whatever the acceleration.

    See Also
    --------
    current_delay, stribeck, speed_dead_zone

    References
    ----------
    P. R. Dahl, A Solid Friction Model, Aerospace Corporation TOR-0158(3107-18)-1, 1968; C. Canudas de Wit et al., IEEE
    TAC 40(3), 1995 (LuGre: with `stribeck` on top). The range 1e-3 to 5e-2 rad is a working assumption for preloaded
    pairs of ball bearings.
    """

    name = "presliding"
    title = "Presliding (Dahl)"
    formula = (
        r"\dot z = \omega - |\omega|\, z / z_c, \qquad \tau = \tau_C \left(z / z_c - "
        r"\operatorname{sign}(\omega)\right)"
    )
    separate_by = "Reversals at two accelerations: a fixed angle, a fixed time and a fixed speed then part."
    parameters = (
        Parameter("strength_Nm", "N m", 0.0, np.inf, 1.6e-3, linear=True),
        Parameter("breakaway_angle_rad", "rad", 1e-6, 10.0, 2.0e-2, shown=_shown_angle),
    )

    @classmethod
    def columns(cls, channels: Channels, shape: Shape, memory: Memory = None) -> tuple[FloatArray, Memory]:
        speed, period_s = channels.speed_rad_s, channels.sample_period_s
        bristle, state = follow(dahl_bristle, speed, channels.moving, period_s, shape["breakaway_angle_rad"], memory)
        return stack(bristle - channels.direction), state

    @classmethod
    def unresolved_as(cls, channels: Channels, shape: Shape) -> str:
        """Return the dead zone where a reversal at the usual |dω/dt| turns through the angle in less than SEEN_SLOTS.

        Then only the first samples after a change of sign are off.
        """
        return "" if shape["breakaway_angle_rad"] >= SEEN_SLOTS**2 * _slot_at_reversal(channels) else SpeedDeadZone.name


def _shown_drift(channels: Channels) -> tuple[float, float]:
    """Return a twentieth of the record (shorter: a transient at its start) and ten records (longer: a ramp)."""
    return 0.05 * channels.duration_s, 10.0 * channels.duration_s


class RunInDrift(MeanEffect):
    """A slow drift of the dry friction, from a ramp to an exponential.

    Surfaces run in and lubricant migrates: the level of the dry friction drifts, at first with the rate a. In run-in it
    falls and settles with a time constant. Wear or loss of lubricant makes it rise and does not settle: that is the
    plain ramp of a time constant beyond the record. Time starts with the record, not with the bearing's life: a is the
    rate at the first sample, and records of different age need strengths of their own.

    What shows it
    -------------
    A slow ramp of the level, which a segmentation otherwise follows by many small jumps.

    See Also
    --------
    viscosity_temperature, lubricant_lag

    References
    ----------
    B. J. Hamrock, S. R. Schmid, B. O. Jacobson, Fundamentals of Fluid Film Lubrication, 2004 (running-in of rolling
    contacts, qualitative). Hours and longer; the exponential form is a working assumption.
    """

    name = "run_in_drift"
    title = "Run-in drift"
    formula = (
        r"\tau = a\, T_d \left(1 - e^{-t / T_d}\right) \operatorname{sign}(\omega) \;\to\; a\, t\, "
        r"\operatorname{sign}(\omega) \text{ for } T_d \to \infty"
    )
    separate_by = "Long records over several windows, at constant temperature."
    parameters = (
        Parameter("strength_Nm_s", "N m/s", -np.inf, np.inf, -5.0e-9, linear=True),
        Parameter("time_constant_s", "s", 1.0, 1.0e9, 1.0e5, shown=_shown_drift),
    )
    shows_at_one_speed = True
    changes_with_time = True
    of_one_recording = True
    unmeasured_cause = "viscosity_temperature"

    @classmethod
    def column(cls, channels: Channels, shape: Shape) -> FloatArray:
        time_constant_s = shape["time_constant_s"]
        settled = -time_constant_s * np.expm1(-channels.time_s / time_constant_s)
        return channels.direction * settled

    @classmethod
    def largest_share(cls, channels: Channels) -> float:
        """Return the record's length in hours, at most 1: run-in takes hours and longer (see `source`)."""
        return min(channels.duration_s / SECONDS_PER_HOUR, 1.0)
