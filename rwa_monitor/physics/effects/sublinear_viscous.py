"""Sublinear viscous drag: grows less than in proportion to the speed."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rwa_monitor.physics.effects.base import Channels, MeanEffect, Memory, Parameter
from rwa_monitor.physics.effects.columns import stack
from rwa_monitor.samples import FloatArray


class SublinearViscous(MeanEffect):
    """Drag that grows as a power of the speed below one."""

    name = "sublinear_viscous"
    title = "Sublinear viscous drag"
    formula = (
        r"\tau = c\, \left|\omega / \omega_1\right|^{p}\, \operatorname{sign}(\omega), \qquad \omega_1 = "
        r"1\,\mathrm{rad/s}"
    )
    description = (
        "The hydrodynamic rolling torque of an oil-lubricated bearing grows as a power of the speed below one "
        "(Palmgren 2/3, SKF 0.6), as starvation and shear heating thin the film. The strength is the drag at 1 "
        "rad/s."
    )
    signature = "A residual that is concave in |ω|: steep near zero, bent towards the slope at high speed."
    confused_with = ("stribeck", "quadratic_drag", "presliding", "speed_dead_zone")
    separate_by = (
        "Dwells over the whole speed range (the sign of the curvature), and whether it scales with temperature."
    )
    source = (
        "A. Palmgren, Ball and Roller Bearing Engineering, 3rd ed., 1959 (exponent 2/3); SKF, Rolling Bearings "
        "catalogue, the SKF model for the frictional moment (exponent 0.6 in the rolling term)."
    )
    parameters = (
        Parameter("strength_Nm", "N m", 0.0, np.inf, 1.0e-4, linear=True),
        Parameter("exponent", "-", 0.3, 0.9, 2.0 / 3.0),
    )

    @classmethod
    def columns(
        cls, channels: Channels, shape: Mapping[str, float], memory: Memory = None
    ) -> tuple[FloatArray, Memory]:
        del memory
        return stack(channels.direction * np.power(np.abs(channels.speed_rad_s), shape["exponent"])), None
