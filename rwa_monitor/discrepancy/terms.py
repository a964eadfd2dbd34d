"""Terms: an effect of the catalogue put into columns of the search problem, and its shape profiled on the data."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from numba import njit
from scipy import optimize
from scipy.ndimage import uniform_filter1d

from rwa_monitor.discrepancy.base_fit import (
    JUMP_PENALTY,
    TUKEY,
    long_lag,
    remove_levels,
    same_record,
    segment_starts,
    solve_bounded,
    strong_level,
    weight_by_size,
)
from rwa_monitor.discrepancy.delay_term import LEAD, SLOPE_REACH, without_pulses
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.discrepancy.record import Record
from rwa_monitor.physics.effects.base import Channels, MeanEffect, Parameter
from rwa_monitor.physics.effects.torque_ripple import TorqueRipple
from rwa_monitor.samples import FloatArray, IntArray

FEW_CHOICES: Final = 3  # of a discrete shape parameter: so few are tried again in each refinement
GRID_POINTS: Final = 9  # per continuous shape parameter; the profile is then refined between neighbours
LOG_SPACING_FROM: Final = 8.0  # ratio of bounds from which a shape parameter is spaced in logarithm
ROBUST_PAIRS: Final = 8_000  # differences that the robust start looks at, evenly spread
ROBUST_ROUNDS: Final = 5  # reweightings; the shape only starts the fit
LARGEST: Final = float(np.finfo(np.float64).max)  # in place of an infinite value
EXPLAINED_AWAY: Final = 1e-8  # share of a column's square below which levels and slope already hold it


@dataclass(frozen=True, slots=True)
class Term:
    """An effect with shape parameters fixed, as columns.

    Attributes
    ----------
    effect
        Its class.
    shape
        Values of the shape parameters.
    columns
        float64 (n, p) at the joined samples, multiplied by s, at unit strength.
    low, high
        float64 (p,), bounds of the strengths.
    smooth
        Whether the strengths are heights of neighbouring knots: what data does not tell is then as its neighbour.
    own
        Whether the columns are of these data alone: effect and shape do not tell them.
    price
        Of the parameters, in units of log N, where that is not their number.
    """

    effect: type[MeanEffect]
    shape: Mapping[str, float]
    columns: FloatArray
    low: FloatArray
    high: FloatArray
    smooth: bool = False
    own: bool = False
    price: float | None = None

    @property
    def name(self) -> Hashable:
        """Say which columns these are, of one problem; None where effect and shape do not tell."""
        return None if self.own or depends_on_level(self.effect) else _name(self.effect, self.shape)

    @property
    def parameters(self) -> float:
        """Return what the parameters cost, in units of log N: their number, shape included, where nothing is said."""
        return len(self.effect.parameters) if self.price is None else self.price


def make_term(problem: Problem, effect: type[MeanEffect], shape: Mapping[str, float], level: FloatArray | None) -> Term:
    """Evaluate an effect's columns on all records.

    Parameters
    ----------
    level
        Current estimate of the dry level at the joined samples [N m], for effects that scale with it.
    """
    return _make_term(problem, effect, shape, _strong(problem, effect, level))


class _Strong:
    """A level with only its strong jumps, which columns follow, and the channels that it gives.

    The channels are the same for every shape of an effect: they are made when they are first asked for.
    """

    def __init__(self, problem: Problem, level: FloatArray) -> None:
        self.problem = problem
        self.level = level  # (n,) [N m]
        self._cleaned: dict[float, _Strong] = {}

    def without_pulses(self, lead: float) -> _Strong:
        """Return the level with its pulses taken out, see `delay_term`."""
        if lead not in self._cleaned:
            self._cleaned[lead] = _Strong(self.problem, without_pulses(self.level, lead))
        return self._cleaned[lead]

    @cached_property
    def step(self) -> float:
        """A small step of the level [N m], for differences."""
        return 1e-3 * float(np.mean(np.abs(self.level))) or 1.0

    @cached_property
    def stepped(self) -> _Strong:
        """The level a small step up."""
        return _Strong(self.problem, self.level + self.step)

    @cached_property
    def channels(self) -> list[Channels]:
        """The channels of each record with this level, and with the motor torque that would overcome it."""
        problem, level = self.problem, self.level
        slope = float((problem.z - level) @ problem.speed / max(float(problem.speed @ problem.speed), 1e-300))
        per_record = []
        for record, dry in zip(problem.records, problem.spread(level), strict=True):
            channels = replace(record.channels, dry_level_Nm=dry)
            if record.accelerating_torque_Nm is not None:
                motor = record.accelerating_torque_Nm + channels.direction * dry + slope * _steady_speed(record)
                rate = np.gradient(motor, channels.sample_period_s)
                channels = replace(channels, motor_torque_Nm=motor, motor_torque_rate_Nm_s=rate)
            per_record.append(channels)
        return per_record

    def columns(self, effect: type[MeanEffect], shape: Mapping[str, float]) -> FloatArray:
        """Evaluate the columns of an effect with this level, float64 (n, p), multiplied by s."""
        return _evaluate(self.problem, effect, shape, self.channels)


def _steady_speed(record: Record) -> FloatArray:
    """Return the speed [rad/s] whose slope shares no noise with friction derived from it, float64 (slots,).

    The slope of a moving mean is told by what enters and leaves it: so far away that no derivative reaches there.
    """
    speed = record.channels.speed_rad_s
    if not record.friction_is_derived:
        return speed
    reach = record.derivative_slots // 2 + SLOPE_REACH + 1
    known = np.isfinite(speed)
    sums = uniform_filter1d(np.where(known, speed, 0.0), 2 * reach + 1, mode="nearest")
    share = uniform_filter1d(known.astype(np.float64), 2 * reach + 1, mode="nearest")
    return np.where(known, sums / np.where(known, share, 1.0), np.nan)


def _strong(problem: Problem, effect: type[MeanEffect], level: FloatArray | None) -> _Strong | None:
    """Return what of a level an effect's columns follow; None where they follow none.

    Only strong jumps count: many weak ones may follow another effect, and the column would then follow it as well.
    """
    if level is None or not depends_on_level(effect):
        return None
    decides = level, problem.z, problem.records
    price = problem.noise.long_run_variance
    return problem.recent.get(
        decides, price, lambda: _Strong(problem.with_empty_caches(), strong_level(problem, level))
    )


def _make_term(problem: Problem, effect: type[MeanEffect], shape: Mapping[str, float], strong: _Strong | None) -> Term:
    """Evaluate an effect's columns, given the level with only its strong jumps."""
    strengths = effect.strength_parameters()
    key = _name(effect, shape)
    columns = problem.columns.get(key)
    if columns is None and strong is not None:
        columns = _columns_with_level(effect, shape, strong)
    if columns is None:
        by_angle = issubclass(effect, TorqueRipple)
        channels = [record.undrifted if by_angle else record.channels for record in problem.records]
        columns = _evaluate(problem, effect, shape, channels)
        if not depends_on_level(effect):
            problem.columns.put(key, columns)
    low, high = (np.array([getattr(p, end) for p in strengths]) for end in ("low", "high"))
    return Term(effect, dict(shape), columns, low, high, price=_price(effect, shape))


def _price(effect: type[MeanEffect], shape: Mapping[str, float]) -> float | None:
    """Return the price of parameters some of which may lie between choices; None where none can.

    A choice is what physics expects: off it costs a parameter more. What has one choice alone costs nothing there.
    """
    between = [p for p in effect.parameters if p.between]
    if not between:
        return None
    off = sum(shape[p.name] not in p.choices for p in between)
    return len(effect.parameters) - sum(len(p.choices) == 1 for p in between) + off


def _evaluate(
    problem: Problem, effect: type[MeanEffect], shape: Mapping[str, float], channels: Sequence[Channels]
) -> FloatArray:
    """Evaluate the columns on the channels of each record, joined and multiplied by s, float64 (n, p)."""
    per_record = [effect.columns(of_one, shape)[0] for of_one in channels]
    columns = problem.gather(per_record)
    _multiply_known(columns, problem.sign)
    return columns


@njit(cache=True, nogil=True)
def _multiply_known(columns: FloatArray, sign: FloatArray) -> None:
    """Multiply columns by s in place, zero where they are unknown."""
    for k in range(columns.shape[0]):
        for j in range(columns.shape[1]):
            value = columns[k, j]
            if np.isnan(value):
                value = 0.0
            elif np.isinf(value):
                value = LARGEST if value > 0 else -LARGEST
            columns[k, j] = value * sign[k]


def _name(effect: type[MeanEffect], shape: Mapping[str, float]) -> Hashable:
    return effect.name, tuple(shape.items())


def depends_on_level(effect: type[MeanEffect]) -> bool:
    """Say whether an effect's columns follow from the dry level, by itself or as a part of the motor torque."""
    return effect.uses_level or "motor_torque_Nm" in effect.needs


def _columns_with_level(effect: type[MeanEffect], shape: Mapping[str, float], strong: _Strong) -> FloatArray:
    """Evaluate the columns with a dry level, and with the motor torque that accelerates and overcomes that level.

    The measured motor torque holds the very friction that is to be explained, jumps and noise included: less J·dω/dt it
    would explain everything by itself. A column that follows the level would explain its jumps by themselves, too: the
    part in proportion to the level is left to the levels.
    """
    if LEAD in shape:
        strong = strong.without_pulses(shape[LEAD])
    level, columns = strong.level, strong.columns(effect, shape)
    if not effect.uses_level:
        share = np.median((strong.stepped.columns(effect, shape) - columns) / strong.step, axis=0)
        return np.asarray(columns - level[:, None] * share, dtype=np.float64)
    centred = level - level.mean()
    energy = float(centred @ centred)
    if energy <= (1e-9 * float(np.max(np.abs(level)))) ** 2 * level.size:
        return columns
    return np.asarray(columns - centred[:, None] * (centred @ columns / energy), dtype=np.float64)


def design_of(problem: Problem, terms: Sequence[Term]) -> FloatArray:
    """Return the columns of a model, float64 (n, 1 + p): speed, then the terms'."""
    return np.column_stack([problem.speed, *(term.columns for term in terms)])


def available(problem: Problem, effect: type[MeanEffect]) -> str | None:
    """Return which channel an effect lacks in these records, or None when it has all."""
    for channel in sorted(effect.needs):
        if any(getattr(record.channels, channel) is None for record in problem.records):
            return channel
    return None


@dataclass(frozen=True, slots=True)
class Background:
    """What is in the model already, prepared for adding one term: a jump set and the inner design."""

    problem: Problem
    first: IntArray
    jump_set: IntArray
    jumps: int
    design: FloatArray  # (n, 1 + p) without levels
    gram: FloatArray
    moment: FloatArray
    low: FloatArray
    high: FloatArray
    z: FloatArray  # without levels
    zz: float
    level: FloatArray  # (n,), dry level with this jump set [N m]

    def criterion_with(self, term: Term, squares: FloatArray | None = None) -> float:
        """Return RSS/σ² + penalties with the term added, jumps kept (an upper bound of the full criterion).

        `squares` are the products of the term's columns, float64 (p, p), where they are known.
        """
        squares = term.columns.T @ term.columns if squares is None else squares
        sums = np.add.reduceat(term.columns, self.first, axis=0)
        lengths = np.diff(np.append(self.first, term.columns.shape[0]))[:, None]
        cross = self.design.T @ term.columns  # the design is without levels: what the column holds of them adds nothing
        size = self.gram.shape[0] + sums.shape[1]
        gram = np.empty((size, size))
        cut = self.gram.shape[0]
        gram[:cut, :cut] = self.gram
        gram[:cut, cut:] = cross
        gram[cut:, :cut] = cross.T
        gram[cut:, cut:] = squares - sums.T @ (sums / lengths)
        moment = np.concatenate([self.moment, term.columns.T @ self.z])
        solution = solve_bounded(
            self.problem,
            gram,
            moment,
            np.concatenate([self.low, term.low]),
            np.concatenate([self.high, term.high]),
        )
        rss = self.zz - 2 * solution @ moment + solution @ gram @ solution
        penalties = JUMP_PENALTY * self.jumps + term.parameters
        return float(rss / self.problem.noise.long_run_variance + self.problem.log_size * penalties)


def make_background(problem: Problem, chosen: Sequence[Term], jumps: IntArray) -> Background:
    """Prepare the model made of `chosen` with the given jumps."""
    first = segment_starts(problem, jumps)
    whole = design_of(problem, chosen)
    design = remove_levels(whole, first)
    z = remove_levels(problem.z, first)
    gram, moment = design.T @ design, design.T @ z
    low = np.concatenate([[-np.inf], *(term.low for term in chosen)])
    high = np.concatenate([[np.inf], *(term.high for term in chosen)])
    rest = problem.z - whole @ solve_bounded(problem, gram, moment, low, high)
    return Background(
        problem,
        first,
        jumps,
        int(jumps.size),
        design,
        gram,
        moment,
        low,
        high,
        z,
        float(z @ z),
        rest - remove_levels(rest, first),
    )


@dataclass(frozen=True, slots=True)
class RobustBackground:
    """Differences over a lag of what is in the model already: jumps are outliers in them, no segmentation is needed."""

    problem: Problem
    lag: int
    pairs: IntArray  # (m,)
    rise: FloatArray  # (m, 1 + p)
    z: FloatArray  # (m,)
    low: FloatArray
    high: FloatArray
    scale: float

    def cost_with(self, term: Term) -> float:
        """Return Tukey's loss of the differences with the term added, coefficients refitted [-]."""
        rise = np.column_stack([self.rise, term.columns[self.pairs + self.lag] - term.columns[self.pairs]])
        low, high = np.concatenate([self.low, term.low]), np.concatenate([self.high, term.high])
        weight = np.ones(self.z.size)
        residual = self.z
        for _ in range(ROBUST_ROUNDS):
            weighted = rise * weight[:, None]
            solution = solve_bounded(self.problem, rise.T @ weighted, weighted.T @ self.z, low, high)
            residual = self.z - rise @ solution
            weight_by_size(residual, TUKEY * self.scale, weight)
        return float(np.sum(1.0 - np.maximum(1.0 - (residual / (TUKEY * self.scale)) ** 2, 0.0) ** 3))


def make_robust_background(problem: Problem, chosen: Sequence[Term]) -> RobustBackground:
    """Prepare long-lag differences of the model made of `chosen`."""
    lag = long_lag(problem)
    pairs = np.flatnonzero(same_record(problem, lag))
    pairs = pairs[:: max(pairs.size // ROBUST_PAIRS, 1)]
    design = np.column_stack([problem.speed, *(term.columns for term in chosen)])
    return RobustBackground(
        problem,
        lag,
        pairs,
        design[pairs + lag] - design[pairs],
        problem.z[pairs + lag] - problem.z[pairs],
        np.concatenate([[-np.inf], *(term.low for term in chosen)]),
        np.concatenate([[np.inf], *(term.high for term in chosen)]),
        float(np.sqrt(2.0) * problem.noise.std),
    )


def profile_robustly(effect: type[MeanEffect], background: RobustBackground, level: FloatArray | None) -> Term:
    """Find the shape on which Tukey's loss of long-lag differences is least: a start that trusts no segmentation."""
    problem, strong = background.problem, _strong(background.problem, effect, level)
    axes = _axes(problem, effect, None)

    def evaluate(values: tuple[float, ...]) -> tuple[Term, float]:
        shape = {axis.name: value for axis, value in zip(axes, values, strict=True)}
        term = _make_term(problem, effect, shape, strong)
        return term, background.cost_with(term)

    best = min(itertools.product(*(axis.points for axis in axes)), key=lambda values: evaluate(values)[1])
    for i, axis in enumerate(axes):
        if axis.refine:
            best = _refine(axis, i, best, lambda values: evaluate(values)[1])
    return evaluate(best)[0]


def profile(
    effect: type[MeanEffect],
    backgrounds: Sequence[Background],
    level: FloatArray | None,
    around: Term | None = None,
    fixed: Mapping[str, float] | None = None,
) -> tuple[Term, float]:
    """Find the shape parameters with the best criterion over the given backgrounds.

    A coarse grid inside the record's bounds (or around a known term), then a bounded refinement: no fixed grid decides.
    Parameters in `fixed` keep their values.

    Returns
    -------
    term, criterion
        The effect at its best shape, and the criterion there.
    """
    problem, strong = backgrounds[0].problem, _strong(backgrounds[0].problem, effect, level)
    axes = [
        _Axis(axis.name, (fixed[axis.name],), False, False) if fixed and axis.name in fixed else axis
        for axis in _axes(problem, effect, around)
    ]
    cache: dict[tuple[float, ...], tuple[Term, float]] = {}

    def evaluate(values: tuple[float, ...]) -> tuple[Term, float]:
        if values not in cache:
            shape = {axis.name: value for axis, value in zip(axes, values, strict=True)}
            term = _make_term(problem, effect, shape, strong)
            squares = term.columns.T @ term.columns
            cache[values] = term, min(background.criterion_with(term, squares) for background in backgrounds)
        return cache[values]

    grid = list(itertools.product(*(axis.points for axis in axes)))
    best = min(grid, key=lambda values: evaluate(values)[1])
    continuous = [i for i, axis in enumerate(axes) if axis.refine]
    for _ in range(2 if len(continuous) > 1 else 1):
        for i in continuous:
            best = _refine(axes[i], i, best, lambda values: evaluate(values)[1])
    return evaluate(best)


@dataclass(frozen=True, slots=True)
class _Axis:
    name: str
    points: tuple[float, ...]
    refine: bool
    logarithmic: bool


def shape_limits(problem: Problem, effect: type[MeanEffect]) -> dict[str, tuple[float, float]]:
    """Return the range of each shape parameter that any of the records can show."""
    bounds: dict[str, tuple[float, float]] = {}
    for record in problem.records:
        for name, (low, high) in effect.shape_bounds(record.channels).items():
            old = bounds.get(name, (low, high))
            bounds[name] = (min(low, old[0]), max(high, old[1]))
    return bounds


def reach_between(problem: Problem, effect: type[MeanEffect]) -> dict[str, float]:
    """Return how far a discrete shape parameter is moved off a choice: what all records show, the least of it."""
    per_record = [effect.reach_between(record.channels) for record in problem.records]
    names = set.intersection(*(set(one) for one in per_record))
    return {name: min(one[name] for one in per_record) for name in names}


def _axes(problem: Problem, effect: type[MeanEffect], around: Term | None) -> list[_Axis]:
    bounds = shape_limits(problem, effect)
    reach = reach_between(problem, effect) if around is not None else {}
    return [
        _axis(parameter, *bounds[parameter.name], around, reach.get(parameter.name, 0.0))
        for parameter in effect.shape_parameters()
    ]


def _axis(parameter: Parameter, low: float, high: float, around: Term | None, reach: float) -> _Axis:
    if around is not None and reach > 0.0:
        centre = around.shape[parameter.name]
        points = (max(centre - reach, low), centre, min(centre + reach, high))
        usual = [choice for choice in parameter.choices if points[0] < choice < points[2]]
        return _Axis(parameter.name, tuple(sorted({*points, *usual})), True, False)
    if parameter.choices:
        keep = around is not None and len(parameter.choices) > FEW_CHOICES
        choices = (around.shape[parameter.name],) if around is not None and keep else parameter.choices
        return _Axis(parameter.name, choices, False, False)
    if not low < high:
        return _Axis(parameter.name, (low,), False, False)
    logarithmic = low > 0 and high / low > LOG_SPACING_FROM
    grid = np.geomspace(low, high, GRID_POINTS) if logarithmic else np.linspace(low, high, GRID_POINTS)
    if around is not None:
        centre = around.shape[parameter.name]
        neighbours = [*grid[grid < centre][-1:], *grid[grid > centre][:1]]
        grid = np.unique([*neighbours, centre])
    return _Axis(parameter.name, tuple(float(p) for p in grid), True, logarithmic)


def _refine(
    axis: _Axis, position: int, best: tuple[float, ...], cost: Callable[[tuple[float, ...]], float]
) -> tuple[float, ...]:
    """Minimise along one axis between the neighbours of the best point."""
    points = sorted({*axis.points, best[position]})
    at = points.index(best[position])
    low, high = points[max(at - 1, 0)], points[min(at + 1, len(points) - 1)]
    to = np.log if axis.logarithmic else (lambda value: value)
    back = np.exp if axis.logarithmic else (lambda value: value)

    def along(u: float) -> float:
        return cost((*best[:position], float(back(u)), *best[position + 1 :]))

    found = optimize.minimize_scalar(along, bounds=(to(low), to(high)), method="bounded", options={"maxiter": 12})
    value = float(back(found.x))
    better = (*best[:position], value, *best[position + 1 :])
    return better if cost(better) < cost(best) else best
