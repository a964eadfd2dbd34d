"""Torque that no known effect explains: nonparametric curves over each quantity, as alternatives to the catalogue.

A named formula must explain what it is accepted for. After the search, piecewise linear curves over |ω|, temperature,
time, … compete for the residual: one that still gains much is *unexplained*, with the quantity as its signature; and a
named effect that is not needed given the curve only mimicked it, and is withdrawn.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from rwa_monitor.discrepancy.base_fit import pieces, remove_levels, segment_starts, strong_jumps, strong_level
from rwa_monitor.discrepancy.fitting import Fitting
from rwa_monitor.discrepancy.likelihood import ACCEPT_GAIN
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.discrepancy.terms import MODEL_ERROR, Model, SearchResult, Term, make_term, nested_to
from rwa_monitor.discrepancy.unnamed import (
    CURVES,
    UNNAMED,
    Periodic,
    PeriodicDrag,
    PeriodicRub,
    PeriodicTorque,
    UnnamedEffect,
    between_recordings,
)
from rwa_monitor.messages import Unexplained
from rwa_monitor.samples import TINY, FloatArray

EXPLAINED_SHARE: Final = 0.7  # of a curve's gain: a law that gains so much with fewer parameters is kept
NEARLY_ALL: Final = 0.9  # of a sum of squares or a variance: the rest is noise and drift
FOLDED_SHARE: Final = 0.9  # of the largest power that folding at any period gives
LEAST_NAMED_SHARE: Final = MODEL_ERROR  # of an unnamed hypothesis's gain that a name found with it must reach
FEWEST_SAMPLES: Final = 4  # for each height of a curve: with fewer it follows the noise
FEWEST_STEPS: Final = 6  # of the level: a jump or two too many is chance
STEPS_TO_JUMPS: Final = 2.0  # ratio of small steps to jumps
LASTING_LAGS: Final = range(64, 129, 4)  # slots: the autocorrelation of the catalogue's noise has decayed to 4 %
LASTING_SHARE: Final = 0.2  # of the residual's variance
FOLD_BINS: Final = 40  # parts of a period: what lasts a twentieth of it is resolved
FEWEST_PERIODS: Final = 5  # in a record: a drag that drifts as a random walk mimics fewer
SHORT_SHARE: Final = 0.25  # of a period: what lasts longer is a wave, not a rub


def judge_leftover(fitting: Fitting, found: SearchResult) -> tuple[SearchResult, Unexplained | None, Model]:
    """Let nonparametric curves compete for the residual of the search.

    Returns
    -------
    found, unexplained, complete
        The search's result without the effects that a curve makes superfluous; what remains unexplained, or None; and
        the model with the curve in it, whose residual is noise.
    """
    problem, model = fitting.problem, found.nested[-1]
    alternatives = with_nonparametric_curves(fitting, model)
    best = min(alternatives, key=lambda alternative: alternative.score, default=model)
    if model.score - best.score < ACCEPT_GAIN:
        return found, None, model
    curve = best.terms[-1]
    kept = [i for i in range(len(model.terms)) if fitting.without(best, i).score - best.score >= ACCEPT_GAIN]
    if issubclass(curve.effect, Periodic):
        unexplained = _periodic_finding(problem, model, curve)
    else:
        size = _size(problem, best, len(best.terms) - 1)
        unexplained = Unexplained(signature=curve.effect.signature, size_Nm=size)
    if len(kept) == len(model.terms):
        return found, unexplained, best
    terms = tuple(model.terms[i] for i in kept)
    reduced = fitting.refitted(terms, best)
    alone = fitting.refitted((*terms, curve), best, [best.fit.jumps])
    # A curve over the same quantity makes any law superfluous, even the right one; and where the noise is far less, a
    # small misfit of that law is significant.
    gains_most = reduced.score - model.score > EXPLAINED_SHARE * (reduced.score - alone.score)
    if gains_most or explains_most(reduced, model, alone):
        return found, unexplained, best
    left = tuple(entry for entry in found.found if entry.name in reduced.names)
    return replace(found, nested=nested_to(reduced, found.nested), found=left), unexplained, best


def combined(one: Unexplained | None, other: Unexplained | None) -> Unexplained | None:
    """Return two unexplained torques as one, the second of them named first; either may be None."""
    return one.beside(other.signature, other.size_Nm) if one and other else one or other


def explains_most(simpler: Model, law: Model, other: Model) -> bool:
    """Return whether a law lowers the sum of squares by nearly as much as another explanation does."""
    lower = simpler.fit.rss - law.fit.rss
    return lower > 0.0 and lower > NEARLY_ALL * (simpler.fit.rss - other.fit.rss)


def with_nonparametric_curves(fitting: Fitting, model: Model) -> list[Model]:
    """Return a model extended by each of the nonparametric curves."""
    return fitting.problem.each(lambda term: fitting.refitted((*model.terms, term), model), _curves(fitting, model))


def _periodic_finding(problem: Problem, model: Model, curve: Term) -> Unexplained:
    """Return an unexplained periodic torque: its period, how long it lasts in each period, and its size."""
    assert issubclass(curve.effect, Periodic)
    period, mean, residual = _repeated(problem, model, curve.shape["frequency_Hz"], flips=curve.effect.flips)
    power, mean = float(np.mean(mean**2)), mean - np.median(mean)
    lasting = float(np.count_nonzero(np.abs(mean) > 0.5 * np.max(np.abs(mean)))) / FOLD_BINS
    short = f", {lasting * period:.2g} s long" if lasting < SHORT_SHARE else ""
    noise = float(np.var(residual)) * FOLD_BINS / residual.size
    size = float(np.sqrt(max(power - noise, 0.0)))
    return Unexplained(signature=f"{curve.effect.signature}, every {period:.3g} s{short}", size_Nm=size)


def _repeated(
    problem: Problem, model: Model, frequency_Hz: float, *, flips: bool
) -> tuple[float, FloatArray, FloatArray]:
    """Return the period [s], the mean over FOLD_BINS parts of it, and the residual of the first record.

    The largest peak of a periodogram may be a harmonic, as of a short rub in a long period: the residual is folded at
    multiples of the peak's period, and the shortest whose folded power is nearly the largest is the period.
    """
    residual = _residual_over_time(problem, model, flips=flips)
    time_s = problem.records[0].channels.time_s[problem.slot[: residual.size]]
    longest = max(int(frequency_Hz * float(np.ptp(time_s)) / FEWEST_PERIODS), 1)
    periods = [k / frequency_Hz for k in range(1, min(longest, PeriodicRub.harmonics) + 1)]
    folds = [_fold(time_s, residual, period) for period in periods]
    powers = [float(np.mean(mean**2)) for mean in folds]
    period = periods[next(i for i, power in enumerate(powers) if power >= FOLDED_SHARE * max(powers))]
    # A peak is as wide as one period more or less in the record: folding determines the period of a short rub better.
    near = period * (1.0 + min(period / float(np.ptp(time_s)), 1.0) * np.linspace(-0.5, 0.5, 2 * FOLD_BINS + 1))
    folds = [_fold(time_s, residual, one) for one in near]
    best = int(np.argmax([float(np.mean(mean**2)) for mean in folds]))
    return float(near[best]), folds[best], residual


def _fold(time_s: FloatArray, values: FloatArray, period_s: float) -> FloatArray:
    """Return the mean of values over FOLD_BINS parts of a period."""
    part = np.minimum((np.mod(time_s / period_s, 1.0) * FOLD_BINS).astype(np.int64), FOLD_BINS - 1)
    count = np.bincount(part, minlength=FOLD_BINS)
    return np.asarray(np.bincount(part, values, FOLD_BINS) / np.maximum(count, 1), dtype=np.float64)


def slow_drag(problem: Problem, model: Model) -> Unexplained | None:
    """Return the slow drag that the level follows in small steps or that stays in the residual; None without either.

    A switching system jumps, it does not creep: steps worth many times their penalty are jumps, and where most are not,
    the level drifts as a random walk. Noise decorrelates: that of the catalogue (autocorrelation up to 0.95 from slot
    to slot) within some sixty slots. What lasts longer is drag that no effect explains.
    """
    strong = strong_jumps(problem, model.fit.level + model.fit.residual).size
    weak, variance = model.fit.jumps.size - strong, 0.0
    if weak >= FEWEST_STEPS and weak >= STEPS_TO_JUMPS * strong:
        variance += float(np.var(model.fit.level - strong_level(problem, model.fit.level)))
    lasting = _lasting_variance(problem, model.fit.residual)
    if lasting > LASTING_SHARE * float(np.var(model.fit.residual)):
        variance += lasting
    return Unexplained(signature="a drag that wanders with time", size_Nm=float(variance**0.5)) if variance else None


def _lasting_variance(problem: Problem, residual: FloatArray) -> float:
    """Return the mean autocovariance of a residual over LASTING_LAGS, within records, at least zero [N² m²]."""
    products, pairs = 0.0, 0
    for values in (residual[piece] - residual[piece].mean() for piece in pieces(problem)):
        for lag in LASTING_LAGS:
            products += float(values[lag:] @ values[:-lag])
            pairs += max(values.size - lag, 0)
    return max(products / max(pairs, 1), 0.0)


def _curves(fitting: Fitting, model: Model) -> list[Term]:
    """Return the nonparametric curves that these records can test, periodic ones at the best frequency."""
    problem = fitting.problem
    known = [curve for curve in CURVES if all(curve.quantity(one.channels) is not None for one in problem.records)]
    shown, _ = fitting.split_testable(known, model)
    terms = [make_term(problem, curve, {}, None) for curve in shown]
    for curve, columns in between_recordings(problem):
        free = np.full(columns.shape[1], np.inf)
        terms.append(Term(curve, {}, columns, -free, free, columns.shape[1]))
    if problem.is_command:  # a command has no error that varies with time
        return terms
    for effect in (PeriodicTorque, PeriodicDrag):
        frequency = _best_frequency(problem, model, flips=effect.flips)
        terms.append(make_term(problem, effect, {"frequency_Hz": frequency}, None))
    period, *_ = _repeated(problem, model, terms[-1].shape["frequency_Hz"], flips=True)
    terms.append(make_term(problem, PeriodicRub, {"frequency_Hz": 1.0 / period}, None))
    return [term for term in terms if term.columns.shape[1] * FEWEST_SAMPLES <= problem.size]


def _best_frequency(problem: Problem, model: Model, *, flips: bool) -> float:
    """Return the frequency of the largest peak of the residual's periodogram, first record [Hz]."""
    record, residual = problem.records[0], _residual_over_time(problem, model, flips=flips)
    values = np.zeros(record.used.size)
    values[problem.slot[: residual.size]] = residual
    power = np.abs(np.fft.rfft(values, 4 * values.size))
    frequency = np.fft.rfftfreq(4 * values.size, record.channels.sample_period_s)
    slowest = 4 * FEWEST_PERIODS  # slower is a trend, which levels absorb
    return float(frequency[slowest + np.argmax(power[slowest:])])


def _residual_over_time(problem: Problem, model: Model, *, flips: bool) -> FloatArray:
    """Return the residual of the first record without what repeats with its motion, a function of the motion."""
    end = int(problem.starts[1])
    residual = model.fit.residual[:end] * (1.0 if flips else problem.sign[:end])
    period = _repetition_slots(np.nan_to_num(problem.records[0].channels.speed_rad_s))
    if period is None:
        return residual
    phase = problem.slot[:end] % period
    return residual - (np.bincount(phase, residual) / np.maximum(np.bincount(phase), 1))[phase]


def _repetition_slots(speed: FloatArray) -> int | None:
    """Return after how many slots a speed, float64 (n,), repeats by its autocorrelation; None where it does not."""
    n, speed = speed.size, speed - speed.mean()
    lags = np.arange(n // FEWEST_PERIODS)
    covariance = np.fft.irfft(np.abs(np.fft.rfft(speed, 2 * n)) ** 2)[lags] / (n - lags)
    first = int(np.argmax(covariance < 0.0))  # at shorter lags any smooth motion correlates
    best = first + int(np.argmax(covariance[first:]))
    return best if first and covariance[best] >= NEARLY_ALL * covariance[0] else None


# ---- unnamed hypotheses that won -------------------------------------------------------------------------------------


def without_unnamed(
    fitting: Fitting, found: SearchResult, left: Unexplained | None
) -> tuple[SearchResult, Unexplained | None]:
    """Take unnamed hypotheses out of what was found, and report them as unexplained.

    Where one is equivalent to a named effect, the effect that it would be with an additional channel is listed instead:
    without that channel it is only a possibility. Effects found with it that gain little correct its form: left out.
    """
    would_be = {one.name: one.named_with_channel for one in UNNAMED}
    possible = [
        replace(entry, equivalent=tuple(filter(None, dict.fromkeys(would_be.get(n, n) for n in entry.equivalent))))
        for entry in found.found
    ]
    found = replace(found, found=tuple(possible))
    while (entry := next((one for one in found.found if one.name in would_be), None)) is not None:
        model = found.nested[-1]
        index, least = model.names.index(entry.name), LEAST_NAMED_SHARE * entry.gain
        term, named = model.terms[index], tuple(one for one in found.found if one is not entry and one.gain >= least)
        terms = tuple(other for other in model.terms if other.effect.name in {one.name for one in named})
        reduced = fitting.refitted(terms, model) if terms else found.nested[0]
        assert issubclass(term.effect, UnnamedEffect)
        others = [other for other in entry.equivalent if other != term.effect.named_with_channel]
        in_words = term.effect.in_words(term.shape) + "".join(f", or {other} as well" for other in others)
        size = _size(fitting.problem, model, index)
        left = combined(left, Unexplained(signature=in_words, size_Nm=size))
        found = replace(found, nested=nested_to(reduced, found.nested), found=named)
    return found, left


def _size(problem: Problem, model: Model, index: int) -> float:
    """Return the RMS of a term's torque after removal of levels and slope [N m]."""
    first = segment_starts(problem, model.fit.jumps)
    torque = remove_levels(model.torque(index), first)
    speed_part = remove_levels(problem.speed, first)
    torque = torque - speed_part * float(speed_part @ torque) / max(float(speed_part @ speed_part), TINY)
    return float(np.sqrt(np.mean(torque**2)))
