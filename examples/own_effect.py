"""Your own effect: one class with a formula, and the simulator, the diagnosis and the search all know it.

    python examples/own_effect.py

The effect here is made up: a grease whose drag levels off at high speed, like tanh(ω/ω₀).
"""

import numpy as np
from numpy.typing import NDArray

import rwa_monitor as rwa
from rwa_monitor.wheel.effects.base import Channels, MeanEffect, Parameter, Shape
from rwa_monitor.wheel.effects.catalogue import register


# 1. The class. Metadata state what it is and what it is confused with; `column` is the formula at unit strength.
@register
class GreasePlateau(MeanEffect):
    """Drag of a stiff grease that shears off: it grows with the speed and levels off."""

    name = "grease_plateau"
    title = "Grease plateau"
    formula = r"\tau = T \tanh(\omega / \omega_0)"
    description = "A stiff grease drags along at low speed; above a speed it shears off and the torque stays."
    signature = "A residual that bends at ω₀ and is flat above."
    confused_with = ("stribeck", "sublinear_viscous")
    separate_by = "A ladder of dwells from 0.2 ω₀ to 5 ω₀."
    source = "Made up for this example."
    parameters = (
        Parameter("strength_Nm", "N m", 0.0, np.inf, 2.0e-4, linear=True),
        Parameter("plateau_speed_rad_s", "rad/s", 20.0, 200.0, 60.0),
    )

    @classmethod
    def column(cls, channels: Channels, shape: Shape) -> NDArray[np.float64]:
        return np.tanh(channels.speed_rad_s / shape["plateau_speed_rad_s"])


# 2. A wheel that has it, and a model that does not.
scenario = rwa.Scenario.from_toml(
    """
    [scenario]
    duration_s = 2500.0
    [speed]
    kind = "rich"
    [[effect]]
    name = "grease_plateau"
    parameters = { strength_Nm = 3.0e-4, plateau_speed_rad_s = 60.0 }
    """,
    "own effect",
)
wheel = rwa.read_wheel()
measured = rwa.simulate(scenario, wheel, seed=5).samples

# 3. The search tries it beside all others of the catalogue.
search = rwa.find_discrepancy(measured, wheel)
for effect in search.result.effects:
    values = ", ".join(f"{name} = {value.value:.4g} {value.unit}" for name, value in effect.parameters.items())
    print(f"found {effect.name}: {values}")
print("true:  grease_plateau: strength_Nm = 0.0003 N m, plateau_speed_rad_s = 60 rad/s")
print(f"the extended wheel has: {', '.join(block.name for block in rwa.extended_wheel(search).effect)}")
