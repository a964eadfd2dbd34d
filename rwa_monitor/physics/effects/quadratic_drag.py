"""Quadratic drag: windage of a wheel that turns in gas."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rwa_monitor.physics.effects.base import Channels, MeanEffect, Memory, Parameter
from rwa_monitor.physics.effects.columns import stack
from rwa_monitor.samples import FloatArray


class QuadraticDrag(MeanEffect):
    """Drag that grows with the square of the speed."""

    name = "quadratic_drag"
    title = "Quadratic drag (windage)"
    formula = r"\tau = c\, \omega |\omega|"
    description = (
        "Gas in the housing is dragged along: the torque on a turbulent disc grows with a power of 1.8 to 2 of the "
        "speed. Zero in vacuum, so on ground tests and sealed housings only."
    )
    signature = "A residual that is convex in |ω|."
    confused_with = ("sublinear_viscous",)
    separate_by = "A dwell at top speed, at two bearing temperatures: windage does not follow the bearing's."
    source = (
        "H. Schlichting, Boundary-Layer Theory (rotating disc: moment ∝ ω^1.8 in turbulent flow); the square is the "
        "usual approximation, the size for wheels is a working assumption."
    )
    parameters = (Parameter("strength_Nm_s2_rad2", "N m s²/rad²", 0.0, np.inf, 2.0e-9, linear=True),)

    @classmethod
    def columns(
        cls, channels: Channels, shape: Mapping[str, float], memory: Memory = None
    ) -> tuple[FloatArray, Memory]:
        del shape, memory
        return stack(channels.speed_rad_s * np.abs(channels.speed_rad_s)), None
