"""Saturating drag: grows with the speed at first, and levels off."""

from __future__ import annotations

from typing import ClassVar, Final

import numpy as np

from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import Channels, MeanEffect, Parameter, Shape

SHARPEST: Final = 6.0  # of the bend: at ω_s the drag is 89 % of its end; sharper is a corner
RARER: Final = 100.0  # odds of a power law, which bearings of machines are known to follow, against this one


def _shown_speed(channels: Channels) -> tuple[float, float]:
    """From a few speed steps, below which it is dry friction, to the largest speed, above which it is a slope."""
    top = float(channels.used_speed_rad_s.max())
    return max(3.0 * channels.speed_step_rad_s, 1e-3 * top), top


class SaturatingDrag(MeanEffect):
    """Drag in proportion to the speed well below a certain speed, and constant well above it.

    A lubricant that shears faster thins: Cross's law lets the viscosity fall as 1/(1 + shear rate / critical rate), and
    the drag of a film of constant thickness then levels off at the strength c, half of which it has at ω_s; Carreau's
    and Yasuda's law bends more sharply (b > 1; tanh is near b = 2). Greases and polymer-thickened oils do so; so does
    the friction of motor and gear benches at some tens of rad/s, where the viscous friction is a slope only near zero.
    What is left of a slope is the base law's. The name means concave drag with an end, not which lubricant: a power of
    the speed (`sublinear_viscous`) has no end.

    What shows it
    -------------
    A residual that is concave in |ω|: a slope near zero, a plateau above.

    See Also
    --------
    sublinear_viscous, stribeck, presliding

    References
    ----------
    M. M. Cross, Rheology of non-Newtonian fluids: a new flow equation for pseudoplastic systems, Journal of Colloid
    Science 20, 1965 (exponent 1); K. Yasuda, R. C. Armstrong, R. E. Cohen, Shear flow properties of concentrated
    solutions of linear and star branched polystyrenes, Rheologica Acta 20, 1981 (b; power index 0); S. Andersson, A.
    Söderberg, S. Björklund, Friction models for sliding dry, boundary and mixed lubricated contacts, Tribology
    International 40, 2007. That a whole bearing follows the law of one film is an assumption.
    """

    name = "saturating_drag"
    title = "Saturating drag"
    formula = r"\tau = c\, \frac{\omega / \omega_s}{\left(1 + |\omega / \omega_s|^b\right)^{1/b}}"
    separate_by = "Dwells over the whole speed range, some well above the bend: a plateau, or a power that goes on."
    choice_deviance: ClassVar[float] = 2.0 * float(np.log(RARER))
    parameters = (
        Parameter("strength_Nm", "N m", 0.0, np.inf, 1.0e-4, linear=True),
        Parameter("saturation_speed_rad_s", "rad/s", 1e-3, 1000.0, 20.0, shown=_shown_speed),
        Parameter("bend", "-", 1.0, SHARPEST, 1.0, False, (1.0,), 1.0, lambda _: SHARPEST - 1.0),
    )

    @classmethod
    def column(cls, channels: Channels, shape: Shape) -> FloatArray:
        """Return the drag at unit strength."""
        ratio, bend = channels.speed_rad_s / shape["saturation_speed_rad_s"], shape["bend"]
        if bend == 1.0:
            return ratio / (1.0 + np.abs(ratio))
        return ratio / (1.0 + np.abs(ratio) ** bend) ** (1.0 / bend)
