"""Viscous asymmetry: another viscous slope in each direction of rotation."""

from __future__ import annotations

import numpy as np

from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import Channels, MeanEffect, Parameter, Shape


class ViscousAsymmetry(MeanEffect):
    """A viscous coefficient that differs between the two directions.

    Lubricant is pumped and thrown differently in the two directions: the viscous coefficient is f_v + D_v one way and
    f_v − D_v the other way.

    What shows it
    -------------
    Another slope in each direction.

    See Also
    --------
    torque_bias, coulomb_asymmetry

    References
    ----------
    B. Armstrong-Hélouvry, P. Dupont, C. Canudas de Wit, Automatica 30(7), 1994 (direction-dependent viscous friction).
    A few per cent is a working assumption.
    """

    name = "viscous_asymmetry"
    title = "Viscous asymmetry"
    formula = r"\tau = D_v\, |\omega|"
    separate_by = "Both directions at two speeds each."
    parity = "even"
    scales_with_viscous = True
    parameters = (Parameter("strength_Nm_s_rad", "N m s/rad", -np.inf, np.inf, 3.0e-7, linear=True),)

    @classmethod
    def column(cls, channels: Channels, shape: Shape) -> FloatArray:
        return np.abs(channels.speed_rad_s)
