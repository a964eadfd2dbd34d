"""The model: what was learned from labelled windows about nominal and anomalous friction. Readable JSON, never pickle.

All values are normalised (torque by the nominal dry torque, viscous friction by nominal dry torque over nominal
speed), so a model serves every wheel whose [nominal] is known. For each anomaly it holds two classifiers, side by
side: the paper's linear support vector machine, and the densities of the joint classifier (see `classification`).
"""

import math
from functools import cached_property, lru_cache
from typing import Annotated, ClassVar, Final, Literal, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, model_validator

from rwa_monitor.diagnosis.features import SystemFeatures
from rwa_monitor.kernels.laws import LEVEL_NUMBERS, densities
from rwa_monitor.samples import FloatArray, IntArray
from rwa_monitor.wheel.file_content import Finite, Hashed, Positive, Probability, Range, Rounded, Strict, packaged
from rwa_monitor.wheel.wheel import RESERVED_ANOMALIES, SwitchingSystem, Wheel

BUILT_IN_MODEL_FILE: Final = "built_in_model.json"

# Where a system's healthy friction is stated in the wheel file and no anomaly was learned: softness of the stated
# edges and scale of anomalies, as shares of the middle; share of strays; probability before anything is seen.
STATED_SOFT: Final = 0.03
STATED_REACH: Final = 0.4
STATED_STRAY: Final = 0.02
STATED_RATE: Final = 0.1


class Band(Range):
    """Where values of one class lie: uniform on [low, high], the edges softened by a Gaussian of std `soft`.

    It covers both laws that friction follows here: a range (soft small) and a value with scatter (low = high).
    """

    low: Finite
    high: Finite
    soft: Positive

    def density(self, value: ArrayLike, std: ArrayLike) -> FloatArray:
        """Return the density of measuring `value` with standard deviation `std`; arrays of one shape."""
        alone = np.array([self.low, self.high, self.soft, np.nan, np.nan, np.nan, 0.0, 1.0])  # without strays
        nominal, _ = _densities(np.asarray(value, dtype=np.float64), np.asarray(std, dtype=np.float64), alone)
        return np.asarray(nominal)


class Levels(Strict):
    """Nominal and anomalous values of one coefficient, or of one configuration of a switching system.

    Attributes
    ----------
    nominal
        Band of a healthy wheel.
    anomalous
        Band of the learned anomaly, None where none was learned.
    stray
        Share of values that lie nowhere near their band, because an earlier stage erred.
    reach
        Scale of the density of values outside the learned bands.
    median
        Median of the learned anomaly, None where none was learned.
    """

    nominal: Band
    anomalous: Band | None
    stray: Annotated[Rounded, Field(gt=0, lt=0.5)]
    reach: Positive
    median: Finite | None

    @cached_property
    def numbers(self) -> FloatArray:
        """All that densities need, as kernels take it: float64 (LEVEL_NUMBERS,)."""
        nominal, anomalous = self.nominal, self.anomalous
        learned = (anomalous.low, anomalous.high, anomalous.soft) if anomalous else (np.nan,) * 3
        return np.array([nominal.low, nominal.high, nominal.soft, *learned, self.stray, self.reach])

    @cached_property
    def nominal_low(self) -> float:
        """Lower bound of nominal values: two standard deviations of the softness below the band."""
        return self.nominal.low - 2.0 * self.nominal.soft

    @cached_property
    def nominal_high(self) -> float:
        """Upper bound of nominal values."""
        return self.nominal.high + 2.0 * self.nominal.soft

    @property
    def severity_unit(self) -> float | None:
        """Distance of severity 1 above the nominal bound; None where the learned anomaly does not lie above it.

        Severity 1 is the median of the learned anomaly; where none was learned, it is `reach` above the bound.
        """
        if self.median is None:
            return self.reach
        return self.median - self.nominal_high if self.median > self.nominal_high else None


class LinearSvm(Strict):
    """The paper's classifier: sign(w·z + b) with z the standardised value, or the histogram of a system's friction.

    Attributes
    ----------
    bins
        0 for a single value, else the number of bins over [low, high].
    low, high
        For a histogram its range, that of the training data; for a value the range that becomes [0, 1].
    weights, bias
        w and b.
    slope, offset
        Platt's calibration: probability = 1/(1 + exp(-(slope·decision + offset))).
    """

    bins: Annotated[int, Field(ge=0, le=1000)]
    low: Finite
    high: Finite
    weights: Annotated[tuple[Finite, ...], Field(min_length=1, max_length=1000)]
    bias: Finite
    slope: Finite
    offset: Finite

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if len(self.weights) != max(self.bins, 1):
            raise ValueError(f"{len(self.weights)} weights for {max(self.bins, 1)} features")
        if self.high <= self.low:
            raise ValueError(f"high ({self.high}) is not above low ({self.low})")
        return self


class AnomalyModel(Strict):
    """What was learned about one anomaly.

    Attributes
    ----------
    name
        dry, viscous or the switching system's name.
    levels
        One entry for dry and viscous; one per configuration for a system, None for q = 0 and for those never seen.
    svm
        The paper's classifier, None where it could not be trained.
    rate
        Share of the training windows that have the anomaly: the probability before anything is seen.
    """

    name: Annotated[str, Field(min_length=1, max_length=64)]
    levels: Annotated[tuple[Levels | None, ...], Field(min_length=1, max_length=16)]
    svm: LinearSvm | None
    rate: Annotated[Rounded, Field(gt=0, lt=1)]

    @cached_property
    def numbers(self) -> FloatArray:
        """All that densities need, as kernels take it: float64 (configurations, LEVEL_NUMBERS), NaN for none."""
        unknown = np.full(LEVEL_NUMBERS, np.nan)
        return np.stack([unknown if levels is None else levels.numbers for levels in self.levels])

    def serves(self, system: SwitchingSystem) -> bool:
        """Return whether the model applies to this system: same configurations, and the stated friction nominal."""
        if len(self.levels) != system.configurations:
            return False
        if system.friction is None:
            return True
        return all(
            levels is None or levels.nominal_low <= stated.middle <= levels.nominal_high
            for levels, stated in zip(self.levels, system.friction, strict=True)
        )


class Provenance(Strict):
    """How a model was trained, enough to do it again."""

    wheel: str
    wheel_sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
    windows: Annotated[int, Field(ge=1)]
    source: str  # the recipe with its seed, or the label file's name
    command: str


class Model(Hashed):
    """All classifiers of a wheel.

    Attributes
    ----------
    version
        Version of this format.
    trained
        How it was trained.
    anomalies
        One entry per anomaly.
    simultaneous
        Probability of 0, 1, 2, … anomalies at once in the training windows, smoothed so that none is impossible.
    undecided
        (low, high): a probability between them is inconclusive.
    """

    what: ClassVar[str] = "model file"

    version: Literal[1] = 1
    trained: Provenance
    anomalies: Annotated[tuple[AnomalyModel, ...], Field(min_length=1, max_length=10)]
    simultaneous: Annotated[tuple[Annotated[Rounded, Field(gt=0, le=1)], ...], Field(min_length=2, max_length=11)]
    undecided: tuple[Probability, Probability]

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        names = [anomaly.name for anomaly in self.anomalies]
        if tuple(names[:2]) != RESERVED_ANOMALIES or len(set(names)) != len(names):
            raise ValueError(f"anomalies must be dry, viscous and switching systems, each once, not {', '.join(names)}")
        if any(anomaly.levels[0] is None for anomaly in self.anomalies[:2]):
            raise ValueError("dry and viscous need a nominal range")
        if len(self.simultaneous) != len(names) + 1:
            raise ValueError(f"simultaneous has {len(self.simultaneous)} entries for {len(names)} anomalies")
        if not self.undecided[0] <= 0.5 <= self.undecided[1]:
            raise ValueError("undecided must enclose 0.5")
        return self

    def anomaly(self, name: str) -> AnomalyModel | None:
        """Return the model of one anomaly, or None."""
        return next((anomaly for anomaly in self.anomalies if anomaly.name == name), None)

    def to_json(self) -> str:
        """Write the model as readable JSON, keys sorted, numbers with 12 significant digits."""
        return self.model_dump_json(indent=1) + "\n"


def from_stated_friction(system: SwitchingSystem) -> AnomalyModel | None:
    """Return a system's healthy friction as the wheel file states it, as a model without a learned anomaly.

    None where it does not state it, or not for any configuration above q = 0.
    """
    if system.friction is None or all(stated.high <= 0 for stated in system.friction[1:]):
        return None
    levels: list[Levels | None] = [None]
    for stated in system.friction[1:]:
        middle, level = stated.middle, None
        if middle > 0:
            band = Band(low=stated.low, high=stated.high, soft=STATED_SOFT * middle)
            reach = STATED_REACH * middle
            level = Levels(nominal=band, anomalous=None, stray=STATED_STRAY, reach=reach, median=None)
        levels.append(level)
    return AnomalyModel(name=system.name, levels=tuple(levels), svm=None, rate=STATED_RATE)


def models_for(wheel: Wheel, model: Model | None) -> list[AnomalyModel | None]:
    """Return the model of each anomaly of a wheel, in the wheel's order; None where there is none.

    A system that the model does not hold, or holds with other configurations, is judged by the friction that the wheel
    file states for it: nominal within the stated ranges, without a learned anomaly.
    """
    if model is None or wheel.nominal is None:
        return [None] * len(wheel.anomalies)
    viscous = with_wider_band(model.anomaly("viscous"), wheel.nominal.viscous_spread)
    models = [model.anomaly("dry"), viscous if wheel.nominal.viscous_Nm_s_rad > 0 else None]
    for system in wheel.fss:
        learned = model.anomaly(system.name)
        models.append(learned if learned and learned.serves(system) else from_stated_friction(system))
    return models


def with_wider_band(learned: AnomalyModel | None, spread: float | None) -> AnomalyModel | None:
    """Return the model of a coefficient with its nominal band widened by the spread between healthy recordings.

    `spread` is a standard deviation in units of the nominal value; None or 0 leave the model as it is.
    """
    if learned is None or not spread or (level := learned.levels[0]) is None:
        return learned
    nominal = level.nominal.model_copy(update={"soft": math.hypot(level.nominal.soft, spread)})
    # The scale of anomalies grows by the spread too: otherwise the edge of the healthy range would look anomalous.
    reach = level.reach + 2.0 * spread
    wide = Levels(nominal=nominal, anomalous=None, stray=level.stray, reach=reach, median=None)
    return AnomalyModel(name=learned.name, levels=(wide,), svm=None, rate=learned.rate)


@lru_cache(maxsize=1)
def built_in_model() -> Model:
    """Return the model that ships with the package, trained for the built-in wheel."""
    return Model.from_json(packaged("rwa_monitor.diagnosis", BUILT_IN_MODEL_FILE), BUILT_IN_MODEL_FILE)


# ---- likelihoods of a window's measurements, each with its own standard deviation ------------------------------------

_NO_OFFSET: Final[FloatArray] = np.zeros(1)


def log_densities(levels: Levels, value: FloatArray, std: FloatArray) -> FloatArray:
    """Return the log density of measured values (n,) under nominal (row 0) and anomalous (row 1), float64 (2, n).

    Both classes share the stray values of earlier stages' errors: heavy tails (Lomax, shape 1) around the nominal
    band. The anomalous class also has values beyond the nominal bound that belong to no learned anomaly.
    """
    return np.log(_densities(value, std, levels.numbers))


def _densities(value: FloatArray, std: FloatArray, numbers: FloatArray) -> FloatArray:
    """Return the densities of measured values of one level, float64 (2, …)."""
    level = np.zeros(value.size, dtype=np.int64)
    found = densities(level, value.ravel(), std.ravel(), _NO_OFFSET, numbers[np.newaxis])
    return found[:2].reshape(2, *value.shape)


def system_evidence(model: AnomalyModel | None, system: SystemFeatures, offset: FloatArray) -> FloatArray:
    """Return the log likelihoods (2, offsets) of a system's sojourns above q = 0, with an offset added to all."""
    configuration, friction, std = system.active()
    if model is None or friction.size == 0:
        return np.zeros((2, offset.size))
    log_density = np.log(densities(configuration, friction, std, offset, model.numbers)[:2])
    # `cumsum` adds in order: unlike in a pairwise sum, rounding does not depend on the number of terms.
    return np.asarray(np.cumsum(log_density, axis=1)[:, -1])


def stray_probabilities(
    model: AnomalyModel, configuration: IntArray, value: FloatArray, std: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the probability that each value lies in none of the learned bands, and its standard deviation over reach.

    Parameters
    ----------
    model
        The model of the anomaly.
    configuration, value, std
        (n,); values of configurations that were not learned, and those that are not finite, are left out.
    """
    stray = densities(configuration, value, std, _NO_OFFSET, model.numbers)[2, :, 0]
    known = np.isfinite(stray)
    return stray[known], std[known] / model.numbers[configuration[known], LEVEL_NUMBERS - 1]
