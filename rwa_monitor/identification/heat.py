"""The law of a wheel's viscous friction in its bearing's temperature, learned from recordings; or else its spread.

The law is one of the catalogue's effects that follow the temperature, applied to all of the viscous friction. Its shape
and the jumps are fitted alternately, levels and slope by least squares (`base_fit`). Where the temperature was not
recorded, only the spread of viscous friction between recordings can be estimated.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy import optimize, stats

from rwa_monitor.discrepancy.base_fit import Fit, criterion, fit, make_problem, remove_levels, segment_starts
from rwa_monitor.discrepancy.likelihood import ACCEPT_GAIN
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.discrepancy.record import Record, temperature_range, without_known_effects
from rwa_monitor.discrepancy.shape_profile import reach_between, shape_limits
from rwa_monitor.discrepancy.terms import make_term
from rwa_monitor.samples import TINY, FloatArray, IntArray
from rwa_monitor.simulation.datasets import BASE_VISCOUS_STD
from rwa_monitor.wheel.effects.base import MeanEffect
from rwa_monitor.wheel.effects.catalogue import MEAN_EFFECTS, mean_effects, to_block, viscous_per_K
from rwa_monitor.wheel.wheel import Nominal, Wheel

# Least standard deviation of the friction from temperature, as a share of the lowest level; a smaller one is ignored.
SMALLEST_SWING: Final = 0.005
FEWEST_RECORDINGS: Final = 3  # for a spread: of two that differ, one may be of a failing wheel
GRID: Final = 4  # start values of each shape parameter
ROUNDS: Final = 2  # of alternating fits of jumps and shape
SETTLED: Final = 0.1  # change of the criterion at which a fit has converged
ONE_SIDED: Final = 0.95  # share of future recordings within the spread, on either side


@dataclass(frozen=True, slots=True)
class Heat:
    """Recordings corrected for the temperature, as far as its law is known.

    Attributes
    ----------
    problem, fitted
        The records, with the speed to which viscous friction is proportional, and the base law fitted to them.
    wheel
        The known wheel, with the learned effect and the range of temperatures in which it holds.
    spread
        Relative spread of viscous friction between recordings; None where it is no larger than usual.
    notes
        What was learned, a line each.
    """

    problem: Problem
    fitted: Fit
    wheel: Wheel
    spread: float | None = None
    notes: tuple[str, ...] = ()


def learn_heat(records: Sequence[Record], start: Wheel, bare: Wheel) -> Heat:
    """Learn the law of viscous friction in the temperature, or else its spread.

    Parameters
    ----------
    records
        As measured.
    start, bare
        The wheel as far as it is known, and the same without friction and effects.

    Raises
    ------
    InputError
        As `make_problem`.
    """
    known = [without_known_effects(record, start) for record in records]
    problem = make_problem(known, bare)
    plain = Heat(problem, fit(problem), start)
    if any(effect.follows_temperature for effect in mean_effects(start)):
        seen = start.temperature or temperature_range(records)
        return replace(plain, wheel=start.model_copy(update={"temperature": seen}))
    if any(record.channels.bearing_temperature_degC is None for record in records):
        return _with_spread(plain, known, bare)
    if not _follows_temperature(problem, plain.fitted):
        return plain
    laws = [
        _law_of(problem, effect, lags=lags)
        for effect in MEAN_EFFECTS.values()
        for lags in (False, True)
        if effect.follows_temperature
    ]
    law, fitted_with = min(laws, key=lambda one: one[1])
    if criterion(problem, plain.fitted) - fitted_with < ACCEPT_GAIN:
        return plain
    return _with_law(records, start, bare, law)


def _follows_temperature(problem: Problem, fitted: Fit) -> bool:
    """Return whether viscous friction falls with the bearing's temperature, significantly and by enough to matter."""
    known = [record.channels.bearing_temperature_degC for record in problem.records]
    temperature = problem.gather([values for values in known if values is not None])
    temperature = np.nan_to_num(temperature - np.nanmean(temperature))
    follows = fit(problem, (problem.speed * temperature)[:, None])
    # A lubricant's viscosity falls with temperature.
    falls = -float(follows.coefficients[1]) * float(np.std(problem.speed * temperature))
    better = criterion(problem, fitted) - criterion(problem, follows) >= ACCEPT_GAIN
    return better and falls >= SMALLEST_SWING * abs(float(fitted.level.min()))


def _law_of(problem: Problem, effect: type[MeanEffect], *, lags: bool) -> tuple[MeanEffect, float]:
    """Return the best fit of an effect that multiplies all viscous friction, and the criterion with its parameters.

    `lags`: whether to fit also discrete parameters (the sensor's lag) off their choices, where identifiable.
    """
    (strength,) = (parameter.name for parameter in effect.strength_parameters())
    limits, reach = shape_limits(problem, effect), reach_between(problem, effect) if lags else {}
    usual = {one.name: one.default or 0.0 for one in effect.shape_parameters()}
    bounds = {one.name: limits[one.name] for one in effect.shape_parameters() if not one.choices or one.name in reach}
    grids = [
        (low, low + reach[name]) if name in reach else np.linspace(low, high, GRID)
        for name, (low, high) in bounds.items()
    ]

    def shape(values: FloatArray) -> dict[str, float]:
        return usual | dict(zip(bounds, values.tolist(), strict=True))

    def with_shape(values: FloatArray) -> Problem:
        term = make_term(problem, effect, shape(values), None)
        return replace(problem, speed=problem.speed + term.columns[:, 0])

    def refitted(values: FloatArray) -> tuple[float, FloatArray, Fit]:
        followed = with_shape(values)
        fitted = fit(followed)
        return criterion(followed, fitted), values, fitted

    best = min((refitted(np.array(values)) for values in itertools.product(*grids)), key=lambda one: one[0])
    for _ in range(ROUNDS):
        first = segment_starts(problem, best[2].jumps)
        z = remove_levels(problem.z, first)

        def residual_cost(values: FloatArray, first: IntArray = first, z: FloatArray = z) -> float:
            x = remove_levels(with_shape(values).speed, first)
            return float(z @ z - (x @ z) ** 2 / (x @ x)) / problem.noise.long_run_variance

        ends = list(bounds.values())
        found = optimize.minimize(
            residual_cost, best[1], bounds=ends, method="Nelder-Mead", options={"fatol": SETTLED, "xatol": np.inf}
        )
        best = min(best, refitted(found.x), key=lambda one: one[0])
    law = effect(**{strength: max(float(best[2].coefficients[0]), 0.0), **shape(best[1])})
    return law, best[0] + problem.log_size * len(bounds)


def _with_law(records: Sequence[Record], start: Wheel, bare: Wheel, effect: MeanEffect) -> Heat:
    """Return the records with a law of the temperature in the speed to which viscous friction is proportional."""
    (strength,) = (parameter.name for parameter in effect.strength_parameters())

    def wheel_of(viscous: float) -> Wheel:
        scaled = type(effect)(**{**effect.values, strength: viscous})
        nominal = Nominal(dry_torque_Nm=1.0, viscous_Nm_s_rad=viscous, nominal_speed_rad_s=1.0)
        return start.model_copy(update={"effect": (*start.effect, to_block(scaled)), "nominal": nominal})

    first = wheel_of(effect.values[strength])
    problem = make_problem([without_known_effects(record, first) for record in records], bare)
    fitted = fit(problem)
    wheel = wheel_of(max(float(fitted.coefficients[0]), TINY))
    seen = temperature_range(records)
    assert seen is not None
    per_cent = 100.0 * viscous_per_K(wheel, seen.middle)
    shapes = ", ".join(f"{name} {value:.4g}" for name, value in effect.shape.items())
    note = (
        f"viscous friction follows the bearing's temperature, {per_cent:+.2g} % a kelvin at {seen.middle:.3g} °C"
        f" ({effect.name}: {shapes}): learned over {seen.low_degC:.3g} °C to {seen.high_degC:.3g} °C, and not judged"
        " beyond"
    )
    return Heat(
        problem, fitted, wheel.model_copy(update={"nominal": start.nominal, "temperature": seen}), notes=(note,)
    )


def _with_spread(plain: Heat, records: Sequence[Record], bare: Wheel) -> Heat:
    """Return the records with a viscous slope for each where slopes differ; unchanged where they do not."""
    if len(records) < FEWEST_RECORDINGS:
        return plain
    slopes = np.array([float(fit(make_problem([record], bare)).coefficients[0]) for record in records])
    mean, count = float(slopes.mean()), len(records)
    # The spread of a few recordings is uncertain: widen it to the prediction interval of Student's t.
    few = float(stats.t.ppf(ONE_SIDED, count - 1) / stats.norm.ppf(ONE_SIDED) * np.sqrt(1.0 + 1.0 / count))
    spread = float(np.std(slopes, ddof=1)) / max(mean, TINY)
    if spread < BASE_VISCOUS_STD or slopes.min() <= 0.0:
        return plain
    own = [
        replace(record, own_viscous_rad_s=record.viscous_speed_rad_s * slope / mean)
        for record, slope in zip(records, slopes.tolist(), strict=True)
    ]
    problem = make_problem(own, bare)
    note = (
        f"viscous friction differs by ±{100.0 * spread:.2g} % between these recordings, and the bearing's temperature"
        f" was not recorded: a wheel is judged beyond ±{100.0 * few * spread:.2g} % alone. With"
        " bearing_temperature_degC the part of it that is heat is learned. Is one recording of a failing wheel?"
    )
    return Heat(problem, fit(problem), plain.wheel, few * spread, (note,))
