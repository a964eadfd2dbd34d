"""The wheel: all constants of one reaction wheel, as written in its wheel.toml.

A wheel is immutable and loads the same everywhere: simulator, estimator, detection, search. Only `name` and
`sample_period_s` are required; any other missing constant disables the functions that need it (see `Wheel.missing`).
"""

from typing import Annotated, ClassVar, Final, Literal, Self

from pydantic import Field, model_validator

from rwa_monitor.samples import MIN_PERIOD_NS, SECONDS_PER_DAY, period_ns
from rwa_monitor.wheel.durations import DurationLaw
from rwa_monitor.wheel.file_content import NotNegative, Range, Strict, TomlFile, ordered, packaged

Positive = Annotated[float, Field(gt=0)]
NoNegative = Annotated[float, Field(ge=0)]
Fraction = Annotated[float, Field(ge=0, le=1)]


class Nominal(Strict):
    """Historical averages: torque is normalised by the dry torque, speed by the nominal speed.

    Standard deviations where they are known, as of a wheel that was learned.
    """

    dry_torque_Nm: Positive
    viscous_Nm_s_rad: NoNegative
    nominal_speed_rad_s: Positive
    # Standard deviation of a healthy wheel's viscous friction, as a share of it, where no temperature explains it.
    viscous_spread: NoNegative | None = None
    dry_torque_std_Nm: NotNegative | None = None
    viscous_std_Nm_s_rad: NotNegative | None = None


class Noise(Strict):
    """Measurement noise of the friction torque; estimated from the data where missing."""

    friction_std_Nm: Positive | None = None


class Derivative(Strict):
    """How dω/dt is derived when friction comes from current: Savitzky-Golay (quadratic) or central difference."""

    method: Literal["savitzky_golay", "central"] = "savitzky_golay"
    window_s: Positive = 2.0


class FrictionFilter(Strict):
    """Settings of derived friction: from current and speed, or with the motor off from speed alone, as -J dω/dt."""

    derivative: Derivative = Derivative()
    motor_off: bool | None = None  # unset where the motor is on


class Limits(Strict):
    """What the wheel cannot exceed: values beyond are wrong units or a broken sensor, not telemetry.

    Attributes
    ----------
    max_speed_rad_s, max_current_A
        Largest speed and current.
    min_current_A
        Smallest current that the drive reports, if it has a dead zone: a current that reads zero is then not known.
    """

    max_speed_rad_s: Positive | None = None
    max_current_A: Positive | None = None
    min_current_A: Positive | None = None


class Window(Strict):
    """Window of diagnosis, in slots.

    Attributes
    ----------
    samples
        Slots of a window.
    hop
        From the beginning of one window to that of the next; unset: windows follow each other without overlap.
    dead_band_rad_s
        Below this speed samples are not used; unset: from the noise of the speed.
    run_length
        Samples between false jumps that are reported before the window closes; unset: a false one in 1e9 tests.
    """

    samples: Annotated[int, Field(ge=16, le=10_000_000)] = 80_000
    hop: Annotated[int, Field(ge=1, le=10_000_000)] | None = None
    dead_band_rad_s: NoNegative | None = None
    run_length: Annotated[float, Field(ge=1e4, le=1e12)] | None = None

    @property
    def hop_slots(self) -> int:
        """Slots from the beginning of one window to that of the next."""
        return self.samples if self.hop is None else self.hop


class TemperatureRange(Strict):
    """Temperature of the bearing at which viscous friction was learned; beyond, it is inconclusive [°C]."""

    low_degC: Annotated[float, Field(gt=-273.15)]
    high_degC: float

    _ordered = model_validator(mode="after")(ordered)

    @property
    def middle(self) -> float:
        """The middle of the range [°C]."""
        return 0.5 * (self.low_degC + self.high_degC)


class FrictionRange(Range):
    """Range of a configuration's friction, in units of the nominal dry torque."""


class SwitchingSystem(Strict):
    """A friction switching system (FSS): a hidden semi-Markov chain over the configurations q = 0 … q_max.

    Transitions go to adjacent configurations only (paper, section III-B; errata 12).
    """

    name: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]{0,63}$")]
    durations: Annotated[tuple[DurationLaw, ...], Field(min_length=2, max_length=16)]
    friction: tuple[FrictionRange, ...] | None = None
    up: tuple[Fraction, ...] | None = None

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        count = len(self.durations)
        for field, values in (("friction", self.friction), ("up", self.up)):
            if values is not None and len(values) != count:
                raise ValueError(f"{field} has {len(values)} entries for {count} durations")
        if self.name in RESERVED_ANOMALIES:
            raise ValueError(f"the name {self.name!r} is taken by the anomaly of that name")
        return self

    @property
    def configurations(self) -> int:
        """Number of configurations."""
        return len(self.durations)

    def probability_up(self, q: int) -> float:
        """Return the probability that a transition from configuration `q` goes to q + 1."""
        if q == 0:
            return 1.0
        if q == self.configurations - 1:
            return 0.0
        return 0.5 if self.up is None else self.up[q]


class EffectBlock(Strict):
    """One effect beyond the base model, by its catalogue name, with its parameters in SI units; a formula has a law.

    A search also writes the parameters' standard deviations, where known, and the hash of its report.json.
    """

    name: str
    law: Annotated[str, Field(max_length=200)] | None = None
    report_sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")] | None = None
    parameters: dict[str, float]
    std: dict[str, NotNegative] | None = None

    def __hash__(self) -> int:
        """Hash by content, as the other parts do: results that are computed for a wheel are cached by the wheel."""
        return hash((self.name, self.law, frozenset(self.parameters.items())))


RESERVED_ANOMALIES: Final = ("dry", "viscous")  # anomaly names in addition to those of the switching systems


class Wheel(TomlFile):
    """One reaction wheel. Fields are those of wheel.toml; units stand in the names."""

    head: ClassVar[str] = "wheel"
    first_table: ClassVar[str] = "nominal"
    what: ClassVar[str] = "wheel file"

    name: Annotated[str, Field(min_length=1, max_length=200)]
    sample_period_s: Annotated[float, Field(gt=0, le=SECONDS_PER_DAY)]
    inertia_kg_m2: Positive | None = None
    torque_constant_Nm_A: Positive | None = None
    gear_ratio: Positive | None = None  # turns of the motor for one of the wheel; unset without a gear
    gear_efficiency: Annotated[float, Field(gt=0, le=1)] | None = None  # unset: the gear's loss is friction
    pulses_per_turn: Annotated[int, Field(ge=1, le=10_000)] | None = None  # of tables of pulse times
    winding_resistance_ohm: Positive | None = None
    back_emf_constant_V_s_rad: Positive | None = None

    nominal: Nominal | None = None
    noise: Noise = Noise()
    friction: FrictionFilter = FrictionFilter()
    limits: Limits = Limits()
    window: Window = Window()
    temperature: TemperatureRange | None = None
    fss: Annotated[tuple[SwitchingSystem, ...], Field(max_length=8)] = ()
    effect: Annotated[tuple[EffectBlock, ...], Field(max_length=32)] = ()

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if period_ns(self.sample_period_s) < MIN_PERIOD_NS:
            raise ValueError(f"sample_period_s = {self.sample_period_s} is below one microsecond")
        if self.gear_efficiency is not None and self.gear_ratio is None:
            raise ValueError("gear_efficiency is that of a gear: gear_ratio is missing")
        names = [system.name for system in self.fss]
        if len(set(names)) != len(names):
            raise ValueError(f"two switching systems have one name: {', '.join(names)}")
        return self

    @property
    def period_ns(self) -> int:
        """Sample period in whole nanoseconds."""
        return period_ns(self.sample_period_s)

    @property
    def window_s(self) -> float:
        """Length of a window [s]."""
        return self.window.samples * self.sample_period_s

    @property
    def anomalies(self) -> tuple[str, ...]:
        """Names of all anomalies this wheel can have: dry, viscous, and one per switching system."""
        return (*RESERVED_ANOMALIES, *(system.name for system in self.fss))

    @property
    def torque_per_ampere_Nm_A(self) -> float | None:
        """Torque of a current at the wheel's axis, before a gear's loss [N m/A]; None without a torque constant."""
        if self.torque_constant_Nm_A is None:
            return None
        return self.torque_constant_Nm_A * (self.gear_ratio or 1.0)

    @property
    def max_motor_torque_Nm(self) -> float | None:
        """Largest torque of the motor at the wheel's axis [N m]; None where limit or torque constant is not known."""
        if self.limits.max_current_A is None or self.torque_per_ampere_Nm_A is None:
            return None
        return self.limits.max_current_A * self.torque_per_ampere_Nm_A / (self.gear_efficiency or 1.0)

    @property
    def torque_unit_Nm(self) -> float:
        """Torque by which friction is normalised [N m]: the nominal dry torque, or 1 N m where it is not known."""
        return self.nominal.dry_torque_Nm if self.nominal else 1.0

    @property
    def speed_unit_rad_s(self) -> float:
        """Speed by which speed is normalised [rad/s]: the nominal speed, or 1 rad/s where it is not known."""
        return self.nominal.nominal_speed_rad_s if self.nominal else 1.0

    def missing(self) -> list[str]:
        """Return, in words, what this wheel lacks and what that disables; empty when complete."""
        notes = []
        if self.inertia_kg_m2 is None or (self.torque_constant_Nm_A is None and not self.friction.motor_off):
            notes.append("no inertia or torque constant: friction cannot be derived from motor current")
        if self.nominal is None:
            notes.append("no [nominal]: no classification of anomalies, torque is not normalised")
        if not self.fss:
            notes.append(
                "no [[fss]]: friction changes are found but not attributed, and base dry friction is not judged in a"
                " window that holds any"
            )
        return notes


# The wheel that is used where no file is given: the constants of a small reaction wheel and the switching systems of
# the paper's Examples 1 and 2 (errata 16: a sojourn lasts at least one sample). Normalised, f_d = f_v = 1.
BUILT_IN_WHEEL_TOML: Final = packaged("rwa_monitor.wheel", "built_in_wheel.toml")


def built_in_wheel() -> Wheel:
    """Return the built-in wheel."""
    return Wheel.from_toml(BUILT_IN_WHEEL_TOML, "built-in wheel")
