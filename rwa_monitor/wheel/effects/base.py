"""The base of all effects: a class simulates an effect, gives its columns, bounds its parameters and documents it.

The simulator, the estimator, the live monitor and the discrepancy search share these classes, so that each formula is
written once. Three families: *mean* effects add a torque, *noise* effects change the noise, *switching* effects change
the jumps. This file has the common base, the mean and the noise family; `switching_base.py` has the third, and
`catalogue.py` collects the classes.
"""

from __future__ import annotations

import functools
import inspect
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Final, Literal, Self

import numpy as np

from rwa_monitor.errors import InputError, did_you_mean
from rwa_monitor.samples import BoolArray, FloatArray, IntArray

NEAR_ZERO: Final = 0.05  # share of the largest speed that counts as near zero, where the speed step is measured
Family = Literal["mean", "noise", "switching"]
Shape = Mapping[str, float]  # values of the shape parameters, by name


@dataclass(frozen=True, slots=True)
class Channels:
    """A wheel's motion on consecutive slots, the input of effects: float64 arrays (n,), NaN where unknown.

    Attributes
    ----------
    time_s
        Time since the start of the record [s].
    speed_rad_s, acceleration_rad_s2, angle_rad
        Speed ω [rad/s], dω/dt [rad/s²], and wheel angle ∫ω dt [rad].
    direction
        sign(ω): -1, 0 or 1 [-].
    sample_period_s
        Time from slot to slot [s].
    good
        bool (n,), slots that hold a good sample.
    motor_torque_Nm
        K_T·I [N m], or None where there is no current.
    bearing_temperature_degC
        [°C], or None.
    dry_level_Nm
        The dry friction level, jumps included, always positive against motion [N m]; true in the simulator, estimated
        in the search; None where not known yet.
    motor_torque_rate_Nm_s
        d(K_T·I)/dt [N m/s], from neighbours that exclude every sample entering the friction of the slot; None where
        it was not computed: `current_delay` then takes a backward difference of `motor_torque_Nm`.
    acceleration_rate_rad_s3
        d²ω/dt² [rad/s³], likewise; None where it was not computed, and where there is a motor torque in a search.
    measured_angle_rad
        The wheel's angle as measured [rad]; None where it is the speed's integral.
    bus_voltage_V
        Supply voltage [V], or None.
    averaged
        Whether samples are, or may be, means over their interval: nothing shows that they are instantaneous.
    """

    time_s: FloatArray
    speed_rad_s: FloatArray
    direction: FloatArray
    acceleration_rad_s2: FloatArray
    angle_rad: FloatArray
    sample_period_s: float
    good: BoolArray
    motor_torque_Nm: FloatArray | None = None
    bearing_temperature_degC: FloatArray | None = None
    dry_level_Nm: FloatArray | None = None
    motor_torque_rate_Nm_s: FloatArray | None = None
    acceleration_rate_rad_s3: FloatArray | None = None
    measured_angle_rad: FloatArray | None = None
    bus_voltage_V: FloatArray | None = None
    averaged: bool = False

    def __len__(self) -> int:
        """Count the slots."""
        return int(self.speed_rad_s.size)

    @property
    def moving(self) -> BoolArray:
        """Slots that hold a good sample with a speed, bool (n,)."""
        return self.good & np.isfinite(self.speed_rad_s)

    @property
    def duration_s(self) -> float:
        """Length of the record [s]."""
        return len(self) * self.sample_period_s

    @property
    def used_speed_rad_s(self) -> FloatArray:
        """|ω| of the good slots [rad/s]; a single zero where there are none."""
        return self.known(np.abs(self.speed_rad_s))

    @property
    def speed_step_rad_s(self) -> float:
        """The usual change of speed from slot to slot near zero speed (else overall) [rad/s].

        A feature narrower than a few of these falls between samples.
        """
        change = np.abs(np.diff(self.speed_rad_s))
        changes = change > 0  # not where either is NaN
        near = np.abs(self.speed_rad_s[1:]) < NEAR_ZERO * self.used_speed_rad_s.max()
        moving = change[near & changes] if (near & changes).any() else change[changes]
        return float(np.median(moving)) if moving.size else 0.0

    def known(self, values: FloatArray) -> FloatArray:
        """Return the finite ones of values, float64 (n,), in the good slots; a single zero where there are none."""
        known = values[self.good & np.isfinite(values)]
        return known if known.size else np.zeros(1)

    def optional(self, name: str) -> FloatArray:
        """Return an optional channel by its name; NaN in every slot where the record has no such channel."""
        values: FloatArray | None = getattr(self, name)
        return np.full(len(self), np.nan) if values is None else values


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter of an effect.

    Attributes
    ----------
    name
        With its unit at the end where it has one, as written in wheel.toml.
    unit
        "-" for none.
    low, high
        Physical bounds: a fit never leaves them (a sign is a bound at 0).
    typical
        A usual value, for simulation and as a start.
    linear
        True for a strength: the torque is proportional to it and least squares gives it. False for a shape parameter,
        which the search profiles.
    choices
        The values of a discrete shape parameter that a search tries, empty for a continuous one.
    between
        Largest distance from a choice over which a search fits the value in a record, 0 for none. None: only the
        choices are allowed.
    default
        Value that an effect takes where none is given; None: it must be given.
    shown
        Range in which the parameter is identifiable in a record: of a scale (a speed, a time), the range that the
        record resolves; None: the physical bounds.
    """

    name: str
    unit: str
    low: float
    high: float
    typical: float
    linear: bool = False
    choices: tuple[float, ...] = ()
    default: float | None = None
    between: Callable[[Channels], float] | None = None
    shown: Callable[[Channels], tuple[float, float]] | None = None

    def bounds(self, channels: Channels) -> tuple[float, float]:
        """Return the range identifiable in a record, within the physical bounds; an empty one shrinks to its end."""
        if self.shown is None:
            return self.low, self.high
        low, high = self.shown(channels)
        high = min(max(high, self.low), self.high)
        return min(max(low, self.low), high), high

    def is_shown(self, channels: Channels) -> bool:
        """Return whether any value within the physical bounds is identifiable in a record."""
        return self.shown is None or self.shown(channels)[0] <= self.high


Quantity = Literal["inertia", "torque constant"]  # constants of the wheel file that other channels may determine
# The docstring of an effect: its physics, its signature, what it is confused with, its source.
EXPLAINED: Final = re.compile(
    r"[^\n]+\n\n(.+?)\n\n(?:What shows it\n-+\n(.+?)\n\n)?(?:See Also\n-+\n(.+?)\n\n)?References\n-+\n(.+)", re.DOTALL
)


class Effect:
    """Base of all effects: metadata of the class, parameter values of the instance.

    The docstring of a class is what people read of the effect: behind its first line the physics, then in sections
    "What shows it" in the residual, in "See Also" what it is confused with, in "References" the source. They become
    `description`, `signature`, `confused_with` and `source`.

    Parameters
    ----------
    values
        A value for every parameter, by name, in SI units as named; those with a default may be left out.

    Raises
    ------
    InputError
        If a parameter is unknown, missing, not finite or out of its bounds.
    """

    name: ClassVar[str]
    family: ClassVar[Family]
    title: ClassVar[str]
    formula: ClassVar[str]  # LaTeX, without dollar signs
    description: ClassVar[str] = ""  # the physics
    signature: ClassVar[str] = ""  # what shows it in the residual
    confused_with: ClassVar[tuple[str, ...]] = ()  # catalogue names
    separate_by: ClassVar[str]  # the manoeuvre or channel that separates it from those
    source: ClassVar[str] = ""
    needs: ClassVar[frozenset[str]] = frozenset()  # optional channels: "motor_torque_Nm", "bearing_temperature_degC"
    parameters: ClassVar[tuple[Parameter, ...]] = ()
    # True where it follows the acceleration, as a curve over that does, and coarse rounding of the speed.
    follows_acceleration: ClassVar[bool] = False
    # True where it changes with time alone, as a fault does that grows.
    changes_with_time: ClassVar[bool] = False
    # True where it follows a recording's own time or angle: its strength does not carry over to another.
    of_one_recording: ClassVar[bool] = False
    # True where it is intermittent, so that friction seems to drift as a random walk.
    comes_and_goes: ClassVar[bool] = False
    # True where it may drive the wheel, so that dry friction seems to be negative.
    may_drive: ClassVar[bool] = False
    # The constant whose error it is; None where it is not an error of one.
    error_of: ClassVar[Quantity | None] = None
    # Why an exported friction model leaves it out; "" where it does not.
    not_exported: ClassVar[str] = ""

    def __init_subclass__(cls) -> None:
        """Set the class's texts from its docstring, and a missing title from its name."""
        if "name" in vars(cls) and not hasattr(cls, "title"):
            cls.title = cls.name.replace("_", " ").capitalize()
        found = EXPLAINED.fullmatch(inspect.cleandoc(cls.__doc__ or ""))
        if found is not None:
            texts = (" ".join(part.split()) for part in found.groups(default=""))
            cls.description, cls.signature, names, cls.source = texts
            cls.confused_with = tuple(re.findall(r"\w+", names))

    def __init__(self, **values: float) -> None:
        known = {parameter.name: parameter for parameter in self.parameters}
        values = {name: one.default for name, one in known.items() if one.default is not None} | values
        for name in *sorted(values.keys() - known.keys()), *sorted(known.keys() - values.keys()):
            hint = did_you_mean(name, known) or f"; it has {', '.join(known) or 'none'}"
            raise InputError(f"effect {self.name}", "is missing" if name in known else f"is unknown{hint}", name)
        for name, value in values.items():
            parameter = known[name]
            if not (np.isfinite(value) and parameter.low <= value <= parameter.high):
                raise InputError(f"effect {self.name}", f"{value} is outside [{parameter.low}, {parameter.high}]", name)
            if parameter.choices and not parameter.between and value not in parameter.choices:
                raise InputError(f"effect {self.name}", f"{value} is none of {parameter.choices}", name)
        self.values: Mapping[str, float] = {name: float(values[name]) for name in known}

    @classmethod
    def typical(cls, **changes: float) -> Self:
        """Return the effect at its typical values, some of them changed."""
        return cls(**{**{parameter.name: parameter.typical for parameter in cls.parameters}, **changes})

    @classmethod
    def shape_parameters(cls) -> tuple[Parameter, ...]:
        """Return the parameters that enter non-linearly."""
        return tuple(parameter for parameter in cls.parameters if not parameter.linear)

    @classmethod
    def strength_parameters(cls) -> tuple[Parameter, ...]:
        """Return the parameters that the torque is proportional to, in the order of the columns."""
        return tuple(parameter for parameter in cls.parameters if parameter.linear)

    @classmethod
    def nothing_found(cls, samples: int = 0) -> LikelihoodFit:
        """Return the fit where the effect is not identifiable in the record: typical values, no gain."""
        return LikelihoodFit(
            values={parameter.name: parameter.typical for parameter in cls.parameters},
            std={parameter.name: float("nan") for parameter in cls.parameters},
            log_likelihood_gain=0.0,
            parameters=len(cls.parameters),
            samples=samples,
        )

    @property
    def shape(self) -> dict[str, float]:
        """Values of the shape parameters, by name."""
        return {parameter.name: self.values[parameter.name] for parameter in self.shape_parameters()}

    def weighted(self, columns: FloatArray) -> FloatArray:
        """Return the columns, float64 (n, strengths), times the strengths, float64 (n,)."""
        # A sum in fixed order, not a matrix product: the same bits on every machine and however a record is cut.
        torque = np.zeros(columns.shape[0])
        for parameter, column in zip(self.strength_parameters(), columns.T, strict=True):
            torque += self.values[parameter.name] * column
        return torque

    def read_speed(self, speed_rad_s: FloatArray) -> FloatArray:
        """Return the tachometer's reading of a speed [rad/s]; unchanged by most effects.

        A simulator that derives friction from the measured speed uses this *instead of* the torque or the noise of an
        effect that changes it.
        """
        return speed_rad_s

    @property
    def is_of_tachometer(self) -> bool:
        """Whether the effect changes the tachometer's reading."""
        return type(self).read_speed is not Effect.read_speed


Memory = FloatArray | None


class MeanEffect(Effect):
    """An effect that adds a torque, positive when it opposes positive rotation, like the friction itself.

    The torque is Σ strength_j · column_j(channels, shape). Effects with memory (a lag, a bristle) carry a small state
    from one piece of a record to the next, so that a record evaluated piece by piece gives the same values.
    """

    family: ClassVar[Family] = "mean"
    # True where the columns depend on `Channels.dry_level_Nm`.
    uses_level: ClassVar[bool] = False
    # Its shape parameter that is a speed at which the torque steps; "" without one.
    threshold: ClassVar[str] = ""
    # Symmetry of the torque when the motion is mirrored: it changes sign ("odd", as friction does), it stays ("even",
    # as an offset does), or neither.
    parity: ClassVar[Literal["odd", "even", "none"]] = "odd"
    # True where the torque changes with time or temperature while the speed stays as it is.
    shows_at_one_speed: ClassVar[bool] = False
    # True where the first strength is a part of the viscous friction.
    is_part_of_viscous: ClassVar[bool] = False
    # True where it is a share of the viscous friction at any speed: a fault of the viscous friction scales it, too.
    scales_with_viscous: ClassVar[bool] = False
    # True where it makes the viscous friction follow the bearing's temperature.
    follows_temperature: ClassVar[bool] = False
    # Channels with which another effect takes its place.
    superseded_by: ClassVar[frozenset[str]] = frozenset()
    # The effect that it mimics where a channel of that effect is not measured; "" without one.
    unmeasured_cause: ClassVar[str] = ""
    # Penalty of its choice in a search, as a deviance [-]: 2·ln of the number of its kind, or of the odds against it.
    choice_deviance: ClassVar[float] = 0.0

    @classmethod
    def column(cls, channels: Channels, shape: Shape) -> FloatArray:
        """Return the column of an effect with one strength and without memory, float64 (n,); see `columns`."""
        raise NotImplementedError

    @classmethod
    def columns(cls, channels: Channels, shape: Shape, memory: Memory = None) -> tuple[FloatArray, Memory]:
        """Return the regression columns at unit strength and the memory after the last slot.

        Default: the one `column`.

        Parameters
        ----------
        channels
            n consecutive slots.
        shape
            Values of the shape parameters.
        memory
            What an earlier call returned for the slots just before; None at the start of a record.

        Returns
        -------
        columns
            float64 (n, number of strength parameters), NaN where a channel that is needed is unknown.
        memory
            None for effects without memory.
        """
        return stack(cls.column(channels, shape)), None

    @classmethod
    def shape_bounds(cls, channels: Channels) -> dict[str, tuple[float, float]]:
        """Return the range in which each shape parameter is identifiable in this record, within physical bounds."""
        return {parameter.name: parameter.bounds(channels) for parameter in cls.shape_parameters()}

    @classmethod
    def largest_share(cls, channels: Channels) -> float:
        """Return the effect's largest possible share of the friction in this record; 1 where nothing limits it."""
        return 1.0

    @classmethod
    def is_possible(cls, strengths: FloatArray, dry_Nm: float, viscous_Nm_s_rad: float) -> bool:
        """Return whether the fitted strengths are possible with that friction; one at a bound other than 0 is not."""
        limits = [(parameter.low, parameter.high) for parameter in cls.strength_parameters()]
        return all(one == 0.0 or one not in ends for one, ends in zip(strengths.tolist(), limits, strict=True))

    @classmethod
    def reach_between(cls, channels: Channels) -> dict[str, float]:
        """Return by name how far from a choice a discrete shape parameter is fitted in this record, where it is."""
        reach = {parameter.name: parameter.between(channels) for parameter in cls.parameters if parameter.between}
        return {name: most for name, most in reach.items() if most > 0.0}

    @classmethod
    def unresolved_as(cls, channels: Channels, shape: Shape) -> str:
        """Return the effect that this one mimics where the motion does not resolve the shape; "" where it does."""
        return ""

    @classmethod
    def plainer_shape(cls, shape: Shape) -> dict[str, float] | None:
        """Return the simpler shape that is equivalent where only some strengths are not zero; None without one."""
        return None

    def torque(self, channels: Channels, memory: Memory = None) -> tuple[FloatArray, Memory]:
        """Return the torque of the effect [N m], float64 (n,), and the memory after the last slot."""
        columns, memory = self.columns(channels, self.shape, memory)
        return self.weighted(columns), memory


# ---- helpers of the effects: columns side by side, a memory ----------------------------------------------------------


def stack(*columns: FloatArray) -> FloatArray:
    """Return the columns side by side, float64 (n, number of columns)."""
    return np.stack(columns, axis=1)


def begun(memory: Memory, *start: float) -> FloatArray:
    """Return the memory of an effect to be updated: a copy, or its values at the start of a record."""
    return np.array(start) if memory is None else memory.copy()


def since_last(usable: BoolArray, state: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return the usable slots, int64 (m,), and the distance of each from the previous usable one, float64 (m,).

    `state`, float64 (1,), holds the slots since the last usable one of the previous piece, and is updated.
    """
    at = np.flatnonzero(usable)
    since = np.diff(at, prepend=-1.0 - state[0])
    state[0] = usable.size - 1.0 - at[-1] if at.size else state[0] + usable.size
    return at, since


Recursion = Callable[[FloatArray, BoolArray, float, float, FloatArray], FloatArray]


def follow(
    recursion: Recursion,
    values: Any,
    usable: BoolArray,
    period_s: float,
    parameter: float,
    memory: Memory,
    start: tuple[float, ...] = (np.nan, np.nan),
) -> tuple[FloatArray, FloatArray]:
    """Apply a recursion of the kernels, whose arguments the others are, to values; return the result and its memory.

    `start` is the memory at the start of a record. `values` is float64 (n,), or, in an export, a channel that records
    the recursion instead of computing it (`rwa_monitor.export`).
    """
    state = begun(memory, *start)
    if isinstance(values, np.ndarray):
        return recursion(values, usable, period_s, parameter, state), state
    return values.follow(recursion.__name__, usable, parameter, state), state


# ---- a fit by maximum likelihood: the result of noise and switching effects for the search ---------------------------


@dataclass(frozen=True, slots=True)
class LikelihoodFit:
    """An effect fitted by maximum likelihood, compared with the record's law without it.

    Attributes
    ----------
    values
        The parameters, by name.
    std
        Their standard deviations; NaN where the likelihood has no curvature or none was derived.
    log_likelihood_gain
        log L with the effect less log L without it, each at its maximum; natural logarithm, ≥ 0.
    parameters
        Free parameters beyond those of the law without the effect.
    samples
        Number of values in the fit: residuals, or jumps.
    undetermined
        Parameters that this fit does not estimate; their values are placeholders.
    """

    values: dict[str, float]
    std: dict[str, float]
    log_likelihood_gain: float
    parameters: int
    samples: int
    undetermined: frozenset[str] = frozenset()

    @property
    def penalised_gain(self) -> float:
        """2·gain less log n for each parameter (BIC); positive where the gain exceeds the parameters' penalty."""
        return 2.0 * self.log_likelihood_gain - self.parameters * float(np.log(max(self.samples, 1)))


def curvature_std(log_likelihood: Callable[[float], float], at: float, step: float) -> float:
    """Return the standard deviation that the curvature of a log-likelihood gives a parameter; NaN where it has none."""
    second = (log_likelihood(at + step) - 2.0 * log_likelihood(at) + log_likelihood(at - step)) / step**2
    return float(1.0 / np.sqrt(-second)) if second < 0 else float("nan")


def most_likely_one(
    gain: Callable[[float], float], low: float, high: float, tolerance: float
) -> tuple[float, float, float]:
    """Return the positive parameter of the largest gain, its standard deviation by the curvature, and the gain, ≥ 0.

    The search is over its logarithm, between the logarithms of two bounds and to a tolerance.
    """
    from scipy import optimize

    def of_log(x: float) -> float:
        return gain(float(np.exp(x)))

    bounds = (float(np.log(low)), float(np.log(high)))
    found = optimize.minimize_scalar(
        lambda x: -of_log(x), bounds=bounds, method="bounded", options={"xatol": tolerance}
    )
    best = float(np.exp(found.x))
    return best, best * curvature_std(of_log, float(found.x), 0.02), max(-float(found.fun), 0.0)


def most_likely(
    gain: Callable[[FloatArray], float], starts: Sequence[FloatArray], bounds: Sequence[tuple[float, float]]
) -> tuple[FloatArray, FloatArray, float]:
    """Return the parameters of the largest gain near the best start, with standard deviations by its curvature.

    Returns
    -------
    best, std
        float64 (parameters,).
    gain
        At the maximum, not negative.
    """
    from scipy import optimize

    def loss(x: FloatArray) -> float:
        return -gain(x)

    start = min(starts, key=loss)
    found = optimize.minimize(loss, start, bounds=bounds, method="L-BFGS-B")
    best: FloatArray = found.x if found.fun < loss(start) else start

    def along(i: int, value: float) -> float:
        return gain(np.array([*best[:i], value, *best[i + 1 :]]))

    std = [curvature_std(functools.partial(along, i), float(best[i]), 0.01) for i in range(best.size)]
    return best, np.array(std), max(gain(best), 0.0)


# ---- noise effects: how they change simulated noise, and how they are recognised in a residual -----------------------
# Noise effects add no regression column. Each has a likelihood of its own for the residual of the base law, its jumps
# and the mean effects; it is compared with the likelihood of white Gaussian noise for the same residual.


class NoiseEffect(Effect, ABC):
    """An effect that changes the noise of the friction torque, or of the speed that it is derived from."""

    family: ClassVar[Family] = "noise"
    not_exported = "it is noise around the torque, not a torque"
    fewest: ClassVar[int] = 10  # usable slots that a fit needs

    @abstractmethod
    def apply(self, noise_Nm: FloatArray, channels: Channels, rng: np.random.Generator) -> FloatArray:
        """Return the noise of a simulated friction torque with this effect in it.

        Parameters
        ----------
        noise_Nm
            float64 (n,), the noise so far, white to begin with.
        channels
            The true motion.
        rng
            Source of all randomness.
        """

    @classmethod
    def fit(
        cls, residual_Nm: FloatArray, channels: Channels, good: BoolArray, variance_inflation: float = 1.0
    ) -> LikelihoodFit:
        """Fit the effect to a residual.

        Parameters
        ----------
        residual_Nm
            float64 (n,), residual of base law, jumps and mean effects, on consecutive slots.
        channels
            The measured motion.
        good
            bool (n,), slots whose residual counts.
        variance_inflation
            Number of squared residuals that carry as much information as an independent one, 1 for white noise.

        Returns
        -------
        LikelihoodFit
            At the maximum of the likelihood; a gain of zero where the effect is not identifiable in the record.
        """
        usable = usable_residuals(residual_Nm, channels, good)
        count = int(usable.sum())
        if count < cls.fewest or not residual_Nm[usable].any():
            return cls.nothing_found(count)
        return cls.fitted(residual_Nm, channels, usable, variance_inflation)

    @classmethod
    @abstractmethod
    def fitted(
        cls, residual_Nm: FloatArray, channels: Channels, usable: BoolArray, variance_inflation: float
    ) -> LikelihoodFit:
        """Return the fit to `fewest` usable slots or more; parameters as for `fit`."""


def usable_residuals(residual_Nm: FloatArray, channels: Channels, good: BoolArray) -> BoolArray:
    """Return the good slots with a finite residual and speed, bool (n,)."""
    return good & channels.moving & np.isfinite(residual_Nm)
