"""Jumps of the dry friction of another shape, or of one more system, than wheel.toml has."""

from __future__ import annotations

from typing import Final

import numpy as np

from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.durations import Geometric
from rwa_monitor.wheel.effects.base import Channels, Parameter, Shape, stack
from rwa_monitor.wheel.effects.switching_base import Jumps, SwitchingEffect
from rwa_monitor.wheel.switching_systems import simulate_system
from rwa_monitor.wheel.wheel import FrictionRange, SwitchingSystem

SHORTEST_SLOTS: Final = 20  # of a relaxation: shorter ones are outliers beside a jump
LONGEST_SHARE: Final = 0.1  # of the record: longer ones are drifts


def _shown_time(channels: Channels) -> tuple[float, float]:
    return SHORTEST_SLOTS * channels.sample_period_s, LONGEST_SHARE * channels.duration_s


class DecayingJump(SwitchingEffect):
    """After each jump a part of it fades away, until the next jump.

    A pocket of oil that is run over is squeezed out again: the drag jumps and then relaxes by a share of the jump. What
    has relaxed is forgotten at the next jump, so that the level always lies between its two neighbours.

    What shows it
    -------------
    An exponential in the residual after each jump, in proportion to the jump, of one time constant.

    See Also
    --------
    extra_switching_system, lubricant_lag

    References
    ----------
    Pockets of oil in wheel bearings: the paper, section III, and its reference of 2015, taken to be A. Y. Lee, E. K.
    Wang, In-flight performance of Cassini reaction wheel bearing drag in 1997–2013, Journal of Spacecraft and Rockets
    52(2), 2015. That their drag relaxes exponentially is a working assumption.
    """

    name = "decaying_jump"
    title = "Jumps that relax"
    formula = (
        r"\tau = -\gamma \sum_j \Delta_j \left(1 - e^{-(t - t_j)/T}\right) \operatorname{sign}(\omega), \quad t_j "
        r"\leq t < t_{j+1}"
    )
    separate_by = "Constant speed: a lag of the lubricant rests then, jumps still relax."
    not_exported = ""
    parameters = (
        Parameter("strength", "-", 0.0, 1.0, 0.5, linear=True),
        Parameter("time_constant_s", "s", 1e-3, 1e5, 60.0, shown=_shown_time),
    )

    @classmethod
    def columns(cls, channels: Channels, jumps: Jumps, shape: Shape) -> FloatArray:
        slots = len(channels)
        since_s = jumps.since_s(slots, channels.sample_period_s)
        return stack(channels.direction * jumps.last(slots) * np.expm1(-since_s / shape["time_constant_s"]))


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


class ExtraSwitchingSystem(SwitchingEffect):
    """A system of two configurations, at rest and active, with memoryless durations.

    A phenomenon that wheel.toml does not list switches between rest and extra friction, such as a cage that sits in two
    positions.

    What shows it
    -------------
    Jumps, with their way back, that no known switching system explains.

    See Also
    --------
    wrong_duration_law, cage_instability, decaying_jump

    References
    ----------
    The paper's friction switching systems (section III-B), one more of them; sizes are a working assumption.
    """

    name = "extra_switching_system"
    title = "A switching system that the model lacks"
    formula = r"\tau = f(t) \operatorname{sign}(\omega), \qquad f \in \{0,\; m\,(1 \pm 0.25)\}"
    separate_by = "A longer record: the sizes and durations of the unexplained jumps form groups of their own."
    parameters = (
        Parameter("strength_Nm", "N m", 0.0, np.inf, 4.0e-4),
        Parameter("rest_s", "s", 1e-3, 1e7, 600.0),
        Parameter("active_s", "s", 1e-3, 1e7, 200.0),
    )

    def extra_level(self, channels: Channels, rng: np.random.Generator) -> FloatArray:
        slots = [max(1.0, self.values[name] / channels.sample_period_s) for name in ("rest_s", "active_s")]
        system = SwitchingSystem(
            name="extra",
            durations=tuple(Geometric(mean_slots=mean) for mean in slots),
            friction=(FrictionRange(low=0.0, high=0.0), FrictionRange(low=0.75, high=1.25)),
        )
        return self.values["strength_Nm"] * simulate_system(system, len(channels), rng).friction
