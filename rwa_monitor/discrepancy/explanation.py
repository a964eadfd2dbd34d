"""Explain the records by effects with or without jumps of the friction, and report what no effect explains.

A search with jumps and one without compete by one score. If the residual shows bursts of a cage, the search with jumps
is repeated on the samples outside of them. Where a nonparametric curve (piecewise linear or periodic) still gains, an
effect is missing: a catalogue effect or a formula takes its place, or it is reported as unexplained.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from rwa_monitor.discrepancy.angle import AngleLine, angle_line, ripple_with, with_angle_drift
from rwa_monitor.discrepancy.base_fit import Fit, fit, make_problem, with_noise_of
from rwa_monitor.discrepancy.fitting import EQUIVALENT_WITHIN, Fitting, Progress
from rwa_monitor.discrepancy.hypotheses import formulas, speed_curve
from rwa_monitor.discrepancy.likelihood import ACCEPT_GAIN, Series, fit_noise, least_gain
from rwa_monitor.discrepancy.noise_effects import CageBursts, cage_bursts
from rwa_monitor.discrepancy.own_jumps import with_own_jumps
from rwa_monitor.discrepancy.problem import Mapper, Problem, in_turn
from rwa_monitor.discrepancy.quantisation import redrawn
from rwa_monitor.discrepancy.record import FEWEST_FOR_JUMPS, Record
from rwa_monitor.discrepancy.score import price, regressors
from rwa_monitor.discrepancy.search import grow, prune, rank, search
from rwa_monitor.discrepancy.terms import Found, Model, SearchResult, nested_to
from rwa_monitor.discrepancy.unexplained import (
    LEAST_NAMED_SHARE,
    combined,
    explains_most,
    judge_leftover,
    without_unnamed,
)
from rwa_monitor.discrepancy.unnamed import UNNAMED
from rwa_monitor.messages import NearestEffect, Unexplained
from rwa_monitor.wheel.effects.base import MeanEffect
from rwa_monitor.wheel.effects.catalogue import CATALOGUE, MEAN_EFFECTS
from rwa_monitor.wheel.effects.formula import Formula
from rwa_monitor.wheel.effects.torque_ripple import TorqueRipple
from rwa_monitor.wheel.wheel import Wheel

Effects = Sequence[type[MeanEffect]]

# Mean number of samples between jumps; with fewer, the levels fit the noise: the model without jumps is then preferred.
SHORTEST_SEGMENTS: Final = 50


def prepare(records: Sequence[Record], wheel: Wheel, each: Mapper = in_turn) -> Problem:
    """Join records into the problem that is searched; `each` applies a function to each of many candidates.

    Raises
    ------
    InputError
        If too few samples are in motion.
    """
    problem = make_problem(records, wheel, each)
    base = fit(problem)
    if base.coefficients[0] > 0:
        problem = replace(problem, lowest_viscous=0.0)
    return with_angle_drift(problem, base)


@dataclass(frozen=True, slots=True)
class Explained:
    """The result of a search.

    Attributes
    ----------
    problem
        The data, with the noise estimated from the residual of a model.
    found, leftover
        The mean effects, and what none of them explains.
    complete
        The last model extended by the curve for the leftover, if there is one: its residual is noise.
    cage
        Bursts of a cage; the rest was found in the samples outside of them. None if there are none.
    jumps
        Whether friction may jump.
    """

    problem: Problem
    found: SearchResult
    leftover: Unexplained | None
    complete: Model
    cage: CageBursts | None = None
    jumps: bool = True


def explain(problem: Problem, effects: Effects, progress: Progress, wheel: Wheel) -> Explained:
    """Search for mean effects with jumps and without, and return the better answer."""
    if problem.size < FEWEST_FOR_JUMPS:
        few = _without_jumps(problem, None, effects, progress)
        assert few is not None, "nothing else is likelier"
        return few
    problem, effects, of_line = _treat_angle_line(problem, effects, wheel)
    approach, jumping = _with_jumps(problem, effects, progress, wheel)
    cage = cage_bursts(jumping.problem, jumping.complete) if jumping.problem.has_noise else None
    if cage is None:
        jumping = _with_formula(approach, jumping, effects, progress)
    smooth = _without_jumps(jumping.problem, jumping.complete, effects, progress)
    if smooth is not None:
        return replace(smooth, leftover=combined(smooth.leftover, of_line))
    if cage is not None:
        # Bursts are mistaken for jumps and for laws of the speed: all else is estimated outside of them.
        quiet = prepare(cage.quiet(jumping.problem.records), wheel, problem.each)
        jumping = _with_formula(*_with_jumps(quiet, effects, progress, wheel), effects, progress)
    return replace(jumping, leftover=combined(jumping.leftover, of_line), cage=cage)


def _without_jumps(problem: Problem, jumping: Model | None, effects: Effects, progress: Progress) -> Explained | None:
    """Search without jumps; None where the model with jumps has a score lower by more than ACCEPT_GAIN.

    Given the effects found with jumps, a nonparametric curve over the speed fits as well as any law of the speed: where
    even the score of that is too high, no search is run.
    """
    most = np.inf
    if jumping is not None:
        jumps = jumping.fit.jumps.size
        if jumps * SHORTEST_SEGMENTS <= problem.size:
            most = jumping.score + ACCEPT_GAIN
        if not problem.has_noise or _score_bound(problem, jumping) > most:
            return None
    progress("laws without jumps")
    approach = Fitting(problem, jumps=False)
    found = search(approach, [effect for effect in effects if effect.name in MEAN_EFFECTS], progress)
    found, leftover, complete = judge_leftover(approach, found)
    if complete.score > most:
        return None
    problem = with_noise_of(problem, complete.fit.residual)
    return _with_formula(approach, Explained(problem, found, leftover, complete, jumps=False), effects, progress)


def _score_bound(problem: Problem, jumping: Model) -> float:
    """Return a lower bound of the scores of laws of the speed without jumps, given the effects of a model with jumps.

    It is the score of a nonparametric curve, without a penalty for its parameters or those of the effects.
    """
    series, law = Series.of(problem), jumping.law
    rows, low, high = regressors(series, jumping.terms)
    curve = speed_curve(series)
    free = np.full(curve.shape[0], np.inf)
    rows, low, high = np.vstack([rows, curve]), np.append(low, -free), np.append(high, free)
    start = law.separate_levels if series.several else law
    return fit_noise(series, rows, low, high, start)[1] + problem.log_size * price(())


def _treat_angle_line(
    problem: Problem, candidates: Effects, wheel: Wheel
) -> tuple[Problem, Effects, Unexplained | None]:
    """Subtract a drag that is periodic in the angle of the wheel, or let a torque ripple try the order of a line there.

    Other effects would partly explain it. In data without noise, the significance of a line cannot be judged.

    Returns
    -------
    problem, candidates, subtracted
        What was subtracted from the data, or None.
    """
    line = angle_line(problem) if problem.has_noise else None
    if line is None:
        return problem, candidates, None
    if isinstance(line, AngleLine):
        (record,) = problem.records
        without = replace(record, friction_torque_Nm=record.friction_torque_Nm - line.torque_Nm)
        return prepare([without], wheel, problem.each), candidates, line.finding
    of_any_order = ripple_with(line)
    return problem, [of_any_order if effect is TorqueRipple else effect for effect in candidates], None


def _with_jumps(problem: Problem, candidates: Effects, progress: Progress, wheel: Wheel) -> tuple[Fitting, Explained]:
    """Search for mean effects together with jumps, and judge their residual: see `judge_leftover`."""
    candidates = [*candidates, *(effect for effect in UNNAMED if effect.may_show(problem))]
    approach, grown, own = _grown(problem, candidates, progress)
    best = own or grown.nested[-1]
    if best.terms:

        def again(other: Problem) -> Fit:
            return Fitting(other, jumps=True).refitted(best.terms, best, [best.fit.jumps]).fit

        drawn = redrawn(problem, best.fit, again)
        if drawn is not None:
            problem = prepare(drawn, wheel, problem.each)
            approach, grown, own = _grown(problem, candidates, progress, best)
    if own is not None:
        grown = grow(approach, candidates, progress, _nested_refits(approach, own))
    found = rank(approach, grown, progress)
    problem = approach.problem
    progress("what is left")
    found, leftover, complete = judge_leftover(approach, found)
    found, leftover = without_unnamed(approach, found, leftover)
    return approach, Explained(problem, found, leftover, complete)


def _with_nearest(approach: Fitting, explained: Explained, known: Sequence[Model]) -> Unexplained | None:
    """Return the leftover with the effect that explains most of it, where that effect gains as much as is asked.

    `known`: the last model extended by one effect of the catalogue each, best first.
    """
    last, left = explained.found.nested[-1], explained.leftover
    best = next((one for one in known if len(one.terms) > len(last.terms)), None)
    if best is None or left is None:
        return left
    simpler = approach.without(best, len(last.terms))  # the gain may come from its jumps
    gain = simpler.score - best.score
    share = (simpler.fit.rss - best.fit.rss) / (simpler.fit.rss - explained.complete.fit.rss)
    if gain < least_gain(approach.problem, len(last.terms)) or share < LEAST_NAMED_SHARE:
        return left
    return left.model_copy(update={"nearest": NearestEffect(effect=best.names[-1], share=share)})


def _with_formula(approach: Fitting, explained: Explained, effects: Effects, progress: Progress) -> Explained:
    """Replace the curve for the leftover by an effect of the catalogue or a formula, where one is as good.

    An effect as good as the best formula is preferred. The curve has established that something is missing, so an
    effect need not gain ACCEPT_GAIN again.
    """
    if explained.leftover is None:
        return explained
    progress("a formula for what has no name")
    found, complete = explained.found, explained.complete
    last, most = found.nested[-1], complete.score + EQUIVALENT_WITHIN
    laws, _ = approach.split_testable(formulas(explained.problem), found.nested[0])
    known, _ = approach.split_testable([effect for effect in effects if effect.name in CATALOGUE], found.nested[0])
    of_laws, of_known = approach.extensions(last, laws), approach.extensions(last, known)
    models = [one for one in of_laws if one.score <= most]
    most = min(most, models[0].score + EQUIVALENT_WITHIN) if models else most
    models = [one for one in of_known if one.score <= most] or models
    is_near = not models and not found.found  # a curve of many parameters may fit more than a law
    if is_near:
        models, of_laws = ([one for one in of if explains_most(last, one, complete)] for of in (of_known, of_laws))
        models = models or of_laws
    models = [one for one in models if len(one.terms) > len(last.terms)]
    if not models:
        return replace(explained, leftover=_with_nearest(approach, explained, of_known))
    near = [model.names[-1] for model in models[1:] if model.score - models[0].score < EQUIVALENT_WITHIN]
    best = prune(approach, models[0], keep_last=True)  # an effect named before may have mimicked a part
    simpler, names = approach.without(best, len(best.terms) - 1), set(best.names)
    gain = simpler.score - best.score
    if gain < EQUIVALENT_WITHIN:  # its jumps were missing, not the law
        return explained
    if issubclass(best.terms[-1].effect, Formula):  # of unknown cause: effects of nearly the same shape are listed
        alike = [one for one in approach.extensions(simpler, known) if explains_most(simpler, one, best)]
        near += [one.names[-1] for one in alike if one.terms]
        again = [effect for effect in known if effect.name in names]  # also one named already, at another shape
        near += approach.substitutes(best, len(best.terms) - 1, again)
    named = (*(one for one in found.found if one.name in names), Found(best.names[-1], gain, tuple(near)))
    ranked = tuple(sorted(named, key=lambda one: -one.gain))
    found = replace(found, nested=nested_to(best, found.nested), found=ranked)
    if is_near:
        found, leftover, complete = judge_leftover(approach, found)
        return replace(explained, found=found, leftover=leftover, complete=complete)
    return replace(explained, found=found, leftover=None, complete=best)


def _grown(
    problem: Problem, candidates: Effects, progress: Progress, begin_with: Model | None = None
) -> tuple[Fitting, SearchResult, Model | None]:
    """Return the fitting, the models grown, and the last with jumps of its own kind (`own_jumps`) where better."""
    approach = Fitting(problem, jumps=True)
    grown = grow(approach, candidates, progress, _nested_refits(approach, begin_with))
    progress("other jumps")
    return approach, grown, with_own_jumps(approach, grown.nested[-1], grown.nested[0], candidates)


def _nested_refits(fitting: Fitting, model: Model | None) -> list[Model]:
    """Refit the first effect, the first two, … of a model of nearly the same data."""
    if model is None:
        return []
    return [fitting.refitted(model.terms[: i + 1], model, [model.fit.jumps]) for i in range(len(model.terms))]
