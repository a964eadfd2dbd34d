"""Viscosity and temperature: the viscous slope follows the lubricant's viscosity."""

from __future__ import annotations

from typing import Final

import numpy as np

from rwa_monitor.kernels.effects import first_order_lag
from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import Channels, MeanEffect, Memory, Parameter, Shape, follow, stack

ZERO_CELSIUS_K: Final = 273.15  # [K]
ORIGIN_degC: Final = 20.0  # where laws of the temperature are one or zero: a convention
REFERENCE_K: Final = ZERO_CELSIUS_K + ORIGIN_degC  # [K] where ν = ν₀: it shifts strength into the base slope
LEAST_K: Final = 0.5  # [K] within a record: less is the resolution of a housekeeping sensor, and shows no lag
LAG_REACH_S: Final = 300.0  # [s] of a round of fitting; several follow each other


def temperature_varies(channels: Channels) -> bool:
    """Return whether the bearing's temperature varies within a record by more than a sensor's resolution."""
    return bool(np.ptp(channels.known(channels.optional("bearing_temperature_degC"))) > LEAST_K)


def _lag_reach(channels: Channels) -> float:
    return LAG_REACH_S if temperature_varies(channels) else 0.0


class ViscosityTemperature(MeanEffect):
    """A viscous coefficient that falls as the bearing warms up.

    The lubricant's viscosity falls with temperature, after Andrade's (Arrhenius') law. The strength is the viscous
    coefficient at 20 °C that scales with it. Drag is taken in proportion to the viscosity. Where a bearing's drag goes
    with (νn)^0.6 to (νn)^(2/3) (see `sublinear_viscous`) the B found here is 0.6 to 0.67 of the oil's: it is an
    apparent B, not the one of the oil's data sheet. Over a few kelvin only the product of strength and B shows; over
    ten kelvin and more the curvature gives both, if the oil is exactly Arrhenius. After Vogel's law B falls as the oil
    warms: what is found then holds over the temperatures of the record alone, and strength and B are each off by more
    than their stated errors. Where the sensor sits on the housing, the bearing follows it with a lag of the first
    order; 0 is a sensor in the bearing. In a wheel file with [nominal] this is a factor on the viscous friction, not a
    torque beside it: a fault scales the whole.

    What shows it
    -------------
    A slope that follows the bearing temperature, with its thermal lag.

    See Also
    --------
    lubricant_lag, torque_constant_temperature, run_in_drift

    References
    ----------
    E. N. da C. Andrade, The viscosity of liquids, Nature 125, 1930; review: C. J. Seeton, Viscosity–temperature
    correlation for liquids, Tribology Letters 22, 2006. B from 1700 to 6900 K gives −2 to −8 % per kelvin at 20 °C, the
    range of common space oils as a working assumption.
    """

    name = "viscosity_temperature"
    title = "Viscosity falls with temperature"
    formula = (
        r"\tau = f_v\, \omega \left(\frac{\nu(T)}{\nu_0} - 1\right), \qquad \frac{\nu(T)}{\nu_0} = e^{B \left(1/T - "
        r"1/T_0\right)}, \quad T_0 = 293.15\,\mathrm{K}, \qquad T_l \dot T = T_{\mathrm{sensor}} - T"
    )
    separate_by = "Constant speed for an orbit, at two speeds."
    needs = frozenset({"bearing_temperature_degC"})
    shows_at_one_speed = True
    is_part_of_viscous = True
    scales_with_viscous = True
    follows_temperature = True
    parameters = (
        Parameter("strength_Nm_s_rad", "N m s/rad", 0.0, np.inf, 5.333e-6, linear=True),
        Parameter("activation_temperature_K", "K", 1500.0, 8000.0, 4000.0),
        Parameter("sensor_lag_s", "s", 0.0, 7200.0, 0.0, False, (0.0,), 0.0, _lag_reach),
    )

    @classmethod
    def columns(cls, channels: Channels, shape: Shape, memory: Memory = None) -> tuple[FloatArray, Memory]:
        temperature = channels.optional("bearing_temperature_degC")
        if shape["sensor_lag_s"] > 0.0:
            known, period_s = np.isfinite(temperature), channels.sample_period_s
            temperature, memory = follow(first_order_lag, temperature, known, period_s, shape["sensor_lag_s"], memory)
        exponent = shape["activation_temperature_K"] * (1.0 / (temperature + ZERO_CELSIUS_K) - 1.0 / REFERENCE_K)
        return stack(channels.speed_rad_s * np.expm1(exponent)), memory
