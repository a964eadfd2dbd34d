"""What an extension gains, measured on data that it was not fitted to.

The record is cut into contiguous blocks; coefficients are fitted on every other block and judged on the rest, then the
other way round. Or other recordings are held out: then the models stand as they are, and nothing is fitted there.
Levels and jumps are nuisances of each block: they are segmented afresh on the held-out data, at the same price in all
models.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from rwa_monitor.discrepancy.base_fit import JUMP_PENALTY, levels, remove_levels, segment, segment_starts, solve_bounded
from rwa_monitor.discrepancy.likelihood import Equations, Series
from rwa_monitor.discrepancy.models import Model, law_of
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.discrepancy.score import regressors
from rwa_monitor.discrepancy.terms import depends_on_level, design_of, make_term
from rwa_monitor.samples import BoolArray, FloatArray, IntArray

BLOCKS: Final = 10  # contiguous blocks per search problem; even ones train for odd ones and back
TRAINABLE_SHARE: Final = 0.01  # of a term's energy that the training blocks must hold
SMOOTHNESS: Final = 1e-3  # of a knot's energy: weight of the differences between neighbouring heights
LEVEL_ROUNDS: Final = 3  # of level and columns that follow it, on recordings where nothing is fitted


@dataclass(frozen=True, slots=True)
class HeldOut:
    """Scores on held-out blocks.

    Attributes
    ----------
    rmse_Nm
        Root mean square residual [N m].
    log_score
        Mean log density per sample, jumps charged [nats]: that of white noise with the long-run variance, the variance
        that the search counts with, in norm and squares alike. Where noise is coloured that density is wider than the
        residual, the same for all models.
    block_log_scores
        float64 (blocks,), the same per block, for intervals of a difference.
    """

    rmse_Nm: float
    log_score: float
    block_log_scores: FloatArray


def held_out(problem: Problem, model: Model, blocks: int = BLOCKS) -> HeldOut:
    """Score a model on held-out blocks; shapes stay as found, all strengths and the slope are fitted anew."""
    edges = np.linspace(0, problem.size, blocks + 1).astype(np.int64)
    block = _block_of(problem, blocks)
    squares, scores, counts = np.zeros(blocks), np.zeros(blocks), np.diff(edges)
    for parity in (0, 1):
        train = block % 2 == parity
        coefficients = trained(problem, model, train)
        for b in range(1 - parity, blocks, 2):
            squares[b], scores[b] = _judge(problem, _design(problem, model), coefficients, edges[b : b + 2])
    return _summary(squares, scores, counts)


def held_out_without_jumps(problem: Problem, model: Model) -> HeldOut:
    """Score a model on blocks that its coefficients were not fitted to; shapes and noise stay as found."""
    series = Series.of(problem)
    rows, low, high = regressors(series, model.terms)
    white, _ = series.whitened(np.vstack([series.friction, rows]), law_of(model))
    spread, _ = series.whitened(np.ones((1, series.size)), replace(law_of(model), white=1.0))
    edges = np.linspace(0, series.size, BLOCKS + 1).astype(np.int64)
    block = np.searchsorted(edges, np.arange(series.size), side="right") - 1
    squares, scores = np.zeros(BLOCKS), np.zeros(BLOCKS)
    for b in range(BLOCKS):
        train = white[:, block != b]
        products = train @ train.T
        coefficients, _ = Equations(products[1:, 1:], products[1:, 0], products[0, 0], low, high, 1, 0.0).solve()
        left = train[0] - coefficients @ train[1:]
        variance = float(left @ left) / left.size
        here = block == b
        innovations = white[0, here] - coefficients @ white[1:, here]
        squares[b] = np.sum((series.friction[here] - coefficients @ rows[:, here]) ** 2)
        log_spread = np.log(np.abs(spread[0, here]))
        scores[b] = np.sum(log_spread - 0.5 * np.log(2 * np.pi * variance) - 0.5 * innovations**2 / variance)
    counts = np.diff(edges)
    return HeldOut(float(np.sqrt(squares.sum() / series.size)), float(scores.sum() / series.size), scores / counts)


def on_other_recordings(problem: Problem, other: Problem, model: Model) -> HeldOut:
    """Score a model on recordings that it was not found on: slope, strengths, shapes and noise as fitted on `problem`.

    Columns that follow the dry level follow the level that the other recordings show with that model.
    """
    other = replace(other, noise=problem.noise)
    coefficients = model.fit.coefficients
    level = levels(other, other.z - coefficients[0] * other.speed)
    terms = model.terms
    for _ in range(LEVEL_ROUNDS):
        terms = tuple(make_term(other, term.effect, term.shape, level) for term in model.terms)
        if not any(depends_on_level(term.effect) for term in terms):
            break
        level = levels(other, other.z - design_of(other, terms) @ coefficients)
    design = design_of(other, terms)
    edges = np.linspace(0, other.size, BLOCKS + 1).astype(np.int64)
    judged = [_judge(other, design, coefficients, edges[b : b + 2]) for b in range(BLOCKS)]
    squares, scores = (np.array(values) for values in zip(*judged, strict=True))
    return _summary(squares, scores, np.diff(edges))


def _summary(squares: FloatArray, scores: FloatArray, counts: IntArray) -> HeldOut:
    size = float(counts.sum())
    return HeldOut(float(np.sqrt(squares.sum() / size)), float(scores.sum() / size), scores / np.maximum(counts, 1))


def _block_of(problem: Problem, blocks: int) -> IntArray:
    """Return the block of each joined sample, int64 (n,)."""
    edges = np.linspace(0, problem.size, blocks + 1).astype(np.int64)
    return np.searchsorted(edges, np.arange(problem.size), side="right") - 1


def _design(problem: Problem, model: Model) -> FloatArray:
    return design_of(problem, model.terms)


def trained(problem: Problem, model: Model, train: BoolArray) -> FloatArray:
    """Fit the coefficients on the training samples, within the model's segments."""
    label = np.searchsorted(segment_starts(problem, model.fit.jumps), np.flatnonzero(train), side="right")
    first = np.flatnonzero(np.diff(label, prepend=-1))
    design = remove_levels(_design(problem, model)[train], first)
    z = remove_levels(problem.z[train], first)
    low = np.concatenate([[-np.inf], *(term.low for term in model.terms)])
    high = np.concatenate([[np.inf], *(term.high for term in model.terms)])
    # A term that the training blocks hardly show is not trained: it predicts nothing, rather than anything.
    everywhere = remove_levels(_design(problem, model), segment_starts(problem, model.fit.jumps))
    shown = np.sum(design**2, axis=0) >= TRAINABLE_SHARE * np.sum(everywhere**2, axis=0)
    shown[0] = True
    gram, at = design.T @ design, 1
    for term in model.terms:
        end = at + term.columns.shape[1]
        if term.smooth:
            shown[at:end] = True
            gram[at:end, at:end] += _of_differences(end - at) * SMOOTHNESS * np.trace(gram[at:end, at:end]) / (end - at)
        at = end
    coefficients = np.zeros(shown.size)
    coefficients[shown] = solve_bounded(
        problem, gram[np.ix_(shown, shown)], design[:, shown].T @ z, low[shown], high[shown]
    )
    return coefficients


def _of_differences(count: int) -> FloatArray:
    """Return the Gram matrix of the differences between neighbours, float64 (count, count)."""
    difference = np.diff(np.eye(count), axis=0)
    return np.asarray(difference.T @ difference)


def _judge(problem: Problem, design: FloatArray, coefficients: FloatArray, edges: IntArray) -> tuple[float, float]:
    """Return the squared residual and the log-likelihood of the block between two edges, levels segmented afresh."""
    begin, end = int(edges[0]), int(edges[1])
    variance = problem.noise.long_run_variance
    price = JUMP_PENALTY * problem.log_size
    cuts = [begin, *[int(s) for s in problem.starts if begin < s < end], end]
    total, jumps = 0.0, 0
    rest = problem.z[begin:end] - design[begin:end] @ coefficients
    for a, b in itertools.pairwise(cuts):
        piece = rest[a - begin : b - begin]
        found = segment(piece, price * variance)
        for first, last in zip([0, *found], [*found, piece.size], strict=True):
            total += float(np.sum((piece[first:last] - piece[first:last].mean()) ** 2))
        jumps += found.size
    density = 0.5 * np.log(2 * np.pi * variance)
    return total, -(end - begin) * density - 0.5 * (total / variance + price * jumps)
