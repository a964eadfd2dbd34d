"""Wrong duration law: a switching system's sojourns last otherwise than in wheel.toml."""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy import special

from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.durations import DurationLaw, Weibull
from rwa_monitor.wheel.effects.base import LikelihoodFit, Parameter, most_likely
from rwa_monitor.wheel.effects.switching_base import TINY, Sojourns, SwitchingEffect
from rwa_monitor.wheel.wheel import SwitchingSystem

FEWEST_SOJOURNS: Final = 5


class WrongDurationLaw(SwitchingEffect):
    """Sojourns that follow a Weibull law with another mean than the known law's.

    The sojourns of a switching system are longer or shorter by a factor r than the mean μ of their known law, and
    spread otherwise (Weibull shape k; 1 is memoryless, large k is regular).

    What shows it
    -------------
    Durations between attributed jumps that do not follow the law in wheel.toml; jumps that look odd in time.

    See Also
    --------
    extra_switching_system, speed_triggered_jumps

    References
    ----------
    The paper's duration laws (section III-B); W. Weibull, A statistical distribution function of wide applicability, J.
    Applied Mechanics 18, 1951. Factors are a working assumption.
    """

    name = "wrong_duration_law"
    title = "Durations that do not follow their law"
    formula = r"P(d > t) = e^{-(t / \lambda)^k}, \qquad \lambda = \frac{r\, \mu_q}{\Gamma(1 + 1/k)}"
    separate_by = "A longer record, at constant speed and temperature."
    parameters = (
        Parameter("duration_factor", "-", 0.01, 100.0, 0.4),
        Parameter("weibull_shape", "-", 0.3, 20.0, 1.0),
    )

    def change_system(self, system: SwitchingSystem) -> SwitchingSystem:
        laws = tuple(self._law(law.mean()) for law in system.durations)
        return system.model_copy(update={"durations": laws})

    def _law(self, mean_slots: float) -> DurationLaw:
        return weibull_of_mean(self.values["duration_factor"] * mean_slots, self.values["weibull_shape"])

    @classmethod
    def fit(cls, system: SwitchingSystem, sojourns: Sojourns) -> LikelihoodFit:
        """Fit factor and shape to the sojourns of one system, against its known laws."""
        means = np.array([law.mean() for law in system.durations])
        known = sojourns.log_likelihood(system, sojourns.slots)
        bounds = [(float(np.log(p.low)), float(np.log(p.high))) for p in cls.parameters]

        def gain(x: FloatArray) -> float:
            factor, shape = float(np.exp(x[0])), float(np.exp(x[1]))
            total = 0.0
            for q, mean in enumerate(means):
                at = sojourns.slots[sojourns.configuration == q]
                total += float(np.sum(np.log(weibull_of_mean(factor * mean, shape).pmf(at) + TINY)))
            return total - known

        relative = sojourns.slots / means[sojourns.configuration]
        start = np.array([np.log(np.clip(relative.mean(), 0.011, 99.0)), 0.0])
        best, std, most = most_likely(gain, [start], bounds)
        names, values = [parameter.name for parameter in cls.parameters], np.exp(best)
        return LikelihoodFit(
            dict(zip(names, values.tolist(), strict=True)),
            dict(zip(names, (values * std).tolist(), strict=True)),
            most,
            2,
            int(sojourns.slots.size),
        )


def weibull_of_mean(mean_slots: float, shape: float) -> Weibull:
    """Return the Weibull law of a given mean (before rounding to slots) and shape."""
    return Weibull(shape=shape, scale=mean_slots / float(special.gamma(1.0 + 1.0 / shape)))
