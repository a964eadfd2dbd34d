"""Run-in drift: the dry friction changes slowly, at a constant rate or towards an end value."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import Channels, MeanEffect, Memory, Parameter, duration, narrowed, stack

HOUR_S: Final = 3600.0


class RunInDrift(MeanEffect):
    """A slow drift of the dry friction, from a ramp to an exponential."""

    name = "run_in_drift"
    title = "Run-in drift"
    formula = (
        r"\tau = a\, T_d \left(1 - e^{-t / T_d}\right) \operatorname{sign}(\omega) \;\to\; a\, t\, "
        r"\operatorname{sign}(\omega) \text{ for } T_d \to \infty"
    )
    description = (
        "Surfaces run in and lubricant migrates: the level of the dry friction drifts, at first with the rate a. In "
        "run-in it falls and settles with a time constant. Wear or loss of lubricant makes it rise and does not "
        "settle: that is the plain ramp of a time constant beyond the record. Time starts with the record, not with "
        "the bearing's life: a is the rate at the first sample, and records of different age need strengths of their "
        "own."
    )
    signature = "A slow ramp of the level, which a segmentation otherwise follows by many small jumps."
    confused_with = ("viscosity_temperature", "lubricant_lag")
    separate_by = "Long records over several windows, at constant temperature."
    source = (
        "B. J. Hamrock, S. R. Schmid, B. O. Jacobson, Fundamentals of Fluid Film Lubrication, 2004 (running-in of "
        "rolling contacts, qualitative). Hours and longer; the exponential form is a working assumption."
    )
    parameters = (
        Parameter("strength_Nm_s", "N m/s", -np.inf, np.inf, -5.0e-9, linear=True),
        Parameter("time_constant_s", "s", 1.0, 1.0e9, 1.0e5),
    )
    shows_at_one_speed = True
    changes_with_time = True
    of_one_recording = True
    unmeasured_cause = "viscosity_temperature"

    @classmethod
    def columns(
        cls, channels: Channels, shape: Mapping[str, float], memory: Memory = None
    ) -> tuple[FloatArray, Memory]:
        del memory
        time_constant_s = shape["time_constant_s"]
        settled = -time_constant_s * np.expm1(-channels.time_s / time_constant_s)
        return stack(channels.direction * settled), None

    @classmethod
    def shape_bounds(cls, channels: Channels) -> dict[str, tuple[float, float]]:
        """From a twentieth of the record (shorter: a transient at its start) to ten records (longer: a ramp)."""
        bounds = super().shape_bounds(channels)
        length = duration(channels)
        return {**bounds, "time_constant_s": narrowed(bounds["time_constant_s"], 0.05 * length, 10.0 * length)}

    @classmethod
    def largest_share(cls, channels: Channels) -> float:
        """All of the friction within an hour: the catalogue's is slower (see `source`: hours and longer)."""
        return min(duration(channels) / HOUR_S, 1.0)
