"""Coulomb asymmetry: all dry friction is larger in one direction of rotation."""

from __future__ import annotations

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
    title = "Coulomb asymmetry"
    formula = r"\tau = \varepsilon \cdot \mathrm{level}(t) \cdot \operatorname{sign}^2(\omega)"
    separate_by = "Sizes of the same jump in both directions; the current with the motor off (it shows a bias)."
    parity = "even"
    uses_level = True
    parameters = (Parameter("strength", "-", -1.0, 1.0, 0.05, linear=True),)

    @classmethod
    def column(cls, channels: Channels, shape: Shape) -> FloatArray:
        """Return level·sign²; NaN where the level is not known (`Channels.dry_level_Nm`)."""
        return channels.optional("dry_level_Nm") * np.abs(channels.direction)
