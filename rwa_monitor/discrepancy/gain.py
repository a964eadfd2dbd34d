"""What an extension gains, measured on data that it was not fitted to, by the likelihood that the search counts with.

Blocks of time are left out in turn, and the coefficients fitted to the others; or other recordings are held out: then
the models stand as they are, and nothing is fitted there. Shapes and the noise's law stay as found. Levels and jumps
are nuisances of each recording: their price is charged where they lie.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from rwa_monitor.discrepancy.base_fit import (
    JUMP_PENALTY,
    jump_price,
    levels,
    remove_levels,
    segment_records,
    segment_starts,
)
from rwa_monitor.discrepancy.likelihood import Equations, Series, Whitening
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.discrepancy.score import regressors
from rwa_monitor.discrepancy.terms import Model, depends_on_level, law_of, make_term
from rwa_monitor.samples import FloatArray, IntArray

BLOCKS: Final = 10  # contiguous blocks of a search problem
TRAINABLE_SHARE: Final = 0.01  # of a regressor's energy that the training blocks must hold
LEVEL_ROUNDS: Final = 3  # of level and columns that follow it, on recordings where nothing is fitted


@dataclass(frozen=True, slots=True)
class HeldOut:
    """Scores on held-out data.

    Attributes
    ----------
    rmse_Nm
        Root mean square residual [N m].
    log_score
        Mean log density per sample given those before it, jumps charged [nats].
    block_log_scores
        float64 (blocks,), the same per block, for intervals of a difference.
    """

    rmse_Nm: float
    log_score: float
    block_log_scores: FloatArray


def held_out(problem: Problem, model: Model, blocks: int = BLOCKS) -> HeldOut:
    """Score a model on blocks of time that its strengths and slope were not fitted to."""
    series = Series.of(problem, model.fit.jumps)
    rows, low, high = regressors(series, model.terms)
    white, _ = series.whitened(np.vstack([series.friction, rows]), law_of(model))
    energy, jumps = np.sum(white**2, axis=1), model.fit.jumps if model.fit.jumps.size else None
    whitening = _whitening(problem, model, jumps)
    block = np.searchsorted(_first_of(blocks, series.size), np.arange(series.size), side="right") - 1
    residual, innovations, variance = np.zeros((3, series.size))
    for b in range(blocks):
        here, train = block == b, white[:, block != b]
        # A regressor that the training blocks hardly show is not trained: it predicts nothing, rather than anything.
        shown = np.sum(train**2, axis=1) >= TRAINABLE_SHARE * energy
        products = (train @ train.T) * np.outer(shown, shown)
        equations = replace(Equations.of_products(series, products, low, high, 0.0), samples=train.shape[1])
        coefficients, _ = equations.solve()
        variance[here] = equations.rss(coefficients) / train.shape[1]
        rest = _residual(problem, coefficients @ rows, jumps)
        residual[here] = rest[here]
        innovations[here] = whitening.innovations((rest * problem.sign)[None])[0, here]
    return _scored(problem, whitening, residual, innovations, jumps, variance, blocks)


def on_other_recordings(problem: Problem, other: Problem, model: Model, *, jumps: bool) -> HeldOut:
    """Score a model on recordings that it was not found on: slope, strengths, shapes and noise as fitted on `problem`.

    Columns that follow the dry level follow the level that the other recordings show with that model. `jumps`: whether
    friction may jump, so that its levels are their own there; else they are that of the searched ones.
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
    searched = Series.of(problem, model.fit.jumps)
    left, _ = searched.whitened(model.fit.residual * problem.sign, law_of(model))
    residual = _residual(other, other.sign * (drag + float(np.mean(model.fit.level))), there)
    whitening, variance = _whitening(other, model, there), np.full(other.size, float(np.mean(left**2)))
    innovations = whitening.innovations((residual * other.sign)[None])[0]
    return _scored(other, whitening, residual, innovations, there, variance, BLOCKS)


def _first_of(blocks: int, size: int) -> IntArray:
    """Return the first sample of each of so many blocks, int64 (blocks,)."""
    return np.linspace(0, size, blocks + 1).astype(np.int64)[:-1]


def _residual(problem: Problem, torque_Nm: FloatArray, jumps: IntArray | None) -> FloatArray:
    """Return what a torque leaves of the friction, float64 (n,), less the levels between the jumps, if any [N m]."""
    rest = problem.z - problem.sign * torque_Nm
    return remove_levels(rest, segment_starts(problem, jumps)) if jumps is not None else rest


def _whitening(problem: Problem, model: Model, jumps: IntArray | None) -> Whitening:
    """Return the filter of a model's noise; levels between jumps are not drawn from it."""
    law = law_of(model)
    return Whitening.of(Series.of(problem), law if jumps is None else replace(law, level_spread=0.0))


def _scored(
    problem: Problem,
    whitening: Whitening,
    residual: FloatArray,
    innovations: FloatArray,
    jumps: IntArray | None,
    variance: FloatArray,
    blocks: int,
) -> HeldOut:
    """Return the scores of a residual beside jumps [N m], under a noise of a given variance, float64 (n,).

    `innovations` are what of it the samples before do not show, float64 (n,) [N m].
    """
    series = Series.of(problem)
    variance = np.maximum(variance, series.smallest_variance)
    spread = np.sqrt(variance) * (1.0 if whitening.spread is None else whitening.spread) / whitening.gains[:, 0]
    density = -np.log(np.sqrt(2.0 * np.pi) * spread) - 0.5 * innovations**2 / variance
    if jumps is not None:
        density[jumps] -= 0.5 * JUMP_PENALTY * problem.log_size
    first = _first_of(blocks, series.size)
    of_block = np.add.reduceat(density, first) / np.diff(first, append=series.size)
    return HeldOut(float(np.sqrt(np.mean(residual**2))), float(np.mean(density)), of_block)
