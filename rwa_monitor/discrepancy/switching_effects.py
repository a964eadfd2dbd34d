"""Switching effects: possible causes of the jumps that the mean effects leave, judged by one likelihood.

The diagnosis's own search attributes the jumps to the wheel's switching systems and returns the log-likelihood of its
best attribution. With an additional system, or with other laws of duration, it attributes them anew and returns the
log-likelihood of the same data, so that the hypotheses compare as models do. Each alternative's parameters and
attribution are found alternately (hard expectation maximisation, as in Viterbi training: Juang & Rabiner, IEEE Trans.
ASSP 38, 1990).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np

from rwa_monitor.changepoints.evidence import WindowAccumulator
from rwa_monitor.changepoints.stage_results import UNATTRIBUTED, Assignment, Evidence
from rwa_monitor.discrepancy.base_fit import REVERSAL
from rwa_monitor.discrepancy.fitting import EQUIVALENT_WITHIN, SETTLED
from rwa_monitor.discrepancy.likelihood import ROUNDS
from rwa_monitor.discrepancy.noise_effects import accepted
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.discrepancy.result import FoundEffect
from rwa_monitor.discrepancy.terms import Model
from rwa_monitor.samples import BoolArray, FloatArray, IntArray
from rwa_monitor.switching.assignment import assign, window_priors
from rwa_monitor.switching.duration_likelihoods import log_probability
from rwa_monitor.switching.friction_model import Priors
from rwa_monitor.wheel.effects.base import LikelihoodFit
from rwa_monitor.wheel.effects.catalogue import SWITCHING_EFFECTS
from rwa_monitor.wheel.effects.jumps import FEWEST_SOJOURNS, SpeedTriggeredJumps, WrongDurationLaw, weibull_of_mean
from rwa_monitor.wheel.effects.switching_base import Jumps, Sojourns, SwitchingEvidence
from rwa_monitor.wheel.wheel import FrictionRange, SwitchingSystem, Wheel

EXTRA, WRONG_LAW, SPEED = NAMES = "extra_switching_system", "wrong_duration_law", "speed_triggered_jumps"
MOST_JUMPS: Final = 400  # more are no jumps, and their attribution is meaningless
FEWEST_OF_EXTRA: Final = 3  # jumps that suggest an additional system
FIRST_FACTORS: Final = (0.2, 0.5, 1.0, 2.5)  # of the known mean durations, memoryless: starts of the iteration
SIZES_OF_EXTRA: Final = (0.75, 1.25)  # times the median size: the range in the catalogue
TYPICAL_OF_EXTRA: Final = (0.1, 0.9)  # quantiles of the sizes found: some are of several simultaneous jumps
SIZE_MARGIN: Final = 0.05  # relative, beyond those quantiles or the sizes of the wheel file
EXTRA_PARAMETERS: Final = 6  # two durations and their shape, two limits of the sizes, and the system's existence


@dataclass(frozen=True, slots=True)
class _Attributed:
    """A wheel as a hypothesis changes it, and the result of the attribution with it."""

    wheel: Wheel
    assignment: Assignment

    @property
    def score(self) -> float:
        return self.assignment.log_score

    def under(self, wheel: Wheel, slots: int) -> _Attributed:
        """Return the same sojourns, scored under other laws of duration of the same systems."""
        score = self.score + self._log_durations(wheel, slots) - self._log_durations(self.wheel, slots)
        return _Attributed(wheel, replace(self.assignment, log_score=score))

    def _log_durations(self, wheel: Wheel, slots: int) -> float:
        sojourns = zip(wheel.fss, self.assignment.configurations, self.assignment.starts, strict=True)
        return sum(log_probability(system, q, starts, slots, None) for system, q, starts in sojourns)

    def sojourns(self, system: int) -> Sojourns:
        """Return the complete sojourns of one system, without the first and the last, which are truncated."""
        starts, q = self.assignment.starts[system], self.assignment.configurations[system]
        return Sojourns(starts[1:-1], q[1:-1], np.diff(starts)[1:])


def switching_effects(
    problem: Problem, model: Model, wheel: Wheel, in_band: Sequence[BoolArray] = ()
) -> list[FoundEffect]:
    """Return the switching effect that explains the jumps best; those that explain them as well are its equivalents.

    `in_band`: for each record bool (slots,), the band of a cage. There the drag comes and goes with its bursts, and a
    sojourn that ends there unobserved seems too long: only an additional system is tested.
    """
    found = accepted(problem, fits_of_jumps(problem, model, wheel, in_band))
    if not found:
        return []
    near = found[0].delta_deviance - EQUIVALENT_WITHIN
    return [replace(found[0], equivalent=tuple(effect.name for effect in found[1:] if effect.delta_deviance > near))]


def fits_of_jumps(
    problem: Problem, model: Model, wheel: Wheel, in_band: Sequence[BoolArray] = ()
) -> dict[str, list[LikelihoodFit]]:
    """Fit each switching effect to each record."""
    hidden = _is_between_levels(problem, model)
    if in_band:
        bands = (band[record.used] for band, record in zip(in_band, problem.records, strict=True))
        hidden |= np.concatenate(list(bands))
    fitted = [_fit_record(problem, model, wheel, index, hidden) for index in range(len(problem.records))]
    return {name: [of[name] for of in fitted] for name in (NAMES[:1] if in_band else NAMES)}


def _fit_record(
    problem: Problem, model: Model, wheel: Wheel, index: int, hidden: BoolArray
) -> dict[str, LikelihoodFit]:
    """Fit each switching effect to the jumps of a record, attributed where the wheel has switching systems."""
    record = problem.records[index]
    begin, end = int(problem.starts[index]), int(problem.starts[index + 1])
    found = model.fit.jumps[(model.fit.jumps > begin) & (model.fit.jumps < end)]
    evidence = SwitchingEvidence(
        record.channels,
        record.used,
        Jumps(problem.slot[found], model.fit.level[found] - model.fit.level[found - 1]),
        systems={system.name: system for system in wheel.fss},
    )
    nothing = {name: SWITCHING_EFFECTS[name].nothing_found() for name in NAMES}
    plain = wheel.model_copy(update={"effect": ()})
    if wheel.fss and wheel.nominal is not None and 0 < found.size <= MOST_JUMPS:
        gathered = _gather(problem, model, plain, index, hidden)
        if len(gathered.candidates):
            return nothing | _compare(evidence, gathered, plain, max(record.derivative_slots, REVERSAL))
    return {**nothing, SPEED: SpeedTriggeredJumps.fit(evidence)}


def _gather(problem: Problem, model: Model, plain: Wheel, index: int, hidden: BoolArray) -> Evidence:
    """Return the diagnosis's evidence from the friction less the model's effects, hidden samples left out."""
    record = problem.records[index]
    base = model.fit.level + model.fit.residual + model.fit.coefficients[0] * problem.motion
    torque = problem.spread(np.where(hidden, np.nan, base * problem.sign), np.nan)[index]
    window = WindowAccumulator(plain, slots=record.used.size)
    window.append(np.nan_to_num(record.channels.speed_rad_s), np.nan_to_num(torque), np.isfinite(torque))
    return window.close()


def _is_between_levels(problem: Problem, model: Model) -> BoolArray:
    """Return which samples are at no level, bool (n,): those near a change of direction, and averages across a jump.

    A sensor that averages over the sample turns a jump into two steps of the same sign, one sample apart.
    """
    jumps, step = model.fit.jumps, np.diff(model.fit.level, prepend=0.0)
    between = problem.to_reversal < REVERSAL
    between[jumps[:-1][(np.diff(jumps) == 1) & (step[jumps[:-1]] * step[jumps[1:]] > 0.0)]] = True
    return between


def _compare(evidence: SwitchingEvidence, gathered: Evidence, plain: Wheel, shortest: int) -> dict[str, LikelihoodFit]:
    """Return the fits of the three alternatives: gains of one likelihood over that of the known wheel.

    No attribution is certain to be the best: the known laws are also scored on attributions found with other laws.
    """
    base = _attribute(gathered, plain)
    extra, others = _with_extra_system(gathered, base, evidence.good, shortest), _with_other_laws(gathered, base)
    base = max([base, *(one.under(plain, gathered.slots) for one in others)], key=lambda one: one.score)
    fits = {} if extra is None else {EXTRA: _describe_extra(evidence, extra, base.score)}
    if not others:
        return fits
    other = max(others, key=lambda one: one.score)
    laws = [_best_law(plain, other, system)[1] for system in range(len(plain.fss))]
    best = max(laws, key=lambda fitted: fitted.penalised_gain)
    count = int(np.count_nonzero(base.assignment.direction))
    fits[WRONG_LAW] = replace(
        best,
        log_likelihood_gain=max(other.score - base.score, 0.0),
        parameters=2 * len(laws),
        samples=max(count, best.samples),
    )
    fits[SPEED] = _speed_fit(evidence, base, other, sum(fitted.log_likelihood_gain for fitted in laws))
    return fits


def _attribute(gathered: Evidence, wheel: Wheel) -> _Attributed:
    """Return the best attribution; the rate of unattributed jumps is that at which they are found.

    Where a system's sizes may be anomalous, the search attributes nearly any jump to it: tried with and without.
    """
    known = window_priors(gathered, wheel)
    healthy = known._replace(anomaly=tuple(cases[:1] for cases in known.anomaly))
    best, priors = max(
        ((_attribute_given(gathered, wheel, one), one) for one in (known, healthy)), key=lambda one: one[0].score
    )
    for _ in range(ROUNDS):
        odd = float(np.count_nonzero(best.assignment.system == UNATTRIBUTED))
        again = _attribute_given(gathered, wheel, priors._replace(unattributed=max(odd, known.unattributed)))
        if again.score < best.score + SETTLED:
            break
        best = again
    return best


def _attribute_given(gathered: Evidence, wheel: Wheel, priors: Priors) -> _Attributed:
    found = assign(gathered, wheel, priors=priors)[0]
    # Unattributed jumps are a Poisson process; the factor of each single jump is already in the attribution.
    return _Attributed(wheel, replace(found, log_score=found.log_score - priors.unattributed))


# ---- an additional system --------------------------------------------------------------------------------------------


def _with_extra_system(gathered: Evidence, base: _Attributed, used: BoolArray, shortest: int) -> _Attributed | None:
    """Return the best attribution with an additional system; None where too few jumps are attributed to it.

    Or where its mean sojourns hold fewer than `shortest` used samples, bool (slots,), as artefacts of a filter do. Its
    size is the commonest of the jumps that no known system makes, or of all jumps, in case known ones make it, too.
    """
    found = base.assignment
    sizes = (np.sort(np.abs(found.jump[jumps])) for jumps in (_is_odd(base), found.direction != 0))
    fitted = [_fitted_extra(gathered, base, _commonest(one)) for one in sizes if one.size >= FEWEST_OF_EXTRA]
    samples = np.append(0, np.cumsum(used))
    lasting = [one for one in fitted if one and all(_mean_length(one, q, np.inf, samples) >= shortest for q in (0, 1))]
    return max(lasting, key=lambda one: one.score, default=None)


def _commonest(sizes: FloatArray) -> FloatArray:
    """Return the largest group of sizes that are about the same, from increasing ones, float64 (n,)."""
    low, high = SIZES_OF_EXTRA
    last = np.searchsorted(sizes, sizes * high / low, side="right")
    first = int(np.argmax(last - np.arange(sizes.size)))
    return sizes[first : int(last[first])]


def _fitted_extra(gathered: Evidence, base: _Attributed, alike: FloatArray) -> _Attributed | None:
    """Return the best attribution with an additional system whose jumps are about as large as `alike`, float64 (n,).

    Its sizes, mean durations and their Weibull shape are found alternately with the attribution; None where too few
    jumps are attributed to it.
    """
    least, most = sizes = tuple(share * float(np.median(alike)) for share in SIZES_OF_EXTRA)
    rest = active = max(gathered.slots / (alike.size + 1), 1.0)
    best, shape = base, 1.0
    for _ in range(ROUNDS):
        system = SwitchingSystem(
            name="extra",
            durations=(weibull_of_mean(rest, shape), weibull_of_mean(active, shape)),
            friction=(FrictionRange(low=0.0, high=0.0), FrictionRange(low=sizes[0], high=sizes[1])),
        )
        attributed = _attribute(gathered, _with_systems(base.wheel, (*base.wheel.fss, system)))
        if best is not base and attributed.score < best.score + SETTLED:
            break
        best, seen = attributed, _sizes_of_extra(attributed)
        if seen.size < FEWEST_OF_EXTRA:
            return None
        low, high = np.quantile(seen, TYPICAL_OF_EXTRA).tolist()
        sizes = max((1.0 - SIZE_MARGIN) * low, least), min((1.0 + SIZE_MARGIN) * high, most)
        if sizes[0] >= sizes[1]:  # only jumps of other sizes were attributed to it
            return None
        rest, active = (_mean_length(attributed, q, mean) for q, mean in ((0, rest), (1, active)))
        sojourns = attributed.sojourns(-1)
        if (
            sojourns.slots.size >= FEWEST_SOJOURNS
        ):  # below 1, which is memoryless, jumps come in clusters, as noise does
            shape = max(WrongDurationLaw.fit(system, sojourns).values["weibull_shape"], 1.0)
    return best


def _is_odd(attributed: _Attributed) -> BoolArray:
    """Return which jumps no switching system of the wheel makes, or makes with a size that the wheel does not state."""
    found = attributed.assignment
    odd: BoolArray = found.system == UNATTRIBUTED
    for index, system in enumerate(attributed.wheel.fss):
        known = [(upper.low - lower.high, upper.high - lower.low) for lower, upper in pairwise(system.friction or ())]
        if known:
            low, high = (1.0 - SIZE_MARGIN) * min(known)[0], (1.0 + SIZE_MARGIN) * max(high for _, high in known)
            odd |= (found.system == index) & ((np.abs(found.jump) < low) | (np.abs(found.jump) > high))
    return odd


def _sizes_of_extra(attributed: _Attributed) -> FloatArray:
    mine = attributed.assignment.system == len(attributed.wheel.fss) - 1
    return np.asarray(np.abs(attributed.assignment.jump[mine]))


def _mean_length(attributed: _Attributed, configuration: int, none: float, samples: IntArray | None = None) -> float:
    """Return the mean sojourn of the extra system in a configuration [slots], at least one; `none` where there is none.

    The first sojourn counts from the record's beginning; the last one, whose end is not observed, does not count.
    `samples`: the number of samples before each slot, int64 (slots + 1,), to count in samples.
    """
    starts = attributed.assignment.starts[-1]
    lengths = np.diff(starts if samples is None else samples[starts])
    at = lengths[attributed.assignment.configurations[-1][:-1] == configuration]
    return max(float(at.mean()), 1.0) if at.size else none


def _describe_extra(evidence: SwitchingEvidence, attributed: _Attributed, base: float) -> LikelihoodFit:
    sizes = attributed.wheel.torque_unit_Nm * _sizes_of_extra(attributed)
    rest, active = (law.mean() * evidence.channels.sample_period_s for law in attributed.wheel.fss[-1].durations)
    values = {"strength_Nm": float(np.median(sizes)), "rest_s": rest, "active_s": active}
    # The mean of a memoryless law has a relative standard deviation of 1/√count; the count is half that of the jumps.
    of_means = float(np.sqrt(2.0 / sizes.size))
    std = {name: value * of_means for name, value in values.items()}
    std["strength_Nm"] = float(np.std(sizes) / np.sqrt(sizes.size))
    jumps = int(np.count_nonzero(attributed.assignment.direction))
    return LikelihoodFit(values, std, max(attributed.score - base, 0.0), EXTRA_PARAMETERS, jumps)


# ---- other laws of duration ------------------------------------------------------------------------------------------


def _with_other_laws(gathered: Evidence, base: _Attributed) -> list[_Attributed]:
    """Return attributions with Weibull laws in place of the known ones; none where there are too few jumps."""
    if np.count_nonzero(base.assignment.direction) < FEWEST_SOJOURNS:
        return []
    wheel = base.wheel
    found = [
        _attribute(gathered, _with_systems(wheel, (_with_weibull(system, factor, 1.0) for system in wheel.fss)))
        for factor in FIRST_FACTORS
    ]
    best = max(found, key=lambda one: one.score)
    for _ in range(ROUNDS):
        fitted = (_best_law(wheel, best, number)[0] or before for number, before in enumerate(best.wheel.fss))
        found.append(_attribute(gathered, _with_systems(wheel, fitted)))
        if found[-1].score < best.score + SETTLED:
            break
        best = found[-1]
    return found


def _with_systems(wheel: Wheel, systems: Iterable[SwitchingSystem]) -> Wheel:
    return wheel.model_copy(update={"fss": tuple(systems)})


def _with_weibull(system: SwitchingSystem, factor: float, shape: float, only: int | None = None) -> SwitchingSystem:
    """Return a system with Weibull laws whose means are `factor` times the known ones, in one configuration or all."""
    durations = tuple(
        weibull_of_mean(factor * law.mean(), shape) if only in (None, q) else law
        for q, law in enumerate(system.durations)
    )
    return system.model_copy(update={"durations": durations})


def _best_law(plain: Wheel, attributed: _Attributed, number: int) -> tuple[SwitchingSystem | None, LikelihoodFit]:
    """Return a system with the law that fits its sojourns best, and the fit; None where they are too few.

    Either all configurations of the system follow another law, or a single one: what makes a system rest longer need
    not change how long it acts.
    """
    known, sojourns = plain.fss[number], attributed.sojourns(number)
    every = tuple(range(len(known.durations)))
    system, best = None, WrongDurationLaw.nothing_found()
    for only, of_these in [(None, sojourns.of(every)), *((q, sojourns.of((q,))) for q in every)]:
        if of_these.slots.size < FEWEST_SOJOURNS:
            continue
        fitted = WrongDurationLaw.fit(known, of_these)
        if system is None or fitted.log_likelihood_gain > best.log_likelihood_gain:
            values, best = fitted.values, fitted
            system = _with_weibull(known, values["duration_factor"], values["weibull_shape"], only)
    return system, best


def _speed_fit(evidence: SwitchingEvidence, base: _Attributed, other: _Attributed, of_laws: float) -> LikelihoodFit:
    """Fit a rate that depends on speed or temperature: the known laws, on a clock that runs at this rate.

    Tried on the attribution found with the known laws and on that found with free laws. The latter does not use the
    clock: the gain of the free laws on these sojourns is subtracted from its likelihood, and the clock's gain added.
    """
    fits = []
    for attributed, offset in ((base, 0.0), (other, other.score - base.score - of_laws)):
        sojourns = {system.name: attributed.sojourns(i) for i, system in enumerate(base.wheel.fss)}
        fitted = SpeedTriggeredJumps.fit(replace(evidence, jumps=_jumps(attributed), sojourns=sojourns))
        fits.append(replace(fitted, log_likelihood_gain=max(fitted.log_likelihood_gain + offset, 0.0)))
    return max(fits, key=lambda fitted: fitted.penalised_gain)


def _jumps(attributed: _Attributed) -> Jumps:
    kept: IntArray = np.flatnonzero(attributed.assignment.direction)
    sizes = attributed.wheel.torque_unit_Nm * attributed.assignment.jump[kept]
    return Jumps(attributed.assignment.index[kept], sizes)
