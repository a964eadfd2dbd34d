"""Models with jumps of the friction or without: made, extended by an effect, exchanged, each fitted by one score.

A candidate is screened with the noise and the jumps of the model that it extends; of those that come first, shapes,
noise and jumps are fitted in turn. Friction of small wheels jumps, and a missing smooth effect is paid for by dozens of
false jumps: so a candidate starts from several sets of jumps, and jumps are dear at first. Friction of larger machines
is often smooth, beside autocorrelated noise: there the noise must not be taken from what the base law leaves, and slow
noise must not be cut into jumps.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import Final

import numpy as np

from rwa_monitor.discrepancy.base_fit import (
    Fit,
    fit,
    jump_price,
    jump_sets,
    segment_records,
    with_noise_of,
)
from rwa_monitor.discrepancy.hypotheses import sort_out
from rwa_monitor.discrepancy.likelihood import LONG_MEMORY, NO_JUMPS, NoiseLaw, Series
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.discrepancy.score import Background, held_out, off_reversals, scored, with_exact_jumps, with_law
from rwa_monitor.discrepancy.shape_profile import profile, shape_limits
from rwa_monitor.discrepancy.terms import Model, Term, depends_on_level, law_of, make_term
from rwa_monitor.samples import TINY, FloatArray, IntArray
from rwa_monitor.wheel.effects.base import MeanEffect

Progress = Callable[[str], None]
Effects = Sequence[type[MeanEffect]]

EQUIVALENT_WITHIN: Final = 10.0  # effects.md, step 6
ANNEALING: Final = (8.0, 3.0, 1.0, 1.0)  # times the price of a jump
STARTED: Final = 4  # candidates of each start that are tried, those that screening puts first
REFITTED: Final = 5  # candidates whose shapes and noise are refitted, of those that were segmented anew
LEAST_SHARE: Final = 0.25  # of the best one's gain: with less, shapes and noise fitted anew never put one first
ROUNDS: Final = 4  # of shapes, noise and jumps in turn
SETTLED: Final = 0.5  # of the score
STEP: Final = 0.25  # of a column's range from one sample to the next: more is a step
AT_STEP: Final = 8  # samples: a jump so near to a step may be that step
MOST_TRIED: Final = 60  # thresholds
FEWEST_CROSSED: Final = 2  # jumps at one speed: one is no threshold
WORSE: Final = 1.1  # of the sum of squares: slow noise lets the right law leave a few per cent more by chance
COLOURED: Final = 0.5  # correlation of neighbours from which noise is not white
CALMER: Final = 0.9  # of the long-run variance: from there on what a model leaves is taken for the noise
MOST_BLOCKS: Final = 8  # of ten: chance alone gets there in one of twenty


class Fitting:
    """Makes models of the same data.

    Attributes
    ----------
    problem
        The data, with the noise that the last accepted model leaves.
    jumps
        Whether friction may jump.
    """

    def __init__(self, problem: Problem, *, jumps: bool) -> None:
        self.problem = problem
        self.jumps = jumps
        self.several = Series.of(problem).several
        self._known: dict[Hashable, tuple[Sequence[Term], Model]] = {}  # what `without` returned
        self._replaced: dict[tuple[int, int], tuple[Model, list[Model]]] = {}  # and `replacements`

    def base(self) -> Model:
        """Return the model with dry and viscous friction alone."""
        if not self.jumps:
            return self.refined(self._annealed((), [NO_JUMPS], NoiseLaw()))
        problem, start = self.problem, fit(self.problem)
        jumps = off_reversals(problem, start.level + start.residual, start.jumps)
        base = with_exact_jumps(problem, scored(problem, Model((), replace(start, jumps=jumps))))
        memory = _memory_of_neighbours(base.fit.residual)
        if not problem.has_noise or memory < COLOURED:
            return base
        # Jumps that a coloured noise hides pass for noise that remembers still longer.
        other = with_exact_jumps(problem, with_law(problem, base, NoiseLaw(white=0.0, correlation=memory)))
        return min(base, with_exact_jumps(problem, scored(problem, other)), key=lambda one: one.score)

    def sort_out(self, effects: Effects, base: Model) -> tuple[list[type[MeanEffect]], list[tuple[str, str]]]:
        """Split effects into those that the data can test, and the names of the others with what is missing.

        Beside a level of each recording where friction may jump: jumps may swallow more.
        """
        problem, at = self.problem, np.arange(self.problem.size)
        known = Series.of(problem).base
        if self.jumps:
            levels = [(at >= a) & (at < b) for a, b in pairwise(problem.starts.tolist()) if b > a]
            known = np.vstack([problem.speed, *levels]) * problem.sign
        return sort_out(problem, known, effects, base.fit.level)

    def settled(self, model: Model) -> Model:
        """Return an accepted model fitted to the end; what it leaves prices jumps from now on, where that is calmer."""
        if not self.jumps:  # shapes and a law of several parameters settle slowly
            return min(model, self.refined(model), key=lambda one: one.score)
        calmer = with_noise_of(self.problem, model.fit.residual)
        if calmer.noise.long_run_variance < CALMER * self.problem.noise.long_run_variance:
            self.problem, self._known, self._replaced = calmer, {}, {}
        return model

    def extensions(self, current: Model, effects: Effects, *, all_of_them: bool = False) -> list[Model]:
        """Return a model with one effect more, for each of the most promising, best first.

        Or with levels of the recordings that differ: a hypothesis like any other. `all_of_them`: those with an effect
        that does not count, too.
        """
        models = self._extended(current, effects, all_of_them=all_of_them)
        if not self.jumps and self.several and law_of(current).level_spread == 0.0:
            models.append(self.refined(self._annealed(current.terms, [NO_JUMPS], law_of(current).apart)))
        return _in_order(models, effects)

    def counts(self, model: Model, current: Model) -> bool:
        """Return whether the last effect of a model is more than another is not exact by, and predicts something."""
        return not model.is_minor(-1, self.problem.sign) and predicts(self.problem, model, current)

    def replacements(self, model: Model, index: int, effects: Effects) -> list[Model]:
        """Return the model with another effect in the place of term `index`, of those that come near, best first."""
        if (id(model), index) not in self._replaced:
            simpler = self.without(model, index)
            if not self.jumps:
                simpler = replace(simpler, law=model.law)
            allowed = [effect for effect in effects if effect.name not in model.names]
            found = _in_order(self._extended(simpler, allowed, model.terms[index]), effects)
            self._replaced[id(model), index] = model, found
        return self._replaced[id(model), index][1]

    def without(self, model: Model, index: int) -> Model:
        """Return a model without term `index`, refitted from the full model's jumps."""
        terms, jumps = model.terms[:index] + model.terms[index + 1 :], model.fit.jumps
        key = tuple(map(id, terms)), jumps.tobytes(), law_of(model)
        if key not in self._known:
            self._known[key] = terms, self.refitted(terms, model, [jumps])
        return self._known[key][1]

    def refitted(self, terms: Sequence[Term], near: Model, jumps: Sequence[IntArray] = ()) -> Model:
        """Return a model with other terms than one that is near to it, from these jumps or from those of the near one.

        Of those, also from the strong ones: a curve may explain the rest.
        """
        return self.refined(self.begun(terms, near, jumps))

    def begun(self, terms: Sequence[Term], near: Model, jumps: Sequence[IntArray] = ()) -> Model:
        """Return what `refitted` refines: shapes and noise are those of the near model still."""
        return self._annealed(tuple(terms), jumps or self._starts(near), law_of(near))

    def plainer(self, model: Model) -> Model | None:
        """Return a model with the same effects and fewer other parameters; None where there is none."""
        law = law_of(model)
        if self.jumps or law.level_spread == 0.0:
            return None  # one level of all recordings
        return self.refined(self._annealed(model.terms, [NO_JUMPS], replace(law, level_spread=0.0)))

    def as_good(self, model: Model, index: int, effects: Effects) -> list[str]:
        """Return the effects that are as good in the place of a term with jumps and level of the model as they are.

        Without the term, levels may take its part wherever a change of direction parts them, as in a few dwells: an
        effect that follows the level then follows that, too, and never comes near.
        """
        term = model.terms[index]
        unresolved = {term.effect.unresolved_as(one.channels, term.shape) for one in self.problem.records}
        names = [name for name in unresolved if name and len(unresolved) == 1]
        if self.jumps:
            names += self.in_place(model, index, [effect for effect in effects if effect.name not in model.names])
        return names

    def in_place(self, model: Model, index: int, effects: Effects) -> list[str]:
        """Return the effects that are as good in the place of a term, with jumps, level and noise as they are."""
        others = model.terms[:index] + model.terms[index + 1 :]
        beside = Background.of(self.problem, others, law_of(model), model.fit.jumps)
        most = beside.criterion_with(model.terms[index]) + EQUIVALENT_WITHIN
        tried = self.problem.each(partial(profile, beside, model.fit.level), effects)
        return [one.effect.name for one, score in tried if score < most]

    def _starts(self, model: Model) -> list[IntArray]:
        """Return sets of jumps that a model near to another may start from."""
        if not self.jumps:
            return [NO_JUMPS]
        return jump_sets(self.problem, model.fit)

    def _extended(
        self, current: Model, effects: Effects, instead: Term | None = None, *, all_of_them: bool = False
    ) -> list[Model]:
        """Return the model with each of the most promising effects added; `instead` of a term, those that come near."""
        law, missing = law_of(current), [effect for effect in effects if effect.name not in current.names]
        starts = [(law, jumps) for jumps in self._starts(current)]
        if not self.jumps:  # slow noise hides what it could be
            starts.append((replace(law, white=1.0, correlation=0.0), NO_JUMPS))
        tried: list[tuple[Term, IntArray]] = []
        for one, jumps in starts:
            beside = Background.of(self.problem, current.terms, one, jumps)
            most = np.inf
            if instead is not None:
                most = 0.5 * (beside.criterion_with() + beside.criterion_with(instead))
            scores = self.problem.each(partial(profile, beside, current.fit.level), missing)
            ranked = sorted(scores, key=lambda entry: entry[1])[:STARTED]
            tried += [(term, jumps) for term, score in ranked if score < most]
        for effect in missing:
            tried += self._at_thresholds(current, effect)
        started = self.problem.each(lambda entry: self._annealed((*current.terms, entry[0]), entry[1:], law), tried)
        if self.jumps:
            started = _best_of_each(started)[:REFITTED]
            gain = max((current.score - one.score for one in started), default=0.0)
            started = [one for one in started if gain < 0.0 or current.score - one.score >= LEAST_SHARE * gain]
        refined = self.problem.each(lambda one: self._plainer_shape(self.refined(one)), started)
        possible = [one for one in refined if is_possible(one) and _explains(one, current)]
        return _best_of_each([one for one in possible if all_of_them or self.counts(one, current)])

    def _at_thresholds(self, current: Model, effect: type[MeanEffect]) -> list[tuple[Term, IntArray]]:
        """Return an effect with a threshold of speed where it makes most of the jumps superfluous, and the others.

        A profile over the threshold has no slope to follow: beside the true one no jump is explained. But the jumps
        that crossing it makes lie at its speed.
        """
        problem, jumps, best = self.problem, current.fit.jumps, np.inf
        found: list[tuple[Term, IntArray]] = []
        tried = jumps[:: max(jumps.size // MOST_TRIED, 1)] if effect.threshold else NO_JUMPS
        motion = problem.motion
        for speed in 0.5 * (motion[tried - 1] + motion[tried]):
            low, high = shape_limits(problem, effect)[effect.threshold]
            term = make_term(problem, effect, {effect.threshold: float(speed)}, None)
            left = off_steps(term, jumps)
            if low <= speed <= high and jumps.size - left.size >= FEWEST_CROSSED:
                score = Background.of(problem, current.terms, law_of(current), left).criterion_with(term)
                best, found = min((best, found), (score, [(term, left)]), key=lambda one: one[0])
        return found

    def _plainer_shape(self, model: Model) -> Model:
        """Return a model whose last term has the shape that does as well with a part of it, where there is one."""
        *chosen, last = model.terms
        shape = last.effect.plainer_shape(last.shape)
        if shape is None:
            return model
        term = make_term(self.problem, last.effect, {**last.shape, **shape}, model.fit.level)
        plainer = self.refitted((*chosen, term), model, [model.fit.jumps])
        return plainer if plainer.score < model.score + EQUIVALENT_WITHIN else model

    def _annealed(self, terms: tuple[Term, ...], starts: Sequence[IntArray], law: NoiseLaw) -> Model:
        """Return a model under a law of the noise with any of these jumps, or those found while they are dear at first.

        What is found from several starts is soon the same.
        """
        nothing = np.zeros(self.problem.size)
        bare, known = Model(terms, Fit(NO_JUMPS, np.zeros(0), nothing, nothing, 0.0)), dict[bytes, Model]()

        def beside(jumps: IntArray) -> Model:
            """Return the model with these jumps."""
            key = jumps.tobytes()
            if key not in known:
                known[key] = with_law(self.problem, bare, law, jumps)
            return known[key]

        reached = [beside(jumps) for jumps in starts]
        for dear in ANNEALING if self.jumps else ():
            found = [beside(self._segmented(one, dear)) for one in reached]
            reached = list({id(one): one for one in found}.values())
        return min(known.values(), key=lambda one: one.score)

    def _segmented(self, model: Model, dear: float = 1.0) -> IntArray:
        """Return the best jumps beside a model's coefficients, in white noise of as much long-run variance, if any."""
        if not self.jumps:
            return model.fit.jumps
        along = model.fit.level + model.fit.residual
        jumps = segment_records(self.problem, along, dear * jump_price(self.problem))
        return off_reversals(self.problem, along, jumps)

    def refined(self, model: Model) -> Model:
        """Return a model with shapes, noise and jumps fitted in turn."""
        best: Model | None = None
        for _ in range(ROUNDS):
            model = scored(self.problem, model, model.law, again=self.jumps)
            gained = np.inf if best is None else best.score - model.score
            if best is None or gained > 0.0:
                best = model
            if gained < SETTLED or not any(term.shape or depends_on_level(term.effect) for term in model.terms):
                break
            model = self._reshaped(model)
            model = with_law(self.problem, model, law_of(model), self._segmented(model))
        assert best is not None
        return self._with_own_level(with_exact_jumps(self.problem, best) if self.jumps else best)

    def _with_own_level(self, model: Model) -> Model:
        """Return a model whose columns follow its own level, where they follow one: that of another is no such law."""
        for _ in range(ROUNDS if any(depends_on_level(term.effect) for term in model.terms) else 0):
            followed = with_law(self.problem, replace(model, terms=self._following(model)), law_of(model))
            change, model = abs(followed.score - model.score), followed
            if change < SETTLED:
                break
        return model

    def _following(self, model: Model) -> tuple[Term, ...]:
        """Return the terms of a model, those that follow a level with columns made anew from its level and its drag."""
        problem, fit = self.problem, model.fit
        beside = problem.z - fit.level - fit.residual - fit.coefficients[0] * problem.speed
        return tuple(
            make_term(problem, term.effect, term.shape, fit.level, beside) if depends_on_level(term.effect) else term
            for term in model.terms
        )

    def _reshaped(self, model: Model) -> Model:
        """Return a model whose terms each have the shape that is best beside the others.

        Its jumps are kept, but for those where a term steps itself.
        """
        terms, jumps = list(self._following(model)), model.fit.jumps
        for i, term in enumerate(terms):
            if term.shape:
                others, jumps = (*terms[:i], *terms[i + 1 :]), off_steps(term, jumps)
                beside = Background.of(self.problem, others, law_of(model), jumps)
                terms[i], _ = profile(beside, model.fit.level, term.effect, around=term)
                jumps = off_steps(term, jumps)
        return with_law(self.problem, replace(model, terms=tuple(terms)), law_of(model), jumps)


def _memory_of_neighbours(residual: FloatArray) -> float:
    """Return φ of the AR(1) noise whose differences over two samples and over one have the same medians.

    Few differences meet a jump. They grow by 1 + φ in square.
    """
    near, far = (float(np.median(np.abs(residual[lag:] - residual[:-lag]))) for lag in (1, 2))
    return float(np.clip(far**2 / max(near**2, TINY) - 1.0, 0.0, LONG_MEMORY))


def is_possible(model: Model) -> bool:
    """Return whether the strengths are what physics lets them be, beside the friction that the model has."""
    dry, viscous = float(model.fit.level.mean()), float(model.fit.coefficients[0])
    return all(term.effect.is_possible(model.strengths(i), dry, viscous) for i, term in enumerate(model.terms))


def _explains(model: Model, current: Model) -> bool:
    """Return whether a model with as many jumps leaves no more than the current one does.

    Beside noise of long correlation, only what neighbouring samples differ by is likely or not: a law may fit that
    and predict a slow friction that is not there.
    """
    return model.fit.jumps.size < current.fit.jumps.size or model.fit.rss <= WORSE * current.fit.rss


def predicts(problem: Problem, model: Model, simpler: Model) -> bool:
    """Return whether a model does better than a simpler one on blocks that it is not fitted to, or has fewer jumps.

    Better is a smaller error, or a greater likelihood: on the whole, or in most blocks, as one at the end of a sweep is
    extrapolated to. A few samples at changes of direction may decide the error, the law of the noise the likelihood.
    """
    if model.fit.jumps.size < simpler.fit.jumps.size:
        return True
    with_it, without = held_out(problem, model), held_out(problem, simpler)
    likelier = np.count_nonzero(with_it.block_log_scores > without.block_log_scores)
    better = with_it.rmse_Nm < without.rmse_Nm or with_it.log_score > without.log_score
    return better or bool(likelier >= MOST_BLOCKS)


def off_steps(term: Term, jumps: IntArray) -> IntArray:
    """Return the jumps that are not where a term steps itself, as at a threshold of the speed."""
    if depends_on_level(term.effect):
        return jumps
    change = np.abs(np.diff(term.columns, axis=0))
    steps = np.flatnonzero((change > STEP * np.ptp(term.columns, axis=0)).any(axis=1)) + 1
    nearest = np.searchsorted(steps, jumps + AT_STEP, side="right") - np.searchsorted(steps, jumps - AT_STEP)
    kept: IntArray = jumps[nearest == 0]
    return kept


def _in_order(models: Sequence[Model], effects: Effects) -> list[Model]:
    """Return models, best first; those that the score does not set apart from the best with the plainest effect first.

    One that follows the dry level is less plain than one that does not; then the order of the effects decides.
    """
    place = {effect.name: (depends_on_level(effect), number) for number, effect in enumerate(effects)}
    ordered = sorted(models, key=lambda model: model.score)
    near = [model for model in ordered if model.score < ordered[0].score + SETTLED]
    near.sort(key=lambda model: place.get((model.names or ("",))[-1], (False, 0)))
    return [*near, *ordered[len(near) :]]


def _best_of_each(models: Sequence[Model]) -> list[Model]:
    """Return the best of the models that end with the same effect, best first."""
    best: dict[str, Model] = {}
    for model in sorted(models, key=lambda one: one.score):
        best.setdefault(model.names[-1], model)
    return list(best.values())
