"""Effects near zero speed: more drag where the film is not built up, and a speed that reads zero."""

from __future__ import annotations

from typing import Final

import numpy as np

from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import Channels, MeanEffect, Parameter, Shape, speed_step, used_speed

GONE_AT: Final = 5.0  # [-] at |ω| = 5 ω_s less than 1 % is left for exponents of one and more
WIDEST_SHARE: Final = 0.5  # of the largest speed: e⁻² of a wide one (δ = 1) is left there, and the rest is seen
EXPONENT_REACH: Final = 0.6  # of a round of fitting; several follow each other


def _shown_speed(channels: Channels) -> tuple[float, float]:
    """From a few speed steps to half of the largest speed: wider ones are a part of the slope."""
    speed = used_speed(channels)
    return max(3.0 * speed_step(channels), float(speed.min()) / GONE_AT), WIDEST_SHARE * float(speed.max())


class Stribeck(MeanEffect):
    """Drag that falls from the static to the Coulomb level as the speed grows."""

    name = "stribeck"
    title = "Stribeck effect"
    formula = r"\tau = (\tau_S - \tau_C)\, e^{-|\omega/\omega_s|^{\delta}}\, \operatorname{sign}(\omega)"
    description = (
        "Near zero speed the balls ride on metal instead of on a film of lubricant (mixed and boundary "
        "lubrication), and the drag is higher than the Coulomb level by up to the difference to the static "
        "friction. How sharp the knee is differs: δ = 1 (Tustin) and 2 (Gaussian, as in LuGre) are usual, ½ to 1 was "
        "measured by Bo and Pavelescu, 1.4 is in SKF's φ_bl. Both usual ones are tried, and any other is fitted where "
        "that pays."
    )
    signature = (
        "Extra drag near zero: at three Stribeck speeds 0.01 % of it is left for δ = 2, 5 % for δ = 1 (1 % at five), "
        "18 % for δ = ½. "
        "As a formula of the speed alone it is the same for both signs of dω/dt; a real film needs time to build and "
        "to drain, so that mixed friction lags the speed (frictional memory) and makes a loop in fast reversals."
    )
    confused_with = ("presliding", "speed_dead_zone", "sublinear_viscous")
    separate_by = "A slow zero crossing, and a ladder of dwells up to ten Stribeck speeds."
    source = (
        "B. Armstrong-Hélouvry, Control of Machines with Friction, Kluwer 1991; C. Canudas de Wit, H. Olsson, K. J. "
        "Åström, P. Lischinsky, A new model for control of systems with friction, IEEE TAC 40(3), 1995; exponential "
        "form: A. Tustin, The effects of backlash and of speed-dependent friction on the stability of closed-cycle "
        "control systems, Journal of the IEE 94, 1947; L. C. Bo, D. Pavelescu, The friction-speed relation and its "
        "influence on the critical velocity of stick-slip motion, Wear 82, 1982, 277–289; frictional memory: D. P. "
        "Hess, A. Soom, Friction at a lubricated line contact operating at oscillating sliding velocities, ASME "
        "Journal of Tribology 112, 1990. That wheels have drag near zero beyond Coulomb and viscous friction: S. "
        "Sarani, Determining Spacecraft Reaction Wheel Friction Parameters, NASA Tech Briefs NPO-44712, 2009. The "
        "range of ω_s for wheel bearings, 1–30 rad/s, and of δ, 0.4–3, are working assumptions."
    )
    parameters = (
        Parameter("strength_Nm", "N m", 0.0, np.inf, 5.0e-4, linear=True),
        Parameter("stribeck_speed_rad_s", "rad/s", 1e-3, 200.0, 8.0, shown=_shown_speed),
        Parameter("exponent", "-", 0.4, 3.0, 2.0, False, (1.0, 2.0), 2.0, lambda _: EXPONENT_REACH),
    )

    @classmethod
    def column(cls, channels: Channels, shape: Shape) -> FloatArray:
        ratio, exponent = np.abs(channels.speed_rad_s) / shape["stribeck_speed_rad_s"], shape["exponent"]
        usual = {1.0: ratio, 2.0: ratio * ratio}  # without logarithms
        decay = np.exp(-(usual[exponent] if exponent in usual else np.power(ratio, exponent)))
        return channels.direction * decay


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
