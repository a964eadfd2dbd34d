"""Speed dead zone: below a small speed the wheel's electronics see no motion."""

from __future__ import annotations

import numpy as np

from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import Channels, MeanEffect, Parameter, Shape, speed_step, used_speed


def _shown_width(channels: Channels) -> tuple[float, float]:
    return 2.0 * speed_step(channels), 0.1 * float(used_speed(channels).max())


class SpeedDeadZone(MeanEffect):
    """Friction that is missing in a narrow band of speeds around zero."""

    name = "speed_dead_zone"
    threshold = "dead_zone_rad_s"
    title = "Dead zone of the speed reading"
    formula = r"\tau = -\tau_0\, \operatorname{sign}(\omega) \text{ where } |\omega| < \omega_{dz}, \text{ else } 0"
    description = (
        "Below a smallest speed the tachometer reads nothing. What that does depends on how the record came to be. "
        "Where friction is computed from the speed by a friction model, or estimated with the speed read, its part "
        "that follows the sign is lost inside the zone: this is the plateau of the formula. A torque balance K_T I − "
        "J dω/dt does not lose it: the current still carries the friction, and as the dω/dt of the reading is zero "
        "inside, J dω/dt of the true motion is added to it, with a pulse of the opposite sign where the reading jumps "
        "at the ends. There the zone shows in the speed readings, not as this plateau. `read_speed` gives what such a "
        "tachometer reads."
    )
    signature = (
        "A plateau around zero speed with sharp ends, in friction that was computed with the speed read; a speed that "
        "reads exactly zero while the wheel reverses, in any record."
    )
    confused_with = ("stribeck", "presliding", "sublinear_viscous")
    separate_by = "A slow zero crossing: a plateau has sharp ends, a Stribeck peak fades out and has the other sign."
    source = (
        "Elementary: a tachometer that counts pulses has a smallest speed at which a pulse falls into its gate "
        "time. The width is a working assumption."
    )
    parameters = (
        Parameter("strength_Nm", "N m", 0.0, np.inf, 1.6e-3, linear=True),
        Parameter("dead_zone_rad_s", "rad/s", 1e-4, 100.0, 1.0, shown=_shown_width),
    )

    @classmethod
    def column(cls, channels: Channels, shape: Shape) -> FloatArray:
        inside = np.abs(channels.speed_rad_s) < shape["dead_zone_rad_s"]
        # Where the speed is not known, neither is the column: direction is NaN there and so is the product.
        return np.where(inside | np.isnan(channels.speed_rad_s), -channels.direction, 0.0)

    def read_speed(self, speed_rad_s: FloatArray) -> FloatArray:
        """Return what a tachometer with this dead zone reads [rad/s]: zero inside."""
        return np.where(np.abs(speed_rad_s) < self.values["dead_zone_rad_s"], 0.0, speed_rad_s)
