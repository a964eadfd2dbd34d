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
        "The rolling torque of an oil-lubricated bearing grows as a power of the speed below one. Palmgren's law is "
        "empirical: ∝ (νn)^(2/3) from νn = 2000 mm²/s·r/min on, constant below. In SKF's model the rolling term is ∝ "
        "(νn)^0.6, with inlet shear heating and replenishment or starvation as two further factors, both falling with "
        "the speed: they lower the apparent exponent and are not where the 0.6 comes from. The strength is the drag "
        "at 1 rad/s."
    )
    signature = "A residual that is concave in |ω|: steep near zero, bent towards the slope at high speed."
    confused_with = ("stribeck", "quadratic_drag", "presliding", "speed_dead_zone")
    separate_by = (
        "Dwells over the whole speed range (the sign of the curvature), and whether it scales with temperature."
    )
    source = (
        "A. Palmgren, Ball and Roller Bearing Engineering, 3rd ed., 1959 (exponent 2/3, constant below νn = 2000); "
        "SKF, Rolling Bearings catalogue, the SKF model for the frictional moment (G_rr (νn)^0.6 with the factors "
        "φ_ish and φ_rs). Both laws are for bearings of machines; that they hold for lightly loaded, sparsely oiled "
        "wheel bearings is an assumption."
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
