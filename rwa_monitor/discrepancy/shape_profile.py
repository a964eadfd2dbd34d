"""The shape of an effect, profiled on the data: a coarse grid inside what the records can show, then a refinement.

Each shape is judged as a term (see `terms`) added to what is in the model already.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import optimize

from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.discrepancy.score import Background
from rwa_monitor.discrepancy.terms import Term, followed_level, make_term_with
from rwa_monitor.samples import FloatArray
from rwa_monitor.wheel.effects.base import MeanEffect, Parameter

FEW_CHOICES: Final = 3  # of a discrete shape parameter: so few are tried again in each refinement
GRID_POINTS: Final = 9  # per continuous shape parameter; the profile is then refined between neighbours
LOG_SPACING_FROM: Final = 8.0  # ratio of bounds from which a shape parameter is spaced in logarithm


def profile(
    effect: type[MeanEffect],
    background: Background,
    level: FloatArray | None,
    around: Term | None = None,
    fixed: Mapping[str, float] | None = None,
) -> tuple[Term, float]:
    """Find the shape parameters with the best criterion beside what is in the model already.

    A coarse grid inside the record's bounds (or around a known term), then a bounded refinement: no fixed grid decides.
    Parameters in `fixed` keep their values.

    Returns
    -------
    term, criterion
        The effect at its best shape, and the criterion there.
    """
    problem, followed = background.problem, followed_level(background.problem, effect, level)
    axes = [
        _Axis(axis.name, (fixed[axis.name],), False, False) if fixed and axis.name in fixed else axis
        for axis in _axes(problem, effect, around)
    ]
    grid = dict.fromkeys(itertools.product(*(axis.points for axis in axes)))
    again = grid if around is None else {}  # the same for every model: other shapes are seldom met again
    cache: dict[tuple[float, ...], tuple[Term, float]] = {}

    def evaluate(values: tuple[float, ...]) -> tuple[Term, float]:
        if values not in cache:
            shape = {axis.name: value for axis, value in zip(axes, values, strict=True)}
            term = make_term_with(problem, effect, shape, followed, keep=values in again)
            cache[values] = term, background.criterion_with(term)
        return cache[values]

    best = min(grid, key=lambda values: evaluate(values)[1])
    continuous = [i for i, axis in enumerate(axes) if axis.refine]
    for _ in range(2 if len(continuous) > 1 else 1):
        for i in continuous:
            best = _refine(axes[i], i, best, lambda values: evaluate(values)[1])
    return evaluate(best)


@dataclass(frozen=True, slots=True)
class _Axis:
    """The values of one shape parameter that are tried, and whether and how the best of them is refined."""

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


def middle_shape(problem: Problem, effect: type[MeanEffect]) -> dict[str, float]:
    """Return a shape in the middle of what the first record can show."""
    bounds = effect.shape_bounds(problem.records[0].channels)
    shape = {}
    for parameter in effect.shape_parameters():
        low, high = bounds[parameter.name]
        middle = float(np.sqrt(low * high)) if low > 0 else 0.5 * (low + high)
        shape[parameter.name] = parameter.choices[0] if parameter.choices else middle
    return shape
