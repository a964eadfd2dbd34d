"""What the bearing's temperature leaves open of viscous friction.

Where the wheel file holds the law, viscous friction is judged at the temperature that was measured. Where that is not
known, or is one at which the law was not learned, it may be anything that the law makes of the temperatures it can be.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

from rwa_monitor.changepoints.stage_results import Temperature
from rwa_monitor.diagnosis.features import Features
from rwa_monitor.wheel.effects.catalogue import viscous_per_K
from rwa_monitor.wheel.wheel import Wheel

UNSEEN_K: Final = 15.0  # K: what a sensor that never moves may miss, the swing of the seasons; a working assumption
ANYTHING: Final = 10.0  # times viscous friction: no window shows anything of it then
WORTH_SAYING: Final = 0.01  # of viscous friction: half of what healthy wheels spread by


@dataclass(frozen=True, slots=True)
class TemperatureUncertainty:
    """How uncertain viscous friction is for the temperature's sake.

    Attributes
    ----------
    share
        Standard deviation, of the viscous friction itself.
    reason
        Why, as the end of a sentence; "" where it is not worth saying.
    """

    share: float = 0.0
    reason: str = ""

    def widen(self, features: Features) -> Features:
        """Return the features with viscous friction as uncertain."""
        if self.share == 0.0:
            return features
        std = math.hypot(features.viscous_std, self.share * max(abs(features.viscous), 1.0))
        by_path = tuple(replace(one, features=self.widen(one.features)) for one in features.by_path)
        return replace(features, viscous_std=std, by_path=by_path)


KNOWN: Final = TemperatureUncertainty()


def temperature_uncertainty(heat: Temperature | None, wheel: Wheel, *, adequate: bool) -> TemperatureUncertainty:
    """Return how uncertain viscous friction is for the temperature's sake.

    Parameters
    ----------
    heat
        Of the window; None where viscous friction does not follow the temperature.
    wheel
        Its law, and the range of temperature that it holds over.
    adequate
        Whether the friction model fits.
    """
    if heat is None:
        return KNOWN
    known = wheel.temperature
    if heat.unknown < 0.5 and known and not known.low_degC <= heat.mean_degC <= known.high_degC:
        return TemperatureUncertainty(
            ANYTHING,
            f"the bearing is at {heat.mean_degC:.3g} °C, and its viscous friction was learned from"
            f" {known.low_degC:.3g} °C to {known.high_degC:.3g} °C",
        )
    per_K, error_K = abs(viscous_per_K(wheel, heat.mean_degC)), heat.error_K
    reason = f"the bearing's temperature is missing, or stuck, for {100.0 * heat.unknown:.0f} % of the window"
    if not adequate and heat.low_degC == heat.high_degC and not heat.unknown:
        error_K = math.hypot(error_K, UNSEEN_K)
        reason = f"the bearing's temperature stands still at {heat.mean_degC:.3g} °C while friction does not"
    return TemperatureUncertainty(per_K * error_K, reason if per_K * error_K > WORTH_SAYING else "")
