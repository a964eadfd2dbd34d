"""A scenario: motion, anomalies, sensors and faults of a simulated wheel, read from TOML as the wheel's constants are.

```toml
[scenario]
duration_s = 10000.0
friction_given = true            # false: only speed and current, friction is left to be derived

[speed]
kind = "orbit"                   # one_direction, crossings, rich, constant, from_rest

[anomalies.fss_2]
factor = 1.4
onset_s = 3000.0                 # nominal before
growth_s = 2000.0                # from 1 to the factor over this time; 0: at once

[[effect]]                       # beyond those of the wheel: what the wheel's model does not know
name = "stribeck"
parameters = { strength_Nm = 5.0e-4, stribeck_speed_rad_s = 8.0 }

[[fault]]
kind = "gap"
start_s = 1000.0
duration_s = 12.0
```
"""

from typing import Annotated, ClassVar, Final, Literal

import numpy as np
from numpy.random import Generator
from pydantic import Field

from rwa_monitor.errors import InputError
from rwa_monitor.samples import BoolArray, FloatArray, TableChannelName
from rwa_monitor.simulation.motion import SpeedProfile
from rwa_monitor.wheel.effects.noise_laws import autoregress
from rwa_monitor.wheel.file_content import Strict, TomlFile
from rwa_monitor.wheel.torque_balance import inertia_of, torque_constant_of
from rwa_monitor.wheel.wheel import EffectBlock, NoNegative, Positive, Wheel, built_in_wheel

MAX_SLOTS: Final = 100_000_000  # of one simulated record: 10 GB of channels and truth; more is a wrong unit

# Sensors of a small wheel, relative to what they measure; a scenario may give its own.
SPEED_NOISE: Final = 0.01 / 300.0  # of the nominal speed: 0.01 rad/s at 300 rad/s (errata 17)
SPEED_QUANTUM: Final = 0.005 / 300.0  # of the nominal speed: 24-bit period counter, well below its noise
CURRENT_NOISE: Final = 2.0e-5  # of the maximum current: 0.1 mA at 5 A
CURRENT_QUANTUM: Final = 2.0**-15  # of the maximum current: 16-bit converter over ± that current


class Sensors(Strict):
    """Noise (standard deviations) and quantisation (steps) of the channels; None: usual for a wheel of this size."""

    speed_noise_rad_s: NoNegative | None = None
    speed_quantum_rad_s: NoNegative | None = None
    current_noise_A: NoNegative | None = None
    current_quantum_A: NoNegative | None = None
    friction_quantum_Nm: NoNegative = 0.0
    voltage_noise_V: NoNegative = 1.0e-3
    power_noise_W: NoNegative = 0.05
    momentum_noise_Nms: NoNegative = 1.0e-4
    temperature_noise_K: NoNegative = 0.02  # a thermistor with averaging

    def for_wheel(self, wheel: Wheel) -> dict[str, float]:
        """Return all values by name; in place of None the usual value for this wheel, or for the built-in one."""
        speed = wheel.speed_unit_rad_s
        current = wheel.limits.max_current_A or built_in_wheel().limits.max_current_A
        assert current is not None
        usual = {
            "speed_noise_rad_s": SPEED_NOISE * speed,
            "speed_quantum_rad_s": SPEED_QUANTUM * speed,
            "current_noise_A": CURRENT_NOISE * current,
            "current_quantum_A": CURRENT_QUANTUM * current,
        }
        return {**usual, **self.model_dump(exclude_none=True)}


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

    def draw(self, std_Nm: float, slots: int, rng: Generator) -> FloatArray:
        """Return float64 (slots,), noise of standard deviation `std_Nm`, started in its stationary law [N m]."""
        if self.law == "student_t":
            nu = self.degrees_of_freedom
            heavy: FloatArray = std_Nm * np.sqrt((nu - 2.0) / nu) * rng.standard_t(nu, size=slots)
            return heavy
        white = std_Nm * rng.standard_normal(slots)
        return autoregress(white, self.ar_coefficient) if self.law == "ar1" else white

    def long_run_std(self, std_Nm: float) -> float:
        """Return the standard deviation of a long mean times the root of its length [N m], the noise of jump sizes."""
        if self.law == "ar1":
            return float(std_Nm * np.sqrt((1.0 + self.ar_coefficient) / (1.0 - self.ar_coefficient)))
        return std_Nm


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
    duration_s: Positive
    channel: TableChannelName = "speed_rad_s"
    share: Annotated[float, Field(gt=0, le=1)] = 0.01
    size: float = 0.0

    def slots_hit(self, slots: int, period_s: float, rng: Generator) -> BoolArray:
        """Return bool (slots,), the slots that the fault hits. Slot 0 anchors the grid and is never hit."""
        hit = np.zeros(slots, dtype=np.bool_)
        first, last = (round(at / period_s) for at in (self.start_s, self.start_s + self.duration_s))
        hit[max(first, 1) : max(last, 1)] = True
        if self.kind in ("dropout", "spikes"):
            hit &= rng.random(slots) < self.share
        return hit

    def apply(self, values: FloatArray, hit: BoolArray, rng: Generator) -> FloatArray:
        """Return the channel with the fault in it, float64 (n,)."""
        faulty = values.copy()
        if self.kind == "dropout":
            faulty[hit] = np.nan
        elif self.kind == "stuck" and hit.any():
            faulty[hit] = values[int(np.argmax(hit)) - 1]
        elif self.kind == "spikes":
            faulty[hit] += self.size * rng.choice([-1.0, 1.0], size=int(hit.sum()))
        return faulty


class Temperature(Strict):
    """The bearing's surroundings, where a scenario states them: mean [°C], and swing about it in an orbit, ± [K]."""

    mean_degC: Annotated[float, Field(gt=-100, lt=200)] = 20.0
    swing_K: NoNegative = 0.0


class Anomaly(Strict):
    """A component of the friction grows by a factor.

    Attributes
    ----------
    factor
        On base dry friction, viscous coefficient or the friction of a switching system, by the anomaly's name.
    onset_s
        Nominal before this time from the beginning of the record [s].
    growth_s
        The factor grows linearly from 1 to its value over this time after the onset [s].
    """

    factor: Annotated[float, Field(ge=0, le=100)]
    onset_s: NoNegative = 0.0
    growth_s: NoNegative = 0.0

    def factor_at(self, time_s: FloatArray) -> FloatArray:
        """Return the factor at times from the beginning of the record [s], float64 (n,)."""
        return 1.0 + (self.factor - 1.0) * self.share_at(time_s)

    def share_at(self, time_s: FloatArray) -> FloatArray:
        """Return how far the anomaly has grown at those times, 0 … 1, float64 (n,)."""
        if self.growth_s == 0.0:
            return np.where(time_s >= self.onset_s, 1.0, 0.0)
        return np.clip((time_s - self.onset_s) / self.growth_s, 0.0, 1.0)


class Base(Strict):
    """Healthy friction of this wheel relative to its wheel file's historical averages, as factors on them.

    Base dry friction drifts from there as a random walk: `dry_drift_per_sqrt_h` is its standard deviation after an
    hour, relative to the average [1/√h].
    """

    dry: Positive = 1.0
    viscous: NoNegative = 1.0
    dry_drift_per_sqrt_h: NoNegative = 0.0


class Scenario(TomlFile):
    """What happens to a simulated wheel; see the module's example.

    Attributes
    ----------
    duration_s
        Length of the record [s].
    start_ns
        Time of the first sample [ns].
    friction_given
        True: the record has `friction_torque_Nm`, the true friction plus noise, and a current that agrees with it.
        False: only speed and current; what friction there is must be derived from them.
    channels
        Channels of the record, by the names of the sample table; None: those of a message that the wheel's constants
        allow, without motor torque, which repeats the current. The body's momentum is the wheel's with opposite sign.
    temperature
        None: drawn, as usual for a wheel inside the spacecraft.
    speed, base, anomalies, noise, sensors, effect, fault
        See their classes. `effect` comes on top of the wheel's own effects.
    """

    head: ClassVar[str] = "scenario"
    first_table: ClassVar[str] = "speed"
    what: ClassVar[str] = "scenario"

    duration_s: Positive = 10_000.0
    start_ns: Annotated[int, Field(ge=0, lt=2**62)] = 0
    friction_given: bool = True
    channels: tuple[TableChannelName, ...] | None = None

    speed: SpeedProfile = SpeedProfile()
    base: Base = Base()
    temperature: Temperature | None = None
    anomalies: dict[str, Anomaly] = Field(default_factory=dict)
    noise: FrictionNoise = FrictionNoise()
    sensors: Sensors = Sensors()
    effect: Annotated[tuple[EffectBlock, ...], Field(max_length=32)] = ()
    fault: Annotated[tuple[Fault, ...], Field(max_length=1000)] = ()

    def factor_at(self, name: str, time_s: FloatArray) -> FloatArray:
        """Return an anomaly's factor at times from the beginning of the record [s]; 1 without such an anomaly."""
        return self.anomalies.get(name, Anomaly(factor=1.0)).factor_at(time_s)

    def slots(self, wheel: Wheel) -> int:
        """Return the length of the record [slots].

        Raises
        ------
        InputError
            If the record has fewer than 2 or more than 100,000,000 slots.
        """
        count = round(self.duration_s / wheel.sample_period_s)
        if not 2 <= count <= MAX_SLOTS:
            raise InputError(
                "scenario", f"is {count} slots of the wheel; 2 to {MAX_SLOTS} can be simulated", "duration_s"
            )
        return count

    def check(self, wheel: Wheel) -> None:
        """Raise InputError, naming the key, where this scenario needs a constant or system that the wheel lacks."""
        for name in self.anomalies:
            if name not in wheel.anomalies:
                raise InputError("scenario", f"this wheel has {', '.join(wheel.anomalies)}", f"anomalies.{name}")
        if wheel.nominal is None:
            raise InputError(f"wheel {wheel.name}", "is missing; friction cannot be simulated without it", "nominal")
        if not self.friction_given:
            inertia_of(wheel)
            torque_constant_of(wheel)
