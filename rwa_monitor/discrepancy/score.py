"""The score of a model, by which the search decides: its exact likelihood, with the price of all that is in it.

Twice the negative log-likelihood with coefficients, levels and the noise's law refitted, plus log N for each parameter
and 3 log N for each jump. Candidates are screened by a faster criterion (`base_fit`) whose noise is fixed; what comes
near is scored.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final, Self

import numpy as np

from rwa_monitor.discrepancy.base_fit import (
    JUMP_PENALTY,
    Fit,
    distance_to_crossings,
    remove_levels,
    segment_correlated,
    segment_starts,
)
from rwa_monitor.discrepancy.likelihood import Equations, NoiseLaw, Series, Whitening, fit_noise
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.discrepancy.terms import TINY, Model, Term
from rwa_monitor.samples import BoolArray, FloatArray, IntArray

REVERSAL: Final = 5  # samples from a change of direction: bristles turn over there, and filters smear
SCREENED: Final = 20_000  # means of samples, of which screening uses no more
LEVEL_SAMPLES: Final = 64  # from which a level beside a change of direction is taken
BASE_PARAMETERS: Final = 2  # dry and viscous friction


def scored(problem: Problem, model: Model, start: NoiseLaw | None = None, *, again: bool = False) -> Model:
    """Return a model with its noise's law, its score, and the coefficients that are best under that law.

    Parameters
    ----------
    problem, model
        The data, and a model with the jumps that its fit has.
    start
        A law of the noise to begin with.
    again
        Whether that is the law of nearly the same model: then only near it is looked.
    """
    series = Series.of(problem, model.fit.jumps)
    law = start or (NoiseLaw().apart if series.several else NoiseLaw())
    if problem.has_noise:
        law, _ = fit_noise(series, *regressors(series, model.terms), law, again=again and start is not None)
    return with_law(problem, model, law)


def with_law(problem: Problem, model: Model, law: NoiseLaw, jumps: IntArray | None = None) -> Model:
    """Return a model with the coefficients that are best under a law of the noise, and its score.

    `jumps`: others than those that its fit has, int64 (j,).
    """
    jumps = model.fit.jumps if jumps is None else jumps
    series = Series.of(problem, jumps)
    law = law.beside(series)
    rows, low, high = regressors(series, model.terms)
    coefficients, deviance = Equations.of(series, rows, low, high, law).solve()
    parameters = price(model.terms) + JUMP_PENALTY * jumps.size
    fit = _fit(problem, series, rows, coefficients, law)
    score = deviance + series.log_size * parameters + law.price(series.size)
    return replace(model, fit=fit, law=law, score=score + contradiction(problem, model.terms, coefficients[2:]))


def with_exact_jumps(problem: Problem, model: Model) -> Model:
    """Return a scored model with the jumps that are the best of all beside its coefficients, where the score falls."""
    assert model.law is not None, "the model is scored"
    series, law = Series.of(problem), model.law
    # Along the rotation, the noise of the torque changes its sign where the direction does.
    spread = series.spread(law)
    variance = series.memory * float(np.mean((model.fit.residual / spread) ** 2)) * spread**2
    along, slot = model.fit.level + model.fit.residual, np.cumsum(np.maximum(series.gap, 1))
    apart, jumps = np.flatnonzero(~_reverses(problem)), [np.zeros(0, dtype=np.int64)]
    for a, b in pairwise(problem.starts.tolist()):
        kept = apart[(apart >= a) & (apart < b)]
        if kept.size:
            flips = np.append(1.0, series.sign[kept[1:]] * series.sign[kept[:-1]])
            correlation = flips * law.memory ** np.diff(slot[kept], prepend=slot[kept[0]] - 1)
            fresh = variance[kept] * np.append(1.0, 1.0 - correlation[1:] ** 2)
            price = JUMP_PENALTY * problem.log_size
            jumps.append(kept[segment_correlated(along[kept], correlation, fresh, 0.0, price)])
    exact = _placed(problem, along, np.concatenate(jumps))
    if np.array_equal(exact, model.fit.jumps):
        return model
    return min(model, with_law(problem, model, law, exact), key=lambda one: one.score)


def off_reversals(problem: Problem, along: FloatArray, jumps: IntArray) -> IntArray:
    """Return jumps with one at most in a change of direction; `along` is what a model leaves to the levels [N m].

    What comes and goes there within a few samples is an effect of the reversal, or the smear of a filter.
    """
    after = np.append(np.flatnonzero(~_reverses(problem)), problem.size)
    moved = np.unique(after[np.searchsorted(after, jumps)])
    return _placed(problem, along, moved[moved < problem.size])


def _placed(problem: Problem, along: FloatArray, jumps: IntArray) -> IntArray:
    """Move jumps behind a change of direction to where in it the levels on both sides part best.

    Parameters
    ----------
    problem
        The data.
    along
        float64 (n,), what a model leaves to the levels [N m].
    jumps
        int64 (j,), in no change of direction.
    """
    at = np.arange(problem.size)
    latest = np.maximum.accumulate(np.where(_reverses(problem), -1, at))
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


def _reverses(problem: Problem) -> BoolArray:
    """Return which samples are so near a change of direction that a jump of the level would not show, bool (n,)."""
    return distance_to_crossings(problem, np.arange(problem.size)) < REVERSAL


def price(terms: Sequence[Term]) -> float:
    """Return what the parameters of the base law and of terms cost, in units of log N."""
    return BASE_PARAMETERS + sum(term.parameters for term in terms)


def contradiction(problem: Problem, terms: Sequence[Term], strengths: FloatArray) -> float:
    """Return twice the negative log-likelihood of what other channels show of the wheel file's constants.

    Parameters
    ----------
    problem, terms
        The data and the terms of a model, which gives a constant no error where none of them has it.
    strengths
        float64 (p,), of their columns.
    """
    begins = np.cumsum([0, *(term.columns.shape[1] for term in terms)])
    errors = {term.effect.error_of: float(strengths[at]) for term, at in zip(terms, begins, strict=False)}
    total = 0.0
    for shown in problem.shown:
        strength, std = shown.strength
        total += ((errors.get(shown.quantity, 0.0) - strength) / std) ** 2
    return total


def term_rows(series: Series, term: Term) -> FloatArray:
    """Return the columns of a term in the friction's own sign, float64 (p, n)."""
    return np.asarray(term.columns.T * series.sign)


def regressors(series: Series, terms: Sequence[Term]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the rows of a law and the bounds of their coefficients.

    Dry and viscous friction are not negative, and the viscous part is not larger than all friction is.
    """
    rows = np.vstack([series.base, *(term_rows(series, term) for term in terms)])
    low = np.concatenate([np.zeros(2), *(term.low for term in terms)])
    steepest = float(np.abs(series.friction).max() / max(np.abs(series.speed).max(), TINY))
    high = np.concatenate([[np.inf, steepest], *(term.high for term in terms)])
    return rows, low, high


@dataclass(frozen=True, slots=True)
class Background:
    """What is in a model already, whitened: one term more is scored by its own columns alone, noise and jumps kept.

    Long records are averaged over a few samples: it only screens.

    Attributes
    ----------
    problem, terms
        The data, and what is in the model.
    sign
        float64 (n,), direction of rotation at each sample.
    first
        int64 (m,), first sample of each mean; each of its own where nothing is averaged.
    whitening
        Of the means and the law of their noise.
    white, products
        float64 (1 + p, m), friction and the model's regressors, and (1 + p, 1 + p), their products.
    low, high
        float64 (p,), bounds of the coefficients.
    price
        Of the parameters and jumps so far.
    """

    problem: Problem
    terms: tuple[Term, ...]
    sign: FloatArray
    first: IntArray
    whitening: Whitening
    white: FloatArray
    products: FloatArray
    low: FloatArray
    high: FloatArray
    price: float

    @classmethod
    def of(cls, problem: Problem, terms: Sequence[Term], law: NoiseLaw, jumps: IntArray) -> Self:
        """Whiten what is in a model."""
        whole = Series.of(problem, jumps)
        law = law.beside(whole)
        rows, low, high = regressors(whole, terms)
        series, first = whole.averaged(SCREENED)
        means = law.of_means(-(-whole.size // series.size))
        whitening = Whitening.of(series, means)
        white = whitening.innovations(np.vstack([series.friction, _means(rows, first)]))
        known = whole.log_size * (price(terms) + JUMP_PENALTY * jumps.size) + law.price(whole.size)
        products = white @ white.T
        return cls(problem, tuple(terms), whole.sign, first, whitening, white, products, low, high, known)

    def equations_with(self, *terms: Term) -> Equations:
        """Return the normal equations with terms more."""
        if not terms:
            return self._equations(self.products, self.low, self.high)
        rows = np.vstack([term.columns.T * self.sign for term in terms])
        columns = self.whitening.innovations(_means(rows, self.first))
        across = self.white @ columns.T
        products = np.block([[self.products, across], [across.T, columns @ columns.T]])
        low = np.concatenate([self.low, *(term.low for term in terms)])
        high = np.concatenate([self.high, *(term.high for term in terms)])
        return self._equations(products, low, high)

    def _equations(self, products: FloatArray, low: FloatArray, high: FloatArray) -> Equations:
        filtered = self.whitening
        return Equations.of_products(filtered.series, products, low, high, filtered.log_determinant)

    def criterion_with(self, *terms: Term) -> float:
        """Return the score with terms more."""
        added = sum(term.parameters for term in terms)
        coefficients, deviance = self.equations_with(*terms).solve()
        other = contradiction(self.problem, (*self.terms, *terms), coefficients[2:])
        return deviance + other + self.price + self.problem.log_size * added


def _means(rows: FloatArray, first: IntArray) -> FloatArray:
    """Return the means of rows, float64 (p, n), from each first index to the next, (p, m)."""
    if first.size == rows.shape[1]:
        return rows
    return np.asarray(np.add.reduceat(rows, first, axis=1) / np.diff(first, append=rows.shape[1]))


def _fit(problem: Problem, series: Series, rows: FloatArray, coefficients: FloatArray, law: NoiseLaw) -> Fit:
    """Return a fit with other coefficients; its level is the common dry friction where nothing makes it differ."""
    rest = series.sign * (series.friction - coefficients[1:] @ rows[1:])
    residual = rest - coefficients[0]
    if series.jumps.size or law.level_spread > 0.0:
        residual = remove_levels(rest, segment_starts(problem, series.jumps))
    return Fit(series.jumps, coefficients[1:], rest - residual, residual, float(residual @ residual))
