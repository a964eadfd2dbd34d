"""The exact likelihood of a law of friction, with or without jumps; the noise is refitted under every law.

    y_k = s_k l_k + Σ β_j φ_j + a_k + w_k,   a: AR(1),   w: white,   both growing with the speed

The level l of each recording is a random draw about a common one; after a jump it is unknown (a diffuse prior). Dry and
viscous friction are not negative. Noise that is estimated once, from the residual of the base law, would contain the
effect that is searched for. A score is -2 log-likelihood, its scale profiled out, plus log N for each parameter (BIC;
G. Schwarz, Annals of Statistics 6, 1978): the lower the better.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Final, NamedTuple, Self

import numpy as np
from scipy import linalg, optimize, sparse, special

from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.kernels.state_space import filter_gains, whiten
from rwa_monitor.samples import TINY, FloatArray, IntArray

Score = Callable[["NoiseLaw"], float]

# Gain required of the first effect: chance reaches it in two records of a thousand (see `nulls.json`).
FIRST_GAIN: Final = 6.0
DERIVED_GAIN: Final = 11.5  # the same where friction is derived: the derivative misses fast changes of acceleration
ACCEPT_GAIN: Final = 25.0  # the same of further effects: no law is exact, and the residual of one is more than chance
FEWEST_MEMORIES: Final = 20  # correlation times in the data; noise with fewer is a level that drifts as a random walk
NOISE_SAMPLES: Final = 10_000  # samples, from which the law of the noise is known to some per cent
NOISE_SEGMENTS: Final = 10  # segments of a long recording from which its noise is fitted
ROUNDS: Final = 4  # at most, in which parts of a model are fitted in turn
SETTLED: Final = 0.1  # change of the score at which alternation ends
LEAST_PIVOT: Final = 1e-4  # of the Cholesky factor of regressors of length 1; below it too many digits are lost
# Bounds of the noise's parameters, beyond which its law hardly changes: shares of white noise from 3e-4 to 1 - 3e-4,
# memory of up to a thousand samples, growth by a factor of a hundred, levels a thousand standard deviations apart.
WIDEST_SHARE: Final = 8.0
LONGEST_MEMORY: Final = 7.0
LONG_MEMORY: Final = 0.95  # φ: noise correlated over some sixty samples can be mistaken for a law of a slow motion
BOUNDS: Final = {"growth": (-4.6, 4.6), "slew": (0.0, 4.6), "level_spread": (-14.0, 14.0)}  # of the spread: its log
LEVELS_APART: Final = 100.0  # initial `level_spread` of a fit
SHORTEST_MEMORY: Final = -4.0  # logit of φ
NOISE_STARTS: Final = ((0.0, 1.0), (-3.0, 0.0), (0.0, 4.0))  # initial logits of share and φ; the last of a drift, too
BORDER_MARGIN: Final = 1e-6  # distance, in the logit of φ, from the border between noise and a drifting level
DESCENT: Final = {"eps": 1e-3, "ftol": 1e-6, "gtol": 0.05}  # converges to some hundredths of the score
UNUSED_VALUES: Final = (  # values at which a parameter is not in use
    {"white": 1.0, "correlation": 0.0},
    {"growth": 0.0},
    {"slew": 0.0},
    {"level_spread": 0.0},
)

NO_JUMPS: Final[IntArray] = np.zeros(0, dtype=np.int64)


def least_gain(problem: Problem, named: int) -> float:
    """Return the gain that is required of an effect, given the number of effects already named."""
    first = DERIVED_GAIN if problem.friction_is_derived else FIRST_GAIN
    return ACCEPT_GAIN if named else first


@dataclass(frozen=True, slots=True)
class NoiseLaw:
    """The law of the noise; its scale is fitted together with the coefficients.

    Attributes
    ----------
    white
        Share of the variance that is white; the rest is AR(1).
    correlation
        φ of the AR(1) part from slot to slot.
    growth
        Logarithm of the ratio of the standard deviation at the largest speed to that at rest; linear in between.
    slew
        The same at the largest |dω/dt| and at constant speed: a time offset between channels causes errors in
        proportion to dω/dt.
    level_spread
        Variance of the recordings' levels about the common one, relative to the variance of the noise.
    """

    white: float = 1.0
    correlation: float = 0.0
    growth: float = 0.0
    slew: float = 0.0
    level_spread: float = 0.0

    @property
    def separate_levels(self) -> NoiseLaw:
        """The law with differing levels of the recordings, as a start of a fit."""
        return self if self.level_spread > 0.0 else replace(self, level_spread=LEVELS_APART)

    def for_series(self, series: Series) -> NoiseLaw:
        """Return the law without noise of slews if the level of the samples jumps: that noise would hide jumps."""
        return replace(self, slew=0.0) if series.jumps_within else self

    @property
    def memory(self) -> float:
        """φ of the AR(1) noise with the same ratio of long-run variance to variance."""
        long_run = self.white + (1.0 - self.white) * (1.0 + self.correlation) / (1.0 - self.correlation)
        return (long_run - 1.0) / (long_run + 1.0)

    def price(self, size: int) -> float:
        """Return the penalty of the law in `size` samples: log N for each parameter.

        A drifting level and noise of slews have no known cause. Each is penalised like a further hypothesis, so that a
        law that explains the same is preferred.
        """
        parameters = 2 * (self.correlation > 0.0) + (self.growth != 0.0) + (self.slew > 0.0) + (self.level_spread > 0.0)
        return float(np.log(size)) * parameters + ACCEPT_GAIN * (self.is_drift(size) + (self.slew > 0.0))

    def of_means(self, width: int) -> NoiseLaw:
        """Return the law of means over `width` slots; only the share of white noise changes."""
        lags = np.arange(1, width)
        correlated = (1.0 - self.white) * (width + 2.0 * float((width - lags) @ self.correlation**lags)) / width**2
        white = self.white / width
        return replace(self, white=white / (white + correlated))

    def is_drift(self, size: int) -> bool:
        """Return whether, in `size` samples, the AR(1) part counts as a drifting level instead of noise."""
        return self.correlation > 0.0 and size * (1.0 - self.correlation) < FEWEST_MEMORIES


@dataclass(frozen=True, slots=True)
class Series:
    """Friction on the slots of the records, joined; arrays (n,).

    Attributes
    ----------
    friction
        As measured [N m].
    sign
        Direction of rotation.
    speed
        ω [rad/s].
    gap
        int64, slots since the previous sample; 0 where a recording begins.
    slew
        Largest |dω/dt| nearby, relative to that of all samples, see `Problem`.
    jumps
        int64 (j,), first sample of each new level.
    smallest_variance
        Variance of the rounding of the table, which is added to that of the noise [N² m²].
    memory
        Number of samples that carry the information of one independent sample; above 1 the noise is taken as white, see
        `Problem`.
    top_speed
        Speed |ω| to which `NoiseLaw.growth` refers [rad/s]; 0: the largest of these samples.
    may_drift
        Whether the level may drift: not where friction was commanded, as all noise is then in the speed.
    """

    friction: FloatArray
    sign: FloatArray
    speed: FloatArray
    gap: IntArray
    slew: FloatArray
    jumps: IntArray = field(default_factory=NO_JUMPS.copy)
    smallest_variance: float = 0.0
    memory: float = 1.0
    top_speed: float = 0.0
    may_drift: bool = True

    @classmethod
    def of(cls, problem: Problem, jumps: IntArray = NO_JUMPS) -> Self:
        """Return the used samples of a problem, with jumps, int64 (j,): the first sample of each new level."""
        return cls(
            problem.sign * problem.z,
            problem.sign,
            problem.sign * problem.speed,
            problem.gap,
            problem.slew,
            jumps,
            problem.smallest_noise_Nm**2,
            problem.memory,
            may_drift=all(record.follows_noise for record in problem.records),
        )

    @property
    def several(self) -> bool:
        """Return whether there is more than one recording."""
        return int(np.count_nonzero(self.gap == 0)) > 1

    @property
    def jumps_within(self) -> bool:
        """Return whether a level jumps within a recording."""
        return bool(self.gap[self.jumps].any())

    def subsampled(self) -> Series:
        """Return evenly spaced segments of a long recording: they suffice to fit the law of the noise."""
        if self.size <= NOISE_SAMPLES or self.several:
            return self
        begins = np.linspace(0, self.size - NOISE_SAMPLES // NOISE_SEGMENTS, NOISE_SEGMENTS).astype(np.int64)
        kept = (begins[:, None] + np.arange(NOISE_SAMPLES // NOISE_SEGMENTS)).ravel()
        gap, is_jump = self.gap[kept], np.zeros(self.size, dtype=bool)
        is_jump[self.jumps] = is_jump[begins[1:]] = True
        gap[:: NOISE_SAMPLES // NOISE_SEGMENTS] = 0
        jumps = np.flatnonzero(is_jump[kept])
        taken = self._each(lambda values: values[kept])
        return replace(self, **taken, gap=gap, jumps=jumps, top_speed=float(np.abs(self.speed).max()))

    def _each(self, function: Callable[[FloatArray], FloatArray]) -> dict[str, Any]:
        """Return a function of each array of measured values, by the array's name."""
        return {name: function(getattr(self, name)) for name in ("friction", "sign", "speed", "slew")}

    def averaged(self, most: int) -> tuple[Series, sparse.csr_array]:
        """Return about `most` means over neighbouring samples, and the averaging operator, (m, n).

        A law that is linear in the regressors is linear in their means, even across a change of direction.
        """
        width, at = -(-self.size // most), np.arange(self.size)
        begins = np.flatnonzero(self.gap == 0)
        first = np.flatnonzero((at - begins[np.searchsorted(begins, at, side="right") - 1]) % width == 0)
        counts = np.diff(first, append=self.size)
        averaging = sparse.csr_array((np.repeat(1.0 / counts, counts), at, np.append(first, self.size)))
        if width == 1:
            return self, averaging
        gap = np.diff(np.cumsum(self.gap)[first], prepend=0)
        gap[self.gap[first] == 0] = 0
        means = self._each(lambda values: averaging @ values)
        # A mean across a change of direction may have no level: a jump there is one of the next mean.
        lasting = np.flatnonzero(means["sign"])
        jumps = np.searchsorted(lasting, np.searchsorted(first, self.jumps - width // 2))
        jumps = np.unique(lasting[jumps[(jumps > 0) & (jumps < lasting.size)]])
        memory, top = max(self.memory / width, 1.0), self.top_speed or float(np.abs(self.speed).max())
        return replace(self, **means, gap=gap, jumps=jumps, memory=memory, top_speed=top), averaging

    @property
    def size(self) -> int:
        """Number of samples."""
        return int(self.friction.size)

    @property
    def base(self) -> FloatArray:
        """The regressors of dry and viscous friction, float64 (2, n)."""
        return np.stack([self.sign, self.speed])

    def spread(self, law: NoiseLaw) -> FloatArray:
        """Return the relative standard deviation of the noise, float64 (n,), with mean logarithm 0."""
        share = np.abs(self.speed) / (self.top_speed or np.abs(self.speed).max())
        spread = 1.0 + np.expm1(law.growth) * share + np.expm1(law.slew) * self.slew
        return np.asarray(spread / np.exp(np.mean(np.log(spread))))

    def whitened(self, rows: FloatArray, law: NoiseLaw) -> tuple[FloatArray, float]:
        """Return the innovations of rows, float64 (p, n), and the log-determinant of their covariance without jumps."""
        whitening = Whitening.of(self, law)
        return whitening.innovations(np.array(rows, dtype=np.float64, order="C", ndmin=2)), whitening.log_determinant


@dataclass(frozen=True, slots=True)
class Whitening:
    """The filter that whitens noise of a given law, for any number of rows.

    Attributes
    ----------
    series
        The samples and their jumps.
    spread, level
        float64 (n,), relative standard deviation of the noise, None where it is constant; and the regressor of the
        level, divided by it.
    gains
        float64 (n, 4), see `kernels/state_space`.
    log_determinant
        Of the covariance without jumps.
    """

    series: Series
    spread: FloatArray | None
    level: FloatArray
    gains: FloatArray
    log_determinant: float

    @classmethod
    def of(cls, series: Series, law: NoiseLaw) -> Self:
        """Return the filter for a law."""
        spread = series.spread(law) if law.growth != 0.0 or law.slew > 0.0 else None
        level = series.sign if spread is None else series.sign / spread  # levels do not grow with the speed
        gains, parts = np.empty((series.size, 4)), (law.white, 1.0 - law.white, law.correlation, law.level_spread)
        return cls(series, spread, level, gains, filter_gains(level, series.gap, series.jumps, parts, gains))

    def innovations(self, rows: FloatArray) -> FloatArray:
        """Return the standardised innovations of rows, float64 (p, n), computed in place."""
        rows = np.ascontiguousarray(rows)
        if self.spread is not None:
            rows /= self.spread
        whiten(rows, self.level, self.series.gap, self.gains)
        return rows


@dataclass(frozen=True, slots=True)
class Equations:
    """Normal equations of whitened regressors.

    Attributes
    ----------
    gram, moment, squares
        float64 (p, p), (p,) and scalar: inner products of the regressors, of them with the friction, and of the
        friction with itself.
    low, high
        float64 (p,), bounds of the coefficients.
    samples, log_determinant
        Number of whitened samples, and log-determinant of their covariance.
    smallest_variance
        Added to the variance of the residual [N² m²].
    memory
        Number of samples that carry the information of one independent sample.
    """

    gram: FloatArray
    moment: FloatArray
    squares: float
    low: FloatArray
    high: FloatArray
    samples: int
    log_determinant: float
    smallest_variance: float = 0.0
    memory: float = 1.0

    @classmethod
    def of(cls, series: Series, rows: FloatArray, low: FloatArray, high: FloatArray, law: NoiseLaw) -> Self:
        """Whiten friction and regressors, float64 (p, n), and form the normal equations."""
        whitening = Whitening.of(series, law)
        white = whitening.innovations(np.vstack([series.friction, rows]))
        return cls.of_products(series, white @ white.T, low, high, whitening.log_determinant)

    @classmethod
    def of_products(
        cls, series: Series, products: FloatArray, low: FloatArray, high: FloatArray, log_determinant: float
    ) -> Self:
        """Return the equations from inner products of whitened friction and regressors, float64 (1 + p, 1 + p)."""
        squares, smallest = float(products[0, 0]), series.smallest_variance
        return cls(
            products[1:, 1:], products[1:, 0], squares, low, high, series.size, log_determinant, smallest, series.memory
        )

    def solve(self) -> tuple[FloatArray, float]:
        """Return the coefficients within their bounds, and the deviance with the scale profiled out."""
        squares = self.gram.diagonal()
        left = squares > TINY  # the levels span the others: their coefficients are 0
        scale = np.sqrt(np.where(left, squares, 1.0))
        gram, moment = self.gram / np.outer(scale, scale), np.where(left, self.moment / scale, 0.0)
        factor, failed = linalg.lapack.dpotrf(gram)
        if failed or factor.diagonal().min() < LEAST_PIVOT:
            solution = np.linalg.lstsq(gram, moment, rcond=1e-12)[0]
        else:
            solution = linalg.lapack.dpotrs(factor, moment)[0]
        low, high = self.low * scale, self.high * scale
        if (solution < low).any() or (solution > high).any():
            values, vectors = linalg.eigh(gram)
            root = np.sqrt(np.maximum(values, 1e-12 * values[-1]))
            bounded = optimize.lsq_linear((vectors * root).T, (vectors.T @ moment) / root, (low, high), method="bvls")
            solution = np.clip(bounded.x, low, high)
        variance = max(self.rss(solution / scale), TINY) / self.samples + self.smallest_variance
        deviance = float(self.samples * np.log(variance) + self.log_determinant) / self.memory
        return np.clip(solution / scale, self.low, self.high), deviance

    def rss(self, coefficients: FloatArray) -> float:
        """Return the residual sum of squares of coefficients, float64 (p,)."""
        left = self.squares - 2.0 * coefficients @ self.moment + coefficients @ self.gram @ coefficients
        return max(float(left), 1e-15 * self.squares)


def fit_noise(
    series: Series, rows: FloatArray, low: FloatArray, high: FloatArray, start: NoiseLaw, *, again: bool = False
) -> tuple[NoiseLaw, float]:
    """Return the noise law with the lowest score for the regressors, and the score.

    A noise parameter is used only where it lowers the score by more than its penalty. Coefficients and noise are fitted
    alternately. The noise is fitted to the residual of the regressors with dry and viscous friction left free, since
    slow noise is most easily confused with these. The cost is independent of the number of regressors. The levels of
    recordings differ only if they do at the start: that is a hypothesis, see `NoiseLaw.separate_levels`. `again`: the
    start is the law of nearly the same model, and only its neighbourhood is searched, unless its memory is so long that
    it may mimic a missing law.
    """
    again, start = again and start.correlation < LONG_MEMORY, start.for_series(series)

    def under(law: NoiseLaw) -> _NoiseFit:
        """Return a noise law with its best coefficients and the score."""
        coefficients, deviance = Equations.of(series, rows, low, high, law).solve()
        return _NoiseFit(law, coefficients, deviance + law.price(series.size))

    def refitted(one: _NoiseFit) -> _NoiseFit:
        """Fit the noise to the residual of the coefficients, then the coefficients under that noise."""
        left = replace(series, friction=series.friction - one.coefficients @ rows)
        return under(_fitted_noise_law(left.subsampled(), one.law, again))

    plain = NoiseLaw(level_spread=start.level_spread)
    starts = [under(start)]
    if not again and start != plain:  # slow noise at the start could hide a law that it mimics
        starts.append(under(plain))
    best = min(starts[0], *(refitted(one) for one in starts), key=lambda one: one.score)
    for _ in range(ROUNDS - 1):
        found = refitted(best)
        settled = found.score > best.score - SETTLED
        best = min(best, found, key=lambda one: one.score)
        if settled:
            break
    return best.law, best.score


class _NoiseFit(NamedTuple):
    """A noise law, its best coefficients, float64 (p,), and their score."""

    law: NoiseLaw
    coefficients: FloatArray
    score: float


def _fitted_noise_law(series: Series, start: NoiseLaw, again: bool) -> NoiseLaw:
    """Return the noise law of a residual; with `again`, only parameters in use at the start are fitted."""
    free = np.full(2, np.inf)

    def score(law: NoiseLaw) -> float:
        return Equations.of(series, series.base, -free, free, law).solve()[1] + law.price(series.size)

    law = replace(start, white=1.0, correlation=0.0)
    best, least = law, score(law)

    def try_out(other: NoiseLaw, reached: float) -> None:
        nonlocal best, least
        best, least = min((best, least), (other, reached), key=lambda one: one[1])

    for _ in range(2):  # autocorrelation and growth mask each other at first
        others = best.growth, best.slew, best.level_spread
        if series.memory == 1.0 and (start.correlation > 0.0 or not again):
            try_out(*_fit_ar1(score, best, best if best.correlation > 0.0 else start, series, again))
        tried = {
            "growth": start.growth != 0.0 or not again,
            "slew": not series.jumps_within and (start.slew > 0.0 or not again),
            "level_spread": best.level_spread > 0.0,
        }
        for name, is_tried in tried.items():
            if is_tried:
                try_out(*_fit_one(score, best, name))
        for unused in UNUSED_VALUES:  # a parameter that another one has replaced is removed
            plainer = replace(best, **unused)
            if plainer != best:
                try_out(plainer, score(plainer))
        if (best.growth, best.slew, best.level_spread) == others:
            break
    return best


def _fit_ar1(score: Score, other: NoiseLaw, start: NoiseLaw, series: Series, again: bool) -> tuple[NoiseLaw, float]:
    """Fit the share of white noise and φ of a law, both as noise and as a drifting level; `again`: near the start only.

    The score is smooth within each of the two ranges of φ, and steps by the penalty of a hypothesis at their border.
    """

    def law(at: FloatArray) -> NoiseLaw:
        return replace(other, white=float(special.expit(at[0])), correlation=float(special.expit(at[1])))

    border = float(special.logit(1.0 - FEWEST_MEMORIES / max(series.size, 2.0 * FEWEST_MEMORIES)))
    noise = SHORTEST_MEMORY, min(border, LONGEST_MEMORY) - BORDER_MARGIN
    drifting = min(border, LONGEST_MEMORY) + BORDER_MARGIN, LONGEST_MEMORY if series.may_drift else -np.inf
    tries = [*((at, noise) for at in NOISE_STARTS), (NOISE_STARTS[-1], drifting)]
    if start.correlation > 0.0:
        at = float(special.logit(start.white)), float(special.logit(start.correlation))
        tries = [(at, box) for box in (noise, drifting) if not again or box[0] <= at[1] <= box[1]] or [(at, noise)]
    minimize: Any = optimize.minimize
    found: list[tuple[NoiseLaw, float]] = []
    for (share, memory), box in tries:
        if box[0] < box[1]:
            at, bounds = (share, float(np.clip(memory, *box))), ((-WIDEST_SHARE, WIDEST_SHARE), box)
            best = minimize(lambda x: score(law(x)), at, method="L-BFGS-B", bounds=bounds, options=DESCENT)
            found.append((law(best.x), float(best.fun)))
    return min(found, key=lambda one: one[1])


def _fit_one(score: Score, law: NoiseLaw, name: str) -> tuple[NoiseLaw, float]:
    """Fit one parameter of a law within its bounds, `level_spread` by its logarithm."""

    def changed(at: float) -> NoiseLaw:
        return replace(law, **{name: float(np.exp(at) if name == "level_spread" else at)})

    options: Any = {"xatol": 0.03, "maxiter": 16}
    minimize: Any = optimize.minimize_scalar
    found = minimize(lambda at: score(changed(at)), bounds=BOUNDS[name], method="bounded", options=options)
    return changed(float(found.x)), float(found.fun)
