"""The score of a model, by which the search decides: its exact likelihood, with the price of all that is in it.

Twice the negative log-likelihood with coefficients, levels and the noise's law refitted, plus log N for each parameter
and 3 log N for each jump. Candidates are screened by a faster criterion (`base_fit`) whose noise is fixed; what comes
near is scored.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from rwa_monitor.discrepancy.base_fit import JUMP_PENALTY, Fit, remove_levels, segment_starts
from rwa_monitor.discrepancy.likelihood import Equations, NoiseLaw, Series, fit_noise
from rwa_monitor.discrepancy.models import Model
from rwa_monitor.discrepancy.problem import Problem
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
    coefficients, deviance = Equations.of(series, rows, low, high, law).solve()
    score = deviance + series.log_size * law.parameters
    score += series.log_size * (price(model.terms) + JUMP_PENALTY * model.fit.jumps.size)
    return replace(model, fit=_fit(problem, series, rows, coefficients, law, model.fit), law=law, score=score)


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
