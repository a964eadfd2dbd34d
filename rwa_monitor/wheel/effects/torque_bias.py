"""Torque bias: a constant torque, usually the offset of the current sensor."""

from __future__ import annotations

import numpy as np

from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import Channels, MeanEffect, Parameter, Shape


class TorqueBias(MeanEffect):
    """A constant torque, the same in both directions of rotation.

    An offset I₀ of the current measurement reads as a constant torque, at every speed and at rest; so does what drives
    the wheel from outside on a test bench: wind, a slope, a load cell that was not tared.

    What shows it
    -------------
    A constant that does not flip with the direction, and does not jump. In one direction it is a part of the dry
    friction, unless that seems to be negative: then by as much at least.

    See Also
    --------
    coulomb_asymmetry, viscous_asymmetry

    References
    ----------
    Offset errors of Hall and shunt current sensors are stated in their data sheets, typically 0.1–1 % of full scale;
    the range is a working assumption, no single reference.
    """

    name = "torque_bias"
    title = "Torque bias"
    formula = r"\tau = \tau_0 = K_T I_0, \qquad I_0 = I_{\mathrm{measured}} - I"
    separate_by = "Sizes of the same jump in both directions; the current with the motor off."
    parity = "even"
    may_drive = True
    parameters = (Parameter("strength_Nm", "N m", -np.inf, np.inf, 2.0e-4, linear=True),)

    @classmethod
    def column(cls, channels: Channels, shape: Shape) -> FloatArray:
        return np.ones(len(channels))
