"""The search where friction does not jump: one exact likelihood, its noise refitted under every candidate.

Friction of real machines is often smooth: a law of the speed, and noise that remembers. There the noise must not be
taken from what the base law leaves, and slow noise must not be cut into jumps. Both answers, with jumps and without,
are scored by the same likelihood, and the better one counts (`find_where_likelier`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.signal import savgol_filter

from rwa_monitor.discrepancy.base_fit import JUMP_PENALTY, Fit
from rwa_monitor.discrepancy.gain import BLOCKS, HeldOut
from rwa_monitor.discrepancy.likelihood import Equations, NoiseLaw, Series, fit_noise
from rwa_monitor.discrepancy.models import Found, Model, SearchResult
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.discrepancy.result import Unexplained
from rwa_monitor.discrepancy.search import ACCEPT_GAIN, EQUIVALENT_WITHIN, MAX_EFFECTS, Progress, middle_shape
from rwa_monitor.discrepancy.shape_profile import profile
from rwa_monitor.discrepancy.terms import Term, available, make_term
from rwa_monitor.physics.effects.base import Channels, MeanEffect
from rwa_monitor.physics.effects.catalogue import MEAN_EFFECTS
from rwa_monitor.samples import FloatArray, IntArray

NO_JUMPS: Final[IntArray] = np.zeros(0, dtype=np.int64)
# Fewer samples than this from jump to jump, on average, are no level that could be seen: the steps stand for noise.
SHORTEST_SEGMENTS: Final = 50
REFITTED: Final = 4  # candidates whose noise is refitted in a round, those that screening puts first
ROUNDS: Final = 3  # of noise and shapes in turn
SETTLED: Final = 0.5  # of the score
KNOTS: Final = 12  # of a free curve over the speed, at quantiles of the speeds
SPANNED: Final = 0.02  # of a column's energy beyond the base law: so little is left of what a curve of the speed spans
LEAST_BEYOND: Final = 1e-5  # of its energy: what is left of a column by the noise of the speed, and by smoothing
SLOW_WINDOWS: Final = 50  # in a record: a motion smoothed over one of them has lost its noise
CURVE_SIGNATURE: Final = "a drag that depends on the speed in a way of its own"
FOLLOWS_THE_SPEED: Final = "a motion in which it does not follow the speed: several sweeps, or dwells"


@dataclass(frozen=True, slots=True)
class SmoothModel:
    """A law without jumps, its noise, and the score, see `likelihood`; lower is better."""

    terms: tuple[Term, ...]
    law: NoiseLaw
    coefficients: FloatArray
    score: float

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects."""
        return tuple(term.effect.name for term in self.terms)


@dataclass(frozen=True, slots=True)
class Smooth:
    """What the search without jumps found.

    Attributes
    ----------
    found
        As the other search's; the criterion of its models is the score.
    models
        The same models with their noise.
    unexplained
        What a free curve over the speed explains beyond the last model, or None.
    """

    found: SearchResult
    models: tuple[SmoothModel, ...]
    unexplained: Unexplained | None


@dataclass(frozen=True, slots=True)
class Background:
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
        """Return the score with a term more, the noise kept; as `terms.Background` does."""
        del squares
        columns, _ = self.series.whitened(_rows(self.series, term), self.law)
        rows = np.vstack([self.white, columns])
        products = rows @ rows.T
        low, high = np.concatenate([self.low, term.low]), np.concatenate([self.high, term.high])
        equations = Equations(
            products[1:, 1:], products[1:, 0], products[0, 0], low, high, self.series.size, self.log_determinant
        )
        return equations.solve()[1] + self.price + self.series.log_size * term.parameters


def find_smooth(problem: Problem, effects: Sequence[type[MeanEffect]], progress: Progress = lambda _: None) -> Smooth:
    """Search for mean effects without jumps: forward, backward, and what could stand in each one's place."""
    progress("laws without jumps")
    series = Series.of(problem)
    base = _settled(problem, series, (), NoiseLaw())
    testable, untestable = _sort_out(problem, series, effects, base)
    ladder = [base]
    while len(ladder[-1].terms) < MAX_EFFECTS:
        current = ladder[-1]
        candidates = _extensions(problem, series, current, testable)
        if series.several and current.law.level_spread == 0.0:  # levels that differ are a hypothesis like any other
            candidates.append(_settled(problem, series, current.terms, current.law.apart))
        best = min(candidates, key=lambda one: one.score, default=current)
        if current.score - best.score < ACCEPT_GAIN:
            break
        ladder.append(_pruned(problem, series, best))
        if ladder[-1].score >= current.score:
            break
    final = _pruned(problem, series, min(ladder, key=lambda one: one.score), last=True)
    ladder = [*(one for one in ladder if len(one.terms) < len(final.terms)), final]
    found = tuple(_found(problem, series, final, index, testable) for index in range(len(final.terms)))
    models = tuple(_as_model(problem, series, one) for one in ladder)
    ranked = tuple(sorted(found, key=lambda entry: -entry.gain))
    result = SearchResult(models, ranked, tuple(untestable), -np.inf, "")
    return Smooth(result, tuple(ladder), _left(series, final))


def find_where_likelier(
    problem: Problem,
    jumping: Model,
    effects: Sequence[type[MeanEffect]],
    progress: Progress = lambda _: None,
) -> Smooth | None:
    """Search without jumps; None where a model with jumps is more likely, its noise refitted too.

    A free curve over the speed is as good as any law of it: where even that is less likely, nothing is searched.
    """
    if not problem.has_noise:
        return None
    series = Series.of(problem)
    law, score = _with_jumps(problem, series, jumping)
    if _with_curve(series, (), law.apart if series.several else law)[2] > score:
        return None
    smooth = find_smooth(problem, [effect for effect in effects if effect.name in MEAN_EFFECTS], progress)
    return smooth if smooth.models[-1].score < score else None


def _with_jumps(problem: Problem, series: Series, model: Model) -> tuple[NoiseLaw, float]:
    """Return noise and score of a model with jumps; infinite where they come too fast to be levels."""
    jumps = model.fit.jumps
    if jumps.size * SHORTEST_SEGMENTS > problem.size:
        return NoiseLaw(), np.inf
    rows, low, high = _regressors(series, model.terms)
    ends = np.append(problem.starts[1:-1], problem.size)
    end = ends[np.searchsorted(problem.starts[1:-1], jumps, side="right")]
    at = np.arange(problem.size)
    steps = ((at >= jumps[:, None]) & (at < end[:, None])) * series.sign
    free = np.full(jumps.size, np.inf)
    rows, low, high = np.vstack([rows, steps]), np.append(low, -free), np.append(high, free)
    law, score = fit_noise(series, rows, low, high, NoiseLaw().apart if series.several else NoiseLaw())
    price = _price(model.terms, law) - law.parameters + JUMP_PENALTY * jumps.size
    return law, score + series.log_size * price


def held_out(problem: Problem, model: SmoothModel) -> HeldOut:
    """Score a model on blocks that its coefficients were not fitted to; shapes and noise stay as found."""
    series = Series.of(problem)
    rows, low, high = _regressors(series, model.terms)
    white, _ = series.whitened(np.vstack([series.friction, rows]), model.law)
    spread, _ = series.whitened(np.ones((1, series.size)), replace(model.law, white=1.0))
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


def _rows(series: Series, term: Term) -> FloatArray:
    """Return the columns of a term in the friction's own sign, float64 (p, n)."""
    return np.asarray(term.columns.T * series.sign)


def _regressors(series: Series, terms: Sequence[Term]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the rows of a law and the bounds of their coefficients: dry and viscous friction are not negative."""
    rows = np.vstack([series.base, *(_rows(series, term) for term in terms)])
    low = np.concatenate([np.zeros(2), *(term.low for term in terms)])
    high = np.concatenate([np.full(2, np.inf), *(term.high for term in terms)])
    return rows, low, high


def _price(terms: Sequence[Term], law: NoiseLaw) -> float:
    return 2 + sum(term.parameters for term in terms) + law.parameters


def _background(problem: Problem, series: Series, terms: Sequence[Term], law: NoiseLaw) -> Background:
    rows, low, high = _regressors(series, terms)
    white, log_determinant = series.whitened(np.vstack([series.friction, rows]), law)
    price = series.log_size * _price(terms, law)
    return Background(problem, series, law, white, low, high, log_determinant, price)


def _settled(problem: Problem, series: Series, terms: tuple[Term, ...], law: NoiseLaw) -> SmoothModel:
    """Fit coefficients, noise and shapes in turn."""
    best: SmoothModel | None = None
    for _ in range(ROUNDS):
        rows, low, high = _regressors(series, terms)
        law, score = fit_noise(series, rows, low, high, law)
        coefficients, _ = Equations.of(series, rows, low, high, law).solve()
        score += series.log_size * (_price(terms, law) - law.parameters)
        before = np.inf if best is None else best.score
        if best is None or score < best.score:
            best = SmoothModel(terms, law, coefficients, score)
        if before - score < SETTLED or not any(term.shape or _follows_level(term) for term in terms):
            break
        level = np.full(series.size, coefficients[0])
        for index, term in enumerate(terms):
            others = terms[:index] + terms[index + 1 :]
            background = _background(problem, series, others, law)
            better, _ = profile(term.effect, [background], level, around=term)  # type: ignore[list-item]
            terms = (*terms[:index], better, *terms[index + 1 :])
    assert best is not None
    return best


def _follows_level(term: Term) -> bool:
    return term.effect.uses_level or bool(term.effect.needs)


def _extensions(
    problem: Problem,
    series: Series,
    current: SmoothModel,
    effects: Sequence[type[MeanEffect]],
    most: float = np.inf,
) -> list[SmoothModel]:
    """Return the model with each of the most promising effects added; none that is screened above `most`."""
    level = np.full(series.size, current.coefficients[0])
    missing = [effect for effect in effects if effect.name not in current.names]
    tried: dict[str, Term] = {}
    laws = current.law, replace(current.law, white=1.0, correlation=0.0)  # slow noise hides what it could be
    for law in dict.fromkeys(laws):
        background = _background(problem, series, current.terms, law)

        def screened(effect: type[MeanEffect], background: Background = background) -> tuple[Term, float]:
            return profile(effect, [background], level)  # type: ignore[list-item]

        ranked = sorted(problem.each(screened, missing), key=lambda one: one[1])[:REFITTED]
        tried |= {term.effect.name: term for term, score in ranked if score < most or law != current.law}
    return [_settled(problem, series, (*current.terms, term), current.law) for term in tried.values()]


def _pruned(problem: Problem, series: Series, model: SmoothModel, *, last: bool = False) -> SmoothModel:
    """Leave out effects that later ones have made superfluous; the last one only where that is asked for."""
    for index in range(len(model.terms) - (not last)):
        others = model.terms[:index] + model.terms[index + 1 :]
        simpler = _settled(problem, series, others, model.law)
        if simpler.score - model.score < ACCEPT_GAIN:
            return _pruned(problem, series, simpler, last=last)
    if last and model.law.level_spread > 0.0:
        simpler = _settled(problem, series, model.terms, replace(model.law, level_spread=0.0))
        if simpler.score - model.score < ACCEPT_GAIN:
            return _pruned(problem, series, simpler, last=last)
    return model


def _found(
    problem: Problem, series: Series, model: SmoothModel, index: int, effects: Sequence[type[MeanEffect]]
) -> Found:
    """Return an effect's gain, and the others that are as good in its place."""
    others = model.terms[:index] + model.terms[index + 1 :]
    simpler = _settled(problem, series, others, model.law)
    gain = simpler.score - model.score
    allowed = [effect for effect in effects if effect.name not in model.names]
    rivals = _extensions(problem, series, replace(simpler, law=model.law), allowed, model.score + 0.5 * gain)
    equivalent = tuple(one.names[-1] for one in rivals if one.score - model.score < EQUIVALENT_WITHIN)
    return Found(model.terms[index].effect.name, gain, equivalent)


def _as_model(problem: Problem, series: Series, model: SmoothModel) -> Model:
    """Return a model as the other search has it: its level is the dry friction throughout."""
    rows, _, _ = _regressors(series, model.terms)
    residual = series.sign * (series.friction - model.coefficients @ rows)
    rss = float(residual @ residual)
    level = np.full(problem.size, model.coefficients[0])
    fit = Fit(NO_JUMPS, model.coefficients[1:], level, residual, rss, model.score)
    return Model(model.terms, fit, model.law)


# ---- what the motion can show ----------------------------------------------------------------------------------------


def _sort_out(
    problem: Problem, series: Series, effects: Sequence[type[MeanEffect]], base: SmoothModel
) -> tuple[list[type[MeanEffect]], list[tuple[str, str]]]:
    """Split the effects into those that the records can test and those they cannot, with what is missing.

    By the columns themselves: what the base law spans is not testable, nor what is no law of the speed but follows the
    speed in this motion, as time, acceleration and every lag do while a wheel runs down.
    """
    level = np.full(series.size, base.coefficients[0])
    curve = _speed_curve(series)
    calm = replace(problem, records=tuple(replace(r, channels=_calm(r.channels)) for r in problem.records))
    calm = calm.with_empty_caches()

    def missing(effect: type[MeanEffect]) -> str | None:
        channel = available(problem, effect)
        if channel is not None:
            return channel
        shape = middle_shape(problem, effect)
        rows = _rows(series, make_term(problem, effect, shape, level))
        energy = _beyond(rows, series.base)
        if energy <= 1e-9 * float(np.sum(rows**2)):
            return effect.separate_by
        if _is_law_of_speed(problem, effect, shape):
            return None
        slow = _rows(series, make_term(calm, effect, shape, level))
        beyond, least = _beyond(slow, series.base), LEAST_BEYOND * float(np.sum(slow**2))
        return FOLLOWS_THE_SPEED if _beyond(slow, curve) < max(SPANNED * beyond, least) else None

    reasons = [(effect, missing(effect)) for effect in effects]
    testable = [effect for effect, reason in reasons if reason is None]
    return testable, [(effect.name, reason) for effect, reason in reasons if reason is not None]


def _beyond(rows: FloatArray, others: FloatArray) -> float:
    """Return the energy of rows that others do not span."""
    solution = np.linalg.lstsq(others.T, rows.T, rcond=1e-9)[0]
    return float(np.sum((rows.T - others.T @ solution) ** 2))


def _speed_curve(series: Series) -> FloatArray:
    """Return a free curve over |ω|, one for each direction: hats between quantiles of the speeds, float64 (p, n)."""
    speed = np.abs(series.speed)
    knots = np.unique(np.quantile(speed, np.linspace(0.0, 1.0, KNOTS)))
    hats = np.stack([np.interp(speed, knots, height) for height in np.eye(knots.size)])
    rows = np.vstack([hats * (series.sign > 0), hats * (series.sign < 0)])
    return rows[rows.any(axis=1)]


def _calm(channels: Channels) -> Channels:
    """Return the motion without its noise, smoothed over a small part of the record."""
    width = max(len(channels) // SLOW_WINDOWS, 3) | 1
    known = np.isfinite(channels.speed_rad_s)
    filled = np.interp(np.arange(known.size), np.flatnonzero(known), channels.speed_rad_s[known])
    speed, rate = (savgol_filter(filled, width, 2, deriv=order, delta=channels.sample_period_s) for order in (0, 1))
    return replace(channels, speed_rad_s=speed, acceleration_rad_s2=rate)


def _is_law_of_speed(problem: Problem, effect: type[MeanEffect], shape: dict[str, float]) -> bool:
    """Return whether an effect depends on speed, direction and level alone: its columns then move with the samples."""
    if effect.needs:
        return False
    channels = problem.records[0].channels
    channels = replace(channels, dry_level_Nm=np.ones(len(channels)))
    order = np.random.default_rng(0).permutation(len(channels))
    nothing = np.zeros(len(channels))
    moved = replace(
        channels,
        speed_rad_s=channels.speed_rad_s[order],
        direction=channels.direction[order],
        good=channels.good[order],
        acceleration_rad_s2=nothing,
        angle_rad=nothing,
    )
    here, there = effect.columns(channels, shape)[0], effect.columns(moved, shape)[0]
    return bool(np.array_equal(np.nan_to_num(here[order]), np.nan_to_num(there)))


def _with_curve(series: Series, terms: Sequence[Term], law: NoiseLaw) -> tuple[FloatArray, FloatArray, float]:
    """Return rows, coefficients and score of a law with a free curve over the speed, which costs nothing."""
    rows, low, high = _regressors(series, terms)
    curve = _speed_curve(series)
    free = np.full(curve.shape[0], np.inf)
    rows, low, high = np.vstack([rows, curve]), np.append(low, -free), np.append(high, free)
    law, score = fit_noise(series, rows, low, high, law)
    coefficients, _ = Equations.of(series, rows, low, high, law).solve()
    return rows, coefficients, score + series.log_size * (_price(terms, law) - law.parameters)


def _left(series: Series, model: SmoothModel) -> Unexplained | None:
    """Return what a free curve over the speed explains beyond a model, where that pays."""
    rows, coefficients, score = _with_curve(series, model.terms, model.law)
    own = rows.shape[0] - model.coefficients.size - np.linalg.matrix_rank(series.base)  # what dry and viscous are not
    if model.score - score - series.log_size * own < ACCEPT_GAIN:
        return None
    known = model.coefficients @ rows[: model.coefficients.size]
    return Unexplained(CURVE_SIGNATURE, float(np.std(coefficients @ rows - known)))
