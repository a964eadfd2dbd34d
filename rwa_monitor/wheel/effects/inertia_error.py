"""Inertia error: the inertia in wheel.toml is not the wheel's."""

from __future__ import annotations

import numpy as np

from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import Channels, MeanEffect, Parameter, Shape


class InertiaError(MeanEffect):
    """A part of J dω/dt that is taken for friction.

    Friction is K_T I − J dω/dt; where J is too small, a part of the accelerating torque is taken for friction. At a
    given dω/dt it is the same whichever way the wheel turns; it changes sign with dω/dt, so also when the whole motion
    is mirrored.

    What shows it
    -------------
    A torque that follows dω/dt, not the direction of rotation: in one direction it changes sign between speeding up and
    braking.

    See Also
    --------
    torque_constant_error, load_dependence, lubricant_lag, current_delay

    References
    ----------
    Follows from the torque balance of the wheel; J of wheels is usually known to 1–5 % before a calibration in flight
    (a working assumption).
    """

    name = "inertia_error"
    title = "Wrong inertia"
    follows_acceleration = True
    error_of = "inertia"
    formula = r"\tau = \delta J\, \dot\omega, \qquad \delta J = J_{\mathrm{true}} - J_{\mathrm{assumed}}"
    separate_by = (
        "From current and speed alone never from `torque_constant_error`: `motor_voltage_V` (K_E = K_T), "
        "`drive_power_W` or `body_momentum_Nms` does. From `load_dependence`: brake and accelerate in both directions."
    )
    parameters = (Parameter("strength_kg_m2", "kg m²", -np.inf, np.inf, 2.0e-4, linear=True),)

    @classmethod
    def column(cls, channels: Channels, shape: Shape) -> FloatArray:
        """Return dω/dt.

        In the search `acceleration_rad_s2` must not come from samples that enter the friction of the same slot: the two
        would share noise, and an error of inertia would be found that is not there (1.6 % at |t| = 36 in a trial).
        Derive it from neighbours outside the friction's own stencil.
        """
        return channels.acceleration_rad_s2.astype(np.float64)
