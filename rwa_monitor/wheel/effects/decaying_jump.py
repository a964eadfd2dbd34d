"""Decaying jump: a jump of the dry friction that relaxes instead of staying."""

from __future__ import annotations

from typing import Final

import numpy as np

from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import Channels, Parameter, Shape, stack
from rwa_monitor.wheel.effects.switching_base import Jumps, SwitchingEffect

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
