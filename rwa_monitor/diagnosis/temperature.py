"""What the bearing's temperature leaves open of viscous friction, and of what is measured beside it.

Where the wheel file holds the law, viscous friction is judged at the temperature that was measured. Where that is not
known, or is one at which the law was not learned, it may be anything that the law makes of the temperatures it can be.
Where the friction model then does not fit, viscous friction comes and goes within the window, too, and what it does at
the window's speed is in the levels.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from rwa_monitor.changepoints.stage_results import Components, Evidence
from rwa_monitor.diagnosis.adequacy import ModelErrorUncertainty
from rwa_monitor.diagnosis.features import Features
from rwa_monitor.wheel.effects.catalogue import viscous_per_K
from rwa_monitor.wheel.wheel import Wheel

UNSEEN_K: Final = 15.0  # K: what a sensor that never moves may miss, the swing of the seasons; a working assumption
# Of what is not known of a wheel's heat, what may come and go within a window. A working assumption: of an orbit's ±3 K
# and a year's ±15 K it is a fifth, of an orbit's alone it is all.
WITHIN_WINDOW: Final = 0.5
ANYTHING: Final = 10.0  # times viscous friction: no window shows anything of it then
WORTH_SAYING: Final = 0.01  # of viscous friction: half of what healthy wheels spread by


@dataclass(frozen=True, slots=True)
class TemperatureUncertainty:
    """How uncertain viscous friction is for the temperature's sake.

    Attributes
    ----------
    share
        Standard deviation, of the viscous friction itself.
    level
        By how much that may move the levels, normalised.
    reason
        Why, as the end of a sentence; "" where it is not worth saying.
    """

    share: float = 0.0
    level: float = 0.0
    reason: str = ""

    def widen(self, features: Features) -> Features:
        """Return the features with viscous friction, and the levels, as uncertain."""
        if self.share == 0.0:
            return features
        viscous = self.share * max(abs(features.viscous), 1.0)
        if self.level > 0.0:
            of_levels = ModelErrorUncertainty(self.level, viscous * features.viscous_unit, self.level)
            return of_levels.widen(features)
        by_path = tuple(replace(one, features=self.widen(one.features)) for one in features.by_path)
        return replace(features, viscous_std=math.hypot(features.viscous_std, viscous), by_path=by_path)


KNOWN: Final = TemperatureUncertainty()


def temperature_uncertainty(
    evidence: Evidence, components: Components, wheel: Wheel, *, adequate: bool
) -> TemperatureUncertainty:
    """Return how uncertain viscous friction is for the temperature's sake.

    Parameters
    ----------
    evidence, components
        The window, and its friction.
    wheel
        Its law and the range of temperature that it holds over, or by how much its viscous friction varies.
    adequate
        Whether the friction model fits.
    """
    heat, known = evidence.heat, wheel.temperature
    share, reason = 0.0, ""
    if heat is None:
        # What lies beyond the spread is what is judged (`model.spread_out`), unless the heat shows within the window.
        share = (wheel.nominal.viscous_spread or 0.0) if wheel.nominal and not adequate else 0.0
        reason = "its viscous friction varies with a temperature that is not recorded"
    elif heat.unknown < 0.5 and known and not known.low_degC <= heat.mean_degC <= known.high_degC:
        return TemperatureUncertainty(
            ANYTHING,
            reason=f"the bearing is at {heat.mean_degC:.3g} °C, and its viscous friction was learned from"
            f" {known.low_degC:.3g} °C to {known.high_degC:.3g} °C",
        )
    else:
        error_K = heat.error_K
        reason = f"the bearing's temperature is missing, or stuck, for {100.0 * heat.unknown:.0f} % of the window"
        if not adequate and heat.low_degC == heat.high_degC and not heat.unknown:
            error_K = math.hypot(error_K, UNSEEN_K)
            reason = f"the bearing's temperature stands still at {heat.mean_degC:.3g} °C while friction does not"
        share = abs(viscous_per_K(wheel, heat.mean_degC)) * error_K
    if share == 0.0:
        return KNOWN
    level = 0.0
    if not adequate:
        whole = evidence.sums.between(np.zeros(1, dtype=np.int64), np.array([evidence.slots]))
        mean_speed = float(whole.x[0] / max(whole.n[0], 1.0))
        level = WITHIN_WINDOW * share * max(components.viscous, 0.0) * mean_speed
    return TemperatureUncertainty(share, level, reason if share > WORTH_SAYING else "")
