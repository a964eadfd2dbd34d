"""Quadratic drag: windage of a wheel that turns in gas."""

from __future__ import annotations

import numpy as np

from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import Channels, MeanEffect, Parameter, Shape


class QuadraticDrag(MeanEffect):
    """Drag that grows with the square of the speed.

    Gas in the housing is dragged along. The torque on a smooth disc goes with ω^1.8 in turbulent flow and with ω^1.5 in
    laminar flow (C_M ∝ Re^(−1/2)), and with ω where the gap to the housing is so narrow that the two boundary layers
    merge: the square is an upper end, for rough or spoked wheels and fully turbulent flow. At 1 bar of air Re = ωR²/ν
    of a wheel of 0.15 m radius is 1.5·10⁵ to 3·10⁵ at 100 to 200 rad/s: still laminar on a free disc, which turns
    turbulent from about 3·10⁵ on. A square that is found means convex drag, not which flow. Windage vanishes in vacuum:
    expect it in ground tests in air and in wheels whose sealed housing is filled with gas, which fly too; an evacuated
    or vented housing has none.

    What shows it
    -------------
    A residual that is convex in |ω|.

    See Also
    --------
    sublinear_viscous

    References
    ----------
    H. Schlichting, Boundary-Layer Theory (rotating disc: moment ∝ ω^1.5 laminar, ω^1.8 turbulent); J. W. Daily, R. E.
    Nece, Chamber dimension effects on induced flow and frictional resistance of enclosed rotating disks, ASME Journal
    of Basic Engineering 82, 1960 (four regimes by gap and Reynolds number). Re from ν = 1.5·10⁻⁵ m²/s (air, 20 °C, 1
    bar). The square is a common simplification; the size for wheels is a working assumption.
    """

    name = "quadratic_drag"
    title = "Quadratic drag (windage)"
    formula = r"\tau = c\, \omega |\omega|"
    separate_by = "A dwell at top speed, at two bearing temperatures: windage does not follow the bearing's."
    parameters = (Parameter("strength_Nm_s2_rad2", "N m s²/rad²", 0.0, np.inf, 2.0e-9, linear=True),)

    @classmethod
    def column(cls, channels: Channels, shape: Shape) -> FloatArray:
        return channels.speed_rad_s * np.abs(channels.speed_rad_s)
