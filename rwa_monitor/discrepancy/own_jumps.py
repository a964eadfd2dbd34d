"""Jumps that are independent of those of the dry friction: of the viscous coefficient, or of drag that relaxes again.

The catalogue's `viscous_jump` lets the coefficient follow the dry level, and `decaying_jump` lets a part of every jump
decay. Lubricant that moves in and out of the contact, or a pocket of oil that is run over, need not follow these laws:
each segment of time then has its own multiple of a known basis function, which is |ω| or an exponential decay. The
segments are found like the levels, by an exact segmentation, here into levels plus such a multiple; neighbours are
merged where the difference of their multiples lowers the score by less than its penalty. A change has the penalty of a
jump: it has a place, a size and a sign.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Final

import numpy as np

from rwa_monitor.discrepancy.base_fit import JUMP_PENALTY, jump_price, pieces
from rwa_monitor.discrepancy.fitting import LEAST_GAIN_SHARE, Fitting, off_steps
from rwa_monitor.discrepancy.jump_terms import DecayingJumpTerm, JumpTerm
from rwa_monitor.discrepancy.likelihood import ACCEPT_GAIN
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.discrepancy.record import LOST_DIGITS
from rwa_monitor.discrepancy.result import ParameterValue
from rwa_monitor.discrepancy.score import held_out
from rwa_monitor.discrepancy.search import prune
from rwa_monitor.discrepancy.shape_profile import shape_limits
from rwa_monitor.discrepancy.terms import Model, Term
from rwa_monitor.discrepancy.unexplained import with_nonparametric_curves
from rwa_monitor.discrepancy.unnamed import UNNAMED
from rwa_monitor.kernels.segmentation import optimal_curves
from rwa_monitor.samples import TINY, FloatArray, IntArray
from rwa_monitor.wheel.effects.base import Channels, MeanEffect, Memory, Parameter, Shape
from rwa_monitor.wheel.effects.jumps import DecayingJump, ViscousJump

BLOCKS: Final = 3_000  # of a record, between which the segmentation may cut; each cut is then moved to the exact sample
SHORTEST_BLOCKS: Final = 3  # of a segment: shorter ones are blocks that contain a jump
MOST_CHANGES: Final = 24  # more are a law of speed, not jumps
HELD_OUT_BLOCKS: Final = 41  # so short that each slope occurs in blocks of both parities, if it lasts for two of them
RATIO: Final = 1.5  # between successive time constants that are tried


class OwnJumps(JumpTerm):
    """A basis function, given by the subclass, with its own multiple in each of several segments of time."""

    uses_level = False
    parameters = ()
    places: ClassVar[IntArray]  # joined index at which each multiple begins
    seconds: ClassVar[float]  # time constant of the relaxation, infinite without

    @classmethod
    def columns(cls, channels: Channels, shape: Shape, memory: Memory = None) -> tuple[FloatArray, Memory]:
        """Return zeros: the multiples are known only on the searched records."""
        del shape, memory
        return np.zeros((len(channels), len(cls.parameters))), None

    @classmethod
    def nearest(cls, problem: Problem, model: Model, index: int) -> dict[str, ParameterValue]:
        """Return the catalogue's parameters that approximate the fitted multiples best, by name."""
        raise NotImplementedError


class SlopeJumps(OwnJumps, wraps=ViscousJump):
    """A viscous coefficient of its own in each of several segments of time: `viscous_jump` with free slopes."""

    @classmethod
    def nearest(cls, problem: Problem, model: Model, index: int) -> dict[str, ParameterValue]:
        """Return the strength of `viscous_jump`, whose slopes follow the dry level, that fits these slopes best."""
        (parameter,) = ViscousJump.parameters
        # Slopes are relative to that of one segment: their common part belongs to the base law.
        design = np.stack([problem.speed, model.fit.level * problem.speed], axis=1)
        strength = float(np.clip(np.linalg.lstsq(design, model.torque(index))[0][1], parameter.low, parameter.high))
        note = "the coefficient's jumps are not in proportion to those of the dry friction"
        return {parameter.name: ParameterValue(strength, None, parameter.unit, note)}


class RelaxingJumps(OwnJumps, wraps=DecayingJump):
    """Drag that jumps up at times of its own and relaxes: `decaying_jump`, independent of all other jumps."""

    @classmethod
    def nearest(cls, problem: Problem, model: Model, index: int) -> dict[str, ParameterValue]:
        """Return the share of all jumps that relaxes, and its time constant [s]."""
        del problem
        share, seconds = DecayingJump.parameters
        relaxing = float(np.sum(model.strengths(index)))
        steps = float(np.sum(np.abs(model.fit.level[model.fit.jumps] - model.fit.level[model.fit.jumps - 1])))
        note = "jumps of their own relax to nothing, those of the switching systems stay: the share of all"
        return {
            share.name: ParameterValue(relaxing / (relaxing + steps), None, share.unit, note),
            seconds.name: ParameterValue(cls.seconds, None, seconds.unit, ""),
        }


def with_own_jumps(fitting: Fitting, model: Model, simpler: Model, effects: Sequence[type[MeanEffect]]) -> Model | None:
    """Return the best model with jumps of their own; None where they gain too little or an alternative does better.

    Parameters
    ----------
    fitting, model
        Makes models of the data, and the best model without such jumps.
    simpler
        The base model: effects in `model` may only mimic such jumps.
    effects
        The effects that are searched for.
    """
    tried = {effect.name for effect in effects}
    ways = {SlopeJumps.name: _with_slope_jumps, RelaxingJumps.name: _with_relaxing_jumps}
    found = [with_it(fitting, model, simpler) for name, with_it in ways.items() if name in tried]
    best = min(found, key=lambda one: one.score, default=model)
    if model.score - best.score < ACCEPT_GAIN:
        return None
    # Slopes that differ because the drag is not linear in the speed are a law of the speed, not jumps.
    others = fitting.without(best, len(best.terms) - 1)
    outside = [effect for effect in effects if effect in UNNAMED and effect.name not in others.names]
    alternatives = *with_nonparametric_curves(fitting, others), *fitting.extensions(others, outside)
    return best if all(one.score > best.score for one in alternatives) else None


def _with_slope_jumps(fitting: Fitting, model: Model, simpler: Model) -> Model:
    """Return the best model with jumps of the viscous coefficient that predicts better, and where no drift fits."""
    problem = fitting.problem
    best = _best_with(fitting, model, simpler, [_Basis(problem)])

    def log_score(one: Model) -> float:
        return held_out(problem, one, HELD_OUT_BLOCKS).log_score

    if best is model or log_score(best) <= log_score(model):
        return model
    drifting = fitting.refitted((*best.terms[:-1], _drifting(problem, best.terms[-1])), best, [best.fit.jumps])
    return best if drifting.score > best.score else model


def _with_relaxing_jumps(fitting: Fitting, model: Model, simpler: Model) -> Model:
    """Return the best model with drag that jumps and relaxes, over all time constants."""
    low, high = shape_limits(fitting.problem, DecayingJumpTerm)["time_constant_s"]
    if not low < high:
        return model
    seconds = np.geomspace(low, high, int(np.log(high / low) / np.log(RATIO)) + 2).tolist()
    return _best_with(fitting, model, simpler, [_Basis(fitting.problem, one) for one in seconds])


def _best_with(fitting: Fitting, model: Model, simpler: Model, bases: Sequence[_Basis]) -> Model:
    """Return the best model with multiples of one of the basis functions; as it is where none gains enough.

    Starts from the given model without the catalogue's effect of the same name, and from the simpler model: effects of
    the given one may only mimic such jumps.
    """
    found = []
    kept = tuple(term for term in model.terms if term.effect.name != bases[0].effect.name)
    begin = model if kept == model.terms else fitting.refitted(kept, model)
    for start in (begin, simpler) if begin.terms else (begin,):
        terms = [term for basis in bases if (term := _segmented(basis, start)) is not None]
        rough = [fitting.refitted_roughly((*start.terms, x), start, [off_steps(x, start.fit.jumps)]) for x in terms]
        best = min(rough, key=lambda one: one.score, default=start)
        # The start's noise law contains what is missing: with it, so many jumps may be worth less than their penalty.
        lost = fitting.problem.log_size * best.terms[-1].parameters if rough else 0.0
        if start.score - best.score + lost > LEAST_GAIN_SHARE * max(start.score - model.score, 0.0):
            found.append(prune(fitting, fitting.refined(best), keep_last=True))
    return min(found, key=lambda one: one.score, default=model)


# ---- where the multiple changes --------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Basis:
    """The function of time that each segment has its own multiple of: |ω|, or exponential decay from its beginning."""

    problem: Problem
    seconds: float = np.inf

    @property
    def relaxes(self) -> bool:
        return self.seconds < np.inf

    @property
    def effect(self) -> type[OwnJumps]:
        return RelaxingJumps if self.relaxes else SlopeJumps

    def since(self, begin: IntArray | int, at: IntArray) -> FloatArray:
        """Return |ω| [rad/s], or the decay since the sample where a segment begins, at joined samples of one record.

        The decay is 1 before that sample: extrapolated back over a pause of hours it would overflow.
        """
        if not self.relaxes:
            return self.problem.speed[at]
        slots = np.maximum(self.problem.slot[at] - self.problem.slot[begin], 0)
        return np.asarray(np.exp(-slots * self.problem.records[0].channels.sample_period_s / self.seconds))

    def keep(self, first: IntArray) -> FloatArray:
        """Return the basis function's factor from each segment's start to the next one's, float64 (segments - 1,)."""
        if not self.relaxes:
            return np.ones(first.size - 1)
        of = np.searchsorted(self.problem.starts, first, side="right")
        return np.where(np.diff(of) == 0, self.since(first[:-1], first[1:]), 0.0)


def _segmented(basis: _Basis, model: Model) -> Term | None:
    """Return the changes of the multiple as a term; None where there are none or more than MOST_CHANGES."""
    problem = basis.problem
    values, price = model.fit.level + model.fit.residual, jump_price(problem)
    cuts: list[int] = []
    for piece in pieces(problem):
        begin, end = piece.start, piece.stop
        width = max((end - begin) // BLOCKS, 1)
        first = np.arange(begin, end, width)
        found = first[optimal_curves(_sums(basis, values, first, end), np.append(basis.keep(first), 1.0), price)]
        cuts += [begin, *_refined_cuts(basis, values, np.concatenate([[begin], found, [end]]), width)]
    places = _merged_changes(basis, values, np.array(cuts, dtype=np.int64), price)
    return _term(basis, places) if 0 < places.size <= MOST_CHANGES else None


def _sums(basis: _Basis, values: FloatArray, first: IntArray, end: int) -> FloatArray:
    """Return the sums of 1, x, z, xx, xz, zz over each segment, x from its first sample on, float64 (6, segments)."""
    at = np.arange(first[0], end)
    x = basis.since(np.repeat(first, np.diff(first, append=end)), at)
    z = values[at] - values[at].mean()  # sums of squares then lose few digits
    return np.add.reduceat([np.ones(at.size), x, z, x * x, x * z, z * z], first - first[0], axis=1)


def _refined_cuts(basis: _Basis, values: FloatArray, edges: IntArray, width: int) -> list[int]:
    """Drop segments of few blocks, which contain a jump; move each cut to where the curves on both sides fit best."""
    long = np.diff(edges) >= SHORTEST_BLOCKS * width
    begins, ends = edges[:-1][long].tolist(), edges[1:][long].tolist()
    placed = []
    for i in range(len(begins) - 1):
        near = np.arange(max(ends[i] - width, begins[i]), min(begins[i + 1] + width, ends[i + 1]))
        before, after = (
            (values[near] - _fitted_curve(basis, values, begins[side], ends[side], near)) ** 2 for side in (i, i + 1)
        )
        placed.append(int(near[0]) + int(np.argmin(np.cumsum(np.append(0.0, before - after)))))
    return placed


def _fitted_curve(basis: _Basis, values: FloatArray, begin: int, end: int, at: IntArray) -> FloatArray:
    """Return the fitted level plus multiple of a segment, at samples."""
    x = basis.since(begin, np.arange(begin, end))
    middle, x = x.mean(), x - x.mean()
    multiple = float(x @ values[begin:end]) / max(float(x @ x), TINY)
    return np.asarray(values[begin:end].mean() + multiple * (basis.since(begin, at) - middle))


def _merged_changes(basis: _Basis, values: FloatArray, first: IntArray, price: float) -> IntArray:
    """Return where the multiple changes: neighbours are merged while a common multiple costs less than a change does.

    Slopes of so few samples that they need not occur in two of the blocks held out are merged, too. Of drag that
    relaxes, only upward jumps: a pocket of oil that is run over adds drag.
    """
    n, x, z, xx, xz, _ = _sums(basis, values, first, values.size)
    energy = np.maximum(xx - x * x / n, LOST_DIGITS * xx.max())  # relative to each segment's beginning
    # A change is a multiple less what is left there of the one before.
    step = np.eye(first.size) - np.diag(basis.keep(first), -1)
    change, covariance = step @ ((xz - x * z / n) / energy), (step / energy) @ step.T
    given = 0 if basis.relaxes else 1  # multiples that are no changes: before the first jump there is nothing to relax
    shortest = 0 if basis.relaxes else 2 * values.size // HELD_OUT_BLOCKS
    while first.size > given:
        costs = change[given:] ** 2 / covariance.diagonal()[given:]
        short = np.diff(first, append=values.size) < shortest
        beside = short[given:] | short[: first.size - given]
        if beside.any():
            costs[~beside] = np.inf
        i = given + int(np.argmin(costs))
        if costs[i - given] >= price and not beside.any():
            break
        share = covariance[i] / covariance[i, i]
        change, first = np.delete(change - share * change[i], i), np.delete(first, i)
        covariance = np.delete(np.delete(covariance - np.outer(share, covariance[i]), i, 0), i, 1)
    return first[change > 0.0] if basis.relaxes else first[1:]


def _term(basis: _Basis, places: IntArray) -> Term:
    """Return a term with a column for the change of the multiple at each place."""
    problem, at = basis.problem, np.arange(basis.problem.size)
    columns = np.zeros((problem.size, places.size))
    if basis.relaxes:
        ends = problem.starts[np.searchsorted(problem.starts, places, side="right")]
        for j, (begin, end) in enumerate(zip(places.tolist(), ends.tolist(), strict=True)):
            columns[begin:end, j] = basis.since(begin, at[begin:end])
    else:
        segment = np.searchsorted(places, at, side="right")
        # Relative to the slope of the segment that determines it best, which is known with any block held out.
        base = int(np.argmax(np.bincount(segment, problem.speed**2, places.size + 1)))
        columns = problem.speed[:, None] * (segment[:, None] == np.delete(np.arange(places.size + 1), base))
    unit, least, price = ("N m", 0.0, 1.0) if basis.relaxes else ("N m s/rad", -np.inf, 0.0)
    parameters = tuple(Parameter(f"change_{j + 1}", unit, least, np.inf, 0.0, linear=True) for j in range(places.size))
    effect = type("OwnJumps", (basis.effect,), {"parameters": parameters, "places": places, "seconds": basis.seconds})
    low, high = np.full(places.size, least), np.full(places.size, np.inf)
    begins = places if basis.relaxes else None  # what relaxes within a block is not known from the others
    return Term(effect, {}, columns, low, high, price + JUMP_PENALTY * places.size, begins)


def _drifting(problem: Problem, term: Term) -> Term:
    """Return a coefficient that drifts, piecewise linear with as many knots, in place of one that jumps as often."""
    assert issubclass(term.effect, SlopeJumps)
    edges = np.concatenate([[0], term.effect.places, [problem.size]])
    knots, at = 0.5 * (edges[1:] + edges[:-1]), np.arange(problem.size)
    hats = np.stack([np.interp(at, knots, unit) for unit in np.eye(knots.size)[1:]], axis=1)
    return replace(term, columns=hats * problem.speed[:, None])
