"""Torque ripple: a torque that repeats with the wheel's angle."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from rwa_monitor.physics.effects.base import Channels, MeanEffect, Memory, Parameter
from rwa_monitor.physics.effects.columns import stack
from rwa_monitor.samples import FloatArray

MAX_HARMONIC: Final = 48  # [-] per turn of the wheel: six pulses per electrical turn, up to eight pole pairs


class TorqueRipple(MeanEffect):
    """A torque that is periodic in the wheel's angle: one harmonic and its double."""

    name = "torque_ripple"
    title = "Torque ripple"
    formula = (
        r"\tau = \sum_{m = 1, 2} \left(a_m \cos(m h \theta) + b_m \sin(m h \theta)\right), \qquad \theta = \int "
        r"\omega\, dt"
    )
    description = (
        "Cogging, commutation and bearing geometry repeat with the angle of the wheel. Sampled slowly, the ripple "
        "shows as beats at speeds where a multiple of the rotation meets the sampling rate. The angle is an "
        "integral of the measured speed and loses its phase as the noise adds up: after n slots of speed noise σ "
        "the phase has wandered by h·σ·Δt·√n rad, so fit in blocks where this is below about one."
    )
    signature = "Beats at certain speeds; the residual repeats when it is drawn against the angle."
    confused_with = ("speed_dependent_noise",)
    separate_by = "The residual against the angle, at low speed or with faster sampling."
    source = (
        "P. C. Krause, O. Wasynczuk, S. D. Sudhoff, Analysis of Electric Machinery (six-step drive of brushless "
        "motors: six pulses per electrical turn); W. Bialke, High fidelity mathematical modeling of reaction wheel "
        "performance, AAS 98-063, 1998 (ripple and cogging of wheels). 0.5–2 % of full torque is a working "
        "assumption."
    )
    parity = "none"
    parameters = (
        Parameter("strength_cos_Nm", "N m", -np.inf, np.inf, 1.0e-4, linear=True),
        Parameter("strength_sin_Nm", "N m", -np.inf, np.inf, 0.0, linear=True, default=0.0),
        Parameter("strength_double_cos_Nm", "N m", -np.inf, np.inf, 0.0, linear=True, default=0.0),
        Parameter("strength_double_sin_Nm", "N m", -np.inf, np.inf, 0.0, linear=True, default=0.0),
        Parameter(
            "harmonic", "-", 1.0, float(MAX_HARMONIC), 6.0, choices=tuple(float(h) for h in range(1, MAX_HARMONIC + 1))
        ),
    )

    @classmethod
    def columns(
        cls, channels: Channels, shape: Mapping[str, float], memory: Memory = None
    ) -> tuple[FloatArray, Memory]:
        del memory
        phase = shape["harmonic"] * channels.angle_rad
        return stack(np.cos(phase), np.sin(phase), np.cos(2.0 * phase), np.sin(2.0 * phase)), None
