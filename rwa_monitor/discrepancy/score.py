"""The score of a model, by which the search decides: its exact likelihood, with the price of all that is in it.

Twice the negative log-likelihood with coefficients, levels and the noise's law refitted, plus log N for each parameter
and 3 log N for each jump. Candidates are screened by a faster criterion (`base_fit`) whose noise is fixed; what comes
near is scored.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Final

import numpy as np

from rwa_monitor.discrepancy.base_fit import JUMP_PENALTY, Fit, remove_levels, segment_starts
from rwa_monitor.discrepancy.likelihood import Equations, NoiseLaw, Series, fit_noise
from rwa_monitor.discrepancy.models import Model
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.discrepancy.segmentation import segment_correlated
from rwa_monitor.discrepancy.terms import Term
from rwa_monitor.samples import FloatArray

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
    series = Series.of(problem).with_jumps(model.fit.jumps)
    rows, low, high = regressors(series, model.terms)
    law = start or (NoiseLaw().apart if series.several else NoiseLaw())
    if problem.has_noise:
        law, _ = fit_noise(series, rows, low, high, law, again=again and start is not None)
    return _with_law(problem, series, model, law)


def with_exact_jumps(problem: Problem, model: Model) -> Model:
    """Return a scored model with the jumps that are the best of all beside its coefficients, where the score falls."""
    assert model.law is not None, "the model is scored"
    series, law = Series.of(problem), model.law
    flips = np.append(1.0, series.sign[1:] * series.sign[:-1])  # the noise is the torque's: along the rotation it flips
    correlation = law.memory ** np.maximum(series.gap, 1) * flips
    spread = series.spread(law)
    variance = float(np.mean((model.fit.residual / spread) ** 2)) * (1.0 - correlation**2)
    variance = np.where(series.gap == 0, variance / (1.0 - correlation**2), variance) * spread**2
    along, jumps = model.fit.level + model.fit.residual, []
    for a, b in pairwise(problem.starts.tolist()):
        if b > a:
            found = segment_correlated(
                along[a:b], correlation[a:b], variance[a:b], 0.0, JUMP_PENALTY * problem.log_size
            )
            jumps.append(found + a)
    exact = np.concatenate(jumps)
    if np.array_equal(exact, model.fit.jumps):
        return model
    other = replace(model, fit=replace(model.fit, jumps=exact))
    return min(model, _with_law(problem, series.with_jumps(exact), other, law), key=lambda one: one.score)


def _with_law(problem: Problem, series: Series, model: Model, law: NoiseLaw) -> Model:
    """Return a model with the coefficients that are best under a law of the noise, and its score."""
    rows, low, high = regressors(series, model.terms)
    coefficients, deviance = Equations.of(series, rows, low, high, law).solve()
    parameters = price(model.terms) + law.parameters + JUMP_PENALTY * model.fit.jumps.size
    fit = _fit(problem, series, rows, coefficients, law, model.fit)
    return replace(model, fit=fit, law=law, score=deviance + series.log_size * parameters)


def price(terms: Sequence[Term]) -> float:
    """Return what the parameters of the base law and of terms cost, in units of log N."""
    return BASE_PARAMETERS + sum(term.parameters for term in terms)


def term_rows(series: Series, term: Term) -> FloatArray:
    """Return the columns of a term in the friction's own sign, float64 (p, n)."""
    return np.asarray(term.columns.T * series.sign)


def regressors(series: Series, terms: Sequence[Term]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the rows of a law and the bounds of their coefficients: dry and viscous friction are not negative."""
    rows = np.vstack([series.base, *(term_rows(series, term) for term in terms)])
    low = np.concatenate([np.zeros(2), *(term.low for term in terms)])
    high = np.concatenate([np.full(2, np.inf), *(term.high for term in terms)])
    return rows, low, high


def _fit(problem: Problem, series: Series, rows: FloatArray, coefficients: FloatArray, law: NoiseLaw, fit: Fit) -> Fit:
    """Return a fit with other coefficients; its level is the common dry friction where nothing makes it differ."""
    rest = series.sign * (series.friction - coefficients[1:] @ rows[1:])
    residual = rest - coefficients[0]
    if fit.jumps.size or law.level_spread > 0.0:
        residual = remove_levels(rest, segment_starts(problem, fit.jumps))
    return Fit(fit.jumps, coefficients[1:], rest - residual, residual, float(residual @ residual), fit.criterion)
