"""Load dependence: drag in proportion to the motor torque."""

from __future__ import annotations

import numpy as np

from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import Channels, MeanEffect, Parameter, Shape


class LoadDependence(MeanEffect):
    """Drag that grows with the size of the motor torque, whatever its sign.

    The torque that is transmitted loads the bearings or the gear, and friction grows with load.

    What shows it
    -------------
    Drag that grows with the motor torque, in acceleration and braking alike.

    See Also
    --------
    inertia_error, torque_constant_error

    References
    ----------
    A. Palmgren, Ball and Roller Bearing Engineering, 1959 (load-dependent part of the bearing torque); for geared
    joints: P. Hamon, M. Gautier, P. Garrec, Dynamic identification of robots with a dry friction model depending on
    load and velocity, IROS 2010. No verified range for direct-driven wheels.
    """

    name = "load_dependence"
    title = "Load dependence"
    follows_acceleration = True
    formula = r"\tau = c\, |K_T I|\, \operatorname{sign}(\omega)"
    separate_by = (
        "Accelerate and brake, in both directions: this drag always opposes the motion, an error of inertia does not."
    )
    needs = frozenset({"motor_torque_Nm"})
    parameters = (Parameter("strength", "-", 0.0, 1.0, 0.02, linear=True),)

    @classmethod
    def column(cls, channels: Channels, shape: Shape) -> FloatArray:
        """Return |K_T I|·sign; in the search K_T I must be a mean of neighbours that leaves out the slot itself."""
        return channels.direction * np.abs(channels.optional("motor_torque_Nm"))
