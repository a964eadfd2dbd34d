"""Viscous jump: the viscous coefficient jumps together with the dry friction."""

from __future__ import annotations

from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import Channels, Parameter, Shape, stack
from rwa_monitor.wheel.effects.switching_base import Jumps, SwitchingEffect


class ViscousJump(SwitchingEffect):
    """Jumps whose size grows with the speed.

    Where lubricant moves in or out of the contact, the viscous coefficient jumps along with the dry friction: the jump
    is larger at high speed by the factor 1 + c|ω|.

    What shows it
    -------------
    Another slope after each jump; sizes of the same jump grow with |ω|.

    See Also
    --------
    speed_triggered_jumps, sublinear_viscous

    References
    ----------
    The paper keeps the viscous coefficient constant between jumps (section III-A); that a change of the lubricant
    distribution changes it is a working assumption without a verified size.
    """

    name = "viscous_jump"
    title = "Jumps of the viscous friction"
    formula = r"\tau = c\, \omega \sum_{t_j \leq t} \Delta_j"
    separate_by = "Change the speed between two jumps: the slope of each segment shows by itself."
    not_exported = ""
    parameters = (Parameter("strength_s_rad", "s/rad", -1.0, 1.0, 3.0e-3, linear=True),)

    @classmethod
    def columns(cls, channels: Channels, jumps: Jumps, shape: Shape) -> FloatArray:
        return stack(jumps.total(len(channels)) * channels.speed_rad_s)
