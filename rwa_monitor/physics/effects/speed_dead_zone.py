"""Speed dead zone: below a small speed the wheel's electronics see no motion."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from rwa_monitor.physics.effects.base import Channels, MeanEffect, Memory, Parameter
from rwa_monitor.physics.effects.columns import stack
from rwa_monitor.physics.effects.resolution import narrowed, speed_step, used_speed
from rwa_monitor.samples import FloatArray

FEWEST_REPEATS: Final = 3  # readings equal to the one before, near zero: less may be chance
REPEATS_ELSEWHERE: Final = 0.02  # share of equal neighbours from which readings repeat at any speed: a coarse lattice
WIDER_THAN_STEPS: Final = 3.0  # a gap between zero and the next reading is no wider in a wheel that starts from rest


class SpeedDeadZone(MeanEffect):
    """Friction that is missing in a narrow band of speeds around zero."""

    name = "speed_dead_zone"
    title = "Dead zone of the speed reading"
    formula = r"\tau = -\tau_0\, \operatorname{sign}(\omega) \text{ where } |\omega| < \omega_{dz}, \text{ else } 0"
    description = (
        "Below a smallest speed the tachometer reads nothing. What that does depends on how the record came to be. "
        "Where friction is computed from the speed by a friction model, or estimated with the speed read, its part "
        "that follows the sign is lost inside the zone: this is the plateau of the formula. A torque balance K_T I − "
        "J dω/dt does not lose it: the current still carries the friction, and as the dω/dt of the reading is zero "
        "inside, J dω/dt of the true motion is added to it, with a pulse of the opposite sign where the reading jumps "
        "at the ends. There the zone shows in the speed readings, not as this plateau. `read_speed` gives what such a "
        "tachometer reads; `plateau_speed` finds it in a record of the speed alone."
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


def plateau_speed(channels: Channels) -> float | None:
    """Return the width of a dead zone that the speed readings themselves show [rad/s], None where they show none.

    Near zero, readings repeat exactly (zero, or the last one held) while the wheel goes on turning, and no reading lies
    between them and the zone's ends. A coarse lattice repeats readings at any speed; a wheel at rest with a quiet
    tachometer leaves zero in small steps: neither is a dead zone.
    """
    speed = channels.speed_rad_s[channels.good & np.isfinite(channels.speed_rad_s)]
    if speed.size < 2 or not speed.any():
        return None
    repeats = speed[1:] == speed[:-1]
    size = np.abs(speed[1:])
    width = float(size[size > 0].min())  # no reading lies below: the zone, or just the smallest reading
    inside = size <= 1.5 * width
    if int((repeats & inside).sum()) < FEWEST_REPEATS or repeats[~inside].mean() > REPEATS_ELSEWHERE:
        return None
    # The step of readings that leave the zone's surroundings, not of those that cross it.
    around = ~repeats & (size > width) & (size < 10.0 * width) & (speed[1:] * speed[:-1] > 0)
    change = np.abs(np.diff(speed))[around]
    held = bool((np.abs(speed[1:][repeats & inside]) > 0).any())
    if not held and change.size and width < WIDER_THAN_STEPS * float(np.median(change)):
        return None
    return width
