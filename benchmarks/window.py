"""One simulated window on its slots, with the input of detectors of other packages."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rwa_monitor.changepoints.evidence import WindowAccumulator
from rwa_monitor.changepoints.stage_results import Evidence, NoiseEstimate
from rwa_monitor.samples import BoolArray, FloatArray, Samples
from rwa_monitor.simulation.datasets import LabelledWindow
from rwa_monitor.wheel.torque_balance import corrected_friction, motor_torque
from rwa_monitor.wheel.wheel import Wheel


@dataclass(frozen=True, slots=True)
class Window:
    """One window on its slots, with the true values that peers are given.

    Attributes
    ----------
    wheel
        Its wheel.
    speed_rad_s, torque_Nm, good
        (slots,).
    noise_std
        Standard deviation of the noise, normalised.
    slope
        True viscous coefficient, normalised: peers cannot estimate it.
    """

    wheel: Wheel
    speed_rad_s: FloatArray
    torque_Nm: FloatArray
    good: BoolArray
    noise_std: float
    slope: float

    @property
    def x(self) -> FloatArray:
        """Normalised speed, float64 (slots,)."""
        return np.abs(self.speed_rad_s) / self.wheel.speed_unit_rad_s

    @property
    def z(self) -> FloatArray:
        """Normalised friction along the motion, float64 (slots,)."""
        return np.sign(self.speed_rad_s) * self.torque_Nm / self.wheel.torque_unit_Nm

    @property
    def moving(self) -> BoolArray:
        """Good slots outside the dead band, bool (slots,)."""
        return self.good & (np.abs(self.speed_rad_s) >= (self.wheel.window.dead_band_rad_s or 0.0))

    @classmethod
    def of(cls, samples: Samples, wheel: Wheel) -> Window:
        """Return samples with friction and without gaps as a window whose noise and slope are not given, NaN."""
        assert samples.friction_torque_Nm is not None
        everywhere = np.ones(len(samples), dtype=np.bool_)
        return cls(wheel, samples.speed_rad_s, samples.friction_torque_Nm, everywhere, np.nan, np.nan)

    @property
    def noise(self) -> NoiseEstimate:
        """The window's noise, assumed white."""
        return NoiseEstimate(self.noise_std, np.array([self.noise_std**2]), long_run_factor=1.0)

    def evidence(self) -> Evidence:
        """Run stage 1 over the window at once."""
        accumulator = WindowAccumulator(self.wheel, self.speed_rad_s.size)
        accumulator.append(self.speed_rad_s, self.torque_Nm, self.good)
        return accumulator.close()

    def series(self) -> FloatArray:
        """Return the input of peers: friction less viscous friction, over the noise, outside the dead band."""
        return np.ascontiguousarray((self.z - self.slope * self.x)[self.moving] / self.noise_std)


def window_of(labelled: LabelledWindow) -> Window:
    """Return a labelled window on its slots, with the truth that peers are given."""
    speed, torque = _on_slots(labelled)
    wheel, truth = labelled.wheel, labelled.telemetry.truth
    slope = float(np.mean(truth.viscous_Nm_s_rad)) * wheel.speed_unit_rad_s / wheel.torque_unit_Nm
    good = np.isfinite(speed) & np.isfinite(torque)
    return Window(wheel, speed, torque, good, truth.noise_std_Nm / wheel.torque_unit_Nm, slope)


def _on_slots(window: LabelledWindow) -> tuple[FloatArray, FloatArray]:
    """Return speed and friction torque on the slots of the window, NaN where there is no sample; float64 (slots,)."""
    samples, wheel = window.telemetry.samples, window.wheel
    slots = window.telemetry.truth.used.size
    at = np.rint((samples.time_ns - samples.time_ns[0]) / wheel.period_ns).astype(np.int64)
    speed, torque = np.full(slots, np.nan), np.full(slots, np.nan)
    speed[at] = samples.speed_rad_s
    if samples.friction_torque_Nm is not None:
        torque[at] = samples.friction_torque_Nm
        return speed, torque
    measured, motor = motor_torque(samples, wheel), np.full(slots, np.nan)
    assert measured is not None  # recipes give friction or current
    motor[at] = measured
    return speed, corrected_friction(speed, motor, wheel)
