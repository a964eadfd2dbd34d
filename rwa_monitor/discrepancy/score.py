"""The score of a model, by which the search decides: its exact likelihood, with a penalty for parameters and jumps.

Twice the negative log-likelihood with coefficients, levels and the noise's law refitted, plus log N for each parameter
and 3 log N for each jump. Candidates are screened faster, with noise and jumps fixed (`Background`); the best of them
are scored.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final, Self

import numpy as np
from scipy import sparse

from rwa_monitor.discrepancy.base_fit import (
    JUMP_PENALTY,
    LEVEL_SAMPLES,
    REVERSAL,
    Fit,
    jump_price,
    levels,
    pieces,
    remove_levels,
    segment_correlated,
    segment_records,
    segment_starts,
)
from rwa_monitor.discrepancy.likelihood import NO_JUMPS, Equations, NoiseLaw, Series, Whitening, fit_noise
from rwa_monitor.discrepancy.problem import MAX_LAG, Problem
from rwa_monitor.discrepancy.terms import Model, Term, depends_on_level, make_term
from rwa_monitor.samples import TINY, FloatArray, IntArray

SCREENED: Final = 20_000  # means of neighbouring samples: a longer record is averaged to about so many
BASE_PARAMETERS: Final = 2  # dry and viscous friction


def scored(
    problem: Problem, terms: Sequence[Term], jumps: IntArray, start: NoiseLaw | None = None, *, again: bool = False
) -> Model:
    """Return the model of terms and jumps, with the law of its noise fitted, the best coefficients, and its score.

    Parameters
    ----------
    problem, terms, jumps
        The data, the effects, and the first sample of each new level, int64 (j,).
    start
        A law of the noise to begin with.
    again
        Whether that is the law of nearly the same model: then laws near it alone are tried.
    """
    series = Series.of(problem, jumps)
    law = start or (NoiseLaw().separate_levels if series.several else NoiseLaw())
    if problem.has_noise:
        law, _ = fit_noise(series, *regressors(series, terms), law, again=again)
    return with_law(problem, terms, jumps, law)


def with_law(problem: Problem, terms: Sequence[Term], jumps: IntArray, law: NoiseLaw) -> Model:
    """Return the model of terms and jumps with the coefficients that are best under a law of the noise."""
    series = Series.of(problem, jumps)
    law = law.for_series(series)
    rows, low, high = regressors(series, terms)
    coefficients, deviance = Equations.of(series, rows, low, high, law).solve()
    parameters = price(terms) + JUMP_PENALTY * jumps.size
    score = deviance + problem.log_size * parameters + law.price(series.size)
    score += constants_deviance(problem, terms, coefficients[2:])
    return Model(tuple(terms), _fit(problem, series, rows, coefficients, law), law, score)


def of_least_error(problem: Problem, model: Model) -> Model:
    """Return a model with coefficients of least squares: in noise of long memory, the likeliest ones miss by more."""
    return with_law(problem, model.terms, model.fit.jumps, NoiseLaw(level_spread=model.law.level_spread))


def at_best(judge: Callable[[Model], HeldOut], problem: Problem, model: Model) -> HeldOut:
    """Return the scores of a model on held-out data, with the RMSE of its coefficients of least squares if less."""
    found, least = judge(model), judge(of_least_error(problem, model))
    return replace(found, rmse_Nm=min(found.rmse_Nm, least.rmse_Nm))


def with_exact_jumps(problem: Problem, model: Model) -> Model:
    """Return a scored model with the optimal jumps given its coefficients and noise, where that lowers the score."""
    series, law = Series.of(problem), model.law
    if law.white > 1.0 - law.memory**2:
        return model  # its innovations as AR(1) noise are so small that white noise would be segmented into jumps
    # Along the rotation (in z), the noise of the torque changes its sign where the direction does.
    spread = series.spread(law)
    variance = series.memory * float(np.mean((model.fit.residual / spread) ** 2)) * spread**2
    along, slot = model.fit.level + model.fit.residual, np.cumsum(np.maximum(series.gap, 1))
    apart, jumps = np.flatnonzero(problem.to_reversal >= REVERSAL), [NO_JUMPS]
    for piece in pieces(problem):
        kept = apart[(apart >= piece.start) & (apart < piece.stop)]
        if kept.size:
            flips = np.append(1.0, series.sign[kept[1:]] * series.sign[kept[:-1]])
            correlation = flips * law.memory ** np.diff(slot[kept], prepend=slot[kept[0]] - 1)
            fresh = variance[kept] * np.append(1.0, 1.0 - correlation[1:] ** 2)
            price = JUMP_PENALTY * problem.log_size
            jumps.append(kept[segment_correlated(along[kept], correlation, fresh, price)])
    exact = _placed(problem, along, np.concatenate(jumps))
    if np.array_equal(exact, model.fit.jumps):
        return model
    return min(model, with_law(problem, model.terms, exact, law), key=lambda one: one.score)


def off_reversals(problem: Problem, along: FloatArray, jumps: IntArray) -> IntArray:
    """Merge the jumps within each change of direction into one; `along` is z less all terms but the levels [N m].

    A level that lasts a few samples there is an effect of the reversal, or of a filter.
    """
    after = np.append(np.flatnonzero(problem.to_reversal >= REVERSAL), problem.size)
    moved = np.unique(after[np.searchsorted(after, jumps)])
    return _placed(problem, along, moved[moved < problem.size])


def _placed(problem: Problem, along: FloatArray, jumps: IntArray) -> IntArray:
    """Move jumps that follow a change of direction to the sample in it that best separates the levels on both sides.

    Parameters
    ----------
    problem
        The data.
    along
        float64 (n,), z less all terms of a model but the levels [N m].
    jumps
        int64 (j,), none of them within a change of direction.
    """
    at = np.arange(problem.size)
    latest = np.maximum.accumulate(np.where(problem.to_reversal < REVERSAL, -1, at))
    borders = np.unique(np.concatenate([problem.starts, jumps]))
    begins, placed = latest[jumps - 1] + 1, jumps.copy()
    for i in np.flatnonzero(begins < jumps):
        begin, jump = int(begins[i]), int(jumps[i])
        before = max(int(borders[np.searchsorted(borders, jump) - 1]), begin - LEVEL_SAMPLES)
        after = min(int(borders[np.searchsorted(borders, jump, side="right")]), jump + LEVEL_SAMPLES)
        if before < begin:
            left, right = along[before:begin].mean(), along[jump:after].mean()
            worse = np.cumsum((along[begin:jump] - left) ** 2 - (along[begin:jump] - right) ** 2)
            placed[i] = begin + int(np.argmin(np.append(0.0, worse)))
    return placed


def price(terms: Sequence[Term]) -> float:
    """Return the penalty for the parameters of the base law and of terms, in units of log N."""
    return BASE_PARAMETERS + sum(term.parameters for term in terms)


def constants_deviance(problem: Problem, terms: Sequence[Term], strengths: FloatArray) -> float:
    """Return twice the negative log-likelihood of constants of the wheel file, given estimates from other channels.

    Parameters
    ----------
    problem, terms
        The data, and the terms of a model; a constant has no error unless a term is its error.
    strengths
        float64 (p,), of their columns.
    """
    begins = np.cumsum([0, *(term.columns.shape[1] for term in terms)])
    errors = {term.effect.error_of: float(strengths[at]) for term, at in zip(terms, begins, strict=False)}
    total = 0.0
    for shown in problem.measured_constants:
        strength, std = shown.strength
        total += ((errors.get(shown.quantity, 0.0) - strength) / std) ** 2
    return total


def regressors(series: Series, terms: Sequence[Term]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the regressors of the base law and of terms, float64 (p, n), and the bounds of their coefficients, (p,).

    Dry and viscous friction are not negative, and the viscous part is not larger than the largest friction, unless a
    term is a part of it, as where it is the viscous friction at another temperature.
    """
    rows = np.vstack([series.base, *(term.columns.T for term in terms)])
    rows[BASE_PARAMETERS:] *= series.sign
    low = np.concatenate([np.zeros(2), *(term.low for term in terms)])
    steepest = float(np.abs(series.friction).max() / max(np.abs(series.speed).max(), TINY))
    high = np.concatenate([[np.inf, _viscous_bound(steepest, terms)], *(term.high for term in terms)])
    return rows, low, high


def _viscous_bound(seen: float, terms: Sequence[Term]) -> float:
    return np.inf if any(term.effect.is_part_of_viscous for term in terms) else seen


@dataclass(frozen=True, slots=True)
class Background:
    """The regressors of a model, whitened: with noise and jumps kept, a further term is scored from its columns alone.

    Long records are averaged over a few samples, which makes their scores approximate.

    Attributes
    ----------
    problem, terms
        The data, and the terms of the model.
    averaging
        float64 (m, n), turns columns of terms into means with the sign of the friction.
    whitening
        The filter for the noise law of the means.
    white, products
        float64 (1 + p, m), friction and the model's regressors, and (1 + p, 1 + p), their products.
    low, high
        float64 (p,), bounds of the coefficients.
    price
        Penalty for the parameters and jumps of the model.
    """

    problem: Problem
    terms: tuple[Term, ...]
    averaging: sparse.csr_array
    whitening: Whitening
    white: FloatArray
    products: FloatArray
    low: FloatArray
    high: FloatArray
    price: float

    @classmethod
    def of(cls, problem: Problem, terms: Sequence[Term], law: NoiseLaw, jumps: IntArray) -> Self:
        """Whiten the friction and the regressors of a model."""
        whole = Series.of(problem, jumps)
        law = law.for_series(whole)
        rows, low, high = regressors(whole, terms)
        series, averaging = whole.averaged(SCREENED)
        whitening = Whitening.of(series, law.of_means(-(-whole.size // series.size)))
        white = whitening.innovations(np.vstack([series.friction, (averaging @ rows.T).T]))
        known = problem.log_size * (price(terms) + JUMP_PENALTY * jumps.size) + law.price(whole.size)
        products = white @ white.T
        averaging = averaging @ sparse.diags_array(whole.sign)
        return cls(problem, tuple(terms), averaging, whitening, white, products, low, high, known)

    def equations_with(self, *terms: Term) -> Equations:
        """Return the normal equations with further terms."""
        products = self.products
        if terms:
            columns = self.whitening.innovations(np.hstack([self.averaging @ term.columns for term in terms]).T)
            across = self.white @ columns.T
            products = np.block([[products, across], [across.T, columns @ columns.T]])
        low = np.concatenate([self.low, *(term.low for term in terms)])
        high = np.concatenate([self.high, *(term.high for term in terms)])
        high[1] = _viscous_bound(high[1], terms)
        return Equations.of_products(self.whitening.series, products, low, high, self.whitening.log_determinant)

    def criterion_with(self, *terms: Term) -> float:
        """Return the score with further terms."""
        added = sum(term.parameters for term in terms)
        coefficients, deviance = self.equations_with(*terms).solve()
        other = constants_deviance(self.problem, (*self.terms, *terms), coefficients[2:])
        return deviance + other + self.price + self.problem.log_size * added


def _fit(problem: Problem, series: Series, rows: FloatArray, coefficients: FloatArray, law: NoiseLaw) -> Fit:
    """Return a fit with given coefficients; without jumps or separate levels, its level is the common dry friction."""
    rest = series.sign * (series.friction - coefficients[1:] @ rows[1:])
    residual = rest - coefficients[0]
    if series.jumps.size or law.level_spread > 0.0:
        residual = remove_levels(rest, segment_starts(problem, series.jumps))
    return Fit(series.jumps, coefficients[1:], rest - residual, residual)


# ---- how well the coefficients of a model are known ------------------------------------------------------------------
# The residual of an incomplete model is correlated for longer than the law of its noise: then the standard deviation is
# estimated from the autocovariance of the residual (W. K. Newey, K. D. West, Econometrica 55, 1987).


SEGMENTS: Final = 20  # segments of the samples: residuals that are one of them apart are taken as independent
FEWEST_SEGMENTS: Final = 1.5  # segments: from fewer, the variance of a residual cannot be estimated


def wald(problem: Problem, model: Model) -> FloatArray:
    """Return the Wald statistic of each term: (size of its torque over its standard deviation)², float64 (terms,).

    Where the residual is noise of the fitted law, that is about the gain of the term (A. Wald, Trans. AMS 54, 1943).
    Infinite in a record too short to estimate the autocovariance of the residual, and for switching effects: few
    samples decide on those by nature, and each jump has its penalty.
    """
    if problem.size < SEGMENTS * MAX_LAG:
        return np.full(len(model.terms), np.inf)
    torques = np.column_stack([model.torque(i) for i in range(len(model.terms))])
    std = standard_deviations(problem, model, np.column_stack([torques, problem.speed]))[:-1]
    squares = np.where(torques.any(axis=0), 1.0 / np.maximum(std**2, TINY), 0.0)
    return np.where([term.effect.family == "switching" for term in model.terms], np.inf, squares)


def standard_deviations(problem: Problem, model: Model, columns: FloatArray) -> FloatArray:
    """Return the standard deviation of the coefficient of each column, of any scale; the levels are estimated, too.

    It is the larger of two: by the fitted law of the noise, and by the autocovariance of the residual.
    """
    series = Series.of(problem, model.fit.jumps)
    rows = np.vstack([model.fit.residual, columns.T, np.ones(problem.size)]) * series.sign
    white, _ = series.whitened(rows, model.law)
    residual, design = white[0], white[1:].T
    variance = series.memory * float(residual @ residual) / residual.size
    scale = np.sqrt(np.sum(design**2, axis=0))
    scale[scale == 0] = 1.0
    design = design / scale
    inverse = np.linalg.pinv(design.T @ design, rcond=1e-14, hermitian=True)
    influence = design @ inverse  # of each sample on each coefficient
    of_noise = variance * np.sum(influence**2, axis=0)
    std: FloatArray = np.sqrt(np.maximum(of_noise, _newey_west_variance(influence, residual))) / scale
    return std[: columns.shape[1]]


def _newey_west_variance(influence: FloatArray, residual: FloatArray) -> FloatArray:
    """Return the variance of the coefficients for a residual that is correlated within a segment, float64 (p,).

    It sums the products of the scores influence · residual over all lags with Bartlett's triangular weights, zero from
    a segment's width on: that is the sum of the squares of all window sums of that width, over the width. The fit has
    reduced the residual's variance by (m - 1)/m, m the segments that inform a coefficient: this is corrected.
    """
    size = residual.size
    width = max(size // SEGMENTS, min(MAX_LAG, size // 2))
    scores = influence * residual[:, None]
    sums = np.concatenate([np.zeros((width, scores.shape[1])), np.cumsum(scores, axis=0)])
    sums = np.concatenate([sums, np.repeat(sums[-1:], width - 1, axis=0)])
    windows = sums[width:] - sums[:-width]
    weight = np.add.reduceat(influence**2, np.arange(0, size, width), axis=0)
    informative = np.sum(weight, axis=0) ** 2 / np.maximum(np.sum(weight**2, axis=0), TINY)
    informative = np.maximum(informative, FEWEST_SEGMENTS)
    return np.asarray(np.sum(windows**2, axis=0) / width * informative / (informative - 1.0), dtype=np.float64)


# ---- the likelihood of held-out data ---------------------------------------------------------------------------------
# The gain of an extension there, by the same likelihood as in the search.
# Blocks of time are left out in turn, and the coefficients fitted to the others; or other recordings are held out, with
# the coefficients kept. Shapes and the noise's law are kept. Levels and jumps are nuisance parameters of a recording:
# they are fitted to it, and the penalty of a jump is charged at its sample.


BLOCKS: Final = 10  # contiguous blocks of a search problem
TRAINABLE_SHARE: Final = 0.01  # of the energy of a regressor that the training blocks must contain
LEVEL_ROUNDS: Final = 3  # of level and level-dependent columns in turn, on held-out recordings


@dataclass(frozen=True, slots=True)
class HeldOut:
    """Scores on held-out data.

    Attributes
    ----------
    rmse_Nm
        Root mean square residual [N m].
    log_score
        Mean log density per sample given those before it, less the penalties of jumps [nats].
    block_log_scores
        float64 (blocks,), the same per block, for confidence intervals of differences.
    """

    rmse_Nm: float
    log_score: float
    block_log_scores: FloatArray


def held_out(problem: Problem, model: Model, blocks: int = BLOCKS) -> HeldOut:
    """Score a model on blocks of time, each with the strengths and the slope fitted to the other blocks."""
    problem = replace(problem, z=problem.z - model.of_own_jumps)
    places = [term.places for term in model.terms if term.places is not None]
    series = Series.of(problem, model.fit.jumps)
    rows, low, high = regressors(series, [term for term in model.terms if term.places is None])
    white, _ = series.whitened(np.vstack([series.friction, rows]), model.law)
    energy, jumps = np.sum(white**2, axis=1), model.fit.jumps if model.fit.jumps.size else None
    whitening = _whitening(problem, model, jumps)
    residual, innovations, variance = np.zeros((3, series.size))
    for begin, end in pairwise(_edges(blocks, series.size).tolist()):
        here, train = slice(begin, end), np.delete(white, slice(begin, end), axis=1)
        # A regressor with hardly any energy in the training blocks gets the coefficient 0, not an arbitrary one.
        shown = np.sum(train**2, axis=1) >= TRAINABLE_SHARE * energy
        products = (train @ train.T) * np.outer(shown, shown)
        equations = replace(Equations.of_products(series, products, low, high, 0.0), samples=train.shape[1])
        coefficients, _ = equations.solve()
        variance[here] = equations.rss(coefficients) / train.shape[1]
        rest = _residual(problem, coefficients @ rows, jumps)
        residual[here] = rest[here]
        innovations[here] = whitening.innovations((rest * problem.sign)[None])[0, here]
    charged = np.concatenate([model.fit.jumps, *places])
    return _score_of(problem, whitening, residual, innovations, charged, variance, blocks)


def on_other_recordings(problem: Problem, other: Problem, model: Model, *, jumps: bool) -> HeldOut:
    """Score a model on recordings that it was not found on: slope, strengths, shapes and noise as fitted on `problem`.

    Level-dependent columns follow the level that is estimated on the other recordings with that model. `jumps`: whether
    friction may jump; then levels are fitted there, else the mean level of the searched recordings is used.
    """
    other = replace(other, noise=problem.noise)
    viscous, terms = float(model.fit.coefficients[0]), model.terms
    drag = viscous * other.speed
    for _ in range(LEVEL_ROUNDS):
        rest, beside = other.z - drag, drag - viscous * other.speed
        level = levels(other, rest, segment_records(other, rest, jump_price(other)))
        terms = tuple(make_term(other, term.effect, term.shape, level, beside) for term in model.terms)
        drag = np.column_stack([other.speed, *(term.columns for term in terms)]) @ model.fit.coefficients
        if not any(depends_on_level(term.effect) for term in terms):
            break
    there = segment_records(other, other.z - drag, jump_price(other)) if jumps else None
    left, _ = Series.of(problem, model.fit.jumps).whitened(model.fit.residual * problem.sign, model.law)
    residual = _residual(other, other.sign * (drag + float(np.mean(model.fit.level))), there)
    whitening = _whitening(other, model, there)
    innovations = whitening.innovations((residual * other.sign)[None])[0]
    charged, variance = NO_JUMPS if there is None else there, np.mean(left**2)
    return _score_of(other, whitening, residual, innovations, charged, variance, BLOCKS)


def _edges(blocks: int, size: int) -> IntArray:
    """Return the first sample of each of so many blocks, and the number of samples, int64 (blocks + 1,)."""
    return np.linspace(0, size, blocks + 1).astype(np.int64)


def _residual(problem: Problem, torque_Nm: FloatArray, jumps: IntArray | None) -> FloatArray:
    """Return z less s·torque, float64 (n,), and less the level of each segment where jumps are given [N m]."""
    rest = problem.z - problem.sign * torque_Nm
    return remove_levels(rest, segment_starts(problem, jumps)) if jumps is not None else rest


def _whitening(problem: Problem, model: Model, jumps: IntArray | None) -> Whitening:
    """Return the whitening filter of a model's noise; where there are jumps, levels are fitted and not part of it."""
    law = model.law
    return Whitening.of(Series.of(problem), law if jumps is None else replace(law, level_spread=0.0))


def _score_of(
    problem: Problem,
    whitening: Whitening,
    residual: FloatArray,
    innovations: FloatArray,
    jumps: IntArray,
    variance: FloatArray | np.floating,
    blocks: int,
) -> HeldOut:
    """Return the scores of a residual [N m] with given jumps, under noise of a given variance [N² m²].

    `innovations`: the residual less its prediction from the samples before, of that variance, float64 (n,) [N m].
    """
    series = Series.of(problem)
    variance = np.maximum(variance, series.smallest_variance)
    spread = np.sqrt(variance) * (1.0 if whitening.spread is None else whitening.spread) / whitening.gains[:, 0]
    density = -np.log(np.sqrt(2.0 * np.pi) * spread) - 0.5 * innovations**2 / variance
    np.subtract.at(density, jumps, 0.5 * JUMP_PENALTY * problem.log_size)
    edges = _edges(blocks, series.size)
    of_block = np.add.reduceat(density, edges[:-1]) / np.diff(edges)
    return HeldOut(float(np.sqrt(np.mean(residual**2))), float(np.mean(density)), of_block)
