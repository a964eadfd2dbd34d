"""Views of a residual: what the model leaves, drawn against each quantity that a missing effect could follow.

Each view is data for a plot and a test: the means (or spreads) of the residual in bins, and the probability that they
scatter as much by chance. The same bins are used for the base and the extended model, so that a reader sees the gain.

The base model's residual is taken with the *extended* model's jumps: with its own, false jumps have already swallowed
part of what is to be seen.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import stats

from rwa_monitor.discrepancy.base_fit import least_squares, remove_levels, segment_starts
from rwa_monitor.discrepancy.models import Model
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.samples import FloatArray, IntArray
from rwa_monitor.wheel.effects.base import Channels

BINS: Final = 24  # of equal counts
MIN_PER_BIN: Final = 12  # samples; fewer make no mean
SLEW_SHARE: Final = 0.5  # of the largest |dω/dt|: from there on the wheel slews
LAGS: Final = 40  # slots of the autocorrelation
JUMP_RATE_BINS: Final = 8


@dataclass(frozen=True, slots=True)
class Curve:
    """One model's residual in a view: bin centres, values and their standard errors, and the test's p-value."""

    x: FloatArray
    y: FloatArray
    error: FloatArray
    p_value: float


@dataclass(frozen=True, slots=True)
class View:
    """One view.

    Attributes
    ----------
    name
        Short identifier.
    title, x_label, y_label
        With units, for a plot.
    base, extended
        The residual of the two models.
    question
        What a deviation would mean, in words.
    expected
        Values that an adequate model would give at `base.x` (zeros for means).
    """

    name: str
    title: str
    x_label: str
    y_label: str
    base: Curve
    extended: Curve
    question: str
    expected: FloatArray


def all_views(problem: Problem, base: Model, extended: Model) -> list[View]:
    """Return every view that the records allow.

    Parameters
    ----------
    problem
        The data.
    base, extended
        First and last nested model; may be the same.
    """
    before = base_residual(problem, extended)
    after = extended.fit.residual
    views = _mean_views(problem, extended, before, after)
    views.append(_slope_view(problem, extended, before, after))
    views.append(_spread_view(problem, before, after))
    views.append(_autocorrelation_view(problem, before, after))
    views.append(_tail_view(problem, before, after))
    views.append(_quantisation_view(problem))
    if extended.fit.jumps.size >= MIN_PER_BIN:
        views.append(_jump_rate_view(problem, base, extended))
        views.append(_duration_view(problem, base, extended))
    return views


def base_residual(problem: Problem, extended: Model) -> FloatArray:
    """Return what the base law leaves with the extended model's jumps, s·torque [N m], float64 (n,)."""
    design = problem.speed[:, None]
    slope = least_squares(problem, design, extended.fit.jumps)
    return remove_levels(problem.z - design @ slope, segment_starts(problem, extended.fit.jumps))


def binned(problem: Problem, quantity: FloatArray, residual: FloatArray) -> Curve:
    """Return the residual's means in bins of equal count and the χ² test that all are zero.

    The noise of a mean is taken from the long-run variance, so that coloured noise does not pass for structure.
    """
    known = np.isfinite(quantity)
    quantity, residual = quantity[known], residual[known]
    edges = np.unique(np.quantile(quantity, np.linspace(0, 1, BINS + 1))) if quantity.size else np.zeros(1)
    if edges.size < 2:
        return Curve(np.zeros(0), np.zeros(0), np.zeros(0), 1.0)
    at = np.clip(np.searchsorted(edges, quantity, side="right") - 1, 0, edges.size - 2)
    count = np.bincount(at, minlength=edges.size - 1)
    full = count >= MIN_PER_BIN
    mean = np.bincount(at, residual, edges.size - 1)[full] / count[full]
    centre = np.bincount(at, quantity, edges.size - 1)[full] / count[full]
    error = np.sqrt(problem.noise.long_run_variance / count[full])
    p_value = float(stats.chi2.sf(np.sum((mean / error) ** 2), max(mean.size - 1, 1)))
    return Curve(centre, mean, error, p_value)


def _mean_views(problem: Problem, extended: Model, before: FloatArray, after: FloatArray) -> list[View]:
    views = []
    for name, title, label, question, flips, quantity in _QUANTITIES:
        per_record = [quantity(record.channels) for record in problem.records]
        if any(values is None for values in per_record):
            continue
        joined = problem.gather([values for values in per_record if values is not None])
        sign = 1.0 if flips else problem.sign
        views.append(_mean_view(problem, name, title, label, question, joined, before * sign, after * sign))
    since_jump = _since(problem, extended.fit.jumps)
    views.append(
        _mean_view(
            problem,
            "time_since_jump",
            "Residual after a jump",
            "time since the last jump [s]",
            "jumps that relax, an oil pocket",
            since_jump,
            before * _last_jump_sign(problem, extended),
            after * _last_jump_sign(problem, extended),
        )
    )
    return views


def _mean_view(
    problem: Problem,
    name: str,
    title: str,
    label: str,
    question: str,
    quantity: FloatArray,
    before: FloatArray,
    after: FloatArray,
) -> View:
    base = binned(problem, quantity, before)
    return View(
        name,
        title,
        label,
        "mean residual [N m]",
        base,
        binned(problem, quantity, after),
        question,
        np.zeros(base.x.size),
    )


def _time_since_slew(channels: Channels) -> FloatArray | None:
    acceleration = np.abs(np.nan_to_num(channels.acceleration_rad_s2))
    slewing = acceleration > SLEW_SHARE * acceleration.max()
    if not slewing.any() or slewing.all():
        return None
    last = np.maximum.accumulate(np.where(slewing, np.arange(slewing.size), -1))
    since = np.where(last >= 0, (np.arange(slewing.size) - last) * channels.sample_period_s, np.nan)
    return np.asarray(since, dtype=np.float64)


_Quantity = Callable[[Channels], FloatArray | None]
# name, title, axis, what a deviation would mean, whether the residual is taken along the rotation, quantity
_QUANTITIES: Final[tuple[tuple[str, str, str, str, bool, _Quantity], ...]] = (
    (
        "speed",
        "Residual against speed",
        "|ω| [rad/s]",
        "drag near zero: Stribeck, presliding, a dead zone; curvature: sublinear viscous friction, windage",
        True,
        lambda c: np.abs(c.speed_rad_s),
    ),
    (
        "signed_speed",
        "Residual against signed speed, not along it",
        "ω [rad/s]",
        "an offset, or friction that differs by direction",
        False,
        lambda c: c.speed_rad_s,
    ),
    (
        "temperature",
        "Residual against temperature",
        "bearing temperature [°C]",
        "viscosity or torque constant that follow temperature",
        True,
        lambda c: c.bearing_temperature_degC,
    ),
    (
        "acceleration",
        "Residual against acceleration",
        "dω/dt [rad/s²]",
        "a wrong inertia or torque constant; a delay",
        False,
        lambda c: c.acceleration_rad_s2,
    ),
    (
        "motor_torque",
        "Residual against motor torque",
        "K_T·I [N m]",
        "friction that depends on load; a wrong torque constant",
        True,
        lambda c: c.motor_torque_Nm,
    ),
    (
        "angle",
        "Residual against wheel angle",
        "angle within a turn [rad]",
        "torque ripple",
        False,
        lambda c: np.mod(c.angle_rad, 2 * np.pi),
    ),
    ("time", "Residual against time", "time [s]", "run-in, drift", True, lambda c: c.time_s),
    (
        "time_since_slew",
        "Residual after a slew",
        "time since the last slew [s]",
        "a lubricant that lags",
        True,
        _time_since_slew,
    ),
)


def _since(problem: Problem, jumps: IntArray) -> FloatArray:
    """Return the time since the last jump within the record [s], NaN before the first."""
    first = problem.starts[:-1][np.diff(problem.starts) > 0]
    marker = np.full(problem.size, -1, dtype=np.int64)
    marker[jumps] = jumps
    marker[first] = np.where(marker[first] >= 0, marker[first], -2 - first)
    at = np.where(marker == -1, -1, np.arange(problem.size))
    latest = np.maximum.accumulate(at)
    from_jump = marker[latest] >= 0
    period = problem.records[0].channels.sample_period_s
    return np.where(from_jump, (problem.slot - problem.slot[latest]) * period, np.nan)


def _last_jump_sign(problem: Problem, model: Model) -> FloatArray:
    """Return the sign of the latest jump at each sample; 1 before the first."""
    jumps = model.fit.jumps
    size = np.sign(model.fit.level[jumps] - model.fit.level[jumps - 1]) if jumps.size else np.zeros(0)
    return np.concatenate([[1.0], size])[np.searchsorted(jumps, np.arange(problem.size), side="right")]


def _slope_view(problem: Problem, extended: Model, before: FloatArray, after: FloatArray) -> View:
    first = segment_starts(problem, extended.fit.jumps)
    x = remove_levels(problem.speed, first)
    energy = np.add.reduceat(x * x, first)
    enough = energy > 1e-3 * energy.max(initial=0.0)
    middle = problem.slot[first] * problem.records[0].channels.sample_period_s

    def slopes(residual: FloatArray) -> Curve:
        slope = np.add.reduceat(x * residual, first)[enough] / energy[enough]
        error = np.sqrt(problem.noise.long_run_variance / energy[enough])
        p_value = float(stats.chi2.sf(np.sum((slope / error) ** 2), max(slope.size - 1, 1)))
        return Curve(middle[enough].astype(np.float64), slope, error, p_value)

    base = slopes(before)
    return View(
        "slope_per_segment",
        "Slope left in each segment",
        "start of the segment [s]",
        "slope of the residual [N m s/rad]",
        base,
        slopes(after),
        "a viscous coefficient that changes: temperature, jumps of viscous friction",
        np.zeros(base.x.size),
    )


def _spread_view(problem: Problem, before: FloatArray, after: FloatArray) -> View:
    def spread(residual: FloatArray) -> Curve:
        squares = binned(problem, problem.speed, residual**2)
        count = max(problem.size / max(squares.x.size, 1), 1.0)
        rms = np.sqrt(np.maximum(squares.y, 0.0))
        # Relative standard error of a standard deviation from n samples: 1/√(2n).
        error = rms / np.sqrt(2 * count)
        mean = float(np.sqrt(np.mean(residual**2)))
        p_value = float(stats.chi2.sf(np.sum(((rms - mean) / error) ** 2), max(rms.size - 1, 1)))
        return Curve(squares.x, rms, error, p_value)

    base = spread(before)
    return View(
        "spread",
        "Noise against speed",
        "|ω| [rad/s]",
        "rms residual [N m]",
        base,
        spread(after),
        "noise that depends on speed, cage instability",
        np.full(base.x.size, problem.noise.std),
    )


def _autocorrelation_view(problem: Problem, before: FloatArray, after: FloatArray) -> View:
    lags = np.arange(1, min(LAGS, problem.size // 4) + 1)

    def correlate(residual: FloatArray) -> Curve:
        total = float(residual @ residual)
        values = np.array([float(residual[lag:] @ residual[:-lag]) / total for lag in lags])
        error = np.full(lags.size, 1 / np.sqrt(problem.size))
        # The test of Ljung and Box, Biometrika 65, 1978.
        statistic = problem.size * (problem.size + 2) * np.sum(values**2 / (problem.size - lags))
        return Curve(lags.astype(np.float64), values, error, float(stats.chi2.sf(statistic, lags.size)))

    return View(
        "autocorrelation",
        "Autocorrelation of the residual",
        "lag [slots]",
        "autocorrelation [-]",
        correlate(before),
        correlate(after),
        "coloured noise, a smooth effect that is missing",
        np.zeros(lags.size),
    )


def _tail_view(problem: Problem, before: FloatArray, after: FloatArray) -> View:
    at = np.linspace(0.5, 5.0, 19)
    expected = 2 * stats.norm.sf(at)

    def survival(residual: FloatArray) -> Curve:
        scaled = np.abs(residual) / (np.median(np.abs(residual)) / stats.norm.ppf(0.75))
        share = np.array([np.mean(scaled > threshold) for threshold in at])
        error = np.sqrt(np.maximum(expected * (1 - expected), 1 / problem.size) / problem.size)
        beyond = int(np.count_nonzero(scaled > 4.0))
        return Curve(at, share, error, float(stats.binom.sf(beyond - 1, problem.size, 2 * stats.norm.sf(4.0))))

    return View(
        "tails",
        "Tails of the residual",
        "threshold [standard deviations]",
        "share beyond [-]",
        survival(before),
        survival(after),
        "heavy tails, packet errors",
        expected,
    )


def _quantisation_view(problem: Problem) -> View:
    """Show how the last digits of the measured speed are spread: even, or on a lattice."""
    speed = np.concatenate([record.channels.speed_rad_s[record.used] for record in problem.records])
    step = max(record.speed_step_rad_s for record in problem.records)
    # Where no lattice is known: a step as small as the noise, within which the speed would be spread evenly.
    unit = step if step > 0 else max(*(record.speed_noise_rad_s for record in problem.records), 1e-12)
    phase = np.mod(speed / unit, 1.0)
    count, edges = np.histogram(phase, bins=20, range=(0.0, 1.0))
    expected = speed.size / 20
    p_value = float(stats.chi2.sf(np.sum((count - expected) ** 2) / expected, 19))
    curve = Curve(
        0.5 * (edges[1:] + edges[:-1]), count / speed.size, np.sqrt(expected) / speed.size * np.ones(20), p_value
    )
    return View(
        "lattice",
        "Lattice of the measured speed",
        f"speed within a step of {unit:.3g} rad/s [-]",
        "share of samples [-]",
        curve,
        curve,
        "a quantised tachometer",
        np.full(20, 0.05),
    )


def _jump_rate_view(problem: Problem, base: Model, extended: Model) -> View:
    edges = np.quantile(problem.speed, np.linspace(0, 1, JUMP_RATE_BINS + 1))
    period = problem.records[0].channels.sample_period_s
    time_s = np.histogram(problem.speed, edges)[0] * period

    def rate(model: Model) -> Curve:
        count = np.histogram(problem.speed[model.fit.jumps], edges)[0]
        expected = count.sum() * time_s / time_s.sum()
        p_value = float(stats.chi2.sf(np.sum((count - expected) ** 2 / np.maximum(expected, 1e-9)), count.size - 1))
        return Curve(0.5 * (edges[1:] + edges[:-1]), count / time_s, np.sqrt(np.maximum(count, 1)) / time_s, p_value)

    after = rate(extended)
    return View(
        "jump_rate",
        "Rate of jumps against speed",
        "|ω| [rad/s]",
        "jumps per second [1/s]",
        rate(base),
        after,
        "jumps that speed triggers; false jumps where an effect is missing",
        np.full(after.x.size, extended.fit.jumps.size / time_s.sum()),
    )


def _duration_view(problem: Problem, base: Model, extended: Model) -> View:
    """Show the distribution of times between jumps against a memoryless law of the same mean."""
    period = problem.records[0].channels.sample_period_s
    gaps_s = np.diff(problem.slot[extended.fit.jumps]) * period
    gaps_s = gaps_s[gaps_s > 0]
    at = np.quantile(gaps_s, np.linspace(0.05, 0.95, 12))

    def survival(model: Model) -> Curve:
        own = np.diff(problem.slot[model.fit.jumps]) * period
        own = own[own > 0]
        share = np.array([np.mean(own > t) for t in at])
        p_value = float(stats.kstest(own, "expon", args=(0, own.mean())).pvalue)
        return Curve(at, share, np.sqrt(np.maximum(share * (1 - share), 1 / own.size) / own.size), p_value)

    return View(
        "durations",
        "Times between jumps",
        "time [s]",
        "share longer [-]",
        survival(base),
        survival(extended),
        "a duration law that differs; false jumps crowd together",
        np.exp(-at / gaps_s.mean()),
    )
