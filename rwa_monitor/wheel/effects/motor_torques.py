"""Torques that follow the motor torque or the acceleration: wrong constants of the balance, and friction under load."""

from __future__ import annotations

from typing import Final

import numpy as np

from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import Channels, MeanEffect, Parameter, Shape, known_or_nan


class InertiaError(MeanEffect):
    """A part of J dω/dt that is taken for friction."""

    name = "inertia_error"
    title = "Wrong inertia"
    formula = r"\tau = \delta J\, \dot\omega, \qquad \delta J = J_{\mathrm{true}} - J_{\mathrm{assumed}}"
    description = (
        "Friction is K_T I − J dω/dt; where J is too small, a part of the accelerating torque is taken for friction. "
        "At a given dω/dt it is the same whichever way the wheel turns; it changes sign with dω/dt, so also when the "
        "whole motion is mirrored."
    )
    signature = (
        "A torque that follows dω/dt, not the direction of rotation: in one direction it changes sign between "
        "speeding up and braking."
    )
    confused_with = ("torque_constant_error", "load_dependence", "lubricant_lag", "current_delay")
    separate_by = (
        "From current and speed alone never from `torque_constant_error`: the motor voltage (K_E = K_T) or the "
        "body's angular momentum does. From `load_dependence`: brake and accelerate in both directions."
    )
    source = (
        "Follows from the torque balance of the wheel; J of wheels is usually known to 1–5 % before a calibration "
        "in flight (a working assumption)."
    )
    parameters = (Parameter("strength_kg_m2", "kg m²", -np.inf, np.inf, 2.0e-4, linear=True),)

    @classmethod
    def column(cls, channels: Channels, shape: Shape) -> FloatArray:
        """Return dω/dt.

        In the search `acceleration_rad_s2` must not come from samples that enter the friction of the same slot: the two
        would share noise, and an error of inertia would be found that is not there (1.6 % at |t| = 36 in a trial).
        Derive it from neighbours outside the friction's own stencil.
        """
        return channels.acceleration_rad_s2.astype(np.float64)


class TorqueConstantError(MeanEffect):
    """A part of the motor torque that is taken for friction."""

    name = "torque_constant_error"
    title = "Wrong torque constant"
    formula = r"\tau = \frac{\delta K_T}{K_T}\, K_T I, \qquad \delta K_T = K_{T,\mathrm{assumed}} - K_{T,\mathrm{true}}"
    description = (
        "Friction is K_T I − J dω/dt; where K_T is too large, a part of the motor torque that is not there reads as "
        "friction."
    )
    signature = "A torque in proportion to the motor current."
    confused_with = ("inertia_error", "load_dependence", "torque_constant_temperature")
    separate_by = (
        "From current and speed alone it equals `inertia_error` up to a common factor on all friction: the motor "
        "voltage (K_E = K_T) or the body's angular momentum separates them."
    )
    source = (
        "Follows from the torque balance of the wheel; motor data sheets state K_T to 5–10 %, calibrated 1–5 % (a "
        "working assumption)."
    )
    needs = frozenset({"motor_torque_Nm"})
    parameters = (Parameter("strength", "-", -0.5, 0.5, 0.02, linear=True),)

    @classmethod
    def column(cls, channels: Channels, shape: Shape) -> FloatArray:
        """Return K_T I; in the search it must be a mean of neighbours without the slot itself (shared noise)."""
        return known_or_nan(channels.motor_torque_Nm, channels)


REFERENCE_DEGC: Final = 20.0  # [°C] where the torque constant is the assumed one


class TorqueConstantTemperature(MeanEffect):
    """A torque constant that changes with temperature."""

    name = "torque_constant_temperature"
    title = "Torque constant falls with temperature"
    formula = (
        r"\tau = k\, (T - T_0)\, K_T I, \qquad T_0 = 20\,^\circ\mathrm{C}, \quad K_{T,\mathrm{true}} = K_T \left(1 - "
        r"k (T - T_0)\right)"
    )
    description = (
        "Permanent magnets lose flux as they warm up, so that the true torque constant is below the assumed one and "
        "the difference reads as friction: k > 0. The bearing's temperature stands for the magnets'."
    )
    signature = "A torque in proportion to temperature times current: seen in slews, not at constant speed."
    confused_with = ("viscosity_temperature", "torque_constant_error")
    separate_by = (
        "Slews at two temperatures; at a steady speed it cannot be distinguished from `viscosity_temperature`."
    )
    source = (
        "Reversible temperature coefficients of remanence in magnet makers' data sheets: about −0.04 %/K (SmCo) to "
        "−0.12 %/K (NdFeB)."
    )
    needs = frozenset({"motor_torque_Nm", "bearing_temperature_degC"})
    shows_at_one_speed = True
    parameters = (Parameter("strength_1_K", "1/K", -0.01, 0.01, 8.0e-4, linear=True),)

    @classmethod
    def column(cls, channels: Channels, shape: Shape) -> FloatArray:
        """Return (T - T₀)·K_T I; in the search K_T I must be a mean of neighbours that leaves out the slot itself."""
        warmer_K = known_or_nan(channels.bearing_temperature_degC, channels) - REFERENCE_DEGC
        return warmer_K * known_or_nan(channels.motor_torque_Nm, channels)


class LoadDependence(MeanEffect):
    """Drag that grows with the size of the motor torque, whatever its sign."""

    name = "load_dependence"
    title = "Load dependence"
    formula = r"\tau = c\, |K_T I|\, \operatorname{sign}(\omega)"
    description = "The torque that is transmitted loads the bearings or the gear, and friction grows with load."
    signature = "Drag that grows with the motor torque, in acceleration and braking alike."
    confused_with = ("inertia_error", "torque_constant_error")
    separate_by = (
        "Accelerate and brake, in both directions: this drag always opposes the motion, an error of inertia does not."
    )
    source = (
        "A. Palmgren, Ball and Roller Bearing Engineering, 1959 (load-dependent part of the bearing torque); for "
        "geared joints: P. Hamon, M. Gautier, P. Garrec, Dynamic identification of robots with a dry friction model "
        "depending on load and velocity, IROS 2010. No verified range for direct-driven wheels."
    )
    needs = frozenset({"motor_torque_Nm"})
    parameters = (Parameter("strength", "-", 0.0, 1.0, 0.02, linear=True),)

    @classmethod
    def column(cls, channels: Channels, shape: Shape) -> FloatArray:
        """Return |K_T I|·sign; in the search K_T I must be a mean of neighbours that leaves out the slot itself."""
        return channels.direction * np.abs(known_or_nan(channels.motor_torque_Nm, channels))
