"""Speed dead zone: below a small speed the wheel's electronics see no motion."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rwa_monitor.physics.effects.base import Channels, MeanEffect, Memory, Parameter
from rwa_monitor.physics.effects.columns import stack
from rwa_monitor.physics.effects.resolution import narrowed, speed_step, used_speed
from rwa_monitor.samples import FloatArray


class SpeedDeadZone(MeanEffect):
    """Friction that is missing in a narrow band of speeds around zero."""

    name = "speed_dead_zone"
    title = "Dead zone of the speed reading"
    formula = r"\tau = -\tau_0\, \operatorname{sign}(\omega) \text{ where } |\omega| < \omega_{dz}, \text{ else } 0"
    description = (
        "Below a smallest speed the tachometer reads nothing: whatever is computed with that speed, friction "
        "included, loses its part that follows the sign, and a plateau appears around zero. `read_speed` gives what "
        "such a tachometer reads, `plateau_speed` finds it in a speed record."
    )
    signature = "A plateau around zero speed with sharp ends; a speed that reads exactly zero while the wheel reverses."
    confused_with = ("stribeck", "presliding", "sublinear_viscous")
    separate_by = "A slow zero crossing: a plateau has sharp ends, a Stribeck peak fades out and has the other sign."
    source = (
        "Tachometers of few pulses per turn have a smallest speed that they resolve: W. Bialke, AAS 98-063, 1998 "
        "(Hall-sensor tachometers). The width is a working assumption."
    )
    parameters = (
        Parameter("strength_Nm", "N m", 0.0, np.inf, 1.6e-3, linear=True),
        Parameter("dead_zone_rad_s", "rad/s", 1e-4, 100.0, 1.0),
    )

    @classmethod
    def columns(
        cls, channels: Channels, shape: Mapping[str, float], memory: Memory = None
    ) -> tuple[FloatArray, Memory]:
        del memory
        inside = np.abs(channels.speed_rad_s) < shape["dead_zone_rad_s"]
        # Where the speed is not known, neither is the column: direction is NaN there and so is the product.
        return stack(np.where(inside | np.isnan(channels.speed_rad_s), -channels.direction, 0.0)), None

    @classmethod
    def shape_bounds(cls, channels: Channels) -> dict[str, tuple[float, float]]:
        """From two speed steps to a tenth of the largest speed."""
        bounds = super().shape_bounds(channels)
        low, high = 2.0 * speed_step(channels), 0.1 * float(used_speed(channels).max())
        return {**bounds, "dead_zone_rad_s": narrowed(bounds["dead_zone_rad_s"], low, high)}

    def read_speed(self, speed_rad_s: FloatArray) -> FloatArray:
        """Return what a tachometer with this dead zone reads [rad/s]: zero inside."""
        return np.where(np.abs(speed_rad_s) < self.values["dead_zone_rad_s"], 0.0, speed_rad_s)
