"""Drag beyond the base law: near zero, as a power of the speed, saturating, by load or by temperature."""

from collections.abc import Callable
from typing import ClassVar, Final

import numpy as np
from scipy.constants import zero_Celsius

from rwa_monitor.kernels.effects import first_order_lag
from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import Channels, MeanEffect, Memory, Parameter, Shape, follow, stack

GONE_AT: Final = 5.0  # [-] at |ω| = 5 ω_s less than 1 % is left for exponents of one and more
# Of the largest value: a wide knee (δ = 1) has fallen to e⁻² there and is identifiable; a wider bump has no centre.
WIDEST_SHARE: Final = 0.5
MOST_STATIC: Final = 3.0  # (τ_S − τ_C)/τ_C [-]: bearings show up to 1, other machines more, a working assumption
EXPONENT_REACH: Final = 0.6  # from the start of a round of fitting; several rounds follow each other


def _shown_knee(channels: Channels) -> tuple[float, float]:
    """Return a few speed steps and half of the largest speed: a wider knee is a part of the slope."""
    speed = channels.used_speed_rad_s
    return max(3.0 * channels.speed_step_rad_s, float(speed.min()) / GONE_AT), WIDEST_SHARE * float(speed.max())


class Stribeck(MeanEffect):
    """Drag that falls from the static to the Coulomb level as the speed grows.

    Near zero speed the balls ride on metal instead of on a film of lubricant (mixed and boundary lubrication), and the
    drag is higher than the Coulomb level by up to the difference to the static friction. How sharp the knee is differs:
    δ = 1 (Tustin) and 2 (Gaussian, as in LuGre) are usual, ½ to 1 was measured by Bo and Pavelescu, 1.4 is in SKF's
    φ_bl. Both usual ones are tried, and any other is fitted where the score favours it.

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
        Parameter("stribeck_speed_rad_s", "rad/s", 1e-3, 200.0, 8.0, shown=_shown_knee),
        Parameter("exponent", "-", 0.4, 3.0, 2.0, False, (1.0, 2.0), 2.0, lambda _: EXPONENT_REACH),
    )

    @classmethod
    def column(cls, channels: Channels, shape: Shape) -> FloatArray:
        ratio, exponent = np.abs(channels.speed_rad_s) / shape["stribeck_speed_rad_s"], shape["exponent"]
        usual = {1.0: ratio, 2.0: ratio * ratio}  # without logarithms
        decay = np.exp(-(usual[exponent] if exponent in usual else np.power(ratio, exponent)))
        return channels.direction * decay

    @classmethod
    def is_possible(cls, strengths: FloatArray, dry_Nm: float, viscous_Nm_s_rad: float) -> bool:
        """Return whether static friction exceeds Coulomb friction by at most three times that; else other drag."""
        return float(strengths[0]) <= MOST_STATIC * dry_Nm


ORIGIN_degC: Final = 20.0  # where laws of the temperature are one or zero: a convention
REFERENCE_K: Final = zero_Celsius + ORIGIN_degC  # [K] where ν = ν₀: it shifts strength into the base slope
SEASON_K: Final = 15.0  # [K] to either side over a year in orbit; a working assumption
LEAST_K: Final = 0.5  # [K] within a record: less is the resolution of a housekeeping sensor, and shows no lag
LAG_REACH_S: Final = 300.0  # [s] from the start of a round of fitting; several rounds follow each other
ACTIVATION_REACH_K: Final = 3000.0  # [K] from the start of a round of fitting; several rounds follow each other


def temperature_varies(channels: Channels) -> bool:
    """Return whether the bearing's temperature varies within a record by more than a sensor's resolution."""
    return bool(np.ptp(channels.known(channels.optional("bearing_temperature_degC"))) > LEAST_K)


def _reach(reach: float) -> Callable[[Channels], float]:
    """Return a function that gives this reach where the temperature varies, else zero."""
    return lambda channels: reach if temperature_varies(channels) else 0.0


SENSOR_LAG: Final = Parameter("sensor_lag_s", "s", 0.0, 7200.0, 0.0, False, (0.0,), 0.0, _reach(LAG_REACH_S))


def lagged_temperature(channels: Channels, shape: Shape, memory: Memory) -> tuple[FloatArray, Memory]:
    """Return the sensor's temperature lagged by `sensor_lag_s` [°C], float64 (n,), and the memory of the lag."""
    temperature = channels.optional("bearing_temperature_degC")
    if shape[SENSOR_LAG.name] > 0.0:
        known, period_s = np.isfinite(temperature), channels.sample_period_s
        return follow(first_order_lag, temperature, known, period_s, shape[SENSOR_LAG.name], memory)
    return temperature, memory


class ViscosityTemperature(MeanEffect):
    """A viscous coefficient that falls as the bearing warms up.

    The lubricant's viscosity falls with temperature, after Andrade's (Arrhenius') law. The strength is the viscous
    coefficient at 20 °C that scales with it. Drag is taken in proportion to the viscosity. Where a bearing's drag goes
    with (νn)^0.6 to (νn)^(2/3) (see `sublinear_viscous`) the B found here is 0.6 to 0.67 of the oil's: it is an
    apparent B, not the one of the oil's data sheet. Over a few kelvin only the product of strength and B shows; over
    ten kelvin and more the curvature gives both, if the oil is exactly Arrhenius. After Vogel's law B falls as the oil
    warms: what is found then holds over the temperatures of the record alone, and strength and B are each off by more
    than their stated errors. Where the sensor sits on the housing, the bearing follows it with a lag of the first
    order; 0 is a sensor in the bearing. In a wheel file with [nominal] this is a factor on the viscous friction, not a
    torque beside it: a fault scales the whole.

    What shows it
    -------------
    A slope that follows the bearing temperature, with its thermal lag.

    See Also
    --------
    lubricant_lag, torque_constant_temperature, run_in_drift

    References
    ----------
    E. N. da C. Andrade, The viscosity of liquids, Nature 125, 1930; review: C. J. Seeton, Viscosity–temperature
    correlation for liquids, Tribology Letters 22, 2006. B from 1700 to 6900 K gives −2 to −8 % per kelvin at 20 °C, the
    range of common space oils as a working assumption.
    """

    name = "viscosity_temperature"
    title = "Viscosity falls with temperature"
    formula = (
        r"\tau = f_v\, \omega \left(\frac{\nu(T)}{\nu_0} - 1\right), \qquad \frac{\nu(T)}{\nu_0} = e^{B \left(1/T - "
        r"1/T_0\right)}, \quad T_0 = 293.15\,\mathrm{K}, \qquad T_l \dot T = T_{\mathrm{sensor}} - T"
    )
    separate_by = "Constant speed for an orbit, at two speeds."
    needs = frozenset({"bearing_temperature_degC"})
    shows_at_one_speed = True
    is_part_of_viscous = True
    scales_with_viscous = True
    follows_temperature = True
    parameters = (
        Parameter("strength_Nm_s_rad", "N m s/rad", 0.0, np.inf, 5.333e-6, linear=True),
        Parameter("activation_temperature_K", "K", 1500.0, 8000.0, 4000.0),
        SENSOR_LAG,
    )

    @classmethod
    def columns(cls, channels: Channels, shape: Shape, memory: Memory = None) -> tuple[FloatArray, Memory]:
        temperature, memory = lagged_temperature(channels, shape, memory)
        exponent = shape["activation_temperature_K"] * (1.0 / (temperature + zero_Celsius) - 1.0 / REFERENCE_K)
        return stack(channels.speed_rad_s * np.expm1(exponent)), memory


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
RARER: Final = 100.0  # prior odds of a power law, which bearings of machines are known to follow, over this law


def _shown_speed(channels: Channels) -> tuple[float, float]:
    """Return a few speed steps, below which it is dry friction, and the largest speed, above which it is a slope."""
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


class SublinearViscous(MeanEffect):
    """Drag that grows as a power of the speed below one.

    The rolling torque of an oil-lubricated bearing grows as a power of the speed below one. Palmgren's law is
    empirical: ∝ (νn)^(2/3) from νn = 2000 mm²/s·r/min on, constant below. In SKF's model the rolling term is ∝
    (νn)^0.6, with inlet shear heating and replenishment or starvation as two further factors, both falling with the
    speed: they lower the apparent exponent and are not where the 0.6 comes from. The strength is the drag at 1 rad/s
    and 20 °C. Viscosity enters with the same power as the speed: where the bearing's temperature is recorded and
    varies, the oil's B (Andrade's law, see `viscosity_temperature`) is fitted too if the score favours it; B = 0 is a
    drag that does not follow the temperature.

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
        Parameter("activation_temperature_K", "K", 0.0, 8000.0, 0.0, False, (0.0,), 0.0, _reach(ACTIVATION_REACH_K)),
    )

    @classmethod
    def column(cls, channels: Channels, shape: Shape) -> FloatArray:
        """Return the drag at unit strength; where B is not zero, it falls as the bearing warms."""
        drag = channels.direction * np.power(np.abs(channels.speed_rad_s), shape["exponent"])
        activation_K = shape["activation_temperature_K"]
        if activation_K != 0.0:
            temperature_K = channels.optional("bearing_temperature_degC") + zero_Celsius
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
