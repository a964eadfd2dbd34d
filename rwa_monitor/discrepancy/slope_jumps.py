"""Jumps of the viscous coefficient that keep no step with those of the dry friction.

The catalogue's `viscous_jump` lets the coefficient follow the dry level. Lubricant that moves in and out of the contact
need not: then the drag of a stretch of time has a slope over the speed of its own. The stretches are found like the
levels, by an exact segmentation, here of straight lines over |ω|; neighbours whose slopes differ by less than they cost
are merged. A change of slope is priced as a jump is: it has a place, a size and a sign.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from rwa_monitor.discrepancy.base_fit import JUMP_PENALTY
from rwa_monitor.discrepancy.fitting import Fitting
from rwa_monitor.discrepancy.gain import held_out
from rwa_monitor.discrepancy.jump_terms import ViscousJumpTerm
from rwa_monitor.discrepancy.likelihood import ACCEPT_GAIN
from rwa_monitor.discrepancy.models import Model
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.discrepancy.result import ParameterValue
from rwa_monitor.discrepancy.search import prune
from rwa_monitor.discrepancy.terms import Term
from rwa_monitor.kernels.segmentation import optimal_lines
from rwa_monitor.samples import FloatArray, IntArray
from rwa_monitor.wheel.effects.base import Channels, Memory, Parameter
from rwa_monitor.wheel.effects.viscous_jump import ViscousJump

BLOCKS: Final = 3_000  # of a record, between which the segmentation may cut; each cut is then placed to the sample
LINE_PENALTY: Final = 2 * JUMP_PENALTY  # times log N, for a new straight line: its level and its slope
SHORTEST_BLOCKS: Final = 3  # of a straight line: shorter ones are blocks in which something jumps
MOST_CHANGES: Final = 24  # of slope: more are a law of speed, not jumps
HELD_OUT_BLOCKS: Final = 41  # so short that each slope is seen in blocks of both parities


class SlopeJumps(ViscousJumpTerm):
    """A viscous coefficient of its own in each of some stretches of time: `viscous_jump`, with slopes that are free."""

    uses_level = False
    parameters = ()
    places: tuple[int, ...] = ()  # joined index at which each stretch begins, but for the first

    @classmethod
    def columns(
        cls, channels: Channels, shape: Mapping[str, float], memory: Memory = None
    ) -> tuple[FloatArray, Memory]:
        """Return zeros: slopes are known only where they were found."""
        del shape, memory
        return np.zeros((len(channels), len(cls.parameters))), None


def with_slope_jumps(
    problem: Problem, model: Model, simpler: Model, alternatives: Callable[[Model], Sequence[Model]]
) -> Model | None:
    """Return the best model in which the viscous coefficient jumps by itself; None where that does not pay.

    Parameters
    ----------
    problem
        The data.
    model
        The best model without.
    simpler
        The base model: what `model` names may be what jumps of the slope look like.
    alternatives
        Returns a model extended by each of the free curves: slopes that differ since the drag is no straight line are
        a law of the speed.
    """
    kept = tuple(term for term in model.terms if term.effect.name != ViscousJump.name)
    fitting = Fitting(problem, jumps=True)
    begin = model if kept == model.terms else fitting.refitted(kept, model)
    best = _with_slopes(problem, begin)
    if best is not None and begin.terms:
        # What was named may be what jumps of the slope look like.
        alone = _with_slopes(problem, simpler)
        best = best if alone is None else min(best, alone, key=lambda one: one.score)
    if best is None or model.score - best.score < ACCEPT_GAIN:
        return None
    before, after = (held_out(problem, one, HELD_OUT_BLOCKS).log_score for one in (model, best))
    if after <= before:
        return None
    others = fitting.refitted(best.terms[:-1], best, [best.fit.jumps])
    drifting = fitting.refitted((*others.terms, _drifting(problem, best.terms[-1])), best, [best.fit.jumps])
    if min(alternative.score for alternative in (drifting, *alternatives(others))) <= best.score:
        return None
    return best


def _with_slopes(problem: Problem, begin: Model) -> Model | None:
    """Return a model with free slopes, without the names that they make superfluous; None where the slope is one."""
    term, fitting = _slopes(problem, begin), Fitting(problem, jumps=True)
    if term is None:
        return None
    return prune(fitting, fitting.refitted((*begin.terms, term), begin), keep_last=True)


def shared_strength(problem: Problem, model: Model, index: int) -> tuple[str, ParameterValue]:
    """Return the catalogue's strength, slope per dry friction [s/rad], that is nearest to free slopes, and its name."""
    (parameter,) = ViscousJump.parameters
    torque = model.terms[index].columns @ model.strengths(index)
    # Slopes are relative to that of the first stretch: how much all have in common is the base law's.
    value = float(np.linalg.lstsq(np.stack([problem.speed, model.fit.level * problem.speed], axis=1), torque)[0][1])
    note = "the coefficient's jumps are not in proportion to those of the dry friction"
    nearest = float(np.clip(value, parameter.low, parameter.high))
    return parameter.name, ParameterValue(nearest, None, parameter.unit, note)


# ---- where the slope changes -----------------------------------------------------------------------------------------


def _slopes(problem: Problem, model: Model) -> Term | None:
    """Return the stretches of time in which the slope is another, as columns; None where it is one all over."""
    values = model.fit.level + model.fit.residual + model.fit.coefficients[0] * problem.speed
    variance = problem.noise.long_run_variance
    cuts: list[int] = []
    for begin, end in zip(problem.starts[:-1].tolist(), problem.starts[1:].tolist(), strict=True):
        if end > begin:
            width = max((end - begin) // BLOCKS, 1)
            speed, of_one = problem.speed[begin:end], values[begin:end]
            found = _straight_lines(speed, of_one, width, LINE_PENALTY * problem.log_size * variance)
            cuts += [begin, *(begin + _placed(speed, of_one, found, width)).tolist()]
    first = np.array(cuts, dtype=np.int64)
    places = _merged(problem.speed, values, first, JUMP_PENALTY * problem.log_size * variance)
    return _term(problem, places) if 0 < len(places) <= MOST_CHANGES else None


def _term(problem: Problem, places: Sequence[int]) -> Term:
    stretch = np.searchsorted(places, np.arange(problem.size), side="right")
    columns = problem.speed[:, None] * (stretch[:, None] == np.arange(1, len(places) + 1))
    names = [f"change_{j + 1}_Nm_s_rad" for j in range(len(places))]
    parameters = tuple(Parameter(name, "N m s/rad", -np.inf, np.inf, 0.0, linear=True) for name in names)
    effect = type("SlopeJumps", (SlopeJumps,), {"parameters": parameters, "places": tuple(places)})
    free = np.full(len(places), np.inf)
    return Term(effect, {}, columns, -free, free, own=True, price=JUMP_PENALTY * len(places))


def _drifting(problem: Problem, term: Term) -> Term:
    """Return a coefficient that drifts through as many knots, in place of one that jumps as often."""
    assert issubclass(term.effect, SlopeJumps)
    edges = np.array([0, *term.effect.places, problem.size], dtype=np.float64)
    knots, at = 0.5 * (edges[1:] + edges[:-1]), np.arange(problem.size)
    hats = np.stack([np.interp(at, knots, unit) for unit in np.eye(knots.size)[1:]], axis=1)
    return replace(term, columns=hats * problem.speed[:, None])


def _straight_lines(speed: FloatArray, values: FloatArray, width: int, penalty: float) -> IntArray:
    """Return the index at which each straight line over the speed begins, but the first, to a block's width."""
    x, z = speed - speed.mean(), values - values.mean()  # sums of squares then lose few digits
    edges = np.append(np.arange(0, x.size, width), x.size)
    sums = np.cumsum([np.ones(x.size), x, z, x * x, x * z, z * z], axis=1)
    return edges[optimal_lines(np.take(np.pad(sums, ((0, 0), (1, 0))), edges, axis=1), penalty)]


def _placed(speed: FloatArray, values: FloatArray, found: IntArray, width: int) -> IntArray:
    """Move each cut to where the lines on both its sides fit best, in place of the blocks that hold some of either."""
    edges = np.concatenate([[0], found, [speed.size]])
    long = np.diff(edges) >= SHORTEST_BLOCKS * width
    begins, ends = edges[:-1][long], edges[1:][long]
    placed = []
    for i in range(begins.size - 1):
        before, after = slice(begins[i], ends[i]), slice(begins[i + 1], ends[i + 1])
        near = slice(max(ends[i] - width, begins[i]), min(begins[i + 1] + width, ends[i + 1]))
        squares = [(values[near] - _line(speed, values, side, speed[near])) ** 2 for side in (before, after)]
        placed.append(near.start + int(np.argmin(np.cumsum(np.append(0.0, squares[0] - squares[1])))))
    return np.array(placed, dtype=np.int64)


def _line(speed: FloatArray, values: FloatArray, side: slice, at: FloatArray) -> FloatArray:
    x = speed[side] - speed[side].mean()
    slope = float(x @ values[side]) / max(float(x @ x), np.finfo(np.float64).tiny)
    return np.asarray(values[side].mean() + slope * (at - speed[side].mean()))


def _merged(speed: FloatArray, values: FloatArray, first: IntArray, price: float) -> tuple[int, ...]:
    """Return where the slope changes: neighbours are merged while one slope for both costs less than a change does."""
    sums = [np.add.reduceat(one, first) for one in (np.ones(speed.size), speed, values, speed**2, speed * values)]
    n, x, z, xx, xz = sums
    rest = np.stack([xx - x * x / n, xz - x * z / n])  # energy and moment of each
    while first.size > 1:
        (e0, m0), (e1, m1) = rest[:, :-1], rest[:, 1:]
        both = e0 * e1
        costs = np.where(both > 0, (m0 * e1 - m1 * e0) ** 2 / np.where(both > 0, both * (e0 + e1), 1.0), 0.0)
        i = int(np.argmin(costs))
        if costs[i] >= price:
            break
        rest[:, i] += rest[:, i + 1]
        rest, first = np.delete(rest, i + 1, axis=1), np.delete(first, i + 1)
    return tuple(first[1:].tolist())
