"""Torque constant and temperature: magnets weaken as the motor warms up."""

from __future__ import annotations

from typing import Final

from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import Channels, MeanEffect, Parameter, Shape

REFERENCE_DEGC: Final = 20.0  # [°C] where the torque constant is the assumed one


class TorqueConstantTemperature(MeanEffect):
    """A torque constant that changes with temperature.

    Permanent magnets lose flux as they warm up, so that the true torque constant is below the assumed one and the
    difference reads as friction: k > 0. The bearing's temperature stands for the magnets'.

    What shows it
    -------------
    A torque in proportion to temperature times current: seen in slews, not at constant speed.

    See Also
    --------
    viscosity_temperature, torque_constant_error

    References
    ----------
    Reversible temperature coefficients of remanence in magnet makers' data sheets: about −0.04 %/K (SmCo) to −0.12 %/K
    (NdFeB).
    """

    name = "torque_constant_temperature"
    title = "Torque constant falls with temperature"
    follows_acceleration = True
    formula = (
        r"\tau = k\, (T - T_0)\, K_T I, \qquad T_0 = 20\,^\circ\mathrm{C}, \quad K_{T,\mathrm{true}} = K_T \left(1 - "
        r"k (T - T_0)\right)"
    )
    separate_by = (
        "Slews at two temperatures; at a steady speed it cannot be distinguished from `viscosity_temperature`."
    )
    needs = frozenset({"motor_torque_Nm", "bearing_temperature_degC"})
    shows_at_one_speed = True
    parameters = (Parameter("strength_1_K", "1/K", -0.01, 0.01, 8.0e-4, linear=True),)

    @classmethod
    def column(cls, channels: Channels, shape: Shape) -> FloatArray:
        """Return (T - T₀)·K_T I; in the search K_T I must be a mean of neighbours that leaves out the slot itself."""
        warmer_K = channels.optional("bearing_temperature_degC") - REFERENCE_DEGC
        return warmer_K * channels.optional("motor_torque_Nm")
