"""Extra switching system: one more system than wheel.toml has."""

from __future__ import annotations

import numpy as np

from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.durations import Geometric
from rwa_monitor.wheel.effects.base import Channels, LikelihoodFit, Parameter
from rwa_monitor.wheel.effects.switching_base import SwitchingEffect, SwitchingEvidence
from rwa_monitor.wheel.switching_systems import simulate_system
from rwa_monitor.wheel.wheel import FrictionRange, SwitchingSystem


class ExtraSwitchingSystem(SwitchingEffect):
    """A system of two configurations, at rest and active, with memoryless durations."""

    name = "extra_switching_system"
    title = "A switching system that the model lacks"
    formula = r"\tau = f(t) \operatorname{sign}(\omega), \qquad f \in \{0,\; m\,(1 \pm 0.25)\}"
    description = (
        "A phenomenon that wheel.toml does not list switches between rest and extra friction, such as a cage that "
        "sits in two positions."
    )
    signature = "Jumps, with their way back, that no known switching system explains."
    confused_with = ("wrong_duration_law", "cage_instability", "decaying_jump")
    separate_by = "A longer record: the sizes and durations of the unexplained jumps form groups of their own."
    source = "The paper's friction switching systems (section III-B), one more of them; sizes are a working assumption."
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

    @classmethod
    def fit(cls, evidence: SwitchingEvidence) -> LikelihoodFit:
        """Compare the number of unexplained jumps with the number of false ones expected (Poisson)."""
        if not evidence.systems or evidence.unattributed.size != len(evidence.jumps):
            return cls.nothing_found()
        odd = evidence.unattributed
        count = int(odd.sum())
        if count <= evidence.false_jumps or count < 2:
            return cls.nothing_found(count)
        index, size = evidence.jumps.index[odd], evidence.jumps.size_Nm[odd]
        lengths_s = np.diff(index) * evidence.channels.sample_period_s
        # After a jump up the system is active, after a jump down at rest.
        active = lengths_s[size[:-1] > 0]
        rest = lengths_s[size[:-1] <= 0]
        typical = cls.typical().values
        values = {
            "strength_Nm": float(np.median(np.abs(size))),
            "rest_s": float(rest.mean()) if rest.size else typical["rest_s"],
            "active_s": float(active.mean()) if active.size else typical["active_s"],
        }
        std = {
            "strength_Nm": float(np.std(np.abs(size)) / np.sqrt(count)),
            # The mean of an exponential law has a standard deviation of itself over the root of the count.
            "rest_s": values["rest_s"] / np.sqrt(rest.size) if rest.size else float("nan"),
            "active_s": values["active_s"] / np.sqrt(active.size) if active.size else float("nan"),
        }
        gain = count * np.log(count / evidence.false_jumps) - (count - evidence.false_jumps)
        return LikelihoodFit(values, std, float(gain), 3, count)
