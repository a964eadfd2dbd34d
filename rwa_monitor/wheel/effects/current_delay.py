"""Current delay: current and speed are not sampled at the same time."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from rwa_monitor.samples import BoolArray, FloatArray
from rwa_monitor.wheel.effects.base import Channels, MeanEffect, Memory, Parameter, Shape, begun, since_last, stack


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
        noise: good for simulation and for removing a known effect, not for finding one.
        """
        if channels.motor_torque_rate_Nm_s is not None:
            return stack(channels.motor_torque_rate_Nm_s), None
        state = begun(memory, np.nan, 0.0)
        motor_torque = channels.optional("motor_torque_Nm")
        usable = channels.good & np.isfinite(motor_torque)
        return stack(backward_difference(motor_torque, usable, channels.sample_period_s, state)), state


def backward_difference(values: FloatArray, usable: BoolArray, period_s: float, state: FloatArray) -> FloatArray:
    """Return the rate of change since the last usable slot, float64 (n,); 0 at the first of a record, NaN elsewhere.

    `state`, float64 (2,), is the last value (NaN at the start) and the slots since; changed in place.
    """
    rate = np.full(values.size, np.nan)
    at, since = since_last(usable, state[1:])
    if at.size:
        there = values[at]
        rate[at] = (there - np.append(state[0], there[:-1])) / (since * period_s)
        rate[at[0]] = 0.0 if np.isnan(state[0]) else rate[at[0]]
        state[0] = there[-1]
    return rate
