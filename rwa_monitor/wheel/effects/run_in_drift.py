"""Run-in drift: the dry friction changes slowly, at a constant rate or towards an end value."""

from __future__ import annotations

import numpy as np

from rwa_monitor.samples import SECONDS_PER_HOUR, FloatArray
from rwa_monitor.wheel.effects.base import Channels, MeanEffect, Parameter, Shape


def _shown_time(channels: Channels) -> tuple[float, float]:
    """From a twentieth of the record (shorter: a transient at its start) to ten records (longer: a ramp)."""
    return 0.05 * channels.duration_s, 10.0 * channels.duration_s


class RunInDrift(MeanEffect):
    """A slow drift of the dry friction, from a ramp to an exponential.

    Surfaces run in and lubricant migrates: the level of the dry friction drifts, at first with the rate a. In run-in it
    falls and settles with a time constant. Wear or loss of lubricant makes it rise and does not settle: that is the
    plain ramp of a time constant beyond the record. Time starts with the record, not with the bearing's life: a is the
    rate at the first sample, and records of different age need strengths of their own.

    What shows it
    -------------
    A slow ramp of the level, which a segmentation otherwise follows by many small jumps.

    See Also
    --------
    viscosity_temperature, lubricant_lag

    References
    ----------
    B. J. Hamrock, S. R. Schmid, B. O. Jacobson, Fundamentals of Fluid Film Lubrication, 2004 (running-in of rolling
    contacts, qualitative). Hours and longer; the exponential form is a working assumption.
    """

    name = "run_in_drift"
    title = "Run-in drift"
    formula = (
        r"\tau = a\, T_d \left(1 - e^{-t / T_d}\right) \operatorname{sign}(\omega) \;\to\; a\, t\, "
        r"\operatorname{sign}(\omega) \text{ for } T_d \to \infty"
    )
    separate_by = "Long records over several windows, at constant temperature."
    parameters = (
        Parameter("strength_Nm_s", "N m/s", -np.inf, np.inf, -5.0e-9, linear=True),
        Parameter("time_constant_s", "s", 1.0, 1.0e9, 1.0e5, shown=_shown_time),
    )
    shows_at_one_speed = True
    changes_with_time = True
    of_one_recording = True
    unmeasured_cause = "viscosity_temperature"

    @classmethod
    def column(cls, channels: Channels, shape: Shape) -> FloatArray:
        time_constant_s = shape["time_constant_s"]
        settled = -time_constant_s * np.expm1(-channels.time_s / time_constant_s)
        return channels.direction * settled

    @classmethod
    def largest_share(cls, channels: Channels) -> float:
        """All of the friction within an hour: the catalogue's is slower (see `source`: hours and longer)."""
        return min(channels.duration_s / SECONDS_PER_HOUR, 1.0)
