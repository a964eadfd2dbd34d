"""The whole search in order: record → base model → mean effects → what is left → noise and jumps → gain → answer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np

from rwa_monitor.discrepancy.alignment import Delay
from rwa_monitor.discrepancy.angle_drift import with_angle_drift
from rwa_monitor.discrepancy.angle_lines import AngleLine, angle_line, order_to_try, ripple_with
from rwa_monitor.discrepancy.base_fit import Fit, fit, make_problem, with_noise_of
from rwa_monitor.discrepancy.bench import EVEN_CLOCK, as_measured, not_shown_without_motor
from rwa_monitor.discrepancy.cage import CageBursts, cage_bursts
from rwa_monitor.discrepancy.extended import extend
from rwa_monitor.discrepancy.finished_search import Search
from rwa_monitor.discrepancy.fitting import EQUIVALENT_WITHIN, Fitting, Progress
from rwa_monitor.discrepancy.formulas import describe, formulas
from rwa_monitor.discrepancy.gain import BLOCKS, HeldOut, held_out, held_out_without_jumps, on_other_recordings
from rwa_monitor.discrepancy.jump_terms import JUMP_TERMS, DelayTerm
from rwa_monitor.discrepancy.known_effects import known_delay, records_of
from rwa_monitor.discrepancy.likelihood import ACCEPT_GAIN, Series, fit_noise
from rwa_monitor.discrepancy.mapper import Mapper, in_turn
from rwa_monitor.discrepancy.models import Found, Growth, Model, SearchResult, law_of
from rwa_monitor.discrepancy.noise_effects import noise_effects
from rwa_monitor.discrepancy.other_orders import with_other_orders
from rwa_monitor.discrepancy.p_values import built_in_nulls
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.discrepancy.quantisation import drawn_again, without_rounding
from rwa_monitor.discrepancy.record import Record, delay_of
from rwa_monitor.discrepancy.result import (
    INDISTINGUISHABLE,
    DiscrepancyResult,
    FoundEffect,
    Gain,
    ParameterValue,
    SearchedAgain,
    Unexplained,
    Verdict,
)
from rwa_monitor.discrepancy.score import price, regressors
from rwa_monitor.discrepancy.search import (
    grow,
    prune,
    rank,
    search,
)
from rwa_monitor.discrepancy.slope_jumps import SlopeJumps, shared_strength, with_slope_jumps
from rwa_monitor.discrepancy.switching_effects import switching_effects
from rwa_monitor.discrepancy.testable import speed_curve
from rwa_monitor.discrepancy.uncertainty import ORDER, described, spread
from rwa_monitor.discrepancy.unexplained import judge_leftover, shorter, wandering, with_free_curves, without_unnamed
from rwa_monitor.discrepancy.unnamed import UNNAMED
from rwa_monitor.discrepancy.untested import as_a_part, too_weak_to_show, untested_others
from rwa_monitor.samples import Samples
from rwa_monitor.wheel.effects.base import MeanEffect
from rwa_monitor.wheel.effects.catalogue import CATALOGUE, MEAN_EFFECTS, NOISE_EFFECTS, effect_class
from rwa_monitor.wheel.effects.formula import BLOCK, Formula
from rwa_monitor.wheel.effects.torque_ripple import TorqueRipple
from rwa_monitor.wheel.wheel import Wheel

# All that has columns: mean effects, and effects of jumps that are torques too; some with columns of their own here.
CANDIDATES = tuple({**MEAN_EFFECTS, **{term.name: term for term in (DelayTerm, *JUMP_TERMS)}}.values())
# Fewer samples than this from jump to jump, on average, are no level that could be seen: the steps stand for noise.
SHORTEST_SEGMENTS: Final = 50
# What time or temperature shows while the speed stays as it is.
DRIFT: Final = "run_in_drift"
WARMING: Final = "viscosity_temperature"
FEWEST_FOR_JUMPS: Final = 200  # samples; fewer show no jumps, and no law of the noise: only what acts without jumps
MORE_SAMPLES: Final = f"{FEWEST_FOR_JUMPS} samples or more"
NO_JUMPS: Final = "jumps of the friction: none is seen here"
SHOWN_AT_REST: Final = frozenset({DRIFT, WARMING, "torque_constant_temperature"})


def find_discrepancy(
    recordings: Sequence[tuple[str, Samples]],
    wheel: Wheel,
    progress: Progress = lambda _: None,
    each: Mapper = in_turn,
    held_out_recordings: Sequence[tuple[str, Samples]] = (),
) -> Search:
    """Find what the simulation of a wheel gets wrong.

    Parameters
    ----------
    recordings
        Name and samples of each recording; several are one wheel and give one joint answer.
    wheel
        The wheel's constants. Effects that it already has are part of the base model.
    progress
        Called with a word on each step.
    each
        Applies a function to each candidate, in turn or side by side; the answer does not depend on it.
    held_out_recordings
        Name and samples of further recordings of the wheel: nothing is searched or fitted there, the gain is measured
        on them. None: on held-out blocks of the searched ones.

    Raises
    ------
    InputError
        If a recording cannot be used: no friction, too few samples in motion, wrong units.
    """
    bench = as_measured(recordings, wheel, held_out_recordings)
    wheel, recordings, held_out_recordings = bench.wheel, bench.recordings, bench.held_out
    known = any(block.name == DelayTerm.name for block in wheel.effect)
    delay = known_delay(wheel) if known else delay_of(recordings, wheel)
    problem = prepare(records_of(recordings, wheel, delay), wheel, each)
    aside = prepare(records_of(held_out_recordings, wheel, delay), wheel) if held_out_recordings else None
    named = delay if delay is not None and delay.slots and not known else None
    # What is left of a delay that is taken out is less than a part of a slot.
    missing = [effect for effect in candidates(wheel) if delay is None or effect is not DelayTerm]
    silent = not_shown_without_motor(missing, wheel)
    tried = [effect for effect in missing if _can_show(problem, effect) and effect.name not in silent]
    few = problem.size < FEWEST_FOR_JUMPS
    explained, cage = _explained(problem, tried, progress, wheel)
    problem, found, leftover, complete = explained.problem, explained.found, explained.leftover, explained.complete
    others: list[FoundEffect] = []
    wanders = None
    no_noise = MORE_SAMPLES if few else EVEN_CLOCK if bench.noise_is_made else None
    if no_noise is not None:
        silent |= dict.fromkeys(NOISE_EFFECTS, no_noise)
    elif problem.has_noise:
        in_band, by_law = cage.in_band if cage else (), not explained.jumps and not problem.friction_is_derived
        others += noise_effects(problem, complete, explained=leftover is None, in_band=in_band, by_law=by_law)
        wanders = wandering(problem, complete)
    if leftover is None and wanders is None and explained.jumps:
        others += switching_effects(problem, complete, wheel)
    others += [cage.effect] if cage is not None else []
    if any(effect.name == "tachometer_quantisation" for effect in others):
        leftover = None  # rounding errors follow the acceleration: they are named already
        found = without_rounding(problem, found)
    if not {effect.name for effect in others} & {"tachometer_quantisation", "cage_instability"}:
        leftover = leftover or wanders
    progress("gain on held-out data")
    score = partial(held_out, problem) if aside is None else partial(on_other_recordings, problem, aside)
    scores = tuple(each(score, found.ladder))
    if not explained.jumps and aside is None:
        scores = tuple(held_out_without_jumps(problem, model) for model in found.ladder)
    mean = tuple(_with_warm_up(problem, _describe(problem, found.ladder[-1], entry)) for entry in found.found)
    if named is not None:
        mean = tuple(sorted((*mean, _describe_delay(problem, named)), key=lambda effect: -effect.delta_deviance))
    effects = (*mean, *sorted(others, key=lambda effect: -effect.delta_deviance))
    verdict: Verdict = "inadequate" if effects or leftover is not None else "adequate"
    if verdict == "adequate" and _nothing_could_be_tested(problem, found):
        verdict = "untestable"
    at_base = found.ladder[0]
    if named is not None:  # the base model knows of none: it is judged on what is measured
        base = prepare(records_of(recordings, wheel), wheel)
        at_base = Model((), fit(base))
        scores = (held_out(base, at_base), *scores)
    names = tuple(name for name, _ in held_out_recordings)
    gain = replace(_gain(problem, at_base, found.ladder[-1], scores), held_out=names)
    not_shown = [effect for effect in missing if effect.name not in {one.name for one in tried}]
    listed = _listed(found, mean, dict(_untested(problem, found, tried, wheel)), not_shown)
    result = DiscrepancyResult(verdict, effects, leftover, tuple((dict(listed) | silent).items()), gain)
    delay_s = -named.slots * wheel.sample_period_s if named is not None else None
    return _with_simulated(Search(wheel, problem, found, scores[-len(found.ladder) :], result, delay_s))


def with_search_again(
    search: Search,
    recordings: Sequence[tuple[str, Samples]],
    progress: Progress = lambda _: None,
    each: Mapper = in_turn,
) -> Search:
    """Add what the search finds and gains without the data that it is judged on, see `SearchedAgain`.

    Of several recordings the last is held out, of one every second of `BLOCKS` stretches of time.

    Parameters
    ----------
    search
        The search of all that was given.
    recordings
        Name and samples of each.
    progress, each
        As for `find_discrepancy`.

    Raises
    ------
    InputError
        If too little is left to be searched.
    """
    if search.result.gain is None:
        return search
    *seen, aside = recordings
    if not seen:
        name, samples = aside
        block = np.arange(len(samples)) * BLOCKS // len(samples)
        seen = [(f"{name}, blocks 1, 3, …", samples[block % 2 == 0])]
        aside = f"{name}, blocks 2, 4, … of {BLOCKS}", samples[block % 2 == 1]
    found = find_discrepancy(seen, search.wheel, progress, each, [aside]).result
    if found.gain is None:
        return search
    names = tuple("formula" if one.formula else one.name for one in found.effects if one.family != "noise")
    again = SearchedAgain(
        names,
        (aside[0],),
        found.gain.rmse_base_Nm,
        found.gain.rmse_extended_Nm,
        found.gain.log_score_base,
        found.gain.log_score_extended,
    )
    return replace(search, result=replace(search.result, gain=replace(search.result.gain, searched_again=again)))


def _explained(
    problem: Problem, effects: Sequence[type[MeanEffect]], progress: Progress, wheel: Wheel
) -> tuple[_Explained, CageBursts | None]:
    """Search for mean effects with jumps and without; return the better answer, and the bursts of a cage beside it."""
    if problem.size < FEWEST_FOR_JUMPS:
        few = _without_jumps(problem, None, effects, progress)
        assert few is not None, "nothing else is likelier"
        return few, None
    problem, effects, line = _by_angle(problem, effects, wheel)
    jumping = _explain(problem, effects, progress, wheel)
    smooth = _without_jumps(jumping.problem, jumping.complete, effects, progress)
    if smooth is not None:
        return replace(smooth, leftover=_with_line(line, smooth.leftover)), None
    cage = cage_bursts(jumping.problem, jumping.complete) if jumping.problem.has_noise else None
    if cage is not None:
        # Bursts pass for jumps, and for laws of speed: what is said of anything else is said without them.
        quiet = prepare(cage.quiet(jumping.problem.records), wheel, problem.each)
        jumping = _explain(quiet, effects, progress, wheel)
    return replace(jumping, leftover=_with_line(line, jumping.leftover)), cage


@dataclass(frozen=True, slots=True)
class _Explained:
    """What a search made of the records.

    Attributes
    ----------
    problem
        The data, with the noise that the last model leaves.
    found, leftover
        The mean effects, and what none of them explains.
    complete
        The last model with what is left in it: its residual is noise.
    jumps
        Whether friction may jump.
    """

    problem: Problem
    found: SearchResult
    leftover: Unexplained | None
    complete: Model
    jumps: bool = True


def _without_jumps(
    problem: Problem, jumping: Model | None, effects: Sequence[type[MeanEffect]], progress: Progress
) -> _Explained | None:
    """Search without jumps; None where a model with jumps is more likely by as much as an effect must be.

    Beside what is named with jumps, a free curve over the speed is as good as any law of it: where even that is less
    likely, nothing is searched.
    """
    most = np.inf
    if jumping is not None:
        jumps = jumping.fit.jumps.size
        if jumps * SHORTEST_SEGMENTS <= problem.size:
            most = jumping.score + ACCEPT_GAIN
        if not problem.has_noise or _least_score(problem, jumping) > most:
            return None
    progress("laws without jumps")
    approach = Fitting(problem, jumps=False)
    found = search(approach, [effect for effect in effects if effect.name in MEAN_EFFECTS], progress)
    found, leftover, complete = judge_leftover(approach, found)
    if complete.score > most:
        return None
    problem = with_noise_of(problem, complete.fit.residual)
    explained = _Explained(problem, found, leftover, complete, jumps=False)
    return _with_formula(approach, explained, effects, progress) if leftover is not None else explained


def _least_score(problem: Problem, jumping: Model) -> float:
    """Return a score below which no law of the speed without jumps comes beside the effects of a model with jumps.

    It is that of a free curve which costs nothing.
    """
    series, law = Series.of(problem), law_of(jumping)
    rows, low, high = regressors(series, jumping.terms)
    curve = speed_curve(series)
    free = np.full(curve.shape[0], np.inf)
    rows, low, high = np.vstack([rows, curve]), np.append(low, -free), np.append(high, free)
    return fit_noise(series, rows, low, high, law.apart if series.several else law)[1] + series.log_size * price(())


def _with_simulated(search: Search) -> Search:
    """Add what the wheel file says of the records when it is simulated with the effects that were found."""
    gain = search.result.gain
    if gain is None or not search.extended.terms:
        return search
    gain = replace(gain, simulated=extend(search).simulated)
    return replace(search, result=replace(search.result, gain=gain))


def _by_angle(
    problem: Problem, candidates: Sequence[type[MeanEffect]], wheel: Wheel
) -> tuple[Problem, Sequence[type[MeanEffect]], AngleLine | None]:
    """Take out what repeats with the wheel's angle as no ripple does, or let a ripple have the order that it shows.

    Other names would feed on it. Without noise nothing says what would be chance.

    Returns
    -------
    problem, candidates, line
        The line only where it was taken out of the problem.
    """
    if not problem.has_noise:
        return problem, candidates, None
    base = fit(problem)
    line = angle_line(problem, base)
    if line is not None and line.flips:
        return prepare(line.taken_from(problem.records), wheel, problem.each), candidates, line
    order = line.order if line is not None else order_to_try(problem, base)
    if order is None:
        return problem, candidates, None
    of_any_order = ripple_with(order)
    return problem, [of_any_order if effect is TorqueRipple else effect for effect in candidates], None


def _with_line(line: AngleLine | None, left: Unexplained | None) -> Unexplained | None:
    """Tell a line that was taken out before what is left without it."""
    if line is None:
        return left
    of_line = line.unexplained()
    return of_line if left is None else left.beside(of_line.signature, of_line.size_Nm)


def _can_show(problem: Problem, effect: type[MeanEffect]) -> bool:
    """Return whether the motion can show an effect: at constant speed, friction that is derived shows none of motion.

    All that moves the speed is its noise, which is in the friction, too: it would pass for an effect of motion.
    """
    at_rest = problem.friction_is_derived and _speed_is_constant(problem)
    return not at_rest or effect.name in SHOWN_AT_REST


def _listed(
    found: SearchResult,
    mean: Sequence[FoundEffect],
    untested: dict[str, str],
    not_shown: Sequence[type[MeanEffect]],
) -> tuple[tuple[str, str], ...]:
    """Return what is told to be untested: but for what is told beside a name, and with what the motion cannot show."""
    beside = {name for effect in mean for name in effect.equivalent}
    listed = {name: missing for name, missing in untested.items() if name not in beside}
    for effect in not_shown:
        listed.setdefault(effect.name, as_a_part(effect.separate_by))
    if not found.ladder[-1].fit.jumps.size:
        listed |= {term.name: NO_JUMPS for term in JUMP_TERMS if term.name in listed}
    return tuple(listed.items())


def candidates(wheel: Wheel) -> list[type[MeanEffect]]:
    """Return the effects with columns that the search tries: all that the wheel does not have already."""
    known = {block.name for block in wheel.effect}
    return [effect for effect in CANDIDATES if effect.name not in known]


def _explain(problem: Problem, candidates: Sequence[type[MeanEffect]], progress: Progress, wheel: Wheel) -> _Explained:
    """Search for mean effects beside jumps, and judge what they leave: see `judge_leftover`."""
    candidates = [*candidates, *(effect for effect in UNNAMED if effect.may_show(problem))]
    approach, grown, sloped = _grown(problem, candidates, progress)
    best = sloped or grown.ladder[-1]
    if best.terms:

        def again(other: Problem) -> Fit:
            return Fitting(other, jumps=True).refitted(best.terms, best, [best.fit.jumps]).fit

        drawn = drawn_again(problem, best.fit, again)
        if drawn is not None:
            problem = prepare(drawn, wheel, problem.each)
            approach, grown, sloped = _grown(problem, candidates, progress, best)
    if sloped is not None:
        grown = grow(approach, candidates, progress, _taken_over(approach.problem, sloped))
    found = rank(approach, grown, progress)
    problem = approach.problem
    progress("what is left")
    found, leftover, complete = judge_leftover(approach, found)
    found, leftover = without_unnamed(approach, found, leftover)
    explained = _Explained(problem, found, leftover, complete)
    return _with_formula(approach, explained, candidates, progress) if leftover is not None else explained


def _with_formula(
    approach: Fitting, explained: _Explained, effects: Sequence[type[MeanEffect]], progress: Progress
) -> _Explained:
    """Give what a free curve explains a law, where one is as good: an effect that is as good as any formula, or that.

    Something is missing, as the curve shows: an effect need not prove that again.
    """
    progress("a formula for what has no name")
    found = explained.found
    most = explained.complete.score + EQUIVALENT_WITHIN
    laws, _ = approach.sort_out(formulas(explained.problem), found.ladder[0])
    named, _ = approach.sort_out([effect for effect in effects if effect.name in CATALOGUE], found.ladder[0])
    models = [one for one in approach.extensions(found.ladder[-1], laws) if one.score <= most]
    most = min(most, models[0].score + EQUIVALENT_WITHIN) if models else most
    by_name = [one for one in approach.extensions(found.ladder[-1], named) if one.score <= most]
    models = [one for one in by_name or models if len(one.terms) > len(found.ladder[-1].terms)]
    if not models:
        return explained
    near = [model.names[-1] for model in models[1:] if model.score - models[0].score < EQUIVALENT_WITHIN]
    best = prune(approach, models[0], keep_last=True)  # what was named may have stood in for a part of it
    gain = approach.without(best, len(best.terms) - 1).score - best.score
    names = set(best.names)
    named = (*(one for one in found.found if one.name in names), Found(best.names[-1], gain, tuple(near)))
    found = replace(
        found, ladder=(*shorter(found.ladder, best), best), found=tuple(sorted(named, key=lambda one: -one.gain))
    )
    return replace(explained, found=found, leftover=None, complete=best)


def _grown(
    problem: Problem, candidates: Sequence[type[MeanEffect]], progress: Progress, begin_with: Model | None = None
) -> tuple[Fitting, Growth, Model | None]:
    """Return what grows, and the last model with slopes of its own between jumps where that is better."""
    approach = Fitting(problem, jumps=True)
    grown = grow(approach, candidates, progress, _taken_over(problem, begin_with))
    return approach, grown, _with_slope_jumps(approach, grown, candidates, progress)


def _taken_over(problem: Problem, model: Model | None) -> list[Model]:
    """Return a model of nearly the same data fitted anew, one effect more in each."""
    if model is None:
        return []
    fitting = Fitting(problem, jumps=True)
    return [fitting.refitted(model.terms[: i + 1], model, [model.fit.jumps]) for i in range(len(model.terms))]


def _with_slope_jumps(
    approach: Fitting, grown: Growth, candidates: Sequence[type[MeanEffect]], progress: Progress
) -> Model | None:
    """Return the last model with slopes of its own between jumps, or None; see `with_slope_jumps`."""
    if not any(effect.name == SlopeJumps.name for effect in candidates):
        return None
    progress("slopes between jumps")
    problem = approach.problem

    def rivals(model: Model) -> list[Model]:
        outside = [effect for effect in candidates if effect in UNNAMED and effect.name not in model.names]
        return [*with_free_curves(approach, model), *approach.extensions(model, outside)]

    return with_slope_jumps(problem, grown.ladder[-1], grown.ladder[0], rivals)


def prepare(records: Sequence[Record], wheel: Wheel, each: Mapper = in_turn) -> Problem:
    """Join records to the problem that is searched; `each` applies a function to each of many candidates.

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


def _describe(problem: Problem, model: Model, found: Found) -> FoundEffect:
    index = model.names.index(found.name)
    term = model.terms[index]
    if issubclass(term.effect, SlopeJumps):
        parameters = dict([shared_strength(problem, model, index)])
    else:
        std = spread(problem, model).terms[index]
        parameters = described(problem, term, model.strengths(index), std, effect_class(found.name).parameters)
    if found.name == TorqueRipple.name:
        parameters[ORDER] = with_other_orders(problem, model, index, parameters[ORDER])
    if found.name == WARMING and not problem.at_one_speed:
        parameters = _as_a_part_of(float(model.fit.coefficients[0]), parameters)
    return FoundEffect(
        found.name,
        term.effect.family,
        tuple(name for name in found.equivalent if name in CATALOGUE or name.startswith(f"{BLOCK} ")),
        term.effect.separate_by,
        parameters,
        built_in_nulls().p_value("mean", found.gain, problem.log_size, derived=problem.friction_is_derived),
        found.gain,
        describe(term, model.strengths(index)) if issubclass(term.effect, Formula) else "",
    )


def _as_a_part_of(viscous: float, parameters: dict[str, ParameterValue]) -> dict[str, ParameterValue]:
    """Say where the part of the viscous friction that follows the temperature is more than the whole [N m s/rad].

    Over a few kelvin only the product of strength and activation temperature shows: then the whole tells the strength,
    which the fit does not know to be a part of it.
    """
    (strength, value), *others = parameters.items()
    if value.std is not None and value.value <= viscous + INDISTINGUISHABLE * value.std:
        return parameters
    note = f"more than the whole viscous friction, {viscous:.4g}: not determined, only its product with B is"
    noted = [(name, replace(other, std=None, note=other.note or "not determined")) for name, other in others]
    return {strength: replace(value, std=None, note=note), **dict(noted)}


def _describe_delay(problem: Problem, delay: Delay) -> FoundEffect:
    """Return what is said of a delay of whole slots; the catalogue's is above zero where the current is read early."""
    effect, period_s = CATALOGUE[DelayTerm.name], problem.records[0].channels.sample_period_s
    (parameter,) = effect.parameters
    value = ParameterValue(-delay.slots * period_s, delay.std_slots * period_s, parameter.unit)
    return FoundEffect(
        effect.name,
        effect.family,
        (),
        effect.separate_by,
        {parameter.name: value},
        built_in_nulls().p_value("mean", delay.gain, problem.log_size, derived=problem.friction_is_derived),
        delay.gain,
    )


def _with_warm_up(problem: Problem, effect: FoundEffect) -> FoundEffect:
    """Name warming up beside a drift that came while nobody measured the temperature, at nearly the same speed.

    Viscosity that falls as the bearing warms changes drag with the speed, a bearing that runs in changes it at any: at
    one speed the two are the same curve over time.
    """
    measured = any(record.channels.bearing_temperature_degC is not None for record in problem.records)
    if effect.name != DRIFT or measured or not problem.at_one_speed or WARMING in effect.equivalent:
        return effect
    return replace(effect, equivalent=(*effect.equivalent, WARMING), separate_by=CATALOGUE[WARMING].separate_by)


def _untested(
    problem: Problem, found: SearchResult, candidates: Sequence[type[MeanEffect]], wheel: Wheel
) -> tuple[tuple[str, str], ...]:
    """Return what the records could not test, each effect once, none that was named or could stand for one."""
    model = found.ladder[-1]
    named = {name for entry in found.found for name in (entry.name, *entry.equivalent)}
    listed = {name: missing for name, missing in found.untestable if name in CATALOGUE}
    for name, missing in (*too_weak_to_show(problem, model, candidates), *untested_others(problem, model, wheel)):
        if name not in named:
            listed.setdefault(name, missing)
    return tuple(listed.items())


def _nothing_could_be_tested(problem: Problem, found: SearchResult) -> bool:
    """Say whether the record is blind: speed that does not vary lets no law of speed be tested."""
    return _speed_is_constant(problem) and len(problem.noise.autocovariance) > 0 and not found.found


def _speed_is_constant(problem: Problem) -> bool:
    """Say whether the speed varies by hardly more than its noise."""
    noise = max(record.speed_noise_rad_s for record in problem.records)
    return float(np.std(problem.speed)) < max(1e-3 * float(np.max(problem.speed)), 3 * noise)


def _gain(problem: Problem, at_base: Model, at_end: Model, scores: tuple[HeldOut, ...]) -> Gain:
    base, extended = scores[0], scores[-1]
    return Gain(
        base.rmse_Nm,
        extended.rmse_Nm,
        base.log_score,
        extended.log_score,
        problem.noise.std,
        int(at_base.fit.jumps.size),
        int(at_end.fit.jumps.size),
    )
