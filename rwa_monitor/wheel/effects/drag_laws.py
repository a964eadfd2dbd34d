"""Drag beside the base law's: by the square of the speed, by a power below one, with an end, or by the load."""

from __future__ import annotations

from typing import ClassVar, Final

import numpy as np

from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import Channels, MeanEffect, Parameter, Shape
from rwa_monitor.wheel.effects.viscosity_temperature import REFERENCE_K, ZERO_CELSIUS_K, temperature_varies


class QuadraticDrag(MeanEffect):
    """Drag that grows with the square of the speed.

    Gas in the housing is dragged along. The torque on a smooth disc goes with ω^1.8 in turbulent flow and with ω^1.5 in
    laminar flow (C_M ∝ Re^(−1/2)), and with ω where the gap to the housing is so narrow that the two boundary layers
    merge: the square is an upper end, for rough or spoked wheels and fully turbulent flow. At 1 bar of air Re = ωR²/ν
    of a wheel of 0.15 m radius is 1.5·10⁵ to 3·10⁵ at 100 to 200 rad/s: still laminar on a free disc, which turns
    turbulent from about 3·10⁵ on. A square that is found means convex drag, not which flow. Windage vanishes in vacuum:
    expect it in ground tests in air and in wheels whose sealed housing is filled with gas, which fly too; an evacuated
    or vented housing has none.

    What shows it
    -------------
    A residual that is convex in |ω|.

    See Also
    --------
    sublinear_viscous

    References
    ----------
    H. Schlichting, Boundary-Layer Theory (rotating disc: moment ∝ ω^1.5 laminar, ω^1.8 turbulent); J. W. Daily, R. E.
    Nece, Chamber dimension effects on induced flow and frictional resistance of enclosed rotating disks, ASME Journal
    of Basic Engineering 82, 1960 (four regimes by gap and Reynolds number). Re from ν = 1.5·10⁻⁵ m²/s (air, 20 °C, 1
    bar). The square is a common simplification; the size for wheels is a working assumption.
    """

    name = "quadratic_drag"
    title = "Quadratic drag (windage)"
    formula = r"\tau = c\, \omega |\omega|"
    separate_by = "A dwell at top speed, at two bearing temperatures: windage does not follow the bearing's."
    parameters = (Parameter("strength_Nm_s2_rad2", "N m s²/rad²", 0.0, np.inf, 2.0e-9, linear=True),)

    @classmethod
    def column(cls, channels: Channels, shape: Shape) -> FloatArray:
        return channels.speed_rad_s * np.abs(channels.speed_rad_s)


SHARPEST: Final = 6.0  # of the bend: at ω_s the drag is 89 % of its end; sharper is a corner
RARER: Final = 100.0  # odds of a power law, which bearings of machines are known to follow, against this one


def _shown_speed(channels: Channels) -> tuple[float, float]:
    """From a few speed steps, below which it is dry friction, to the largest speed, above which it is a slope."""
    top = float(channels.used_speed_rad_s.max())
    return max(3.0 * channels.speed_step_rad_s, 1e-3 * top), top


class SaturatingDrag(MeanEffect):
    """Drag in proportion to the speed well below a certain speed, and constant well above it.

    A lubricant that shears faster thins: Cross's law lets the viscosity fall as 1/(1 + shear rate / critical rate), and
    the drag of a film of constant thickness then levels off at the strength c, half of which it has at ω_s; Carreau's
    and Yasuda's law bends more sharply (b > 1; tanh is near b = 2). Greases and polymer-thickened oils do so; so does
    the friction of motor and gear benches at some tens of rad/s, where the viscous friction is a slope only near zero.
    What is left of a slope is the base law's. The name means concave drag with an end, not which lubricant: a power of
    the speed (`sublinear_viscous`) has no end.

    What shows it
    -------------
    A residual that is concave in |ω|: a slope near zero, a plateau above.

    See Also
    --------
    sublinear_viscous, stribeck, presliding

    References
    ----------
    M. M. Cross, Rheology of non-Newtonian fluids: a new flow equation for pseudoplastic systems, Journal of Colloid
    Science 20, 1965 (exponent 1); K. Yasuda, R. C. Armstrong, R. E. Cohen, Shear flow properties of concentrated
    solutions of linear and star branched polystyrenes, Rheologica Acta 20, 1981 (b; power index 0); S. Andersson, A.
    Söderberg, S. Björklund, Friction models for sliding dry, boundary and mixed lubricated contacts, Tribology
    International 40, 2007. That a whole bearing follows the law of one film is an assumption.
    """

    name = "saturating_drag"
    title = "Saturating drag"
    formula = r"\tau = c\, \frac{\omega / \omega_s}{\left(1 + |\omega / \omega_s|^b\right)^{1/b}}"
    separate_by = "Dwells over the whole speed range, some well above the bend: a plateau, or a power that goes on."
    choice_deviance: ClassVar[float] = 2.0 * float(np.log(RARER))
    parameters = (
        Parameter("strength_Nm", "N m", 0.0, np.inf, 1.0e-4, linear=True),
        Parameter("saturation_speed_rad_s", "rad/s", 1e-3, 1000.0, 20.0, shown=_shown_speed),
        Parameter("bend", "-", 1.0, SHARPEST, 1.0, False, (1.0,), 1.0, lambda _: SHARPEST - 1.0),
    )

    @classmethod
    def column(cls, channels: Channels, shape: Shape) -> FloatArray:
        """Return the drag at unit strength."""
        ratio, bend = channels.speed_rad_s / shape["saturation_speed_rad_s"], shape["bend"]
        if bend == 1.0:
            return ratio / (1.0 + np.abs(ratio))
        return ratio / (1.0 + np.abs(ratio) ** bend) ** (1.0 / bend)


ACTIVATION_REACH_K: Final = 3000.0  # [K] of a round of fitting; several follow each other


def _activation_reach(channels: Channels) -> float:
    return ACTIVATION_REACH_K if temperature_varies(channels) else 0.0


class SublinearViscous(MeanEffect):
    """Drag that grows as a power of the speed below one.

    The rolling torque of an oil-lubricated bearing grows as a power of the speed below one. Palmgren's law is
    empirical: ∝ (νn)^(2/3) from νn = 2000 mm²/s·r/min on, constant below. In SKF's model the rolling term is ∝
    (νn)^0.6, with inlet shear heating and replenishment or starvation as two further factors, both falling with the
    speed: they lower the apparent exponent and are not where the 0.6 comes from. The strength is the drag at 1 rad/s
    and 20 °C. Viscosity enters with the same power as the speed: where the bearing's temperature is recorded and
    varies, the oil's B (Andrade's law, see `viscosity_temperature`) is fitted, too, if that pays; B = 0 is a drag that
    does not follow the temperature.

    What shows it
    -------------
    A residual that is concave in |ω|: steep near zero, bent towards the slope at high speed; it shrinks as the bearing
    warms.

    See Also
    --------
    stribeck, quadratic_drag, presliding, speed_dead_zone, viscosity_temperature

    References
    ----------
    A. Palmgren, Ball and Roller Bearing Engineering, 3rd ed., 1959 (exponent 2/3, constant below νn = 2000); SKF,
    Rolling Bearings catalogue, the SKF model for the frictional moment (G_rr (νn)^0.6 with the factors φ_ish and φ_rs).
    Both laws are for bearings of machines; that they hold for lightly loaded, sparsely oiled wheel bearings is an
    assumption.
    """

    name = "sublinear_viscous"
    title = "Sublinear viscous drag"
    formula = (
        r"\tau = c \left(\frac{\nu(T)}{\nu_0} \left|\frac{\omega}{\omega_1}\right|\right)^{p} "
        r"\operatorname{sign}(\omega), \qquad \frac{\nu(T)}{\nu_0} = e^{B \left(1/T - 1/T_0\right)}, \quad \omega_1 = "
        r"1\,\mathrm{rad/s}, \quad T_0 = 293.15\,\mathrm{K}"
    )
    separate_by = (
        "Dwells over the whole speed range (the sign of the curvature), at two temperatures of the bearing, recorded: "
        "the whole drag shrinks by the same share, that of `viscosity_temperature` in proportion to the speed."
    )
    parameters = (
        Parameter("strength_Nm", "N m", 0.0, np.inf, 1.0e-4, linear=True),
        Parameter("exponent", "-", 0.3, 0.9, 2.0 / 3.0),
        Parameter("activation_temperature_K", "K", 0.0, 8000.0, 0.0, False, (0.0,), 0.0, _activation_reach),
    )

    @classmethod
    def column(cls, channels: Channels, shape: Shape) -> FloatArray:
        """Return the drag, less as the bearing warms where B is not zero."""
        drag = channels.direction * np.power(np.abs(channels.speed_rad_s), shape["exponent"])
        activation_K = shape["activation_temperature_K"]
        if activation_K != 0.0:
            temperature_K = channels.optional("bearing_temperature_degC") + ZERO_CELSIUS_K
            drag = drag * np.exp(shape["exponent"] * activation_K * (1.0 / temperature_K - 1.0 / REFERENCE_K))
        return drag


class LoadDependence(MeanEffect):
    """Drag that grows with the size of the motor torque, whatever its sign.

    The torque that is transmitted loads the bearings or the gear, and friction grows with load.

    What shows it
    -------------
    Drag that grows with the motor torque, in acceleration and braking alike.

    See Also
    --------
    inertia_error, torque_constant_error

    References
    ----------
    A. Palmgren, Ball and Roller Bearing Engineering, 1959 (load-dependent part of the bearing torque); for geared
    joints: P. Hamon, M. Gautier, P. Garrec, Dynamic identification of robots with a dry friction model depending on
    load and velocity, IROS 2010. No verified range for direct-driven wheels.
    """

    name = "load_dependence"
    title = "Load dependence"
    follows_acceleration = True
    formula = r"\tau = c\, |K_T I|\, \operatorname{sign}(\omega)"
    separate_by = (
        "Accelerate and brake, in both directions: this drag always opposes the motion, an error of inertia does not."
    )
    needs = frozenset({"motor_torque_Nm"})
    parameters = (Parameter("strength", "-", 0.0, 1.0, 0.02, linear=True),)

    @classmethod
    def column(cls, channels: Channels, shape: Shape) -> FloatArray:
        """Return |K_T I|·sign; in the search K_T I must be a mean of neighbours that leaves out the slot itself."""
        return channels.direction * np.abs(channels.optional("motor_torque_Nm"))
