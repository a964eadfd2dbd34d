"""Views of a model's residual against each quantity on which a missing effect could depend.

Each view is data for a plot and a test: the means (or spreads) of the residual in bins, and the probability that they
scatter as much by chance. The bins are the same for the base and the extended model, so that the two can be compared.

The base model's residual is taken with the *extended* model's jumps: with its own, false jumps would already have
fitted part of the missing effect.
"""

from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np
from scipy import stats

from rwa_monitor.discrepancy.base_fit import least_squares, remove_levels, segment_starts
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.discrepancy.terms import Model
from rwa_monitor.samples import FloatArray, IntArray
from rwa_monitor.wheel.effects.base import Channels

BINS: Final = 24  # of equal counts
MIN_PER_BIN: Final = 12  # samples; fewer make no mean, unless that is half of what a bin holds on average
SLEW_SHARE: Final = 0.5  # of the largest |dω/dt|, above which the wheel slews
LAGS: Final = 40  # slots of the autocorrelation
JUMP_RATE_BINS: Final = 8  # of equal counts, over the speed
FAR: Final = 4.0  # standard deviations beyond which samples are counted in the test of the tails


class Curve(NamedTuple):
    """One model's residual in a view: bin centres, values and their standard errors, and the test's p-value.

    `expected` is the value for an adequate model: one, or one for each x.
    """

    x: FloatArray
    y: FloatArray
    error: FloatArray
    p_value: float
    expected: float | FloatArray = 0.0


class View(NamedTuple):
    """One view: a short identifier, and the residual of the two models."""

    name: str
    base: Curve
    extended: Curve


# Computes the curve of one model's residual (s·torque [N m], float64 (n,)), from the records, their extended model, the
# residual and its model; None where the records do not allow it.
Draw = Callable[[Problem, Model, FloatArray, Model], Curve | None]


def all_views(problem: Problem, base: Model, extended: Model) -> list[View]:
    """Return every view that the records allow.

    Parameters
    ----------
    problem
        The data.
    base, extended
        First and last nested model; may be the same.
    """
    residual = base_residual(problem, extended)
    views = []
    for name, draw in VIEWS.items():
        before = draw(problem, extended, residual, base)
        after = draw(problem, extended, extended.fit.residual, extended)
        if before is not None and after is not None and before.x.size:
            views.append(View(name, before, after))
    return views


def base_residual(problem: Problem, extended: Model) -> FloatArray:
    """Return the base law's residual with the extended model's jumps, s·torque [N m], float64 (n,)."""
    design = problem.speed[:, None]
    slope = least_squares(problem, design, extended.fit.jumps)
    return remove_levels(problem.z - design @ slope, segment_starts(problem, extended.fit.jumps))


def _chance(deviations: FloatArray) -> float:
    """Return the probability that standardised deviations are as large by chance (χ²; one degree lost to the mean)."""
    return float(stats.chi2.sf(np.sum(deviations**2), max(deviations.size - 1, 1)))


def _period_s(problem: Problem) -> float:
    return problem.records[0].channels.sample_period_s


# ---- means over a quantity -------------------------------------------------------------------------------------------


def means_in_bins(at: IntArray, *values: FloatArray) -> tuple[list[FloatArray], IntArray]:
    """Return the means of values in bins, int64 (n,), and their numbers of samples; see `MIN_PER_BIN`."""
    count = np.bincount(at)
    full = count >= max(min(MIN_PER_BIN, at.size / (2 * max(int(np.count_nonzero(count)), 1))), 1)
    return [np.bincount(at, one)[full] / count[full] for one in values], count[full]


def binned(problem: Problem, quantity: FloatArray, residual: FloatArray) -> Curve:
    """Return the residual's means in bins of equal count and the χ² test that all are zero.

    The standard error of a mean is from the long-run variance, so that autocorrelated noise does not mimic structure.
    """
    known = np.isfinite(quantity)
    quantity, residual = quantity[known], residual[known]
    edges = np.unique(np.quantile(quantity, np.linspace(0, 1, BINS + 1))) if quantity.size else np.zeros(1)
    if edges.size < 2:
        return Curve(np.zeros(0), np.zeros(0), np.zeros(0), 1.0)
    at = np.clip(np.searchsorted(edges, quantity, side="right") - 1, 0, edges.size - 2)
    (centre, mean), count = means_in_bins(at, quantity, residual)
    error = np.sqrt(problem.noise.long_run_variance / count)
    return Curve(centre, mean, error, _chance(mean / error))


def _over(quantity: Callable[[Channels], FloatArray | None], *, along: bool = True) -> Draw:
    """Return the function of a view over a quantity of the channels; `along`: with the residual along the rotation."""

    def draw(problem: Problem, _: Model, residual: FloatArray, __: Model) -> Curve | None:
        per_record = [values for record in problem.records if (values := quantity(record.channels)) is not None]
        if len(per_record) < len(problem.records):
            return None
        return binned(problem, problem.gather(per_record), residual if along else residual * problem.sign)

    return draw


def _time_since_slew(channels: Channels) -> FloatArray | None:
    acceleration = np.abs(np.nan_to_num(channels.acceleration_rad_s2))
    slewing = acceleration > SLEW_SHARE * acceleration.max()
    if not slewing.any() or slewing.all():
        return None
    last = np.maximum.accumulate(np.where(slewing, np.arange(slewing.size), -1))
    return np.where(last >= 0, (np.arange(slewing.size) - last) * channels.sample_period_s, np.nan)


def _since_jump(problem: Problem, extended: Model, residual: FloatArray, _: Model) -> Curve:
    """Return the residual after a jump, times the jump's sign; without the part before a record's first jump."""
    jumps, level = extended.fit.jumps, extended.fit.level
    here = np.arange(problem.size)
    number = np.searchsorted(jumps, here, side="right")
    last = np.append(-1, jumps)[number]
    begin = problem.starts[np.searchsorted(problem.starts, here, side="right") - 1]
    since_s = np.where(last >= begin, (problem.slot - problem.slot[last]) * _period_s(problem), np.nan)
    sign = np.append(1.0, np.sign(level[jumps] - level[jumps - 1]))[number]
    return binned(problem, since_s, residual * sign)


# ---- other views -----------------------------------------------------------------------------------------------------


def _slope(problem: Problem, extended: Model, residual: FloatArray, _: Model) -> Curve:
    first = segment_starts(problem, extended.fit.jumps)
    x = remove_levels(problem.speed, first)
    energy = np.add.reduceat(x * x, first)
    enough = energy > 1e-3 * energy.max(initial=0.0)
    begin_s = (problem.slot[first] * _period_s(problem))[enough].astype(np.float64)
    error = np.sqrt(problem.noise.long_run_variance / energy[enough])
    slope = np.add.reduceat(x * residual, first)[enough] / energy[enough]
    return Curve(begin_s, slope, error, _chance(slope / error))


def _spread(problem: Problem, _: Model, residual: FloatArray, __: Model) -> Curve:
    squares = binned(problem, problem.speed, residual**2)
    rms = np.sqrt(np.maximum(squares.y, 0.0))
    # Relative standard error of a standard deviation from n samples: 1/√(2n).
    error = rms / np.sqrt(2 * max(problem.size / max(rms.size, 1), 1.0))
    p_value = _chance((rms - np.sqrt(np.mean(residual**2))) / error)
    return Curve(squares.x, rms, error, p_value, problem.noise.std)


def _autocorrelation(problem: Problem, _: Model, residual: FloatArray, __: Model) -> Curve:
    lags = np.arange(1, min(LAGS, problem.size // 4) + 1)
    error = np.full(lags.size, 1 / np.sqrt(problem.size))
    values = np.array([residual[lag:] @ residual[:-lag] for lag in lags]) / (residual @ residual)
    # The test of Ljung and Box, Biometrika 65, 1978.
    statistic = problem.size * (problem.size + 2) * np.sum(values**2 / (problem.size - lags))
    return Curve(lags.astype(np.float64), values, error, float(stats.chi2.sf(statistic, lags.size)))


def _tails(problem: Problem, _: Model, residual: FloatArray, __: Model) -> Curve:
    at = np.linspace(0.5, 5.0, 19)
    expected = 2 * stats.norm.sf(at)
    error = np.sqrt(np.maximum(expected * (1 - expected), 1 / problem.size) / problem.size)
    scaled = np.abs(residual) / (np.median(np.abs(residual)) / stats.norm.ppf(0.75))
    share = np.array([np.mean(scaled > threshold) for threshold in at])
    beyond = int(np.count_nonzero(scaled > FAR))
    return Curve(at, share, error, float(stats.binom.sf(beyond - 1, problem.size, 2 * stats.norm.sf(FAR))), expected)


def _jump_rate(problem: Problem, extended: Model, _: FloatArray, model: Model) -> Curve | None:
    if extended.fit.jumps.size < MIN_PER_BIN:
        return None
    edges = np.quantile(problem.speed, np.linspace(0, 1, JUMP_RATE_BINS + 1))
    time_s = np.histogram(problem.speed, edges)[0] * _period_s(problem)
    count = np.histogram(problem.speed[model.fit.jumps], edges)[0]
    even = count.sum() * time_s / time_s.sum()
    p_value = _chance((count - even) / np.sqrt(np.maximum(even, 1e-9)))
    middle, error = 0.5 * (edges[1:] + edges[:-1]), np.sqrt(np.maximum(count, 1)) / time_s
    return Curve(middle, count / time_s, error, p_value, extended.fit.jumps.size / time_s.sum())


def _durations(problem: Problem, extended: Model, _: FloatArray, model: Model) -> Curve | None:
    """Return the survival function of the times between jumps, with that of a memoryless law of the same mean."""
    if extended.fit.jumps.size < MIN_PER_BIN:
        return None

    def gaps_s(model: Model) -> FloatArray:
        gaps = np.diff(problem.slot[model.fit.jumps]) * _period_s(problem)
        return gaps[gaps > 0]

    usual, gaps = gaps_s(extended), gaps_s(model)
    at = np.quantile(usual, np.linspace(0.05, 0.95, 12))
    share = np.array([np.mean(gaps > t) for t in at])
    error = np.sqrt(np.maximum(share * (1 - share), 1 / gaps.size) / gaps.size)
    p_value = float(stats.kstest(gaps, "expon", args=(0, gaps.mean())).pvalue)
    return Curve(at, share, error, p_value, np.exp(-at / usual.mean()))


# The function of each view, in the order of the page; titles and labels are in the template.
VIEWS: Final[dict[str, Draw]] = {
    "speed": _over(lambda c: np.abs(c.speed_rad_s)),
    "signed_speed": _over(lambda c: c.speed_rad_s, along=False),
    "temperature": _over(lambda c: c.bearing_temperature_degC),
    "acceleration": _over(lambda c: c.acceleration_rad_s2, along=False),
    "motor_torque": _over(lambda c: c.motor_torque_Nm),
    "angle": _over(lambda c: np.mod(c.angle_rad, 2 * np.pi), along=False),
    "time": _over(lambda c: c.time_s),
    "time_since_slew": _over(_time_since_slew),
    "time_since_jump": _since_jump,
    "slope_per_segment": _slope,
    "spread": _spread,
    "autocorrelation": _autocorrelation,
    "tails": _tails,
    "jump_rate": _jump_rate,
    "durations": _durations,
}
