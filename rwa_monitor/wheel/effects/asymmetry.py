"""Differences between the directions of rotation: of dry friction, of viscous friction, or an offset of the torque."""

import numpy as np

from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import Channels, MeanEffect, Parameter, Shape


class CoulombAsymmetry(MeanEffect):
    """Dry friction, jumps included, that is (1 + ε) times the level one way and (1 - ε) times the other way.

    Bearing geometry, preload and cage make the dry friction (1 + ε)·level in positive and (1 − ε)·level in negative
    rotation. In terms of the base law s·level this is a torque ε·level that does not flip with the sign. At rest it is
    zero.

    What shows it
    -------------
    An offset that does not flip with the direction and jumps together with the level.

    See Also
    --------
    torque_bias, viscous_asymmetry

    References
    ----------
    B. Armstrong-Hélouvry, P. Dupont, C. Canudas de Wit, A survey of models, analysis tools and compensation methods for
    the control of machines with friction, Automatica 30(7), 1994 (direction-dependent Coulomb friction). The range of
    1–10 % for wheels is a working assumption: a wheel is nearly symmetric about its plane of rotation. In geared drives
    more is plausible (a robot joint came out at 0.38, where an offset explains as much: see Measured data); in a wheel
    much more rather points to an offset of current or torque (`torque_bias`), which looks the same where the level
    hardly changes.
    """

    name = "coulomb_asymmetry"
    formula = r"\tau = \varepsilon \cdot \mathrm{level}(t) \cdot \operatorname{sign}^2(\omega)"
    separate_by = "Sizes of the same jump in both directions; the current with the motor off (it shows a bias)."
    parity = "even"
    uses_level = True
    parameters = (Parameter("strength", "-", -1.0, 1.0, 0.05, linear=True),)

    @classmethod
    def column(cls, channels: Channels, shape: Shape) -> FloatArray:
        """Return level·sign²; NaN where the level is not known (`Channels.dry_level_Nm`)."""
        return channels.optional("dry_level_Nm") * np.abs(channels.direction)


class ViscousAsymmetry(MeanEffect):
    """A viscous coefficient that differs between the two directions.

    Lubricant is pumped and thrown differently in the two directions: the viscous coefficient is f_v + D_v one way and
    f_v − D_v the other way.

    What shows it
    -------------
    Another slope in each direction.

    See Also
    --------
    torque_bias, coulomb_asymmetry

    References
    ----------
    B. Armstrong-Hélouvry, P. Dupont, C. Canudas de Wit, Automatica 30(7), 1994 (direction-dependent viscous friction).
    A few per cent is a working assumption.
    """

    name = "viscous_asymmetry"
    formula = r"\tau = D_v\, |\omega|"
    separate_by = "Both directions at two speeds each."
    parity = "even"
    scales_with_viscous = True
    parameters = (Parameter("strength_Nm_s_rad", "N m s/rad", -np.inf, np.inf, 3.0e-7, linear=True),)

    @classmethod
    def column(cls, channels: Channels, shape: Shape) -> FloatArray:
        return np.abs(channels.speed_rad_s)


class TorqueBias(MeanEffect):
    """A constant torque, the same in both directions of rotation.

    An offset I₀ of the current measurement reads as a constant torque, at every speed and at rest; so does what drives
    the wheel from outside on a test bench: wind, a slope, a load cell that was not tared.

    What shows it
    -------------
    A constant that does not flip with the direction, and does not jump. In one direction it is a part of the dry
    friction, unless that seems to be negative: then by as much at least.

    See Also
    --------
    coulomb_asymmetry, viscous_asymmetry

    References
    ----------
    Offset errors of Hall and shunt current sensors are stated in their data sheets, typically 0.1–1 % of full scale;
    the range is a working assumption, no single reference.
    """

    name = "torque_bias"
    formula = r"\tau = \tau_0 = K_T I_0, \qquad I_0 = I_{\mathrm{measured}} - I"
    separate_by = "Sizes of the same jump in both directions; the current with the motor off."
    parity = "even"
    may_drive = True
    parameters = (Parameter("strength_Nm", "N m", -np.inf, np.inf, 2.0e-4, linear=True),)

    @classmethod
    def column(cls, channels: Channels, shape: Shape) -> FloatArray:
        return np.ones(len(channels))
