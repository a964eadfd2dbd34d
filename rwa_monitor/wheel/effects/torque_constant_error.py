"""Torque constant error: the motor's torque constant in wheel.toml is not the motor's."""

from __future__ import annotations

from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import Channels, MeanEffect, Parameter, Shape


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
