"""Naming what the model lacks: forward and swap search over the catalogue, jumps re-segmented inside every candidate.

Each candidate is judged by the same penalised likelihood as the base model (see `base_fit`), with its shape parameters
profiled, its signs respected and its own segmentation: a missing smooth effect is paid for by dozens of false jumps,
and the right term is the one that gives them back.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np

from rwa_monitor.discrepancy.base_fit import Fit, fit, jump_sets, remove_levels, strong_jumps
from rwa_monitor.discrepancy.coloured import coloured_gain, is_coloured
from rwa_monitor.discrepancy.models import Found, Growth, Model, SearchResult
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.discrepancy.shape_profile import FEW_CHOICES, profile, profile_robustly, shape_limits
from rwa_monitor.discrepancy.terms import (
    EXPLAINED_AWAY,
    Background,
    RobustBackground,
    Term,
    available,
    depends_on_level,
    make_background,
    make_robust_background,
    make_term,
)
from rwa_monitor.discrepancy.thresholds import best_threshold
from rwa_monitor.physics.effects.base import MeanEffect
from rwa_monitor.physics.effects.presliding import Presliding
from rwa_monitor.physics.effects.speed_dead_zone import SpeedDeadZone
from rwa_monitor.samples import FloatArray, IntArray

ACCEPT_GAIN: Final = 25.0  # effects.md: no false name in 24 null records at this threshold
EQUIVALENT_WITHIN: Final = 10.0  # effects.md, step 6
MAX_EFFECTS: Final = 4
SCREEN_MARGIN: Final = 40.0  # a candidate whose upper bound is this much worse than nothing is not re-segmented
REFINEMENTS: Final = 4  # rounds of shapes and jumps in turn
SETTLING: Final = 8  # rounds where a column follows the level
WORTH_REFINING: Final = 1.0  # of the criterion
# A candidate for another's place whose screening leaves more than this share of what the other gains is not settled:
# that lifts candidates by some per cent of it (19 % at most in 332 of the blind suite, seed 50007).
LEFT_SHARE: Final = 0.5
LEFT_AT_LEAST: Final = 100.0  # of the criterion: small gains are settled all
MAX_REFITS: Final = 9  # candidates, best bound first, that are re-segmented in one step

Progress = Callable[[str], None]


def search(
    problem: Problem,
    effects: Sequence[type[MeanEffect]],
    holds_out: Callable[[Problem, Model, Model], bool],
    progress: Progress = lambda _: None,
) -> SearchResult:
    """Search for mean effects, forward with swaps; the arguments are those of `grow`."""
    return rank(problem, grow(problem, effects, holds_out, progress), progress)


def grow(
    problem: Problem,
    effects: Sequence[type[MeanEffect]],
    holds_out: Callable[[Problem, Model, Model], bool],
    progress: Progress = lambda _: None,
    begin_with: Model | None = None,
) -> Growth:
    """Add effects one after the other, and exchange them, while that pays.

    Parameters
    ----------
    problem
        The data.
    effects
        Candidates.
    holds_out
        Says whether the second model predicts held-out data better than the first.
    progress
        Called with a word on each step.
    begin_with
        A model found before, with another estimate of the noise: its effects are taken over and judged anew.
    """
    progress("base model")
    base = Model((), fit(problem, np.zeros((problem.size, 0))))
    testable, untestable = sort_out(problem, effects, base)
    ladder = [base]
    if begin_with is not None:
        for count in range(1, len(begin_with.terms) + 1):
            ladder.append(refit(problem, begin_with.terms[:count], [begin_with.fit.jumps, ladder[-1].fit.jumps]))
    best_rejected, rejected = -np.inf, ""
    known: tuple[Model, tuple[tuple[Model, ...], ...]] | None = None
    while len(ladder[-1].terms) < MAX_EFFECTS:
        current = ladder[-1]
        rivals = extensions(problem, current, testable, progress)
        if not rivals:
            break
        best = rivals[0]
        gain = current.fit.criterion - best.fit.criterion
        if gain < ACCEPT_GAIN and is_coloured(problem):
            gains = [coloured_gain(problem, current, rival) for rival in rivals]
            best, gain = rivals[int(np.argmax(gains))], max(gains)
        if gain < ACCEPT_GAIN or not holds_out(problem, current, best):
            best_rejected, rejected = gain, best.names[-1]
            break
        swapped, rivals_of_last = _swap(problem, best, testable, progress)
        known = None if rivals_of_last is None else (swapped, rivals_of_last)
        ladder.append(swapped)
    final = _prune(problem, ladder[-1])
    ladder = [*(model for model in ladder if len(model.terms) < len(final.terms)), final]
    rivals_of_final = known[1] if known is not None and known[0] is final else None
    return Growth(tuple(ladder), tuple(testable), tuple(untestable), best_rejected, rejected, rivals_of_final)


def rank(problem: Problem, grown: Growth, progress: Progress = lambda _: None) -> SearchResult:
    """Judge each effect of the last model by itself, and find what could stand in its place."""
    found = _found(problem, grown, progress)
    return SearchResult(grown.ladder, found, grown.untestable, grown.best_rejected, grown.rejected)


def _worth(problem: Problem, simpler: Model, richer: Model) -> float:
    """Return by how much the criterion falls from one model to the other, by whichever look sees more."""
    gain = simpler.fit.criterion - richer.fit.criterion
    return max(gain, coloured_gain(problem, simpler, richer)) if is_coloured(problem) else gain


def sort_out(
    problem: Problem, effects: Sequence[type[MeanEffect]], base: Model
) -> tuple[list[type[MeanEffect]], list[tuple[str, str]]]:
    """Split the effects into those this data can test and those it cannot, with the reason."""
    background = make_background(problem, (), np.zeros(0, dtype=np.int64))  # jumps may have swallowed the effect

    def lacking(effect: type[MeanEffect]) -> str | None:
        """Return what an effect lacks to be tested: a channel, or a motion that sets it apart; None for nothing."""
        channel = available(problem, effect)
        if channel is not None:
            return channel
        term = make_term(problem, effect, middle_shape(problem, effect), base.fit.level)
        inner = remove_levels(term.columns, background.first)
        scale = float(background.design[:, 0] @ background.design[:, 0])
        if scale > 0:
            inner = inner - np.outer(background.design[:, 0], background.design[:, 0] @ inner / scale)
        explained_away = float(np.sum(inner**2)) <= EXPLAINED_AWAY * float(np.sum(term.columns**2))
        return effect.separate_by if explained_away else None

    reasons = list(zip(effects, problem.each(lacking, effects), strict=True))
    testable = [effect for effect, reason in reasons if reason is None]
    return testable, [(effect.name, reason) for effect, reason in reasons if reason is not None]


def middle_shape(problem: Problem, effect: type[MeanEffect]) -> dict[str, float]:
    """Return a shape in the middle of what the first record can show."""
    bounds = effect.shape_bounds(problem.records[0].channels)
    shape = {}
    for parameter in effect.shape_parameters():
        low, high = bounds[parameter.name]
        middle = float(np.sqrt(low * high)) if low > 0 else 0.5 * (low + high)
        shape[parameter.name] = parameter.choices[0] if parameter.choices else middle
    return shape


def extensions(
    problem: Problem,
    current: Model,
    effects: Sequence[type[MeanEffect]],
    progress: Progress,
    most: float = np.inf,
) -> list[Model]:
    """Return `current` extended by each candidate, refitted, best first; none that is screened above `most`."""
    progress(" + ".join((*current.names, f"one of {len(effects)} effects")))
    outset = _outset(problem, current)
    tries = [(effect, way) for effect in effects if effect.name not in current.names for way in _ways(effect)]
    screened: dict[str, Model] = {}
    for model in problem.each(partial(_started, outset), tries):
        if model is not None:
            known = screened.get(model.names[-1], model)
            screened[model.names[-1]] = min(known, model, key=lambda one: one.fit.criterion)
    best = sorted(screened.values(), key=lambda model: model.fit.criterion)[:MAX_REFITS]
    most = min(most, current.fit.criterion + SCREEN_MARGIN)
    worth = [model for model in best if model.fit.criterion < most]
    settled = problem.each(partial(_settled, problem), worth)
    return sorted(_with_best_choices(problem, settled), key=lambda model: model.fit.criterion)


def _settled(problem: Problem, model: Model) -> Model:
    """Return a model that was screened, with its shapes and jumps refined in turn."""
    return _plainer(problem, refit(problem, model.terms, [model.fit.jumps]))


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


def refit(problem: Problem, terms: Sequence[Term], starts: Sequence[IntArray]) -> Model:
    """Fit a set of terms: segment, refine every shape on the new jumps, segment again.

    Without `starts`, from the robust start, to which jumps are outliers.
    """
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
    plainer = refit(problem, (*chosen, term), [model.fit.jumps])
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
    return refit(problem, (*chosen, term), starts)


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


def replacements(
    problem: Problem, model: Model, index: int, effects: Sequence[type[MeanEffect]], progress: Progress
) -> list[Model]:
    """Return the model with term `index` replaced by each other candidate, best first, as far as they come near."""
    others = tuple(term for i, term in enumerate(model.terms) if i != index)
    reduced = Model(others, _fit(problem, others, [model.fit.jumps]))
    allowed = [effect for effect in effects if effect.name != model.terms[index].effect.name]
    most = np.inf
    if not is_coloured(problem):  # where a second look may see more than the criterion
        lost = reduced.fit.criterion - model.fit.criterion
        most = model.fit.criterion + max(LEFT_SHARE * lost, LEFT_AT_LEAST)
    return extensions(problem, reduced, allowed, progress, most)


def _swap(
    problem: Problem, model: Model, effects: Sequence[type[MeanEffect]], progress: Progress
) -> tuple[Model, tuple[tuple[Model, ...], ...] | None]:
    """Exchange effects one by one while that helps; return the rivals of each that were tried last, too."""
    if len(model.terms) == 1:
        return model, None  # the best single effect was chosen among all
    tried: list[tuple[Model, ...]] = []
    while len(tried) < len(model.terms):
        rivals = replacements(problem, model, len(tried), effects, progress)
        tried.append(tuple(rivals))
        if rivals and rivals[0].fit.criterion < model.fit.criterion - 1.0:
            model, tried = rivals[0], []
    return model, tuple(tried)


def _without(problem: Problem, model: Model, index: int) -> Model:
    """Return the model without term `index`, refitted from the full model's and from free jumps."""
    others = tuple(term for i, term in enumerate(model.terms) if i != index)
    starts = [model.fit.jumps]
    return Model(others, _fit(problem, others, starts))


def _prune(problem: Problem, model: Model) -> Model:
    """Leave out effects that later ones have made superfluous."""
    while model.terms:
        reduced = problem.each(partial(_without, problem, model), range(len(model.terms)))
        losses = [_worth(problem, simpler, model) for simpler in reduced]
        if min(losses) >= ACCEPT_GAIN:
            return model
        model = reduced[int(np.argmin(losses))]
    return model


def _found(problem: Problem, grown: Growth, progress: Progress) -> tuple[Found, ...]:
    """Rank the accepted effects and find what could stand in their place."""
    model, found = grown.ladder[-1], []
    for index, term in enumerate(model.terms):
        simpler = _without(problem, model, index)
        gain = _worth(problem, simpler, model)
        by_colour = gain > simpler.fit.criterion - model.fit.criterion  # what saw it says what is as good
        rivals = (
            replacements(problem, model, index, grown.testable, progress)
            if grown.rivals is None
            else grown.rivals[index]
        )
        equivalent = tuple(
            rival.terms[-1].effect.name
            for rival in rivals
            if (coloured_gain(problem, rival, model) if by_colour else rival.fit.criterion - model.fit.criterion)
            < EQUIVALENT_WITHIN
        )
        if not by_colour:
            as_good = _as_good_at_its_level(problem, model, index, grown.testable)
            equivalent = tuple(dict.fromkeys((*equivalent, *as_good)))
        if term.effect is Presliding and not _is_sampled(problem, term):
            equivalent = tuple(dict.fromkeys((*equivalent, SpeedDeadZone.name)))
        found.append(Found(term.effect.name, gain, equivalent))
    return tuple(sorted(found, key=lambda entry: -entry.gain))


def _as_good_at_its_level(problem: Problem, model: Model, index: int, effects: Sequence[type[MeanEffect]]) -> list[str]:
    """Return the effects that are as good in the place of a term with jumps and level of the model as they are.

    Without the term, levels may take its part wherever a change of direction parts them, as in a few dwells: an effect
    that follows the level then follows that, too, and never comes near.
    """
    chosen = tuple(term for i, term in enumerate(model.terms) if i != index)
    background = make_background(problem, chosen, model.fit.jumps)
    others = [effect for effect in effects if effect.name not in model.names]
    bounds = problem.each(partial(_bound, background, model.fit.level), others)
    most = model.fit.criterion + EQUIVALENT_WITHIN
    return [effect.name for effect, bound in zip(others, bounds, strict=True) if bound < most]


def _bound(background: Background, level: FloatArray, effect: type[MeanEffect]) -> float:
    """Return the criterion with an effect more, jumps kept."""
    return profile(effect, [background], level)[1]


def _is_sampled(problem: Problem, term: Term) -> bool:
    angle = term.shape["breakaway_angle_rad"]
    return any(Presliding.is_sampled(record.channels, angle) for record in problem.records)
