"""The shape of an effect, profiled on the data: a coarse grid in the range that the records resolve, then a refinement.

Each shape is judged as a term (see `terms`) added to the model.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

import numpy as np
from scipy import optimize

from rwa_monitor.discrepancy.likelihood import SETTLED
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.discrepancy.score import Background
from rwa_monitor.discrepancy.terms import Term, make_term
from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import MeanEffect, Parameter

FEW_CHOICES: Final = 3  # of a discrete shape parameter: up to so many are all tried again in each refinement
GRID_POINTS: Final = 9  # per continuous shape parameter; the profile is then refined between neighbours
EVALUATIONS: Final = 20  # in a refinement, per continuous shape parameter; models are refitted several times
LOG_SPACING_FROM: Final = 8.0  # ratio of bounds above which the values of a shape parameter are spaced logarithmically


def profile(
    background: Background,
    level: FloatArray | None,
    effect: type[MeanEffect],
    around: Term | None = None,
) -> tuple[Term, float]:
    """Find the shape parameters with the best criterion, given the terms that are in the model already.

    A coarse grid within the records' bounds (or around a known term), then a bounded refinement between its points.

    Returns
    -------
    term, criterion
        The effect at its best shape, and the criterion there.
    """
    problem = background.problem
    limits, reach = shape_limits(problem, effect), reach_between(problem, effect)
    axes = [_axis(one, *limits[one.name], around, reach.get(one.name, 0.0)) for one in effect.shape_parameters()]
    grid = dict.fromkeys(itertools.product(*(axis.points for axis in axes)))
    again = grid if around is None else {}  # kept: the same for every model, as other shapes are not

    @cache
    def evaluate(values: tuple[float, ...]) -> tuple[Term, float]:
        shape = {axis.name: value for axis, value in zip(axes, values, strict=True)}
        term = make_term(problem, effect, shape, level, keep=values in again)
        return term, background.criterion_with(term)

    def cost(values: tuple[float, ...]) -> float:
        return evaluate(values)[1]

    best = min(grid, key=cost)
    continuous = [i for i, axis in enumerate(axes) if axis.refine and len(axis.points) > 1]
    return evaluate(_refine(axes, continuous, best, cost) if continuous else best)


@dataclass(frozen=True, slots=True)
class _Axis:
    """The values of one shape parameter that are tried, and whether and how the best of them is refined."""

    name: str
    points: tuple[float, ...]
    refine: bool = False
    logarithmic: bool = False

    def scale(self, value: float) -> float:
        """Return a value on the scale of the refinement."""
        return float(np.log(value)) if self.logarithmic else value

    def value(self, scaled: float) -> float:
        """Return the value at a position on that scale, clipped to the ends of the axis."""
        value = float(np.exp(scaled)) if self.logarithmic else scaled
        return min(max(value, self.points[0]), self.points[-1])


def shape_limits(problem: Problem, effect: type[MeanEffect]) -> dict[str, tuple[float, float]]:
    """Return the range of each shape parameter, from the lowest to the highest that any record can resolve."""
    bounds = [effect.shape_bounds(record.channels) for record in problem.records]
    return {name: (min(one[name][0] for one in bounds), max(one[name][1] for one in bounds)) for name in bounds[0]}


def reach_between(problem: Problem, effect: type[MeanEffect]) -> dict[str, float]:
    """Return how far a search moves each discrete shape parameter off a choice: the least that a record allows."""
    per_record = [effect.reach_between(record.channels) for record in problem.records]
    names = set.intersection(*(set(one) for one in per_record))
    return {name: min(one[name] for one in per_record) for name in names}


def is_logarithmic(low: float, high: float) -> bool:
    """Return whether the values of a shape parameter between these bounds are spaced logarithmically."""
    return low > 0 and high / low > LOG_SPACING_FROM


def _axis(parameter: Parameter, low: float, high: float, around: Term | None, reach: float) -> _Axis:
    name, choices = parameter.name, parameter.choices
    centre = None if around is None else around.shape[name]
    if centre is not None and reach > 0.0:
        first, last = max(centre - reach, low), min(centre + reach, high)
        usual = [choice for choice in choices if first < choice < last]
        return _Axis(name, tuple(sorted({first, centre, last, *usual})), refine=True)
    if choices:
        if reach > 0.0 and len(choices) == 1:  # no slope may lead from it to a far optimum
            return _Axis(name, tuple(sorted({*choices, min(choices[0] + reach, high)})))
        shown = tuple(choice for choice in choices if low <= choice <= high) or (high,)
        return _Axis(name, shown if centre is None or (len(choices) <= FEW_CHOICES and centre in shown) else (centre,))
    if not low < high:
        return _Axis(name, (low,))
    logarithmic = is_logarithmic(low, high)
    grid = np.geomspace(low, high, GRID_POINTS) if logarithmic else np.linspace(low, high, GRID_POINTS)
    if centre is not None:
        grid = np.unique([*grid[grid < centre][-1:], centre, *grid[grid > centre][:1]])
    return _Axis(name, tuple(grid.tolist()), True, logarithmic)


def _refine(
    axes: list[_Axis], positions: list[int], best: tuple[float, ...], cost: Callable[[tuple[float, ...]], float]
) -> tuple[float, ...]:
    """Minimise over several axes at once: correlated shape parameters form a valley that lies across the axes.

    J. A. Nelder, R. Mead, The Computer Journal 7, 1965.
    """
    start = np.array([axes[i].scale(best[i]) for i in positions])
    bounds, steps = [], []
    for i, at in zip(positions, start, strict=True):
        low, high = (axes[i].scale(axes[i].points[end]) for end in (0, -1))
        half_a_cell = 0.5 * (high - low) / (len(axes[i].points) - 1)
        bounds.append((low, high))
        steps.append(half_a_cell if at < 0.5 * (low + high) else -half_a_cell)

    def shaped(u: FloatArray) -> tuple[float, ...]:
        values = list(best)
        for i, at in zip(positions, u.tolist(), strict=True):
            values[i] = axes[i].value(at)
        return tuple(values)

    options: Any = {
        "initial_simplex": np.vstack([start, start + np.diag(steps)]),
        "maxfev": EVALUATIONS * len(positions),
        "fatol": SETTLED,
        "xatol": np.inf,
    }
    minimize: Any = optimize.minimize
    found = minimize(lambda u: cost(shaped(u)), start, method="Nelder-Mead", bounds=bounds, options=options)
    better = shaped(found.x)
    return better if cost(better) < cost(best) else best


def middle_shape(problem: Problem, effect: type[MeanEffect], share: float = 0.5) -> dict[str, float]:
    """Return a shape in the middle of the range that the first record can resolve, or at another share of it."""
    bounds = effect.shape_bounds(problem.records[0].channels)
    shape = {}
    for parameter in effect.shape_parameters():
        low, high = bounds[parameter.name]
        within = low ** (1.0 - share) * high**share if low > 0 else low + share * (high - low)
        shown = [choice for choice in parameter.choices if low <= choice <= high]
        shape[parameter.name] = shown[0] if shown else high if parameter.choices else float(within)
    return shape
