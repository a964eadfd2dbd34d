"""Make models with or without jumps of the friction, extend them by effects, exchange these, and fit each by one score.

A candidate is screened with the noise and the jumps of the model that it extends; for the best candidates, shapes,
noise and jumps are then fitted in turn. Friction of small wheels jumps, and dozens of false jumps approximate a missing
smooth effect: so a candidate starts from several sets of jumps, with a high price per jump at first. Friction of larger
machines is often smooth, with autocorrelated noise: there the noise must not be estimated from the residual of the base
law, and slow noise must not be segmented into jumps.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from rwa_monitor.discrepancy.base_fit import ANNEALING, fit, jump_price, jump_sets, segment_records, with_noise_of
from rwa_monitor.discrepancy.hypotheses import split_testable
from rwa_monitor.discrepancy.likelihood import LONG_MEMORY, NO_JUMPS, ROUNDS, NoiseLaw, Series
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.discrepancy.score import Background, held_out, off_reversals, scored, with_exact_jumps, with_law
from rwa_monitor.discrepancy.shape_profile import profile, shape_limits
from rwa_monitor.discrepancy.terms import Model, Term, depends_on_level, make_term
from rwa_monitor.samples import TINY, FloatArray, IntArray
from rwa_monitor.wheel.effects.base import MeanEffect

Progress = Callable[[str], None]
Effects = Sequence[type[MeanEffect]]

EQUIVALENT_WITHIN: Final = 10.0  # of the score: docs/theory.md, "Discrepancy search", step 4
CANDIDATES_FITTED: Final = 4  # best candidates of the screening from each start, which are fitted
CANDIDATES_REFINED: Final = 5  # best candidates after segmentation, whose shapes and noise are refitted
LEAST_GAIN_SHARE: Final = 0.25  # of the largest gain: with less, no candidate became the best by a refinement
SETTLED: Final = 0.5  # change of a score, or a log-likelihood, below which a fit has converged
STEP: Final = 0.25  # of a column's range: a larger change from one sample to the next is a step
AT_STEP: Final = 8  # samples: a jump so near to a step of a column may be the same event
MOST_TRIED: Final = 60  # thresholds; fewer than twice as many where there are more jumps
FEWEST_CROSSED: Final = 2  # jumps that a threshold must explain: a single one is no evidence
MOST_RSS_RATIO: Final = 1.1  # of sums of squares: in slow noise the right law may leave a few per cent more by chance
LEAST_CORRELATION: Final = 0.5  # correlation of neighbouring samples from which noise is not taken as white
NOISE_UPDATE_RATIO: Final = 0.9  # of long-run variances: below it, the residual of a model gives a new noise estimate
MOST_BLOCKS: Final = 8  # of ten: by chance alone, so many are better in about one case of twenty


class Fitting:
    """Makes and fits models of the same data.

    Attributes
    ----------
    problem
        The data, with the noise estimated from the residual of an accepted model, see `settled`.
    jumps
        Whether friction may jump.
    """

    def __init__(self, problem: Problem, *, jumps: bool) -> None:
        self.problem = problem
        self.jumps = jumps
        self._known: dict[Hashable, tuple[Sequence[Term], Model]] = {}  # results of `without`
        self._replaced: dict[tuple[int, int], tuple[Model, list[Model]]] = {}  # and of `replacements`

    def base(self) -> Model:
        """Return the model with dry and viscous friction alone."""
        if not self.jumps:
            return self.refined(self._annealed((), [NO_JUMPS], NoiseLaw()))
        problem, start = self.problem, fit(self.problem)
        jumps = off_reversals(problem, start.level + start.residual, start.jumps)
        base = with_exact_jumps(problem, scored(problem, (), jumps))
        memory = _ar1_coefficient(base.fit.residual)
        if not problem.has_noise or memory < LEAST_CORRELATION:
            return base
        # Jumps hidden in autocorrelated noise lengthen its fitted memory: that of neighbours is tried, too.
        start_law = NoiseLaw(white=0.0, correlation=memory)
        other = with_exact_jumps(problem, with_law(problem, (), base.fit.jumps, start_law))
        return min(base, with_exact_jumps(problem, scored(problem, (), other.fit.jumps)), key=lambda one: one.score)

    def split_testable(self, effects: Effects, base: Model) -> tuple[list[type[MeanEffect]], list[tuple[str, str]]]:
        """Split effects into those that the data can test, and the names of the others with what is missing.

        Where friction may jump, an effect must differ from a level per recording; jumps may absorb still more.
        """
        problem = self.problem
        known = Series.of(problem).base
        if self.jumps:
            of = np.repeat(np.arange(len(problem.records)), np.diff(problem.starts))
            known = np.vstack([problem.speed, *(of == record for record in np.unique(of))]) * problem.sign
        return split_testable(problem, known, effects, base.fit.level)

    def settled(self, model: Model) -> Model:
        """Return an accepted model, fitted to convergence if it is without jumps.

        With jumps, the noise estimate, which sets their price, is replaced by that of its residual if that is smaller.
        """
        if not self.jumps:  # shapes and a law of several parameters settle slowly
            return min(model, self.refined(model), key=lambda one: one.score)
        calmer = with_noise_of(self.problem, model.fit.residual)
        if calmer.noise.long_run_variance < NOISE_UPDATE_RATIO * self.problem.noise.long_run_variance:
            self.problem, self._known, self._replaced = calmer, {}, {}
        return model

    def extensions(self, current: Model, effects: Effects, *, all_of_them: bool = False) -> list[Model]:
        """Return the model with one effect more, for each of the most promising effects, best first.

        Without jumps, also the model with separate levels of the recordings, which is one more hypothesis.
        `all_of_them`: also those whose effect does not count, see `counts`.
        """
        models = self._extended(current, effects, all_of_them=all_of_them)
        if not self.jumps and Series.of(self.problem).several and current.law.level_spread == 0.0:
            models.append(self.refined(self._annealed(current.terms, [NO_JUMPS], current.law.separate_levels)))
        return _in_order(models, effects)

    def counts(self, model: Model, current: Model) -> bool:
        """Return whether the last effect of a model is not minor (`Model.is_minor`) and predicts held-out data."""
        return not model.is_minor(-1, self.problem.sign) and self.predicts(model, current)

    def predicts(self, model: Model, simpler: Model) -> bool:
        """Return whether a model predicts held-out blocks better than a simpler one does, or has fewer jumps.

        Better is a smaller RMSE, or a higher log score, of all blocks or in MOST_BLOCKS of them: a block at the end of
        a sweep is an extrapolation. A few samples at changes of direction may decide the RMSE, the noise law the log
        score.
        """
        if model.fit.jumps.size < simpler.fit.jumps.size:
            return True
        with_it, without = held_out(self.problem, model), held_out(self.problem, simpler)
        likelier = np.count_nonzero(with_it.block_log_scores > without.block_log_scores)
        better = with_it.rmse_Nm < without.rmse_Nm or with_it.log_score > without.log_score
        return better or bool(likelier >= MOST_BLOCKS)

    def replacements(self, model: Model, index: int, effects: Effects) -> list[Model]:
        """Return the model with each effect that comes near to term `index` in place of that term, best first."""
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
        key = tuple(map(id, terms)), jumps.tobytes(), model.law
        if key not in self._known:
            self._known[key] = terms, self.refitted(terms, model, [jumps])
        return self._known[key][1]

    def refitted(self, terms: Sequence[Term], near: Model, jumps: Sequence[IntArray] = ()) -> Model:
        """Fit a model with other terms than a similar one, from these jumps or from sets of the similar one's jumps.

        Those include subsets, since the new terms may explain some of the jumps, see `jump_sets`.
        """
        return self.refined(self.refitted_roughly(terms, near, jumps))

    def refitted_roughly(self, terms: Sequence[Term], near: Model, jumps: Sequence[IntArray] = ()) -> Model:
        """Return what `refitted` refines: a model with the shapes as given and the noise law of the similar model."""
        return self._annealed(tuple(terms), jumps or self._starts(near), near.law)

    def with_common_level(self, model: Model) -> list[Model]:
        """Return the model with one level for all recordings, not separate ones; none where it has jumps, or one."""
        if self.jumps or model.law.level_spread == 0.0:
            return []
        return [self.refined(self._annealed(model.terms, [NO_JUMPS], replace(model.law, level_spread=0.0)))]

    def equivalents(self, model: Model, index: int, effects: Effects) -> list[str]:
        """Return the names of effects that are as good in place of a term, with jumps and level of the model kept.

        Fitted without the term, levels absorb part of it where changes of direction separate them, as in a few dwells:
        a column that follows the level then follows that part, too, and `replacements` does not find its effect.
        """
        term = model.terms[index]
        unresolved = {term.effect.unresolved_as(one.channels, term.shape) for one in self.problem.records}
        names = [name for name in unresolved if name and len(unresolved) == 1]
        if self.jumps:
            names += self.substitutes(model, index, [effect for effect in effects if effect.name not in model.names])
        return names

    def substitutes(self, model: Model, index: int, effects: Effects) -> list[str]:
        """Return the names of effects that are as good in place of a term, with jumps, level and noise kept."""
        others = model.terms[:index] + model.terms[index + 1 :]
        beside = Background.of(self.problem, others, model.law, model.fit.jumps)
        most = beside.criterion_with(model.terms[index]) + EQUIVALENT_WITHIN
        tried = self.problem.each(partial(profile, beside, model.fit.level), effects)
        return [one.effect.name for one, score in tried if score < most]

    def _starts(self, model: Model) -> list[IntArray]:
        """Return the sets of jumps from which the fit of a similar model starts."""
        if not self.jumps:
            return [NO_JUMPS]
        return jump_sets(self.problem, model.fit)

    def _extended(
        self, current: Model, effects: Effects, instead: Term | None = None, *, all_of_them: bool = False
    ) -> list[Model]:
        """Return the model with each of the most promising effects; `instead` of a term, each that comes near it."""
        law, missing = current.law, [effect for effect in effects if effect.name not in current.names]
        starts = [(law, jumps) for jumps in self._starts(current)]
        if not self.jumps:  # slow noise may have absorbed the effect: screen in white noise, too
            starts.append((replace(law, white=1.0, correlation=0.0), NO_JUMPS))
        tried: list[tuple[Term, IntArray]] = []
        for one, jumps in starts:
            beside = Background.of(self.problem, current.terms, one, jumps)
            most = np.inf
            if instead is not None:
                most = 0.5 * (beside.criterion_with() + beside.criterion_with(instead))
            scores = self.problem.each(partial(profile, beside, current.fit.level), missing)
            ranked = sorted(scores, key=lambda entry: entry[1])[:CANDIDATES_FITTED]
            tried += [(term, jumps) for term, score in ranked if score < most]
        for effect in missing:
            tried += self._at_thresholds(current, effect)
        started = self.problem.each(lambda entry: self._annealed((*current.terms, entry[0]), entry[1:], law), tried)
        if self.jumps:
            started = _best_of_each(started)[:CANDIDATES_REFINED]
            gain = max((current.score - one.score for one in started), default=0.0)
            started = [one for one in started if gain < 0.0 or current.score - one.score >= LEAST_GAIN_SHARE * gain]
        refined = self.problem.each(lambda one: self._plainer_shape(self.refined(one)), started)
        possible = [one for one in refined if one.is_possible and _fits_as_well(one, current)]
        return _best_of_each([one for one in possible if all_of_them or self.counts(one, current)])

    def _at_thresholds(self, current: Model, effect: type[MeanEffect]) -> list[tuple[Term, IntArray]]:
        """Return an effect at its best threshold speed, and the jumps that it does not explain; empty if there is none.

        A profile over the threshold has no gradient: next to the true value no jump is explained. But the jumps that
        crossing the threshold makes lie at its speed: the speeds of the jumps are tried.
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
                score = Background.of(problem, current.terms, current.law, left).criterion_with(term)
                best, found = min((best, found), (score, [(term, left)]), key=lambda one: one[0])
        return found

    def _plainer_shape(self, model: Model) -> Model:
        """Return the model with the plainer shape of its last term, where that loses less than EQUIVALENT_WITHIN."""
        *chosen, last = model.terms
        shape = last.effect.plainer_shape(last.shape)
        if shape is None:
            return model
        term = make_term(self.problem, last.effect, {**last.shape, **shape}, model.fit.level)
        plainer = self.refitted((*chosen, term), model, [model.fit.jumps])
        return plainer if plainer.score < model.score + EQUIVALENT_WITHIN else model

    def _annealed(self, terms: tuple[Term, ...], starts: Sequence[IntArray], law: NoiseLaw) -> Model:
        """Return the best model under a noise law, with one of these sets of jumps or with those segmented from there.

        Segmentation starts from each set, with a falling price of a jump; different starts soon reach the same jumps.
        """
        known: dict[bytes, Model] = {}

        def beside(jumps: IntArray) -> Model:
            """Return the model with these jumps."""
            key = jumps.tobytes()
            if key not in known:
                known[key] = with_law(self.problem, terms, jumps, law)
            return known[key]

        reached = [beside(jumps) for jumps in starts]
        for price_factor in ANNEALING if self.jumps else ():
            found = [beside(self._segmented(one, price_factor)) for one in reached]
            reached = list({id(one): one for one in found}.values())
        return min(known.values(), key=lambda one: one.score)

    def _segmented(self, model: Model, price_factor: float = 1.0) -> IntArray:
        """Return the best jumps given a model's coefficients, in white noise of the same long-run variance."""
        along = model.fit.level + model.fit.residual
        jumps = segment_records(self.problem, along, price_factor * jump_price(self.problem))
        return off_reversals(self.problem, along, jumps)

    def refined(self, model: Model) -> Model:
        """Return a model with shapes, noise and jumps fitted in turn."""
        best, least = model, np.inf
        for _ in range(ROUNDS):
            model = scored(self.problem, model.terms, model.fit.jumps, model.law, again=self.jumps)
            gained = least - model.score
            if gained > 0.0:
                best, least = model, model.score
            if gained < SETTLED or not any(term.shape or depends_on_level(term.effect) for term in model.terms):
                break
            model = self._reshaped(model)
            if self.jumps:
                segmented = with_law(self.problem, model.terms, self._segmented(model), model.law)
                model = min(model, segmented, key=lambda one: one.score)
        return self._with_own_level(with_exact_jumps(self.problem, best) if self.jumps else best)

    def _with_own_level(self, model: Model) -> Model:
        """Return a model whose level-dependent columns follow its own level, not that of the model before."""
        for _ in range(ROUNDS if any(depends_on_level(term.effect) for term in model.terms) else 0):
            followed = with_law(self.problem, self._with_updated_columns(model), model.fit.jumps, model.law)
            change, model = abs(followed.score - model.score), followed
            if change < SETTLED:
                break
        return model

    def _with_updated_columns(self, model: Model) -> tuple[Term, ...]:
        """Return the terms of a model, level-dependent columns made anew from its level and its effects' torque."""
        problem, fit = self.problem, model.fit
        beside = problem.z - fit.level - fit.residual - fit.coefficients[0] * problem.speed
        return tuple(
            make_term(problem, term.effect, term.shape, fit.level, beside) if depends_on_level(term.effect) else term
            for term in model.terms
        )

    def _reshaped(self, model: Model) -> Model:
        """Return a model with the shape of each term optimised given the other terms.

        A jump at a step of a term's own columns may be that step: it is removed where that lowers the score.
        """
        terms, jumps = list(self._with_updated_columns(model)), model.fit.jumps
        for i, term in enumerate(terms):
            if term.shape:
                others = (*terms[:i], *terms[i + 1 :])
                fitted = []
                for kept in _distinct(jumps, off_steps(term, jumps)):
                    beside = Background.of(self.problem, others, model.law, kept)
                    fitted.append((*profile(beside, model.fit.level, term.effect, around=term), kept))
                terms[i], _, jumps = min(fitted, key=lambda one: one[1])
        fewer = jumps
        for term in terms:
            fewer = off_steps(term, fewer) if term.shape else fewer
        models = [with_law(self.problem, terms, kept, model.law) for kept in _distinct(jumps, fewer)]
        return min(models, key=lambda one: one.score)


def _distinct(jumps: IntArray, fewer: IntArray) -> list[IntArray]:
    """Return jumps and a subset of them, once where they are the same."""
    return [jumps] if fewer.size == jumps.size else [jumps, fewer]


def _ar1_coefficient(residual: FloatArray) -> float:
    """Return φ of AR(1) noise from the median absolute differences over one sample and over two.

    The ratio of their squares is 1 + φ; jumps hardly change medians, as few differences contain one.
    """
    near, far = (float(np.median(np.abs(residual[lag:] - residual[:-lag]))) for lag in (1, 2))
    return float(np.clip(far**2 / max(near**2, TINY) - 1.0, 0.0, LONG_MEMORY))


def _fits_as_well(model: Model, current: Model) -> bool:
    """Return whether a model has fewer jumps than the current one, or at most MOST_RSS_RATIO times its sum of squares.

    In noise of long correlation, the likelihood depends on the differences of neighbouring samples: a law may fit those
    and predict a slow friction that is not there.
    """
    return model.fit.jumps.size < current.fit.jumps.size or model.fit.rss <= MOST_RSS_RATIO * current.fit.rss


def off_steps(term: Term, jumps: IntArray) -> IntArray:
    """Return the jumps that are not near a step of a term's own columns, as at a threshold of the speed."""
    if depends_on_level(term.effect):
        return jumps
    change = np.abs(np.diff(term.columns, axis=0))
    steps = np.flatnonzero((change > STEP * np.ptp(term.columns, axis=0)).any(axis=1)) + 1
    nearest = np.searchsorted(steps, jumps + AT_STEP, side="right") - np.searchsorted(steps, jumps - AT_STEP)
    return np.asarray(jumps[nearest == 0])


def _in_order(models: Sequence[Model], effects: Effects) -> list[Model]:
    """Return models, best first; those within SETTLED of the best are ordered by their last effect, the plainest first.

    An effect that depends on the dry level is less plain than one that does not; then the order of `effects` decides.
    """
    place = {effect.name: (depends_on_level(effect), number) for number, effect in enumerate(effects)}
    near = min((model.score for model in models), default=0.0) + SETTLED

    def key(model: Model) -> tuple[float, tuple[bool, int], float]:
        return max(model.score, near), place.get((model.names or ("",))[-1], (False, 0)), model.score

    return sorted(models, key=key)


def _best_of_each(models: Sequence[Model]) -> list[Model]:
    """Return the best of the models that end with the same effect, best first."""
    best: dict[str, Model] = {}
    for model in sorted(models, key=lambda one: one.score):
        best.setdefault(model.names[-1], model)
    return list(best.values())
