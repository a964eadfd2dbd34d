"""The whole search in order: record → base model → mean effects → leftover → noise and jumps → gain → answer."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from rwa_monitor.discrepancy.alignment import Delay, find_delay
from rwa_monitor.discrepancy.base_fit import fit
from rwa_monitor.discrepancy.bench import EVEN_CLOCK, as_measured, lost_without_motor
from rwa_monitor.discrepancy.derived_friction import Motion, with_fitting_window
from rwa_monitor.discrepancy.explanation import Explained, explain, prepare
from rwa_monitor.discrepancy.extended import extend
from rwa_monitor.discrepancy.fitting import Progress
from rwa_monitor.discrepancy.found_effects import found_delay, found_effect, found_zone, joined
from rwa_monitor.discrepancy.hypotheses import NOT_COMMANDED, candidates, is_observable, speed_is_constant, untested
from rwa_monitor.discrepancy.jump_terms import DelayTerm
from rwa_monitor.discrepancy.noise_effects import noise_effects, with_even_noise
from rwa_monitor.discrepancy.problem import Mapper, Problem, in_turn
from rwa_monitor.discrepancy.quantisation import without_rounding, without_steps
from rwa_monitor.discrepancy.record import FEWEST_FOR_JUMPS, Record, make_record, motions_of, without_known_effects
from rwa_monitor.discrepancy.result import DiscrepancyResult, FoundEffect, Search, Verdict
from rwa_monitor.discrepancy.score import BLOCKS, HeldOut, at_best, held_out, on_other_recordings, scored
from rwa_monitor.discrepancy.switching_effects import switching_effects
from rwa_monitor.discrepancy.terms import Model
from rwa_monitor.discrepancy.unexplained import combined, slow_drag
from rwa_monitor.messages import Gain, SearchedAgain, Unexplained
from rwa_monitor.samples import IntArray, Samples
from rwa_monitor.wheel.effects.catalogue import NOISE_EFFECTS, effect_class
from rwa_monitor.wheel.wheel import Wheel

SPEED_BLOCKS: Final = 5  # ranges of speed, three of which are searched
MORE_SAMPLES: Final = f"{FEWEST_FOR_JUMPS} samples or more"


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
        Name and samples of each recording; several are of one wheel and give one joint answer.
    wheel
        The wheel's constants. Effects that it already has are part of the base model.
    progress
        Called with a short text at each step.
    each
        Applies a function to each candidate, in turn or in parallel; the answer does not depend on it.
    held_out_recordings
        Name and samples of further recordings of the wheel, which are not searched: the gain is measured on them. If
        there are none, it is measured on held-out blocks of the searched ones.

    Raises
    ------
    InputError
        If a recording cannot be used: no friction, too few samples in motion, wrong units.
    """
    bench = as_measured(recordings, wheel, held_out_recordings)
    motions = motions_of(bench.recordings, bench.wheel)
    is_stated = "window_s" in wheel.friction.derivative.model_fields_set
    wheel = bench.wheel if is_stated else with_fitting_window(motions, bench.wheel)
    delay = _delay(motions, wheel)
    problem = prepare(_records_of(bench.recordings, wheel, delay), wheel, each)
    aside = prepare(_records_of(bench.held_out, wheel, delay), wheel) if bench.held_out else None
    # DelayTerm is tried if no delay is known, or after one of whole slots was removed: a part of a slot may be left.
    # Else the place of a sample within its slot is corrected already, and would be mistaken for a delay.
    left = delay is None or delay.late_slots == delay.slots != 0
    missing = [effect for effect in candidates(wheel, problem) if effect is not DelayTerm or left]
    silent = lost_without_motor(missing, wheel, problem.records[0].channels)
    tried = [effect for effect in missing if effect.name not in silent and is_observable(problem, effect)]
    no_noise = MORE_SAMPLES if problem.size < FEWEST_FOR_JUMPS else EVEN_CLOCK if bench.noise_is_correlated else None
    no_noise = NOT_COMMANDED if problem.is_command else no_noise
    if no_noise is not None:
        silent |= dict.fromkeys(NOISE_EFFECTS, no_noise)

    explained = explain(problem, tried, progress, wheel)
    problem = explained.problem
    others, explained = _noise_and_jumps(explained, wheel, with_noise=no_noise is None and problem.has_noise)
    found = explained.found
    named = delay if delay is not None and delay.late_slots and not _known_delays(wheel) else None
    shown = [found_delay(problem, named)] if named is not None else []
    if (zone := found_zone(problem, wheel)) is not None:
        shown.append(zone)
    mean = joined([*shown, *(found_effect(problem, found.nested[-1], entry) for entry in found.found)])
    effects = tuple(one for of in (mean, others) for one in sorted(of, key=lambda effect: -effect.delta_deviance))
    not_shown = [effect for effect in missing if effect not in tried]
    lacking = untested(problem, found, mean, wheel, tried, not_shown) | silent

    progress("gain on held-out data")
    judge: Callable[[Model], HeldOut] = partial(held_out, problem)
    if aside is not None:
        judge = partial(on_other_recordings, problem, aside, jumps=explained.jumps)
    scores, at_base = each(partial(at_best, judge, problem), found.nested), found.nested[0]
    if named is not None:  # the base model has no delay: it is scored on the data as measured
        base = prepare(_records_of(bench.recordings, wheel, None), wheel)
        at_base = scored(base, (), fit(base).jumps)
        scores = [at_best(partial(held_out, base), base, at_base), *scores]
    gain = _gain(problem, at_base, found.nested[-1], scores, [name for name, _ in bench.held_out])
    verdict: Verdict = "inadequate" if effects or explained.leftover is not None else "adequate"
    if verdict == "adequate" and speed_is_constant(problem):
        verdict = "untestable"  # no law of the speed is identifiable at constant speed
    result = DiscrepancyResult(verdict, effects, explained.leftover, tuple(lacking.items()), gain)
    taken_out = tuple(effect_class(one.name)(**{key: of.value for key, of in one.parameters.items()}) for one in shown)
    search = Search(wheel, problem, found, tuple(scores[-len(found.nested) :]), result, taken_out)
    return _with_gain(search, simulated=extend(search).simulated) if search.extended.terms else search


def with_search_again(
    search: Search,
    recordings: Sequence[tuple[str, Samples]],
    progress: Progress = lambda _: None,
    each: Mapper = in_turn,
) -> Search:
    """Search a part of the data, and add the effects found and their gain on the rest, see `SearchedAgain`.

    Of several recordings the last is held out; of one, every second of `BLOCKS` segments of time, and in a separate
    search every second of `SPEED_BLOCKS` ranges of |ω| with as many samples each, not the slowest and the fastest.

    Parameters
    ----------
    search
        The search of all the data.
    recordings
        Name and samples of each.
    progress, each
        As for `find_discrepancy`.

    Raises
    ------
    InputError
        If too little is left to be searched.
    """

    def again(seen: Sequence[tuple[str, Samples]], aside: tuple[str, Samples]) -> SearchedAgain:
        """Search a part of the data, and judge on the rest."""
        found = find_discrepancy(seen, search.wheel, progress, each, [aside]).result
        names = ["formula" if one.formula else one.name for one in found.effects if one.family != "noise"]
        scores = found.gain.model_dump(include=set(SearchedAgain.model_fields) - {"held_out"})
        return SearchedAgain(effects=names, held_out=[aside[0]], **scores)

    *seen, (name, samples) = recordings
    if seen:
        return _with_gain(search, searched_again=again(seen, (name, samples)))

    def of_every_second(rank: IntArray, blocks: int, unit: str) -> SearchedAgain:
        kept = rank * blocks // rank.size % 2 == 0
        part, rest = f"{name}, {unit} 1, 3, …", f"{name}, {unit} 2, 4, … of {blocks}"
        return again([(part, samples[kept])], (rest, samples[~kept]))

    by_time = of_every_second(np.arange(len(samples)), BLOCKS, "blocks")
    by_speed = of_every_second(np.argsort(np.argsort(np.abs(samples.speed_rad_s))), SPEED_BLOCKS, "speeds")
    return _with_gain(search, searched_again=by_time, searched_again_by_speed=by_speed)


def _known_delays(wheel: Wheel) -> list[float]:
    return [block.parameters["strength_s"] for block in wheel.effect if block.name == DelayTerm.name]


def _delay(motions: Sequence[Motion], wheel: Wheel) -> Delay | None:
    """Return the delay of the current as the wheel file has it, in whole slots, or as the recordings show it."""
    known = _known_delays(wheel)
    if not known:
        return find_delay(motions, wheel)
    slots = -round(sum(known) / wheel.sample_period_s)
    return Delay(slots, 0.0, slots, 0.0, 0.0) if slots else None


def _records_of(recordings: Sequence[tuple[str, Samples]], wheel: Wheel, delay: Delay | None) -> list[Record]:
    """Make records less the effects in the wheel file and a delay of the current, and with coarse rounding undone."""
    if delay is not None:  # removed from the torque itself: the effect in the file would remove it a second time
        wheel = wheel.model_copy(update={"effect": tuple(b for b in wheel.effect if b.name != DelayTerm.name)})
    records = [make_record(samples, wheel, name, delay) for name, samples in recordings]
    return without_steps([without_known_effects(record, wheel) for record in records], wheel)


def _noise_and_jumps(explained: Explained, wheel: Wheel, *, with_noise: bool) -> tuple[list[FoundEffect], Explained]:
    """Return the noise and switching effects, and the explanation without a leftover that these account for."""
    problem, complete, cage = explained.problem, explained.complete, explained.cage
    others: list[FoundEffect] = []
    drift: Unexplained | None = None
    in_band = cage.in_band if cage else ()
    if with_noise:
        by_law = not explained.jumps and not problem.friction_is_derived
        others += noise_effects(problem, complete, in_band=in_band, by_law=by_law)
        drift = slow_drag(problem, complete)
    if explained.leftover is None and drift is None and explained.jumps:
        # The attribution of the jumps assumes even noise: it would take the samples of a noisy band for jumps.
        others += switching_effects(problem, with_even_noise(problem, complete, others), wheel, in_band)
    if cage is not None:
        others.append(cage.effect)
    classes = [effect_class(effect.name) for effect in others]
    if any(effect.follows_acceleration for effect in classes):  # a curve over the acceleration repeats such an effect
        return others, replace(explained, found=without_rounding(problem, explained.found), leftover=None)
    if not any(effect.comes_and_goes for effect in classes):
        explained = replace(explained, leftover=combined(drift, explained.leftover))
    return others, explained


def _with_gain(search: Search, **more: object) -> Search:
    """Add to the gain of a search."""
    return replace(search, result=replace(search.result, gain=search.result.gain.model_copy(update=more)))


def _gain(
    problem: Problem, at_base: Model, at_end: Model, scores: Sequence[HeldOut], held_out_names: list[str]
) -> Gain:
    base, extended = scores[0], scores[-1]
    return Gain(
        rmse_base_Nm=base.rmse_Nm,
        rmse_extended_Nm=extended.rmse_Nm,
        log_score_base=base.log_score,
        log_score_extended=extended.log_score,
        noise_std_Nm=problem.noise.std,
        changepoints_base=int(at_base.fit.jumps.size),
        changepoints_extended=int(at_end.fit.jumps.size),
        diagnosis=None,
        held_out=held_out_names,
    )
