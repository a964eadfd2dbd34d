"""Fit of a model with unknown jumps: y = s·level(t) + Σ coefficient · column + noise, level piecewise constant.

Both sides are multiplied by the direction s: with z = s·y and columns s·φ, z = level(t) + Σ coefficient · column +
noise in both directions. Fitting alternates exact segmentation of the residual of the columns (FPOP) with least
squares for the coefficients, which all segments share, and minimises the penalised criterion

    J = RSS/σ² + 3 log N · jumps

σ² is the long-run variance of the noise: the largest variance of a mean of m samples, times m, over all m. With it,
autocorrelated noise is not mistaken for jumps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np

from rwa_monitor.discrepancy.derived_friction import speed_noise_taps
from rwa_monitor.discrepancy.likelihood import SETTLED, Equations
from rwa_monitor.discrepancy.problem import (
    Mapper,
    Noise,
    Problem,
    clip_outliers,
    estimate_noise,
    in_turn,
    long_run_variance,
)
from rwa_monitor.discrepancy.record import Record, left_out_in_words
from rwa_monitor.errors import InputError
from rwa_monitor.kernels.segmentation import decafs, fpop, segment_sums
from rwa_monitor.samples import TINY, FloatArray, IntArray
from rwa_monitor.wheel.torque_balance import averaging_taps
from rwa_monitor.wheel.wheel import Wheel

JUMP_PENALTY: Final = 3.0  # times log N, for position, size and sign of a jump (Zhang & Siegmund 2007 gives 3/2 · 2)
# Factors of the jump penalty in successive alternations of segmentation and least squares. They are large at first, so
# that contributions of the columns are not fitted by jumps while the coefficients are still inaccurate.
ANNEALING: Final = (8.0, 3.0, 1.0, 1.0)
TUKEY: Final = 4.685  # scales of the residual: 95 % efficient for Gaussian noise (Huber, Robust Statistics, 1981)
MIN_USED: Final = 30  # fewer moving samples cannot separate a law of the speed from their noise
HEAVY_SHARE: Final = 1e-3  # of samples beyond four standard deviations; Gaussian noise has 6e-5
REVERSAL: Final = 5  # samples from a reversal: there bristles turn over, filters smear, and a jump is not identifiable
REVERSAL_REACH: Final = 20  # samples around a reversal: bristles and balls take a few slots to reverse
LEVEL_SAMPLES: Final = 64  # at most, from which the level on each side of a jump is estimated
LONG_LAG_SHARE: Final = 0.02  # of the record: the lag of differences, a few per cent of a sojourn or more


@dataclass(frozen=True, slots=True)
class Fit:
    """A fitted model with jumps.

    Attributes
    ----------
    jumps
        int64 (j,), joined index of the first sample of each new level (record borders not counted).
    coefficients
        float64 (1 + p,): viscous [N m s/rad], then one per column.
    level
        float64 (n,), dry friction level at each sample [N m].
    residual
        float64 (n,) [N m].
    """

    jumps: IntArray
    coefficients: FloatArray
    level: FloatArray
    residual: FloatArray

    @property
    def rss(self) -> float:
        """Σ residual² [N² m²]."""
        return float(self.residual @ self.residual)


def make_problem(records: Sequence[Record], wheel: Wheel, each: Mapper = in_turn) -> Problem:
    """Join records and estimate their noise; `each` applies a function to each of many candidates.

    Raises
    ------
    InputError
        If too few samples are in motion.
    """
    z = np.concatenate([(np.sign(r.channels.speed_rad_s) * r.friction_torque_Nm)[r.used] for r in records])
    if z.size < MIN_USED:
        why = left_out_in_words(records)
        raise InputError(
            ", ".join(r.source for r in records),
            f"only {z.size} good samples in motion{why and f' ({why})'}; at least {MIN_USED} are needed: add rows, or"
            " further recordings of the same wheel",
        )
    speed = np.concatenate([np.abs(r.viscous_speed_rad_s)[r.used] for r in records])
    sign = np.concatenate([r.channels.direction[r.used] for r in records])
    starts = np.cumsum([0, *(np.count_nonzero(r.used) for r in records)])
    slot = np.concatenate([np.flatnonzero(r.used) for r in records])
    nominal = wheel.nominal.viscous_Nm_s_rad if wheel.nominal else None
    noise = estimate_noise([z])
    problem = Problem(tuple(records), z, z, 0.0, speed, sign, starts, slot, noise, nominal, each=each)
    if any(record.friction_is_derived for record in records):
        taps = speed_noise_taps(wheel)
        problem = replace(problem, derivative_taps=taps, averaging_taps=averaging_taps(wheel))
    # In a short record viscous friction would be mistaken for autocorrelated noise, and hide every jump.
    slope = robust_coefficients(problem, speed[:, None])[0]
    problem = with_noise_of(problem, z - slope * speed)
    # The noise is estimated from the residual of a first fit, not from the signal.
    problem = with_noise_of(problem, fit(problem).residual)
    problem = _clip(problem)
    problem = with_noise_of(problem, fit(problem).residual)
    return replace(problem, memory=_memory(problem)) if problem.friction_is_derived else problem


def _memory(problem: Problem) -> float:
    """Return the ratio of long-run variance to variance of derived friction: as estimated, at most that of the filter.

    It is smaller where the noise of the torque exceeds that of dω/dt. A larger estimate is due to a missing law.
    """
    taps = problem.derivative_taps
    covariance = np.correlate(taps, taps, "full")[taps.size - 1 :]
    of_filter = long_run_variance(covariance) / float(covariance[0])
    seen = problem.noise.long_run_variance / problem.noise.std**2
    return float(np.clip(seen, 1.0, of_filter))


def pieces(problem: Problem) -> list[slice]:
    """Return where the samples of each record are among the joined ones; records without samples are left out."""
    return [slice(begin, end) for begin, end in pairwise(problem.starts.tolist()) if end > begin]


def with_noise_of(problem: Problem, residual: FloatArray) -> Problem:
    """Return the problem with the noise estimated from a model's residual, float64 (n,) [N m]."""
    noise = estimate_noise([residual[piece] for piece in pieces(problem)])
    smallest = problem.smallest_noise_Nm
    if noise.std < smallest:
        noise = Noise(smallest, smallest**2)
    return replace(problem, noise=noise)


def _clip(problem: Problem) -> Problem:
    """Clip outliers if they are more than Gaussian noise and a few very short sojourns would give.

    Heavy tails occur at all speeds. Outliers near a change of direction may be friction, and are left unchanged.
    """
    far = problem.to_reversal > REVERSAL_REACH
    slope = fit(problem).coefficients[0] * problem.speed
    clipped = problem.z.copy()
    for piece in pieces(problem):
        inside, outliers = clip_outliers((problem.z - slope)[piece], problem.noise.std)
        outliers &= far[piece]
        clipped[piece][outliers] = (inside + slope[piece])[outliers]
    share = float(np.mean(clipped[far] != problem.z[far])) if far.any() else 0.0
    return replace(problem, z=clipped, clipped_share=share) if share > HEAVY_SHARE else problem


def fit(problem: Problem, columns: FloatArray | None = None) -> Fit:
    """Fit levels, jumps, viscous friction and the coefficients of `columns`.

    Parameters
    ----------
    problem
        The data.
    columns
        float64 (n, p), already multiplied by s.
    """
    design = problem.speed[:, None] if columns is None else np.column_stack([problem.speed, columns])
    coefficients, best, lowest, previous = robust_coefficients(problem, design), None, np.inf, np.inf
    for factor in (*ANNEALING, 1.0, 1.0):
        jumps = segment_records(problem, problem.z - design @ coefficients, factor * jump_price(problem))
        coefficients = least_squares(problem, design, jumps)
        rest = problem.z - design @ coefficients
        residual = remove_levels(rest, segment_starts(problem, jumps))
        fitted = Fit(jumps, coefficients, rest - residual, residual)
        value = criterion(problem, fitted)
        if value < lowest:
            best, lowest = fitted, value
        if factor == 1.0 and previous - value < SETTLED:
            break
        previous = value
    assert best is not None
    return best


def jump_price(problem: Problem) -> float:
    """Return the smallest decrease of the sum of squares for which a jump is accepted [N² m²]."""
    return JUMP_PENALTY * problem.log_size * problem.noise.long_run_variance


def criterion(problem: Problem, fitted: Fit) -> float:
    """Return J of a fit; lower is better."""
    return fitted.rss / problem.noise.long_run_variance + problem.log_size * JUMP_PENALTY * fitted.jumps.size


def segment_starts(problem: Problem, jumps: IntArray) -> IntArray:
    """Return the first joined index of every segment; segments begin at jumps and at the start of a record."""
    return np.unique(np.concatenate([problem.starts[:-1][np.diff(problem.starts) > 0], jumps]))


def remove_levels(values: FloatArray, first: IntArray) -> FloatArray:
    """Subtract each segment's mean, column by column; `first` holds the first index of each segment."""
    length = np.diff(np.append(first, values.shape[0]))
    mean = np.add.reduceat(values, first, axis=0)
    mean /= length if values.ndim == 1 else length[:, None]
    inner: FloatArray = values - np.repeat(mean, length, axis=0)
    return inner


def least_squares(problem: Problem, design: FloatArray, jumps: IntArray) -> FloatArray:
    """Return the least-squares coefficients for given jumps, with the levels eliminated."""
    first = segment_starts(problem, jumps)
    inner = remove_levels(design, first)
    return _solve_normal_equations(problem, inner.T @ inner, inner.T @ remove_levels(problem.z, first))


def _solve_normal_equations(problem: Problem, gram: FloatArray, moment: FloatArray) -> FloatArray:
    """Solve the normal equations; the first coefficient, of viscous friction, is at least `problem.lowest_viscous`."""
    low, gram, moment = np.full(moment.size, -np.inf), gram.copy(), moment.copy()
    low[0] = problem.lowest_viscous
    # A prior on the slope with the weight of 1/1000 sample at the largest speed: it decides only where the data cannot.
    if problem.nominal_viscous is not None:
        weight = problem.top_speed**2 * 1e-3
        gram[0, 0] += weight
        moment[0] += weight * problem.nominal_viscous
    return Equations(gram, moment, 0.0, low, np.full(moment.size, np.inf), 1, 0.0).solve()[0]


def robust_coefficients(problem: Problem, design: FloatArray) -> FloatArray:
    """Return initial coefficients from differences over a long lag, in which jumps are outliers (Tukey's loss)."""
    lag = max(int(LONG_LAG_SHARE * problem.size / len(problem.records)), 8)
    record = np.searchsorted(problem.starts, np.arange(problem.size), side="right")
    same = record[lag:] == record[:-lag]
    rise, z = (design[lag:] - design[:-lag])[same], (problem.z[lag:] - problem.z[:-lag])[same]
    if z.size < 10:
        return least_squares(problem, design, np.zeros(0, dtype=np.int64))
    weight = np.ones(z.size)
    coefficients = np.zeros(design.shape[1])
    for _ in range(12):
        weighted = rise * weight[:, None]
        coefficients = _solve_normal_equations(problem, rise.T @ weighted, weighted.T @ z)
        residual = z - rise @ coefficients
        scale = max(float(np.median(np.abs(residual))) / 0.6745, TINY)
        weight = np.square(np.maximum(1.0 - np.square(residual / (TUKEY * scale)), 0.0))
    return coefficients


def _sharp_jumps(problem: Problem, fitted: Fit) -> IntArray:
    """Return the jumps that are worth their price over LEVEL_SAMPLES on each side, not parts of a smooth change."""
    jumps, sums = fitted.jumps, np.append(0.0, np.cumsum(fitted.level + fitted.residual))
    borders = np.unique(np.append(problem.starts, jumps))
    at = np.searchsorted(borders, jumps)
    before = np.maximum(borders[at - 1], jumps - LEVEL_SAMPLES)
    after = np.minimum(borders[at + 1], jumps + LEVEL_SAMPLES)
    n1, n2 = jumps - before, after - jumps
    step = (sums[after] - sums[jumps]) / n2 - (sums[jumps] - sums[before]) / n1
    return np.asarray(jumps[step**2 * n1 * n2 / (n1 + n2) > jump_price(problem)])


def jump_sets(problem: Problem, fitted: Fit) -> list[IntArray]:
    """Return the fitted jumps, subsets of them that a missing effect is unlikely to cause, and the strong jumps."""
    off_crossings = fitted.jumps[problem.to_reversal[fitted.jumps] >= REVERSAL]
    strong = strong_jumps(problem, fitted.level + fitted.residual)
    sets = fitted.jumps, _sharp_jumps(problem, fitted), off_crossings, strong
    return list({jumps.tobytes(): jumps for jumps in sets}.values())


def strong_jumps(problem: Problem, values: FloatArray) -> IntArray:
    """Return the jumps of values [N m] under ANNEALING[0] times the penalty: smooth effects do not cause them."""
    return segment_records(problem, values, ANNEALING[0] * jump_price(problem))


def levels(problem: Problem, values: FloatArray, jumps: IntArray) -> FloatArray:
    """Return the mean of values in each segment between jumps, float64 (n,) [N m]."""
    return values - remove_levels(values, segment_starts(problem, jumps))


def strong_level(problem: Problem, level: FloatArray) -> FloatArray:
    """Return a level, float64 (n,), reduced to its strong jumps [N m]."""
    return levels(problem, level, strong_jumps(problem, level))


def segment_records(problem: Problem, values: FloatArray, penalty: float) -> IntArray:
    """Segment each record separately and return the joined indices of the jumps."""
    return np.concatenate([segment(values[piece], penalty) + piece.start for piece in pieces(problem)])


# ---- exact penalised segmentation of a sequence into levels: functional pruning optimal partitioning -----------------
# `segment` minimises Σ (z_k - level_k)² + penalty · (number of jumps) exactly. Source: Maidstone, Hocking, Rigaill,
# Fearnhead, "On optimal multiple changepoint algorithms for large data", Statistics and Computing 27 (2017), algorithm
# FPOP. `segment_correlated` does the same for autoregressive noise.


def segment(z: FloatArray, penalty: float) -> IntArray:
    """Return the first index of each segment after the first, int64 (jumps,), increasing.

    Exact for short sequences. Long ones are segmented exactly with jumps between blocks of four samples, then each
    jump is moved to the best sample between its neighbours: the search segments thousands of times.

    Parameters
    ----------
    z
        float64 (n,), finite values, n ≥ 1.
    penalty
        Cost of one jump, in the unit of z² (a few log n times the noise variance).
    """
    # With the mean subtracted, running sums lose fewer digits.
    return segment_sums(np.append(0.0, np.cumsum(z - z.mean())), penalty)


def segment_correlated(
    z: FloatArray, correlation: FloatArray, innovation_variance: FloatArray, penalty: float
) -> IntArray:
    """Return the first index of each segment after the first, int64 (jumps,), increasing.

    Minimises exactly, over the levels μ and the jumps, with the noise e_k = z_k - μ_k,

        e_0² / v_0 + Σ_{k≥1} (e_k - φ_k e_{k-1})² / v_k + penalty · (number of jumps).

    With uncorrelated noise of equal variance that is FPOP, here without blocks. Source: Romano, Rigaill, Runge,
    Fearnhead, "Detecting abrupt changes in the presence of local fluctuations and autocorrelated noise", Journal of the
    American Statistical Association 117 (2022), algorithm DeCAFS, section 3. Here, the level does not walk between its
    jumps, φ and v may differ from step to step, and costs far above the least are cut off until the jumps found are
    proven to be the best (see the kernel).

    Parameters
    ----------
    z
        float64 (n,), finite values, n ≥ 1.
    correlation
        float64 (n,), φ_k of the noise at k with that at k - 1, |φ_k| < 1; entry 0 is not read. Over a gap of g slots,
        φ^g; negative where the noise changes its sign.
    innovation_variance
        float64 (n,), v_k > 0: the variance of e_k given e_{k-1}, and v_0 that of e_0; in the unit of z².
    penalty
        Cost of one jump, > 0, without unit (a few log n).
    """
    variance = float(innovation_variance[0])
    if not correlation[1:].any() and (innovation_variance == variance).all():
        return fpop(z - z.mean(), np.ones(z.size), penalty * variance)
    return decafs(z, correlation, innovation_variance, penalty)
