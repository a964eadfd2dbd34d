"""Stepwise search for missing effects: forward selection, exchange and elimination, all by one score (see `score`).

How a model is made and fitted: see `fitting`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from rwa_monitor.discrepancy.fitting import EQUIVALENT_WITHIN, SETTLED, Effects, Fitting, Progress
from rwa_monitor.discrepancy.likelihood import least_gain
from rwa_monitor.discrepancy.score import wald
from rwa_monitor.discrepancy.terms import Found, Model, SearchResult, nested_to

MAX_EFFECTS: Final = 4  # in one model
WORTH_SWAPPING: Final = 2.0 * SETTLED  # decrease of the score from which an exchange is made: two fits settled


def search(fitting: Fitting, effects: Effects, progress: Progress = lambda _: None) -> SearchResult:
    """Search for mean effects; the arguments are those of `grow`."""
    return rank(fitting, grow(fitting, effects, progress), progress)


def grow(fitting: Fitting, effects: Effects, progress: Progress, begin_with: Sequence[Model] = ()) -> SearchResult:
    """Add effects one at a time, with exchanges and eliminations after each, while each gains as much as is asked.

    Parameters
    ----------
    fitting
        Makes and fits models of the data.
    effects
        Candidates.
    progress
        Called with a short text at each step.
    begin_with
        Models found earlier, each with one effect more than the one before.
    """
    progress("base model")
    base = fitting.base()
    testable, untestable = fitting.split_testable(effects, base)
    nested = [base, *begin_with]
    while len(nested[-1].terms) < MAX_EFFECTS:
        nested[-1] = fitting.settled(nested[-1])
        if not nested[-1].is_possible:  # after the last fit its strengths are not
            testable = [effect for effect in testable if effect.name != nested[-1].names[-1]]
            del nested[-1]
        current = nested[-1]
        progress(" + ".join((*current.names, f"one of {len(testable)} effects")))
        alternatives = fitting.extensions(current, testable, all_of_them=True)
        if not alternatives:
            break
        if len(alternatives[0].terms) > len(current.terms):  # its jumps alone may lower the score
            simpler = fitting.without(alternatives[0], len(current.terms))
            if simpler.score < current.score - SETTLED:
                current = nested[-1] = simpler
                if alternatives[0].score > current.score:  # all were compared with a model without these jumps
                    continue
        named, sign = len(current.terms), fitting.problem.sign  # separate levels of the recordings add no effect
        alternatives = [one for one in alternatives if len(one.terms) == named or not one.is_minor(-1, sign)]
        if not alternatives:
            break
        gain, least = current.score - alternatives[0].score, least_gain(fitting.problem, named)
        drifts = current.law.is_drift(current.fit.residual.size)  # the noise law may absorb a missing effect
        if gain < least and drifts:  # of two missing effects, each alone may gain too little: two are tried in pairs
            pairs = [pair for one in alternatives[:2] for pair in fitting.extensions(one, testable)]
            best = min(pairs, key=lambda pair: pair.score, default=current)
            if current.score - best.score >= least_gain(fitting.problem, 0) + least_gain(fitting.problem, 1):
                alternatives = [best]
        gaining = (one for one in alternatives if current.score - one.score >= least)
        counted = (one for one in gaining if len(one.terms) == named or fitting.predicts(one, current))
        accepted = next(counted, None)
        if accepted is None:
            break
        if len(accepted.terms) > 1:  # a first one was chosen among all
            accepted = _swap(fitting, accepted, testable, progress)
        nested.append(prune(fitting, accepted, keep_last=True))
        if nested[-1].score >= current.score:
            break
    final = fitting.settled(prune(fitting, min(nested, key=lambda model: model.score)))
    final = prune(fitting, final)  # again, with the noise estimated from its residual
    nested = [*(model for model in nested if len(model.terms) < len(final.terms)), final]
    return SearchResult(tuple(nested), tuple(testable), tuple(untestable))


def rank(fitting: Fitting, grown: SearchResult, progress: Progress) -> SearchResult:
    """Find the gain of each significant effect of the last model, and the effects that are as good in its place.

    Where one is better there, as the noise or the jumps are now known better, it takes that place.
    """
    significant = _without_insignificant(fitting, grown.nested[-1])
    model, found = _swap(fitting, significant, grown.testable, progress), []
    grown = replace(grown, nested=nested_to(model, grown.nested))
    for index, name in enumerate(model.names):
        progress(f"in the place of {name}")
        alternatives = fitting.replacements(model, index, grown.testable)
        near = [one.names[-1] for one in alternatives if one.score - model.score < EQUIVALENT_WITHIN]
        equivalent = dict.fromkeys((*near, *fitting.equivalents(model, index, grown.testable)))
        found.append(Found(name, fitting.without(model, index).score - model.score, tuple(equivalent)))
    ranked = tuple(sorted(found, key=lambda entry: -entry.gain))
    return replace(grown, found=ranked)


def _without_insignificant(fitting: Fitting, model: Model) -> Model:
    """Remove effects whose Wald statistic (see `wald`) is below the gain asked, the weakest first."""
    while model.terms:
        squares = wald(fitting.problem, model)
        weakest = int(np.argmin(squares))
        if squares[weakest] >= least_gain(fitting.problem, len(model.terms) - 1):
            break
        model = fitting.without(model, weakest)
    return model


def _swap(fitting: Fitting, model: Model, effects: Effects, progress: Progress) -> Model:
    """Exchange effects one at a time while the score falls by WORTH_SWAPPING."""
    index = 0
    while index < len(model.terms):
        progress(f"in the place of {model.names[index]}")
        alternatives = fitting.replacements(model, index, effects)
        index += 1
        if alternatives and alternatives[0].score < model.score - WORTH_SWAPPING:
            model, index = alternatives[0], 0
    return model


def prune(fitting: Fitting, model: Model, *, keep_last: bool = False) -> Model:
    """Remove effects that are minor, predict nothing or gain less than is asked, and separate levels that gain less."""
    while True:
        simpler = [fitting.without(model, index) for index in range(len(model.terms) - keep_last)]
        minor = [one for index, one in enumerate(simpler) if model.is_minor(index, fitting.problem.sign)]
        minor = minor or [one for one in simpler if not fitting.predicts(model, one)]
        tried = minor or (simpler if keep_last else [*simpler, *fitting.with_common_level(model)])
        best = min(tried, key=lambda one: one.score, default=None)
        least = least_gain(fitting.problem, len(model.terms) - 1)
        if best is None or (not minor and best.score - model.score >= least):
            return model
        model = best
