"""Remove the rounding from torque that was quantised in coarse steps, given a model of the record.

Rounding to steps of several standard deviations is not noise: while the torque is constant, so is the error, and while
it changes, mean and variance of the error depend on it (B. Widrow, I. Kollár, Quantization Noise, 2008, chapter 4). The
search would find levels, laws of speed and a cage in such errors; and a median of quantised differences is zero or one
step. But a reading bounds the torque from both sides. Each sample is therefore drawn from the normal distribution about
a model's prediction, truncated to the step that was read. If the model is right, the draws are distributed as the
unrounded record, and later stages need no treatment of rounding (data augmentation: M. A. Tanner, W. H. Wong, JASA 82,
1987; as residuals: P. K. Dunn, G. K. Smyth, J. Comp. Graph. Stat. 5, 1996). Model and draws are computed alternately
(the stochastic EM of G. Celeux, J. Diebolt, 1985), with the same uniform numbers each time: a fixed-point iteration.

An effect that the model lacks is attenuated, since samples are drawn towards the model: it is found weaker than it is,
and never stronger. Once it is found, the draws are repeated about the model that includes it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from scipy import special

from rwa_monitor.discrepancy.base_fit import Fit, fit, make_problem, strong_level, with_noise_of
from rwa_monitor.discrepancy.fitting import Fitting
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.discrepancy.record import Record
from rwa_monitor.discrepancy.terms import SearchResult, nested_to
from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.tachometer import quantisation_step
from rwa_monitor.wheel.wheel import Wheel

COARSE: Final = 0.5  # standard deviations of the noise: finer steps have no consequence
FINE: Final = 4.0  # steps, the median difference of neighbours, from which steps are far finer than noise and motion
FINEST_NOISE: Final = 0.05  # of a step: the least noise that is assumed; less rarely changes a reading
ROUNDS: Final = 24  # alternations of model and draws, at most
SETTLED: Final = 0.005  # relative change of the standard deviation at which alternation ends
TAIL_STDS: Final = 8.0  # standard deviations from the step to the model, at which the tail is cut off
SEED: Final = 19871987  # fixed: the same record gives the same result


def without_steps(records: Sequence[Record], wheel: Wheel) -> list[Record]:
    """Return the records with the rounding removed about the base model, where friction was read in coarse steps.

    Records whose steps are fine relative to their noise are returned with `steps` None, all others unchanged.

    Raises
    ------
    InputError
        As `make_problem` does.
    """
    records = [record if _may_matter(record) else replace(record, steps=None) for record in records]
    if not any(record.steps for record in records):
        return records
    spread = [
        replace(record, friction_torque_Nm=record.friction_torque_Nm + record.torque_step_Nm * (u - 0.5))
        for record, u in zip(records, _uniform(records), strict=True)
    ]
    variance = make_problem(spread, wheel).noise.std ** 2  # includes that of two rounding errors

    def is_coarse(step: float) -> bool:
        return step > COARSE * float(np.sqrt(max(variance - step**2 / 6.0, 0.0)))

    kept = [one if is_coarse(one.torque_step_Nm) else replace(one, steps=None) for one in records]
    if not any(record.steps for record in kept):
        return kept
    problem = make_problem(kept, wheel)
    problem = replace(problem, z=problem.z_measured)
    return _drawn(problem, fit(problem), fit)


def _may_matter(record: Record) -> bool:
    """Return whether a record's steps are not far finer than the differences of neighbours; this needs no model."""
    change = np.abs(np.diff(record.friction_torque_Nm[record.used]))
    return record.torque_step_Nm > 0.0 and change.size > 0 and float(np.median(change)) < FINE * record.torque_step_Nm


def redrawn(problem: Problem, model: Fit, again: Callable[[Problem], Fit]) -> list[Record] | None:
    """Return the records of a problem with the rounding removed about a better model; None where none is rounded.

    Parameters
    ----------
    problem
        The data, drawn about another model.
    model
        The fit of the better one.
    again
        Fits that model to a problem with other draws.
    """
    return _drawn(problem, model, again) if any(record.steps for record in problem.records) else None


def _predicted(problem: Problem, model: Fit) -> FloatArray:
    """Return a model's prediction of z, float64 (n,) [N m], without weak jumps, which resting on a step mimics."""
    return problem.z - model.residual - model.level + strong_level(problem, model.level)


def _uniform(records: Sequence[Record]) -> list[FloatArray]:
    rng = np.random.default_rng(SEED)
    return [rng.random(record.used.size) for record in records]


def _drawn(problem: Problem, fitted: Fit, again: Callable[[Problem], Fit]) -> list[Record]:
    """Draw each sample of z within its step about the model's prediction, and refit the model, alternately."""
    step = problem.gather([np.full(record.used.size, record.torque_step_Nm) for record in problem.records])
    uniform = problem.gather(_uniform(problem.records))
    read = problem.gather([_as_read(record) for record in problem.records]) * problem.sign
    expected, std = _predicted(problem, fitted), problem.noise.std
    for _ in range(ROUNDS):
        z = _truncated(read, step, expected, std, uniform)
        drawn = replace(problem, z=z, z_measured=z)
        fitted = again(with_noise_of(drawn, z - expected))
        expected, last = _predicted(drawn, fitted), std
        std = with_noise_of(drawn, fitted.residual).noise.std
        if abs(std - last) < SETTLED * last:
            break
    z = _truncated(read, step, expected, std, uniform)
    records = []
    for record, values in zip(problem.records, problem.spread(z * problem.sign), strict=True):
        friction = np.where(record.used, values, record.friction_torque_Nm)
        records.append(replace(record, friction_torque_Nm=friction, friction_as_read_Nm=_as_read(record)))
    return records


def _as_read(record: Record) -> FloatArray:
    return record.friction_torque_Nm if record.friction_as_read_Nm is None else record.friction_as_read_Nm


def _truncated(read: FloatArray, step: FloatArray, expected: FloatArray, std: float, uniform: FloatArray) -> FloatArray:
    """Return draws from the normal law within half a step of the readings, (n,); readings without a step are unchanged.

    The draws use the lower tail, where probabilities keep their digits.
    """
    scale = np.where(step > 0.0, np.maximum(std, FINEST_NOISE * step), 1.0)
    near = np.abs(read - expected) - 0.5 * step
    high = -np.minimum(near / scale, TAIL_STDS)
    low = high - step / scale
    probability = special.ndtr(low) + uniform * (special.ndtr(high) - special.ndtr(low))
    inside = np.clip(special.ndtri(probability), low, high) - high  # from the end of the step nearest to the model, ≤ 0
    away = near - inside * scale
    return np.where(step > 0.0, np.where(read < expected, expected - away, expected + away), read)


# ---- rounding of the speed that is mistaken for a mean effect --------------------------------------------------------
# Where the speed keeps one reading for longer than the derivative's filter is wide, the rounding error of derived
# friction is not noise: it follows the acceleration, step by step. Effects that depend on the acceleration are then
# not identifiable.


MISSING: Final = "a tachometer with finer steps: the speed stands on one reading for longer than the derivative looks"


def without_rounding(problem: Problem, found: SearchResult) -> SearchResult:
    """Withdraw the effects that coarse rounding errors mimic, and those found after them; they become untestable."""
    model = found.nested[-1]
    follows = [term.effect.follows_acceleration for term in model.terms]
    if not any(follows) or not any(map(_is_coarse, problem.records)):
        return found
    kept = model.terms[: follows.index(True)]  # later effects were judged given a wrong one
    withdrawn = tuple((term.effect.name, MISSING) for term in model.terms[len(kept) :])
    reduced = Fitting(problem, jumps=bool(model.fit.jumps.size)).refitted(kept, model) if kept else found.nested[0]
    return replace(
        found,
        nested=nested_to(reduced, found.nested),
        found=tuple(entry for entry in found.found if entry.name in reduced.names),
        untestable=(*found.untestable, *withdrawn),
    )


def _is_coarse(record: Record) -> bool:
    """Return whether friction is derived by a filter within which the speed mostly crosses less than one step."""
    step = quantisation_step(record.channels.speed_rad_s[np.isfinite(record.channels.speed_rad_s)])
    if not record.friction_is_derived or step is None:
        return False
    window_s = record.derivative_slots * record.channels.sample_period_s
    crossed = np.abs(record.channels.acceleration_rad_s2[record.used]) * window_s / step
    return bool(np.nanmedian(crossed) < 1.0)
