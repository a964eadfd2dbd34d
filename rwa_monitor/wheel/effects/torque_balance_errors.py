"""Apparent friction from a torque balance with a wrong constant, or with channels misaligned in time."""

from typing import ClassVar

import numpy as np

from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import Channels, MeanEffect, Memory, Parameter, Shape, begun, since_last, stack
from rwa_monitor.wheel.effects.drag_laws import SENSOR_LAG, ORIGIN_degC, lagged_temperature


class InertiaError(MeanEffect):
    """A part of J dω/dt that is taken for friction.

    Friction is K_T I − J dω/dt; where J is too small, a part of the accelerating torque is taken for friction. At a
    given dω/dt it is the same whichever way the wheel turns; it changes sign with dω/dt, so also when the whole motion
    is mirrored.

    What shows it
    -------------
    A torque that follows dω/dt, not the direction of rotation: in one direction it changes sign between speeding up and
    braking.

    See Also
    --------
    torque_constant_error, load_dependence, lubricant_lag, current_delay

    References
    ----------
    Follows from the torque balance of the wheel; J of wheels is usually known to 1–5 % before a calibration in flight
    (a working assumption).
    """

    name = "inertia_error"
    title = "Wrong inertia"
    follows_acceleration = True
    error_of = "inertia"
    formula = r"\tau = \delta J\, \dot\omega, \qquad \delta J = J_{\mathrm{true}} - J_{\mathrm{assumed}}"
    separate_by = (
        "From current and speed alone never from `torque_constant_error`: `motor_voltage_V` (K_E = K_T), "
        "`drive_power_W` or `body_momentum_Nms` does. From `load_dependence`: brake and accelerate in both directions."
    )
    parameters = (Parameter("strength_kg_m2", "kg m²", -np.inf, np.inf, 2.0e-4, linear=True),)

    @classmethod
    def column(cls, channels: Channels, shape: Shape) -> FloatArray:
        """Return dω/dt.

        In the search `acceleration_rad_s2` must not come from samples that enter the friction of the same slot: the two
        would share noise and mimic an error of inertia (1.6 % at |t| = 36 in a trial).
        Derive it from neighbours outside the friction's own stencil.
        """
        return channels.acceleration_rad_s2.astype(np.float64)


class TorqueConstantError(MeanEffect):
    """A part of the motor torque that is taken for friction.

    Friction is K_T I − J dω/dt; where K_T is too large, a part of the motor torque that is not there reads as friction.

    What shows it
    -------------
    A torque in proportion to the motor current.

    See Also
    --------
    inertia_error, load_dependence, torque_constant_temperature

    References
    ----------
    Follows from the torque balance of the wheel; motor data sheets state K_T to 5–10 %, calibrated 1–5 % (a working
    assumption).
    """

    name = "torque_constant_error"
    title = "Wrong torque constant"
    follows_acceleration = True
    error_of = "torque constant"
    formula = r"\tau = \frac{\delta K_T}{K_T}\, K_T I, \qquad \delta K_T = K_{T,\mathrm{assumed}} - K_{T,\mathrm{true}}"
    separate_by = (
        "From current and speed alone it equals `inertia_error` up to a common factor on all friction: "
        "`motor_voltage_V` (K_E = K_T), `drive_power_W` or `body_momentum_Nms` separates them."
    )
    needs = frozenset({"motor_torque_Nm"})
    parameters = (Parameter("strength", "-", -0.5, 0.5, 0.02, linear=True),)

    @classmethod
    def column(cls, channels: Channels, shape: Shape) -> FloatArray:
        """Return K_T I; in the search it must be a mean of neighbours without the slot itself (shared noise)."""
        return channels.optional("motor_torque_Nm")


class TorqueConstantTemperature(MeanEffect):
    """A torque constant that changes with temperature.

    Permanent magnets lose flux as they warm up, so that the true torque constant is below the assumed one and the
    difference reads as friction: k > 0. The bearing's temperature is used for the magnets', which follow it with a lag
    of the first order; 0 is none.

    What shows it
    -------------
    A torque in proportion to temperature times current: seen in slews, not at constant speed.

    See Also
    --------
    viscosity_temperature, torque_constant_error

    References
    ----------
    Reversible temperature coefficients of remanence in magnet makers' data sheets: about −0.04 %/K (SmCo) to −0.12 %/K
    (NdFeB).
    """

    name = "torque_constant_temperature"
    title = "Torque constant falls with temperature"
    follows_acceleration = True
    formula = (
        r"\tau = k\, (T - T_0)\, K_T I, \qquad T_0 = 20\,^\circ\mathrm{C}, \quad K_{T,\mathrm{true}} = K_T \left(1 - "
        r"k (T - T_0)\right), \qquad T_l \dot T = T_{\mathrm{sensor}} - T"
    )
    separate_by = (
        "Slews at two temperatures; at a steady speed it cannot be distinguished from `viscosity_temperature`."
    )
    needs = frozenset({"motor_torque_Nm", "bearing_temperature_degC"})
    shows_at_one_speed = True
    parameters = (Parameter("strength_1_K", "1/K", -0.01, 0.01, 8.0e-4, linear=True), SENSOR_LAG)

    @classmethod
    def columns(cls, channels: Channels, shape: Shape, memory: Memory = None) -> tuple[FloatArray, Memory]:
        """Return (T - T₀)·K_T I; in the search K_T I must be a mean of neighbours that leaves out the slot itself."""
        temperature, memory = lagged_temperature(channels, shape, memory)
        return stack((temperature - ORIGIN_degC) * channels.optional("motor_torque_Nm")), memory


class CurrentDelay(MeanEffect):
    """A misalignment in time between current and speed.

    Current and speed are sampled, filtered or stamped at different times: the motor torque that enters the balance is
    that of d seconds later (d > 0) or earlier (d < 0), to first order in d.

    What shows it
    -------------
    A torque that follows the derivative of the current: spikes at the ends of slews.

    See Also
    --------
    presliding, inertia_error

    References
    ----------
    Taylor expansion of the torque balance; delays of up to a second or two between telemetry channels are a working
    assumption.
    """

    name = "current_delay"
    title = "Current and speed misaligned in time"
    follows_acceleration = True
    formula = r"\tau = d\, K_T\, \dot I, \qquad I_{\mathrm{measured}}(t) = I(t + d)"
    separate_by = "Cross-correlation of current and dω/dt around slews; reversals at two accelerations."
    needs = frozenset({"motor_torque_Nm"})
    not_exported = (
        "no torque acts on the rotor: it is a shift in time between two channels of telemetry, and a simulator that"
        " feeds a rate of its own motor torque back is unstable; delay its current instead"
    )
    parameters: ClassVar[tuple[Parameter, ...]] = (Parameter("strength_s", "s", -5.0, 5.0, 0.25, linear=True),)

    @classmethod
    def columns(cls, channels: Channels, shape: Shape, memory: Memory = None) -> tuple[FloatArray, Memory]:
        """Return d(K_T I)/dt.

        In the search `motor_torque_rate_Nm_s` must be given, from neighbours that leave out every sample entering
        the friction of the slot. Without it a backward difference of K_T I is taken, which shares the slot's own
        noise: fit for simulation and for removing a known effect, not for finding one. It is 0 at the first usable
        slot of a record, NaN where there is no torque; the memory is the last torque and the slots since.
        """
        if channels.motor_torque_rate_Nm_s is not None:
            return stack(channels.motor_torque_rate_Nm_s), None
        return _backward_difference(channels.optional("motor_torque_Nm"), channels, memory)


class DriveLag(MeanEffect):
    """A drive that follows the torque asked of it with a lag.

    Friction that is given without a motor torque was derived from one, often the torque or the voltage that the drive
    is asked for. What acts on the rotor is that of some time d before: inductance, filters and sampling delay it. To
    first order in d the part J dω/dt that accelerates the rotor is off by d J d²ω/dt²; the friction's own share of the
    motor torque is neglected. Where a motor torque is recorded, a search tries `current_delay` instead.

    What shows it
    -------------
    A torque that follows d²ω/dt², at the beginning and the end of slews, in proportion to the change of dω/dt.

    See Also
    --------
    current_delay, inertia_error, presliding

    References
    ----------
    Taylor expansion of the torque balance, as of `current_delay`, whose form it has where the motor torque is measured.
    """

    name = "drive_lag"
    title = "Drive lags the torque asked of it"
    follows_acceleration = True
    superseded_by = CurrentDelay.needs
    unmeasured_cause = CurrentDelay.name
    formula = r"\tau = d J\, \ddot\omega, \qquad d \geq 0"
    separate_by = "The motor's current in place of the torque asked for; ramps of the speed of different steepness."
    not_exported = CurrentDelay.not_exported
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("strength_kg_m2_s", "kg m² s", 0.0, np.inf, 5.0e-5, linear=True),
    )

    @classmethod
    def columns(cls, channels: Channels, shape: Shape, memory: Memory = None) -> tuple[FloatArray, Memory]:
        """Return d²ω/dt², from neighbours in the search, else a backward difference; see `CurrentDelay.columns`."""
        if channels.acceleration_rate_rad_s3 is not None:
            return stack(channels.acceleration_rate_rad_s3), None
        return _backward_difference(channels.acceleration_rad_s2, channels, memory)


def _backward_difference(values: FloatArray, channels: Channels, memory: Memory) -> tuple[FloatArray, Memory]:
    """Return the rate of a channel from the usable slot before, (n, 1), and the last value with the slots since."""
    state = begun(memory, np.nan, 0.0)
    rate = np.full(values.size, np.nan)
    at, since = since_last(channels.good & np.isfinite(values), state[1:])
    if at.size:
        there = values[at]
        rate[at] = (there - np.append(state[0], there[:-1])) / (since * channels.sample_period_s)
        rate[at[0]] = 0.0 if np.isnan(state[0]) else rate[at[0]]
        state[0] = there[-1]
    return stack(rate), state
