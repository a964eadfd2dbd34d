"""Models without jumps: the exact likelihood screens, too, its noise refitted under every candidate that comes near.

Friction of real machines is often smooth: a law of the speed, and noise that remembers. There the noise must not be
taken from what the base law leaves, and slow noise must not be cut into jumps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np

from rwa_monitor.discrepancy.base_fit import Fit
from rwa_monitor.discrepancy.gain import BLOCKS, HeldOut
from rwa_monitor.discrepancy.likelihood import Equations, NoiseLaw, Series, fit_noise
from rwa_monitor.discrepancy.models import Model
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.discrepancy.score import price, regressors, scored, term_rows
from rwa_monitor.discrepancy.search import Effects, Progress
from rwa_monitor.discrepancy.shape_profile import profile
from rwa_monitor.discrepancy.terms import Term
from rwa_monitor.discrepancy.testable import sort_out, speed_curve
from rwa_monitor.physics.effects.base import MeanEffect
from rwa_monitor.samples import FloatArray, IntArray

NO_JUMPS: Final[IntArray] = np.zeros(0, dtype=np.int64)
REFITTED: Final = 4  # candidates whose noise is refitted in a round, those that screening puts first
ROUNDS: Final = 3  # of noise and shapes in turn
SETTLED: Final = 0.5  # of the score


class Smooth:
    """Makes models without jumps, see `search.Approach`."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.series = Series.of(problem)

    def base(self) -> Model:
        """Return the model with dry and viscous friction alone."""
        return self._fitted((), NoiseLaw())

    def sort_out(self, effects: Effects, base: Model) -> tuple[list[type[MeanEffect]], list[tuple[str, str]]]:
        """Split effects by what the motion can show beside one level of all recordings."""
        return sort_out(self.problem, self.series.base, effects, base.fit.level)

    def settled(self, model: Model) -> Model:
        """Return the model as it is."""
        return model

    def extensions(self, current: Model, effects: Effects, progress: Progress) -> list[Model]:
        """Return the model with one effect more, or with levels of the recordings that differ, best first."""
        del progress
        models = self._extended(current, effects)
        if self.series.several and _law(current).level_spread == 0.0:  # a hypothesis like any other
            models.append(self._fitted(current.terms, _law(current).apart))
        return sorted(models, key=lambda model: model.score)

    def replacements(self, model: Model, index: int, effects: Effects, progress: Progress) -> list[Model]:
        """Return the model with another effect in the place of term `index`, of those that come near, best first."""
        progress(f"in the place of {model.names[index]}")
        simpler = self.without(model, index)
        allowed = [effect for effect in effects if effect.name not in model.names]
        most = 0.5 * (model.score + simpler.score)
        return sorted(self._extended(replace(simpler, law=model.law), allowed, most), key=lambda one: one.score)

    def without(self, model: Model, index: int) -> Model:
        """Return the model without term `index`, refitted."""
        return self._fitted(model.terms[:index] + model.terms[index + 1 :], _law(model))

    def refitted(self, terms: Sequence[Term], near: Model, jumps: Sequence[IntArray] = ()) -> Model:
        """Return a model with other terms than one that is near to it."""
        del jumps
        return self._fitted(tuple(terms), _law(near))

    def plainer(self, model: Model) -> Model | None:
        """Return the model with one level of all recordings; None where there is one already."""
        law = _law(model)
        return self._fitted(model.terms, replace(law, level_spread=0.0)) if law.level_spread > 0.0 else None

    def as_good(self, model: Model, index: int, effects: Effects) -> list[str]:
        """Return nothing: what comes near is among the replacements."""
        del model, index, effects
        return []

    def _fitted(self, terms: tuple[Term, ...], law: NoiseLaw) -> Model:
        """Fit coefficients, noise and shapes in turn."""
        best: Model | None = None
        for _ in range(ROUNDS):
            model = _scored(self.problem, terms, law)
            before = np.inf if best is None else best.score
            if best is None or model.score < best.score:
                best = model
            if before - model.score < SETTLED or not any(term.shape or _follows_level(term) for term in terms):
                break
            law = _law(model)
            for index, term in enumerate(terms):
                background = self._background(terms[:index] + terms[index + 1 :], law)
                better, _ = profile(term.effect, [background], model.fit.level, around=term)
                terms = (*terms[:index], better, *terms[index + 1 :])
        assert best is not None
        return best

    def _extended(self, current: Model, effects: Effects, most: float = np.inf) -> list[Model]:
        """Return the model with each of the most promising effects added; none that is screened above `most`."""
        law, missing = _law(current), [effect for effect in effects if effect.name not in current.names]
        tried: dict[str, Term] = {}
        laws = law, replace(law, white=1.0, correlation=0.0)  # slow noise hides what it could be
        for other in dict.fromkeys(laws):
            background = self._background(current.terms, other)
            screened = partial(_screened, background, current.fit.level)
            ranked = sorted(self.problem.each(screened, missing), key=lambda one: one[1])[:REFITTED]
            tried |= {term.effect.name: term for term, score in ranked if score < most or other != law}
        return [self._fitted((*current.terms, term), law) for term in tried.values()]

    def _background(self, terms: Sequence[Term], law: NoiseLaw) -> _Background:
        rows, low, high = regressors(self.series, terms)
        white, log_determinant = self.series.whitened(np.vstack([self.series.friction, rows]), law)
        known = self.series.log_size * price(terms) + law.price(self.series.size)
        return _Background(self.problem, self.series, law, white, low, high, log_determinant, known)


@dataclass(frozen=True, slots=True)
class _Background:
    """What is in the model already, whitened: one term more is scored by its own columns alone."""

    problem: Problem
    series: Series
    law: NoiseLaw
    white: FloatArray  # friction and the model's regressors
    low: FloatArray
    high: FloatArray
    log_determinant: float
    price: float  # of the parameters so far

    def criterion_with(self, term: Term, squares: FloatArray | None = None) -> float:
        """Return the score with a term more, the noise kept."""
        del squares
        columns, _ = self.series.whitened(term_rows(self.series, term), self.law)
        rows = np.vstack([self.white, columns])
        low, high = np.concatenate([self.low, term.low]), np.concatenate([self.high, term.high])
        equations = Equations.from_whitened(self.series, rows, low, high, self.log_determinant)
        return equations.solve()[1] + self.price + self.series.log_size * term.parameters


def _screened(background: _Background, level: FloatArray, effect: type[MeanEffect]) -> tuple[Term, float]:
    return profile(effect, [background], level)


def _law(model: Model) -> NoiseLaw:
    assert model.law is not None, "models without jumps are scored"
    return model.law


def _scored(problem: Problem, terms: tuple[Term, ...], law: NoiseLaw) -> Model:
    nothing = np.zeros(problem.size)
    return scored(problem, Model(terms, Fit(NO_JUMPS, np.zeros(0), nothing, nothing, 0.0, np.inf)), law)


def _follows_level(term: Term) -> bool:
    return term.effect.uses_level or bool(term.effect.needs)


# ---- as good as any law of the speed ---------------------------------------------------------------------------------


def least_score(problem: Problem, law: NoiseLaw) -> float:
    """Return a score below which no law of the speed without jumps comes: that of a free curve which costs nothing."""
    series = Series.of(problem)
    rows, low, high = regressors(series, ())
    curve = speed_curve(series)
    free = np.full(curve.shape[0], np.inf)
    rows, low, high = np.vstack([rows, curve]), np.append(low, -free), np.append(high, free)
    return fit_noise(series, rows, low, high, law.apart if series.several else law)[1] + series.log_size * price(())


def held_out(problem: Problem, model: Model) -> HeldOut:
    """Score a model on blocks that its coefficients were not fitted to; shapes and noise stay as found."""
    series = Series.of(problem)
    rows, low, high = regressors(series, model.terms)
    white, _ = series.whitened(np.vstack([series.friction, rows]), _law(model))
    spread, _ = series.whitened(np.ones((1, series.size)), replace(_law(model), white=1.0))
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
