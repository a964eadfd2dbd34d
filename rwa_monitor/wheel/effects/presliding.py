"""Presliding (Dahl): after a reversal the drag follows the sign only after a fixed angle."""

from __future__ import annotations

from typing import Final

import numpy as np

from rwa_monitor.kernels.effects import dahl_bristle
from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import Channels, MeanEffect, Memory, Parameter, Shape, begun, follow, stack
from rwa_monitor.wheel.effects.speed_dead_zone import SpeedDeadZone

SEEN_SLOTS: Final = 3  # after a reversal: fewer have no shape


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
        speed, state = channels.speed_rad_s, begun(memory, np.nan, np.nan)
        scale_rad, period_s = shape["breakaway_angle_rad"], channels.sample_period_s
        bristle = follow(dahl_bristle, speed, channels.moving, period_s, scale_rad, state)
        return stack(bristle - channels.direction), state

    @classmethod
    def unresolved_as(cls, channels: Channels, shape: Shape) -> str:
        """Return the dead zone where a reversal at the usual |dω/dt| turns through the angle in less than SEEN_SLOTS.

        Then only the first samples after a change of sign are off.
        """
        return "" if shape["breakaway_angle_rad"] >= SEEN_SLOTS**2 * _slot_at_reversal(channels) else SpeedDeadZone.name
