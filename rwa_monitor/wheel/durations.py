"""Duration laws of a switching system: how many slots a sojourn in one configuration lasts.

A sojourn lasts at least one slot (errata 16). Continuous laws (Weibull, log-normal) are rounded to the nearest slot,
and the probability below 1 is added to that of 1. Every law computes what the assignment needs: P(τ), P(τ ≥ e), the
mean, and Σ_{r ≥ e} P(τ ≥ r) for sojourns that are cut at both ends (errata 9).
"""

from abc import abstractmethod
from typing import Annotated, Final, Literal, Self

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike
from pydantic import ConfigDict, Field, model_validator
from scipy import special

from rwa_monitor.samples import FloatArray, IntArray
from rwa_monitor.wheel.file_content import Strict, ordered

LONGEST: Final = 10**12  # slots, four thousand years at 8 Hz: more is a wrong unit, and too near floats' exact integers
EXACT_TERMS: Final = 4_096  # summed one by one; for longer durations the law hardly changes within a slot


class _Law(Strict):
    """Base of all duration laws, each defined by its survival function P(τ ≥ e)."""

    @abstractmethod
    def survival(self, slots: ArrayLike) -> FloatArray:
        """Return P(τ ≥ slots), float64, the shape of `slots`; 1 for slots ≤ 1."""

    @abstractmethod
    def sample(self, rng: Generator, size: int) -> IntArray:
        """Draw `size` durations [slots], int64, each at least 1."""

    @abstractmethod
    def longest(self) -> float:
        """Return the largest duration with positive probability, or one with survival below 1e-12."""

    def pmf(self, slots: ArrayLike) -> FloatArray:
        """Return P(τ = slots), float64, the shape of `slots`."""
        at = np.asarray(slots, dtype=np.float64)
        return np.where(at >= 1, self.survival(at) - self.survival(at + 1), 0.0)

    @abstractmethod
    def survival_sum(self, start: int) -> float:
        """Return Σ_{r ≥ start} P(τ ≥ r) [slots]; the mean duration for start = 1."""

    def mean(self) -> float:
        """Return the mean duration [slots]."""
        return self.survival_sum(1)


class _PiecewiseLinear(_Law):
    """A law whose survival function is linear between knots at whole numbers of slots, from one down to zero."""

    @property
    @abstractmethod
    def knots(self) -> FloatArray:
        """The knots, float64, increasing [slots]."""

    def survival_sum(self, start: int) -> float:
        at = np.append(float(start), self.knots[self.knots > start])
        survival = self.survival(at)
        return float(np.trapezoid(survival, at) + 0.5 * survival[0])  # exact for a piecewise linear function


class Uniform(_PiecewiseLinear):
    """Every whole number of slots from `low` to `high`, both included, equally likely."""

    law: Literal["uniform"] = "uniform"
    low: Annotated[int, Field(ge=1, le=LONGEST)]
    high: Annotated[int, Field(ge=1, le=LONGEST)]

    _ordered = model_validator(mode="after")(ordered)

    @property
    def knots(self) -> FloatArray:
        return np.array([self.low, self.high + 1], dtype=np.float64)

    def survival(self, slots: ArrayLike) -> FloatArray:
        at = np.asarray(slots, dtype=np.float64)
        return np.minimum(np.maximum((self.high + 1 - at) / (self.high + 1 - self.low), 0.0), 1.0)

    def sample(self, rng: Generator, size: int) -> IntArray:
        return rng.integers(self.low, self.high, size=size, endpoint=True, dtype=np.int64)

    def longest(self) -> float:
        return float(self.high)


class Geometric(_Law):
    """Memoryless: P(τ = k) = p (1 - p)^(k-1) with p = 1 / mean."""

    law: Literal["geometric"] = "geometric"
    mean_slots: Annotated[float, Field(ge=1, le=LONGEST, alias="mean")]

    model_config = ConfigDict(populate_by_name=True)

    def survival(self, slots: ArrayLike) -> FloatArray:
        at = np.maximum(np.asarray(slots, dtype=np.float64), 1.0)
        stay = 1.0 - 1.0 / self.mean_slots
        return np.power(stay, at - 1.0)

    def sample(self, rng: Generator, size: int) -> IntArray:
        return rng.geometric(1.0 / self.mean_slots, size=size).astype(np.int64)

    def longest(self) -> float:
        return 1.0 + 28.0 * self.mean_slots  # exp(-28) < 1e-12

    def survival_sum(self, start: int) -> float:
        return self.mean_slots * float(self.survival(start))


class _RoundedContinuous(_Law):
    """A continuous positive law, rounded to the nearest slot, at least 1."""

    @abstractmethod
    def _tail(self, value: FloatArray) -> FloatArray:
        """Return P(x > value) of the continuous law."""

    @abstractmethod
    def _excess(self, value: float) -> float:
        """Return ∫ P(x > t) dt of the continuous law from a value on."""

    @abstractmethod
    def _draw(self, rng: Generator, size: int) -> FloatArray:
        """Draw `size` values of the continuous law, float64."""

    def survival(self, slots: ArrayLike) -> FloatArray:
        at = np.asarray(slots, dtype=np.float64)
        return np.where(at <= 1, 1.0, self._tail(np.maximum(at - 0.5, 0.5)))

    def survival_sum(self, start: int) -> float:
        # Beyond `end` the law changes so little within a slot that each term equals an integral (midpoint rule).
        end = start + EXACT_TERMS
        return float(self.survival(np.arange(start, end)).sum()) + self._excess(end - 1.0)

    def sample(self, rng: Generator, size: int) -> IntArray:
        return np.clip(np.rint(self._draw(rng, size)), 1, LONGEST).astype(np.int64)


class Weibull(_RoundedContinuous):
    """P(x > t) = exp(-(t / scale)^shape), rounded to slots."""

    law: Literal["weibull"] = "weibull"
    shape: Annotated[float, Field(ge=0.1, le=1_000)]
    scale: Annotated[float, Field(gt=0, le=LONGEST)]

    def _tail(self, value: FloatArray) -> FloatArray:
        return np.exp(-np.power(value / self.scale, self.shape))

    def _excess(self, value: float) -> float:
        order, passed = 1.0 / self.shape, (value / self.scale) ** self.shape
        return float(self.scale * special.gamma(1.0 + order) * special.gammaincc(order, passed))

    def _draw(self, rng: Generator, size: int) -> FloatArray:
        return self.scale * rng.weibull(self.shape, size=size)

    def longest(self) -> float:
        return float(self.scale * 28.0 ** (1.0 / self.shape) + 1.0)


class Lognormal(_RoundedContinuous):
    """log x ~ N(mu, sigma²), rounded to slots."""

    law: Literal["lognormal"] = "lognormal"
    mu: Annotated[float, Field(ge=-30, le=30)]  # exp(30) slots is ten times LONGEST
    sigma: Annotated[float, Field(gt=0, le=5)]

    def _tail(self, value: FloatArray) -> FloatArray:
        return special.ndtr(-(np.log(value) - self.mu) / self.sigma)

    def _excess(self, value: float) -> float:
        far = (np.log(value) - self.mu) / self.sigma
        mean = np.exp(self.mu + 0.5 * self.sigma**2)
        return max(float(mean * special.ndtr(self.sigma - far) - value * special.ndtr(-far)), 0.0)

    def _draw(self, rng: Generator, size: int) -> FloatArray:
        return rng.lognormal(self.mu, self.sigma, size=size)

    def longest(self) -> float:
        return float(np.exp(self.mu + 7.1 * self.sigma) + 1.0)


class Histogram(_PiecewiseLinear):
    """Bins [edges[i], edges[i+1]) of whole slots with weights; equally likely within a bin; `identify` writes it."""

    law: Literal["histogram"] = "histogram"
    edges: Annotated[tuple[Annotated[int, Field(le=LONGEST)], ...], Field(min_length=2)]
    weights: Annotated[tuple[float, ...], Field(min_length=1)]

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if len(self.edges) != len(self.weights) + 1:
            raise ValueError(f"{len(self.edges)} edges need {len(self.edges) - 1} weights, not {len(self.weights)}")
        if self.edges[0] < 1 or any(b <= a for a, b in zip(self.edges, self.edges[1:], strict=False)):
            raise ValueError("edges must increase and begin at 1 or later")
        if min(self.weights) < 0 or sum(self.weights) <= 0:
            raise ValueError("weights must not be negative and must not all be zero")
        return self

    @property
    def knots(self) -> FloatArray:
        return np.array(self.edges, dtype=np.float64)

    def survival(self, slots: ArrayLike) -> FloatArray:
        weights = np.asarray(self.weights)
        # Tail sums accumulated from the end, so that the last is exactly 0 and none is negative.
        tails = np.concatenate([np.cumsum(weights[::-1])[::-1], [0.0]])
        at = np.asarray(slots, dtype=np.float64)
        return np.asarray(np.interp(at, self.knots, tails / tails[0]))

    def sample(self, rng: Generator, size: int) -> IntArray:
        weights = np.asarray(self.weights)
        bins = rng.choice(weights.size, size=size, p=weights / weights.sum())
        edges = np.asarray(self.edges, dtype=np.int64)
        return rng.integers(edges[bins], edges[bins + 1], dtype=np.int64)

    def longest(self) -> float:
        return float(self.edges[-1] - 1)


DurationLaw = Annotated[Uniform | Geometric | Weibull | Lognormal | Histogram, Field(discriminator="law")]
