"""Models with jumps of the friction: started in several ways, segmented anew with every candidate.

Friction of small wheels jumps, and a missing smooth effect is paid for by dozens of false jumps: the right term is the
one that gives them back. Candidates are screened by a criterion with fixed noise (see `base_fit`), on sufficient
statistics; those that come near are scored.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Final

import numpy as np

from rwa_monitor.discrepancy.base_fit import Fit, fit, jump_sets, strong_jumps, with_noise_of
from rwa_monitor.discrepancy.likelihood import NoiseLaw
from rwa_monitor.discrepancy.models import Model
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.discrepancy.score import off_reversals, scored, with_exact_jumps
from rwa_monitor.discrepancy.search import EQUIVALENT_WITHIN, Effects, Progress
from rwa_monitor.discrepancy.shape_profile import FEW_CHOICES, profile, profile_robustly, shape_limits
from rwa_monitor.discrepancy.terms import (
    Background,
    RobustBackground,
    Term,
    depends_on_level,
    make_background,
    make_robust_background,
    make_term,
)
from rwa_monitor.discrepancy.testable import sort_out
from rwa_monitor.discrepancy.thresholds import best_threshold
from rwa_monitor.physics.effects.base import MeanEffect
from rwa_monitor.physics.effects.presliding import Presliding
from rwa_monitor.physics.effects.speed_dead_zone import SpeedDeadZone
from rwa_monitor.samples import FloatArray, IntArray

SCREEN_MARGIN: Final = 40.0  # a candidate whose upper bound is this much worse than nothing is not re-segmented
REFINEMENTS: Final = 4  # rounds of shapes and jumps in turn
SETTLING: Final = 8  # rounds where a column follows the level
WORTH_REFINING: Final = 1.0  # of the criterion
CALMER: Final = 0.9  # of the long-run variance: from there on what a model leaves is taken for the noise that screens
# A candidate for another's place whose screening leaves more than this share of what the other gains is not settled:
# that lifts candidates by some per cent of it (19 % at most in 332 of the blind suite, seed 50007).
LEFT_SHARE: Final = 0.5
LEFT_AT_LEAST: Final = 100.0  # of the criterion: small gains are settled all
MAX_REFITS: Final = 9  # candidates, best bound first, that are re-segmented in one step


class Jumping:
    """Makes models with jumps, see `search.Approach`.

    Attributes
    ----------
    problem
        The data, with the noise that the last accepted model leaves.
    """

    def __init__(self, problem: Problem) -> None:
        self.problem = problem

    def base(self) -> Model:
        """Return the model with dry and viscous friction alone."""
        return _judged(self.problem, Model((), fit(self.problem, np.zeros((self.problem.size, 0)))))

    def sort_out(self, effects: Effects, base: Model) -> tuple[list[type[MeanEffect]], list[tuple[str, str]]]:
        """Split effects by what the motion can show beside a level of each recording: jumps may swallow more."""
        starts, at = self.problem.starts, np.arange(self.problem.size)
        levels = [(at >= a) & (at < b) for a, b in pairwise(starts.tolist()) if b > a]
        known = np.vstack([self.problem.speed, *levels]) * self.problem.sign
        return sort_out(self.problem, known, effects, base.fit.level)

    def settled(self, model: Model) -> Model:
        """Return a model with its noise free; fitted anew where it leaves less than what was taken for noise."""
        calmer = with_noise_of(self.problem, model.fit.residual)
        if calmer.noise.long_run_variance < CALMER * self.problem.noise.long_run_variance:
            self.problem = calmer
            return refit(calmer, model.terms, [model.fit.jumps])
        return min(model, _judged(self.problem, model), key=lambda one: one.score)

    def extensions(self, current: Model, effects: Effects, progress: Progress, most: float = np.inf) -> list[Model]:
        """Return `current` extended by each candidate, refitted, best first; none that is screened above `most`."""
        del progress
        return extensions(self.problem, current, effects, most)

    def replacements(self, model: Model, index: int, effects: Effects, progress: Progress) -> list[Model]:
        """Return the model with term `index` replaced by each other candidate, as far as they come near."""
        progress(f"in the place of {model.names[index]}")
        others = tuple(term for i, term in enumerate(model.terms) if i != index)
        reduced = Model(others, _fit(self.problem, others, [model.fit.jumps]), model.law)
        allowed = [effect for effect in effects if effect.name != model.terms[index].effect.name]
        most = np.inf
        if not is_coloured(model):
            lost = reduced.fit.criterion - model.fit.criterion
            most = model.fit.criterion + max(LEFT_SHARE * lost, LEFT_AT_LEAST)
        return extensions(self.problem, reduced, allowed, most)

    def without(self, model: Model, index: int) -> Model:
        """Return the model without term `index`, refitted from the full model's jumps."""
        others = tuple(term for i, term in enumerate(model.terms) if i != index)
        return _judged(self.problem, Model(others, _fit(self.problem, others, [model.fit.jumps])))

    def refitted(self, terms: Sequence[Term], near: Model, jumps: Sequence[IntArray] = ()) -> Model:
        """Return a model with other terms than one that is near to it, from these jumps or from those of the near one.

        Of those, also from the strong ones: a curve may explain the rest.
        """
        starts = jumps or [*jump_sets(self.problem, near.fit), strong_jumps(self.problem, near.fit)]
        return refit(self.problem, terms, starts, near.law)

    def plainer(self, model: Model) -> Model | None:
        """Return None: nothing but effects can be left out."""
        del model
        return None

    def as_good(self, model: Model, index: int, effects: Effects) -> list[str]:
        """Return the effects that are as good in the place of a term with jumps and level of the model as they are.

        Without the term, levels may take its part wherever a change of direction parts them, as in a few dwells: an
        effect that follows the level then follows that, too, and never comes near.
        """
        term, chosen = model.terms[index], tuple(term for i, term in enumerate(model.terms) if i != index)
        names = []
        if not is_coloured(model):
            background = make_background(self.problem, chosen, model.fit.jumps)
            others = [effect for effect in effects if effect.name not in model.names]
            bounds = self.problem.each(partial(_bound, background, model.fit.level), others)
            most = model.fit.criterion + EQUIVALENT_WITHIN
            names = [effect.name for effect, bound in zip(others, bounds, strict=True) if bound < most]
        if term.effect is Presliding and not _is_sampled(self.problem, term):
            names.append(SpeedDeadZone.name)
        return names


def is_coloured(model: Model) -> bool:
    """Say whether the noise of a model remembers."""
    return model.law is None or model.law.correlation > 0.0


def extensions(problem: Problem, current: Model, effects: Effects, most: float = np.inf) -> list[Model]:
    """Return `current` extended by each candidate, refitted, best first; none that is screened above `most`."""
    outset = _outset(problem, current)
    tries = [(effect, way) for effect in effects if effect.name not in current.names for way in _ways(effect)]
    screened: dict[str, Model] = {}
    for model in problem.each(partial(_started, outset), tries):
        if model is not None:
            known = screened.get(model.names[-1], model)
            screened[model.names[-1]] = min(known, model, key=lambda one: one.fit.criterion)
    best = sorted(screened.values(), key=lambda model: model.fit.criterion)[:MAX_REFITS]
    if not is_coloured(current):  # there the criterion, whose noise is white, says too little
        most = min(most, current.fit.criterion + SCREEN_MARGIN)
        best = [model for model in best if model.fit.criterion < most]
    settled = _with_best_choices(problem, problem.each(partial(_settled, problem), best))
    apart = [off_reversals(problem, model) for model in settled]
    judged = problem.each(lambda model: scored(problem, model, current.law, again=True), apart)
    exact = problem.each(partial(with_exact_jumps, problem), judged)
    return sorted(exact, key=lambda model: model.score)


def _settled(problem: Problem, model: Model) -> Model:
    """Return a model that was screened, with its shapes and jumps refined in turn."""
    return _plainer(problem, _refined(problem, model.terms, [model.fit.jumps]))


@dataclass(frozen=True, slots=True)
class _Outset:
    """What every candidate of a round starts from: the model that is to be extended, and several sets of its jumps."""

    problem: Problem
    current: Model
    starts: list[IntArray]
    backgrounds: list[Background]  # of those
    strong: Background
    robust: RobustBackground

    def extended(self, term: Term, starts: Sequence[IntArray]) -> Model:
        """Return the model with a term more."""
        terms = (*self.current.terms, term)
        return Model(terms, _fit(self.problem, terms, starts))


Way = Callable[[_Outset, type[MeanEffect]], Model | None]


def _outset(problem: Problem, current: Model) -> _Outset:
    starts = jump_sets(problem, current.fit)
    *backgrounds, strong = problem.each(
        lambda jumps: make_background(problem, current.terms, jumps), [*starts, strong_jumps(problem, current.fit)]
    )
    return _Outset(problem, current, starts, backgrounds, strong, make_robust_background(problem, current.terms))


def _started(outset: _Outset, one: tuple[type[MeanEffect], Way]) -> Model | None:
    """Start with an effect in one of its ways."""
    effect, way = one
    return way(outset, effect)


def _ways(effect: type[MeanEffect]) -> list[Way]:
    """Return the ways to start with an effect, each independent of the others."""
    ways: list[Way] = [_from_jumps]
    if effect.shape_parameters() or depends_on_level(effect):
        ways.append(_from_strong_jumps)
    if effect.shape_parameters() and not depends_on_level(effect):
        ways.append(_from_no_jumps)
    if effect is SpeedDeadZone:
        ways.append(_from_threshold)
    return ways


def _from_jumps(outset: _Outset, effect: type[MeanEffect]) -> Model:
    """Start with the jumps as they are, which may have swallowed the effect."""
    return outset.extended(profile(effect, outset.backgrounds, outset.current.fit.level)[0], outset.starts)


def _from_strong_jumps(outset: _Outset, effect: type[MeanEffect]) -> Model:
    """Start with only those jumps that nothing smooth makes."""
    return outset.extended(profile(effect, [outset.strong], outset.strong.level)[0], [outset.strong.jump_set])


def _from_no_jumps(outset: _Outset, effect: type[MeanEffect]) -> Model:
    return outset.extended(profile_robustly(effect, outset.robust, outset.current.fit.level), [])


def _from_threshold(outset: _Outset, effect: type[MeanEffect]) -> Model | None:
    """Start with the jumps away from a threshold."""
    (axis,) = effect.shape_parameters()

    def beyond(speed: float) -> Term:
        return make_term(outset.problem, effect, {axis.name: speed}, None)

    limits = shape_limits(outset.problem, effect)[axis.name]
    found = best_threshold(outset.problem, outset.current.terms, outset.current.fit, beyond, limits)
    return None if found is None else outset.extended(found[0], [found[1]])


def refit(problem: Problem, terms: Sequence[Term], starts: Sequence[IntArray], law: NoiseLaw | None = None) -> Model:
    """Fit a set of terms and score it, see `scored`; without `starts`, from the one to which jumps are outliers."""
    return _judged(problem, _refined(problem, terms, starts), law)


def _judged(problem: Problem, model: Model, law: NoiseLaw | None = None) -> Model:
    """Return a model scored, with its jumps placed exactly; `law` is that of nearly the same model, where known."""
    return with_exact_jumps(problem, scored(problem, off_reversals(problem, model), law, again=True))


def _refined(problem: Problem, terms: Sequence[Term], starts: Sequence[IntArray]) -> Model:
    """Fit a set of terms: segment, refine every shape on the new jumps, segment again."""
    best = Model(tuple(terms), _fit(problem, tuple(terms), starts))
    follows = any(depends_on_level(term.effect) for term in terms)
    for _ in range(SETTLING if follows else REFINEMENTS):
        refined = list(best.terms)
        for i, term in enumerate(refined):
            if term.shape:
                others = [other for j, other in enumerate(refined) if j != i]
                background = make_background(problem, others, best.fit.jumps)
                refined[i], _ = profile(term.effect, [background], best.fit.level, around=term)
            elif depends_on_level(term.effect):
                refined[i] = make_term(problem, term.effect, term.shape, best.fit.level)
        again = Model(tuple(refined), _fit(problem, tuple(refined), [best.fit.jumps]))
        improvement = best.fit.criterion - again.fit.criterion
        # A column that follows a level other than the model's own explains jumps by itself: what has settled counts.
        if improvement > 0 or follows:
            best = again
        if (abs(improvement) if follows else improvement) < WORTH_REFINING:
            break
    return best


def _plainer(problem: Problem, model: Model) -> Model:
    """Give the last term the shape that says as much with a part of it, where that is as good."""
    *chosen, last = model.terms
    shape = last.effect.plainer_shape(last.shape)
    if shape is None:
        return model
    term = make_term(problem, last.effect, {**last.shape, **shape}, model.fit.level)
    plainer = _refined(problem, (*chosen, term), [model.fit.jumps])
    return plainer if plainer.fit.criterion < model.fit.criterion + EQUIVALENT_WITHIN else model


def _with_best_choices(problem: Problem, models: Sequence[Model]) -> list[Model]:
    """Try the other values of a discrete shape parameter of each model's last term, where they are few.

    Jumps that were fitted to one value would not let another win.
    """
    tries = [
        (index, parameter.name, value, starts)
        for index, model in enumerate(models)
        for parameter in model.terms[-1].effect.shape_parameters()
        if 1 < len(parameter.choices) <= FEW_CHOICES
        for value in parameter.choices
        if value != _nearest(parameter.choices, model.terms[-1].shape[parameter.name])
        for starts in ([model.fit.jumps], [])
    ]

    best = list(models)
    others = problem.each(partial(_with_other_choice, problem, models), tries)
    for (index, *_), model in zip(tries, others, strict=True):
        best[index] = min(best[index], model, key=lambda one: one.fit.criterion)
    return best


def _with_other_choice(problem: Problem, models: Sequence[Model], one: tuple[int, str, float, list[IntArray]]) -> Model:
    """Give the last term of a model another value of a discrete shape parameter, and fit anew."""
    index, name, value, starts = one
    *chosen, last = models[index].terms
    background = make_background(problem, chosen, models[index].fit.jumps)
    term, _ = profile(last.effect, [background], models[index].fit.level, fixed={name: value})
    return _refined(problem, (*chosen, term), starts)


def _nearest(choices: Sequence[float], value: float) -> float:
    return min(choices, key=lambda choice: abs(choice - value))


def _fit(problem: Problem, terms: tuple[Term, ...], starts: Sequence[IntArray]) -> Fit:
    if not terms:
        return fit(problem, np.zeros((problem.size, 0)), start=starts)
    return fit(
        problem,
        np.column_stack([term.columns for term in terms]),
        (np.concatenate([term.low for term in terms]), np.concatenate([term.high for term in terms])),
        start=starts,
        parameters=sum(term.parameters for term in terms),
        name=None if any(term.name is None for term in terms) else tuple(term.name for term in terms),
    )


def _bound(background: Background, level: FloatArray, effect: type[MeanEffect]) -> float:
    """Return the criterion with an effect more, jumps kept."""
    return profile(effect, [background], level)[1]


def _is_sampled(problem: Problem, term: Term) -> bool:
    angle = term.shape["breakaway_angle_rad"]
    return any(Presliding.is_sampled(record.channels, angle) for record in problem.records)
