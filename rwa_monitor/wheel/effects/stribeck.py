"""Stribeck effect: extra drag near zero speed, where the lubricant film is not yet built up."""

from __future__ import annotations

from typing import Final

import numpy as np

from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import Channels, MeanEffect, Parameter, Shape

GONE_AT: Final = 5.0  # [-] at |ω| = 5 ω_s less than 1 % is left for exponents of one and more
WIDEST_SHARE: Final = 0.5  # of the largest speed: e⁻² of a wide one (δ = 1) is left there, and the rest is seen
EXPONENT_REACH: Final = 0.6  # of a round of fitting; several follow each other


def _shown_speed(channels: Channels) -> tuple[float, float]:
    """From a few speed steps to half of the largest speed: wider ones are a part of the slope."""
    speed = channels.used_speed_rad_s
    return max(3.0 * channels.speed_step_rad_s, float(speed.min()) / GONE_AT), WIDEST_SHARE * float(speed.max())


class Stribeck(MeanEffect):
    """Drag that falls from the static to the Coulomb level as the speed grows.

    Near zero speed the balls ride on metal instead of on a film of lubricant (mixed and boundary lubrication), and the
    drag is higher than the Coulomb level by up to the difference to the static friction. How sharp the knee is differs:
    δ = 1 (Tustin) and 2 (Gaussian, as in LuGre) are usual, ½ to 1 was measured by Bo and Pavelescu, 1.4 is in SKF's
    φ_bl. Both usual ones are tried, and any other is fitted where that pays.

    What shows it
    -------------
    Extra drag near zero: at three Stribeck speeds 0.01 % of it is left for δ = 2, 5 % for δ = 1 (1 % at five), 18 % for
    δ = ½. As a formula of the speed alone it is the same for both signs of dω/dt; a real film needs time to build and
    to drain, so that mixed friction lags the speed (frictional memory) and makes a loop in fast reversals.

    See Also
    --------
    presliding, speed_dead_zone, sublinear_viscous

    References
    ----------
    B. Armstrong-Hélouvry, Control of Machines with Friction, Kluwer 1991; C. Canudas de Wit, H. Olsson, K. J. Åström,
    P. Lischinsky, A new model for control of systems with friction, IEEE TAC 40(3), 1995; exponential form: A. Tustin,
    The effects of backlash and of speed-dependent friction on the stability of closed-cycle control systems, Journal of
    the IEE 94, 1947; L. C. Bo, D. Pavelescu, The friction-speed relation and its influence on the critical velocity of
    stick-slip motion, Wear 82, 1982, 277–289; frictional memory: D. P. Hess, A. Soom, Friction at a lubricated line
    contact operating at oscillating sliding velocities, ASME Journal of Tribology 112, 1990. That wheels have drag near
    zero beyond Coulomb and viscous friction: S. Sarani, Determining Spacecraft Reaction Wheel Friction Parameters, NASA
    Tech Briefs NPO-44712, 2009. The range of ω_s for wheel bearings, 1–30 rad/s, and of δ, 0.4–3, are working
    assumptions.
    """

    name = "stribeck"
    title = "Stribeck effect"
    formula = r"\tau = (\tau_S - \tau_C)\, e^{-|\omega/\omega_s|^{\delta}}\, \operatorname{sign}(\omega)"
    separate_by = "A slow zero crossing, and a ladder of dwells up to ten Stribeck speeds."
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
