"""Sublinear viscous drag: grows less than in proportion to the speed."""

from __future__ import annotations

from typing import Final

import numpy as np

from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import Channels, MeanEffect, Parameter, Shape
from rwa_monitor.wheel.effects.viscosity_temperature import REFERENCE_K, ZERO_CELSIUS_K, temperature_varies

ACTIVATION_REACH_K: Final = 3000.0  # [K] of a round of fitting; several follow each other


def _activation_reach(channels: Channels) -> float:
    return ACTIVATION_REACH_K if temperature_varies(channels) else 0.0


class SublinearViscous(MeanEffect):
    """Drag that grows as a power of the speed below one.

    The rolling torque of an oil-lubricated bearing grows as a power of the speed below one. Palmgren's law is
    empirical: ∝ (νn)^(2/3) from νn = 2000 mm²/s·r/min on, constant below. In SKF's model the rolling term is ∝
    (νn)^0.6, with inlet shear heating and replenishment or starvation as two further factors, both falling with the
    speed: they lower the apparent exponent and are not where the 0.6 comes from. The strength is the drag at 1 rad/s
    and 20 °C. Viscosity enters with the same power as the speed: where the bearing's temperature is recorded and
    varies, the oil's B (Andrade's law, see `viscosity_temperature`) is fitted, too, if that pays; B = 0 is a drag that
    does not follow the temperature.

    What shows it
    -------------
    A residual that is concave in |ω|: steep near zero, bent towards the slope at high speed; it shrinks as the bearing
    warms.

    See Also
    --------
    stribeck, quadratic_drag, presliding, speed_dead_zone, viscosity_temperature

    References
    ----------
    A. Palmgren, Ball and Roller Bearing Engineering, 3rd ed., 1959 (exponent 2/3, constant below νn = 2000); SKF,
    Rolling Bearings catalogue, the SKF model for the frictional moment (G_rr (νn)^0.6 with the factors φ_ish and φ_rs).
    Both laws are for bearings of machines; that they hold for lightly loaded, sparsely oiled wheel bearings is an
    assumption.
    """

    name = "sublinear_viscous"
    title = "Sublinear viscous drag"
    formula = (
        r"\tau = c \left(\frac{\nu(T)}{\nu_0} \left|\frac{\omega}{\omega_1}\right|\right)^{p} "
        r"\operatorname{sign}(\omega), \qquad \frac{\nu(T)}{\nu_0} = e^{B \left(1/T - 1/T_0\right)}, \quad \omega_1 = "
        r"1\,\mathrm{rad/s}, \quad T_0 = 293.15\,\mathrm{K}"
    )
    separate_by = (
        "Dwells over the whole speed range (the sign of the curvature), at two temperatures of the bearing, recorded: "
        "the whole drag shrinks by the same share, that of `viscosity_temperature` in proportion to the speed."
    )
    parameters = (
        Parameter("strength_Nm", "N m", 0.0, np.inf, 1.0e-4, linear=True),
        Parameter("exponent", "-", 0.3, 0.9, 2.0 / 3.0),
        Parameter("activation_temperature_K", "K", 0.0, 8000.0, 0.0, False, (0.0,), 0.0, _activation_reach),
    )

    @classmethod
    def column(cls, channels: Channels, shape: Shape) -> FloatArray:
        """Return the drag, less as the bearing warms where B is not zero."""
        drag = channels.direction * np.power(np.abs(channels.speed_rad_s), shape["exponent"])
        activation_K = shape["activation_temperature_K"]
        if activation_K != 0.0:
            temperature_K = channels.optional("bearing_temperature_degC") + ZERO_CELSIUS_K
            drag = drag * np.exp(shape["exponent"] * activation_K * (1.0 / temperature_K - 1.0 / REFERENCE_K))
        return drag
