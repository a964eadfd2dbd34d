"""Torque that was read in steps: its rounding is undone as far as a model of the record allows.

Rounding to steps of several standard deviations is no noise: where the torque rests, the error rests with it, and where
the torque moves, mean and spread of the error follow it (B. Widrow, I. Kollár, Quantization Noise, 2008, chapter 4).
Levels, laws of speed and a cage would be read out of that; and a median of quantised differences is nothing, or a
step. But the reading shows between which two values the torque was. So each sample is drawn from the normal law about
a model, as far as it lies within the step that was read: where the model is right that is the unrounded record's own
law, and nothing has to be known of rounding by what comes after (data augmentation: M. A. Tanner, W. H. Wong, JASA 82,
1987; as residuals: P. K. Dunn, G. K. Smyth, J. Comp. Graph. Stat. 5, 1996). Model and draws are found in turns (the
stochastic EM of G. Celeux, J. Diebolt, 1985) with the same uniform numbers in each, which makes it a fixed point.

What the model lacks is drawn towards it within each step: an effect is found weaker than it is, and never stronger.
Once it is found, the draws are repeated about the model that has it.
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
from rwa_monitor.discrepancy.terms import SearchResult
from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.tachometer import quantisation_step
from rwa_monitor.wheel.wheel import Wheel

COARSE: Final = 0.5  # standard deviations of the noise: finer steps are of no consequence
FINE: Final = 4.0  # steps between neighbours, on the median: steps far below any noise or motion
FINEST_NOISE: Final = 0.05  # of a step: less noise than that hardly ever shows
ROUNDS: Final = 24  # of model and draws in turn, at most
SETTLED: Final = 0.005  # change of the standard deviation
FAR: Final = 8.0  # standard deviations: beyond, where within its step a sample lies is as good as known
SEED: Final = 19871987  # fixed: the same record gives the same answer


def without_steps(records: Sequence[Record], wheel: Wheel) -> list[Record]:
    """Return records whose friction was read in coarse steps with the rounding undone, about the base model.

    Others, and those whose steps are fine beside their noise, are returned as they are.

    Raises
    ------
    InputError
        As `make_problem` does.
    """
    records = [record if _may_matter(record) else replace(record, steps=None) for record in records]
    if not any(record.torque_step_Nm > 0.0 for record in records):
        return records
    spread = [
        replace(record, friction_torque_Nm=record.friction_torque_Nm + record.torque_step_Nm * (u - 0.5))
        for record, u in zip(records, _uniform(records), strict=True)
    ]
    variance = make_problem(spread, wheel).noise.std ** 2  # with that of two rounding errors in it
    steps = [record.torque_step_Nm for record in records]
    coarse = [step > COARSE * np.sqrt(max(variance - step**2 / 6.0, 0.0)) for step in steps]
    kept = [record if of_one else replace(record, steps=None) for record, of_one in zip(records, coarse, strict=True)]
    if not any(coarse):
        return kept
    problem = make_problem(kept, wheel)
    problem = replace(problem, z=problem.z_measured)
    return _drawn(problem, fit(problem), fit)


def _may_matter(record: Record) -> bool:
    """Return whether a record's steps are not far finer than what neighbours differ by; that needs no model."""
    change = np.abs(np.diff(record.friction_torque_Nm[record.used]))
    return record.torque_step_Nm > 0.0 and change.size > 0 and float(np.median(change)) < FINE * record.torque_step_Nm


def drawn_again(problem: Problem, model: Fit, again: Callable[[Problem], Fit]) -> list[Record] | None:
    """Return the records of a problem with the rounding undone about a better model; None where none is rounded.

    Parameters
    ----------
    problem
        The data, drawn about another model.
    model
        The fit of the better one.
    again
        Fits it to a problem with other draws.
    """
    if not any(record.torque_step_Nm > 0.0 for record in problem.records):
        return None
    return _drawn(problem, model, again)


def _expected(problem: Problem, model: Fit) -> FloatArray:
    """Return what a model expects of z, float64 (n,) [N m], with no weak jump: what rests on a step looks like one."""
    return problem.z - model.residual - model.level + strong_level(problem, model.level)


def _uniform(records: Sequence[Record]) -> list[FloatArray]:
    rng = np.random.default_rng(SEED)
    return [rng.random(record.used.size) for record in records]


def _drawn(problem: Problem, fitted: Fit, again: Callable[[Problem], Fit]) -> list[Record]:
    """Draw each sample of z within its step about what a model expects, and fit, in turns."""
    step = problem.gather([np.full(record.used.size, record.torque_step_Nm) for record in problem.records])
    uniform = problem.gather(_uniform(problem.records))
    read = problem.gather([_as_read(record) for record in problem.records]) * problem.sign
    expected, std = _expected(problem, fitted), problem.noise.std
    for _ in range(ROUNDS):
        z = _within(read, step, expected, std, uniform)
        drawn = replace(problem, z=z, z_measured=z)
        fitted = again(with_noise_of(drawn, z - expected))
        expected, last = _expected(drawn, fitted), std
        std = with_noise_of(drawn, fitted.residual).noise.std
        if abs(std - last) < SETTLED * last:
            break
    z = _within(read, step, expected, std, uniform)
    records = []
    for record, values in zip(problem.records, problem.spread(z * problem.sign), strict=True):
        friction = np.where(record.used, values, record.friction_torque_Nm)
        records.append(replace(record, friction_torque_Nm=friction, friction_as_read_Nm=_as_read(record)))
    return records


def _as_read(record: Record) -> FloatArray:
    return record.friction_torque_Nm if record.friction_as_read_Nm is None else record.friction_as_read_Nm


def _within(read: FloatArray, step: FloatArray, expected: FloatArray, std: float, uniform: FloatArray) -> FloatArray:
    """Return draws from a normal law within half a step of what was read, (n,); what has no step is left as it is.

    Always on the lower tail, where a probability keeps its digits.
    """
    scale = np.where(step > 0.0, np.maximum(std, FINEST_NOISE * step), 1.0)
    near = np.abs(read - expected) - 0.5 * step
    high = -np.minimum(near / scale, FAR)
    low = high - step / scale
    probability = special.ndtr(low) + uniform * (special.ndtr(high) - special.ndtr(low))
    inside = np.clip(special.ndtri(probability), low, high) - high  # from the near end, ≤ 0
    away = near - inside * scale
    return np.where(step > 0.0, np.where(read < expected, expected - away, expected + away), read)


# ---- rounding of the speed that passes for a mean effect -------------------------------------------------------------
# Where the speed stands on one reading for longer than the derivative's filter is wide, the rounding error of derived
# friction is no noise: it follows the acceleration, step by step. What lives in the acceleration cannot be separated
# from it.


MISSING: Final = "a tachometer with finer steps: the speed stands on one reading for longer than the derivative looks"


def without_rounding(problem: Problem, found: SearchResult) -> SearchResult:
    """Withdraw the effects that rounding errors imitate, where they are coarse; they become untestable."""
    if not any(_is_coarse(problem, index) for index in range(len(problem.records))):
        return found
    model = found.nested[-1]
    follows = [term.effect.follows_acceleration for term in model.terms]
    if not any(follows):
        return found
    kept = model.terms[: follows.index(True)]  # what came after was judged beside a wrong name
    withdrawn = tuple((term.effect.name, MISSING) for term in model.terms[len(kept) :])
    reduced = Fitting(problem, jumps=bool(model.fit.jumps.size)).refitted(kept, model) if kept else found.nested[0]
    names = {term.effect.name for term in kept}
    shorter = (m for m in found.nested if set(m.names) <= names and len(m.terms) < len(kept))
    return replace(
        found,
        nested=(*shorter, reduced),
        found=tuple(entry for entry in found.found if entry.name in names),
        untestable=(*found.untestable, *withdrawn),
    )


def _is_coarse(problem: Problem, index: int) -> bool:
    """Return whether a record's speed crosses less than one step within the derivative's filter, half of the time."""
    record = problem.records[index]
    step = quantisation_step(record.channels.speed_rad_s[np.isfinite(record.channels.speed_rad_s)])
    if not record.friction_is_derived or step is None:
        return False
    window_s = record.derivative_slots * record.channels.sample_period_s
    crossed = np.abs(record.channels.acceleration_rad_s2[record.used]) * window_s / step
    return bool(np.nanmedian(crossed) < 1.0)
