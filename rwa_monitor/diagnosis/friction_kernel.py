"""The compiled loops of `friction_model`: a story laid out as a linear model, and its Gaussian prior conditioned.

Plain loops over small matrices: a tuned library is slower here, and its sums depend on the machine.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit

from rwa_monitor.samples import FloatArray, IntArray

PIVOT_ROUNDING: Final = 2.0**-52  # of a pivot, relative to the diagonal
LEAST_PIVOT: Final = 1e-60  # of a coefficient that a wheel file leaves no room for


@njit(cache=True)
def lay_out(
    configurations: IntArray,
    starts: IntArray,
    sojourns: IntArray,
    unattributed: IntArray,
    borders: IntArray,
    table: FloatArray,
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Lay out the linear model of a story.

    Parameters
    ----------
    configurations, starts
        int64 (all sojourns,), of all systems one after the other.
    sojourns
        int64 (systems,), how many of these each has.
    unattributed, borders
        See `Story` and `solve`.
    table
        See `_law_table`.

    Returns
    -------
    levels, column, laws
        See `_Design`; `column` of all systems one after the other.
    """
    column = np.full(configurations.size, -1)
    laws = np.empty((3, configurations.size))
    free = 0
    at = 0
    for s in range(sojourns.size):
        for _ in range(sojourns[s]):
            mid, scatter = table[s, configurations[at]]
            if mid != 0.0 or scatter != 0.0:
                laws[0, free], laws[1, free], laws[2, free] = s, mid, scatter
                free += 1
                column[at] = free
            at += 1
    segments = borders.size - 1
    levels = np.zeros((segments, 1 + free + unattributed.size))
    levels[:, 0] = 1.0
    first = 0
    for s in range(sojourns.size):
        own = first
        for segment in range(segments):
            # A segment belongs to the sojourns that hold at its end.
            while own + 1 < first + sojourns[s] and starts[own + 1] < borders[segment + 1]:
                own += 1
            if column[own] >= 0:
                levels[segment, column[own]] = 1.0
        first += sojourns[s]
    for j in range(unattributed.size):
        for segment in range(segments):
            if borders[segment + 1] > unattributed[j]:
                levels[segment, 1 + free + j] = 1.0
    return levels, column, np.ascontiguousarray(laws[:, :free])


@njit(cache=True)
def condition_cases(
    levels: FloatArray,
    moments: FloatArray,
    cases: FloatArray,
    laws: FloatArray,
    rest: FloatArray,
    variance: float,
    scatter: float,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Condition the prior of each case on the segments.

    Parameters
    ----------
    levels, moments, variance, scatter
        As in `condition`.
    cases
        float64 (cases, 1 + systems, 2): mean and std of the base and of each system's anomaly.
    laws
        float64 (3, free sojourns): system, mean and standard deviation of each sojourn's friction law.
    rest
        Standard deviation of an unattributed jump; mean and standard deviation of the slope.

    Returns
    -------
    tuple
        Log evidence (cases,), posterior mean (cases, unknowns) and covariance (cases, unknowns, unknowns).
    """
    count, unknowns, sojourns = cases.shape[0], levels.shape[1] + 1, laws.shape[1]
    log_evidence = np.empty(count)
    means = np.empty((count, unknowns))
    covariances = np.empty((count, unknowns, unknowns))
    for c in range(count):
        mean, covariance = np.zeros(unknowns), np.zeros((unknowns, unknowns))
        mean[0], covariance[0, 0] = cases[c, 0, 0], cases[c, 0, 1] * cases[c, 0, 1]
        for i in range(sojourns):
            owner = 1 + int(laws[0, i])
            factor = 1.0 + cases[c, owner, 0]
            mean[1 + i] = factor * laws[1, i]
            deviation = factor * laws[2, i]
            covariance[1 + i, 1 + i] = deviation * deviation
        for i in range(1 + sojourns, unknowns - 1):
            covariance[i, i] = rest[0] * rest[0]
        mean[unknowns - 1], covariance[unknowns - 1, unknowns - 1] = rest[1], rest[2] * rest[2]
        for i in range(sojourns):  # what a system's anomaly does to its sojourns is common to them
            for j in range(sojourns):
                if laws[0, i] == laws[0, j]:
                    spread = cases[c, 1 + int(laws[0, i]), 1]
                    covariance[1 + i, 1 + j] += (spread * laws[1, i]) * (spread * laws[1, j])
        log_evidence[c], means[c], covariances[c] = condition(levels, moments, mean, covariance, variance, scatter)
    return log_evidence, means, covariances


@njit(cache=True)
def condition(
    levels: FloatArray, moments: FloatArray, mean: FloatArray, covariance: FloatArray, variance: float, scatter: float
) -> tuple[float, FloatArray, FloatArray]:
    """Condition the prior N(mean, covariance) on the segments; return log evidence, posterior mean and covariance.

    Plain loops over small matrices: a tuned library is slower here, and its sums depend on the machine.
    """
    segments, unknowns = levels.shape[0], mean.size
    slope_at = unknowns - 1
    precision, log_determinant = _inverse(covariance)
    response = np.zeros(unknowns)
    row = np.zeros(unknowns)
    squares = 0.0
    for i in range(segments):
        n, x, z, xx, xz, zz = moments[:, i]
        if n == 0.0:
            continue
        x_mean, z_mean = x / n, z / n
        # About the segment's own mean only the slope counts; what is left of z after its prior mean is small.
        sxx = xx - n * x_mean * x_mean
        sxz = xz - n * x_mean * z_mean
        szz = zz - n * z_mean * z_mean
        slope = mean[slope_at]
        precision[slope_at, slope_at] += sxx / variance
        response[slope_at] += (sxz - slope * sxx) / variance
        squares += (szz - 2.0 * slope * sxz + slope * slope * sxx) / variance
        # The mean is one observation of level + slope x_mean.
        mean_variance = variance / n + scatter
        for a in range(slope_at):
            row[a] = levels[i, a]
        row[slope_at] = x_mean
        rest = z_mean
        for a in range(unknowns):
            rest -= row[a] * mean[a]
        squares += rest * rest / mean_variance
        log_determinant += np.log(mean_variance * n / variance)  # relative to independent samples
        for a in range(unknowns):
            if row[a] != 0.0:
                response[a] += row[a] * rest / mean_variance
                for b in range(unknowns):
                    precision[a, b] += row[a] * row[b] / mean_variance
    posterior, log_determinant_precision = _inverse(precision)
    shift = np.zeros(unknowns)
    explained = 0.0
    for a in range(unknowns):
        for b in range(unknowns):
            shift[a] += posterior[a, b] * response[b]
        explained += shift[a] * response[a]
    log_evidence = -0.5 * (squares - explained) - 0.5 * (log_determinant + log_determinant_precision)
    return log_evidence, mean + shift, posterior


@njit(cache=True)
def _inverse(matrix: FloatArray) -> tuple[FloatArray, float]:
    """Return inverse and log-determinant of a symmetric positive definite matrix, by its Cholesky factor."""
    size = matrix.shape[0]
    factor, rest, column = np.zeros((size, size)), matrix.copy(), np.empty(size)
    log_determinant = 0.0
    for j in range(size):
        # A pivot smaller than its rounding is taken for that: noise a billionth of the friction leaves no digits in it.
        pivot = max(rest[j, j], PIVOT_ROUNDING * matrix[j, j], LEAST_PIVOT)
        log_determinant += np.log(pivot)
        factor[j, j] = column[j] = np.sqrt(pivot)
        for i in range(j + 1, size):
            factor[i, j] = column[i] = rest[i, j] / column[j]
        for i in range(j + 1, size):  # inner loops along rows, here and below: in the cache, several entries at once
            for c in range(j + 1, i + 1):
                rest[i, c] -= column[i] * column[c]
    lower = np.zeros((size, size))  # inverse of the factor
    for i in range(size):
        for c in range(i):
            for j in range(c + 1):
                lower[i, j] -= factor[i, c] * lower[c, j]
        for j in range(i):
            lower[i, j] /= factor[i, i]
        lower[i, i] = 1.0 / factor[i, i]
    inverse = np.zeros((size, size))
    for c in range(size):
        for i in range(c + 1):
            for j in range(i + 1):
                inverse[i, j] += lower[c, i] * lower[c, j]
    for i in range(size):
        for j in range(i):
            inverse[j, i] = inverse[i, j]
    return inverse, log_determinant


@njit(cache=True)
def mix(
    log_evidences: FloatArray, means: FloatArray, covariances: FloatArray, log_prior: FloatArray
) -> tuple[float, FloatArray, FloatArray, FloatArray]:
    """Mix the posteriors of all cases; return log evidence, mean, standard deviation and covariance of the mixture."""
    scores = log_evidences + log_prior
    best = scores.max()
    weights = np.exp(scores - best)
    log_evidence = best + np.log(weights.sum())
    weights /= weights.sum()
    unknowns = means.shape[1]
    mean, covariance = np.zeros(unknowns), np.zeros((unknowns, unknowns))
    for c in range(weights.size):
        mean += weights[c] * means[c]
    for c in range(weights.size):
        for a in range(unknowns):
            apart = weights[c] * (means[c, a] - mean[a])
            for b in range(unknowns):
                covariance[a, b] += weights[c] * covariances[c, a, b] + apart * (means[c, b] - mean[b])
    std = np.empty(unknowns)
    for a in range(unknowns):
        std[a] = np.sqrt(max(covariance[a, a], 0.0))
    return log_evidence, mean, std, covariance
