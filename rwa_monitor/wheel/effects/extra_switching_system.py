"""Extra switching system: one more system than wheel.toml has."""

from __future__ import annotations

import numpy as np

from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.durations import Geometric
from rwa_monitor.wheel.effects.base import Channels, Parameter
from rwa_monitor.wheel.effects.switching_base import SwitchingEffect
from rwa_monitor.wheel.switching_systems import simulate_system
from rwa_monitor.wheel.wheel import FrictionRange, SwitchingSystem


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
