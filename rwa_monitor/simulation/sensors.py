"""What the wheel's electronics make of the truth: noise, quantisation, and declared faults.

Sensors come before friction: speed and current are noisy and quantised first, and friction is derived from what they
measure where the scenario does not give it. Faults are applied last and marked: the truth holds every sample that is
wrong.
"""

from __future__ import annotations

from typing import Annotated, Final, Literal

import numpy as np
from pydantic import Field

from rwa_monitor.samples import BoolArray, FloatArray
from rwa_monitor.wheel.file_content import Strict
from rwa_monitor.wheel.wheel import Wheel

# Sensors of a small wheel, relative to what they measure; a scenario may give its own.
SPEED_NOISE: Final = 0.01 / 300.0  # of the nominal speed: 0.01 rad/s at 300 rad/s (errata 17)
SPEED_QUANTUM: Final = 0.005 / 300.0  # of the nominal speed: 24-bit period counter, well below its noise
CURRENT_NOISE: Final = 2.0e-5  # of the maximum current: 0.1 mA at 5 A
CURRENT_QUANTUM: Final = 2.0**-15  # of the maximum current: 16-bit converter over ± the maximum
FALLBACK_MAX_CURRENT_A: Final = 5.0  # A, of the built-in wheel; for wheels without [limits]
VOLTAGE_NOISE_V: Final = 1.0e-3  # V
TEMPERATURE_NOISE_K: Final = 0.02  # K, thermistor with averaging

ROTOR_TIME_CONSTANT_S: Final = 1200.0  # s, bearing against housing: tens of minutes for a wheel of a few kilograms
DISSIPATION_K_W: Final = 2.0  # K/W, bearing above the housing per watt of friction
ORBITAL_SWING_K: Final = (1.0, 5.0)  # K, peak to peak over an orbit; a working assumption

NoNegative = Annotated[float, Field(ge=0)]


class Sensors(Strict):
    """Noise (standard deviations) and quantisation (steps) of the channels; None: usual for a wheel of this size."""

    speed_noise_rad_s: NoNegative | None = None
    speed_quantum_rad_s: NoNegative | None = None
    current_noise_A: NoNegative | None = None
    current_quantum_A: NoNegative | None = None
    voltage_noise_V: NoNegative = VOLTAGE_NOISE_V
    temperature_noise_K: NoNegative = TEMPERATURE_NOISE_K

    def for_wheel(self, wheel: Wheel) -> Sensors:
        """Return the sensors with every None replaced by what is usual for this wheel."""
        speed = wheel.speed_unit_rad_s
        current = wheel.limits.max_current_A or FALLBACK_MAX_CURRENT_A
        usual = {
            "speed_noise_rad_s": SPEED_NOISE * speed,
            "speed_quantum_rad_s": SPEED_QUANTUM * speed,
            "current_noise_A": CURRENT_NOISE * current,
            "current_quantum_A": CURRENT_QUANTUM * current,
        }
        return self.model_copy(update={name: value for name, value in usual.items() if getattr(self, name) is None})


class FrictionNoise(Strict):
    """Noise of the friction torque v_k (paper, section II).

    Attributes
    ----------
    std_Nm
        Standard deviation [N m]; None: the wheel's.
    law
        "white" (Gaussian), "ar1" (Gaussian, autocorrelation φ^lag) or "student_t" (white, heavy tails, same variance).
    ar_coefficient
        φ of "ar1".
    degrees_of_freedom
        ν of "student_t", above 2 so that it has a variance.
    """

    std_Nm: NoNegative | None = None
    law: Literal["white", "ar1", "student_t"] = "white"
    ar_coefficient: Annotated[float, Field(gt=-1, lt=1)] = 0.5
    degrees_of_freedom: Annotated[float, Field(gt=2)] = 4.0

    def draw(self, std_Nm: float, slots: int, rng: np.random.Generator) -> FloatArray:
        """Return float64 (slots,), noise of standard deviation `std_Nm`, begun in its stationary law [N m]."""
        if self.law == "student_t":
            nu = self.degrees_of_freedom
            heavy: FloatArray = std_Nm * np.sqrt((nu - 2.0) / nu) * rng.standard_t(nu, size=slots)
            return heavy
        white = std_Nm * rng.standard_normal(slots)
        if self.law == "white":
            return white
        from scipy import signal

        phi = self.ar_coefficient
        white[1:] *= np.sqrt(1.0 - phi * phi)
        coloured: FloatArray = signal.lfilter([1.0], [1.0, -phi], white)
        return coloured

    def long_run_std(self, std_Nm: float) -> float:
        """Return the standard deviation of a long mean times the root of its length [N m]: jumps stand against it."""
        if self.law == "ar1":
            return float(std_Nm * np.sqrt((1.0 + self.ar_coefficient) / (1.0 - self.ar_coefficient)))
        return std_Nm


def measure(true: FloatArray, noise_std: float, quantum: float, rng: np.random.Generator) -> FloatArray:
    """Return a sensor's reading, float64 (n,): the truth plus white noise, rounded to the quantum."""
    reading = true + noise_std * rng.standard_normal(true.size)
    if quantum > 0.0:
        reading = quantum * np.rint(reading / quantum)
    return reading


def bearing_temperature(
    time_s: FloatArray, friction_power_W: FloatArray, orbit_s: float, rng: np.random.Generator
) -> FloatArray:
    """Return the bearing's temperature [°C], float64 (n,): orbital swing of the housing, with lag, plus dissipation.

    Parameters
    ----------
    time_s
        Time of each slot [s].
    friction_power_W
        Friction torque times speed [W], float64 (n,).
    orbit_s
        Period of the orbit [s].
    rng
        Source of all randomness: base temperature, size and phase of the swing.
    """
    base = rng.uniform(15.0, 25.0)  # °C, usual for a wheel inside the spacecraft
    swing = 0.5 * rng.uniform(*ORBITAL_SWING_K)
    rate = 2.0 * np.pi / orbit_s
    lag = np.arctan(rate * ROTOR_TIME_CONSTANT_S)  # of a first-order body behind its housing
    housing: FloatArray = base + swing * np.sin(rate * time_s + rng.uniform(0, 2 * np.pi) - lag)
    if time_s.size < 2:
        return np.asarray(housing + DISSIPATION_K_W * friction_power_W)
    from scipy import signal

    # Exact step of the first-order lag for a power constant over a slot; the record begins in thermal balance.
    stay = float(np.exp(-(time_s[1] - time_s[0]) / ROTOR_TIME_CONSTANT_S))
    target = DISSIPATION_K_W * friction_power_W
    warm, _ = signal.lfilter([1.0 - stay], [1.0, -stay], target, zi=[stay * float(np.mean(target))])
    temperature: FloatArray = housing + warm
    return temperature


class Fault(Strict):
    """A declared fault of the telemetry, applied after the sensors.

    Attributes
    ----------
    kind
        "gap": the samples are not there. "dropout": single values of the channel are not measured (NaN). "stuck": the
        channel repeats its last value. "spikes": single values of the channel are off by `size`.
    start_s, duration_s
        When, from the beginning of the record [s].
    channel
        Which channel; not for a gap.
    share
        Share of the samples within the fault that "dropout" and "spikes" hit.
    size
        Of a spike, in the channel's unit; its sign is random.
    """

    kind: Literal["gap", "dropout", "stuck", "spikes"]
    start_s: NoNegative
    duration_s: Annotated[float, Field(gt=0)]
    channel: str = "speed_rad_s"
    share: Annotated[float, Field(gt=0, le=1)] = 0.01
    size: float = 0.0

    def slots_hit(self, slots: int, period_s: float, rng: np.random.Generator) -> BoolArray:
        """Return bool (slots,), the slots that the fault hits. Slot 0 anchors the grid and is never hit."""
        hit = np.zeros(slots, dtype=np.bool_)
        first, last = (round(at / period_s) for at in (self.start_s, self.start_s + self.duration_s))
        hit[max(first, 1) : max(last, 1)] = True
        if self.kind in ("dropout", "spikes"):
            hit &= rng.random(slots) < self.share
        return hit

    def apply(self, values: FloatArray, hit: BoolArray, rng: np.random.Generator) -> FloatArray:
        """Return the channel with the fault in it, float64 (n,)."""
        faulty = values.copy()
        if self.kind in ("dropout", "gap"):
            faulty[hit] = np.nan
        elif self.kind == "stuck" and hit.any():
            faulty[hit] = values[int(np.argmax(hit)) - 1]
        elif self.kind == "spikes":
            faulty[hit] += self.size * rng.choice([-1.0, 1.0], size=int(hit.sum()))
        return faulty
