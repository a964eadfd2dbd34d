"""The compiled loops of `friction_model`: a story laid out as a linear model, and its Gaussian prior conditioned.

Plain loops over small matrices: a tuned library is slower here, and its sums depend on the machine.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit

from rwa_monitor.diagnosis.results import FlatStory
from rwa_monitor.samples import FloatArray, IntArray

PIVOT_ROUNDING: Final = 2.0**-52  # of a pivot, relative to the diagonal
LEAST_PIVOT: Final = 1e-60  # of a coefficient that a wheel file leaves no room for


@njit(cache=True, error_model="numpy", nogil=True)
def lay_out(story: FlatStory, borders: IntArray, table: FloatArray) -> tuple[FloatArray, IntArray, FloatArray]:
    """Lay out the linear model of a story; its unknowns are base, sojourns, unattributed jumps, and the slope.

    Parameters
    ----------
    story
        Who jumped when.
    borders
        int64 (segments + 1,), slots at which segments begin and end.
    table
        See `friction_priors.law_table`.

    Returns
    -------
    levels
        float64 (segments, unknowns - 1), what each unknown adds to a level; the slope's column left out.
    column
        int64 (all sojourns,), column of each sojourn's friction, -1 where it is 0 by law.
    laws
        float64 (3, free sojourns), of each column that holds a sojourn's friction, which follow the base's: its system,
        mean and standard deviation of its friction law.
    """
    configurations, starts, sojourns, unattributed = story
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


@njit(cache=True, error_model="numpy", nogil=True)
def solve_cases(
    story: FlatStory,
    borders: IntArray,
    table: FloatArray,
    moments: FloatArray,
    cases: FloatArray,
    log_prior: FloatArray,
    rest: FloatArray,
    variance: float,
    scatter: float,
) -> tuple[float, FloatArray, FloatArray, FloatArray, IntArray]:
    """Lay a story out, condition its prior of each case on the segments, and mix what comes out.

    Parameters
    ----------
    story, borders, table
        See `lay_out`.
    moments, cases, rest, variance, scatter
        See `_condition_cases`.
    log_prior
        float64 (cases,), log-probability of each case.

    Returns
    -------
    tuple
        Log evidence, mean, standard deviation and covariance of the mixture, and `column` as `lay_out` gives it.
    """
    levels, column, laws = lay_out(story, borders, table)
    log_evidences, means, covariances = _condition_cases(levels, moments, cases, laws, rest, variance, scatter)
    log_evidence, mean, std, covariance = _mix(log_evidences, means, covariances, log_prior)
    return log_evidence, mean, std, covariance, column


@njit(cache=True, error_model="numpy", nogil=True)
def _condition_cases(
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
        float64 (3, free sojourns): system, mean and standard deviation of each sojourn's friction law; those of a
        system one after the other.
    rest
        Standard deviation of an unattributed jump; mean and standard deviation of the slope.

    Returns
    -------
    tuple
        Log evidence (cases,), posterior mean (cases, unknowns) and covariance (cases, unknowns, unknowns).
    """
    count, unknowns = cases.shape[0], levels.shape[1] + 1
    log_evidence = np.empty(count)
    means = np.empty((count, unknowns))
    covariances = np.empty((count, unknowns, unknowns))
    block = _blocks_of(laws, unknowns)
    mean, covariance = np.empty(unknowns), np.zeros((unknowns, unknowns))
    for c in range(count):
        _prior_of_case(cases[c], laws, rest, block, mean, covariance)
        log_evidence[c] = condition(
            levels, moments, mean, covariance, block, variance, scatter, means[c], covariances[c]
        )
    return log_evidence, means, covariances


@njit(cache=True, error_model="numpy", nogil=True)
def _blocks_of(laws: FloatArray, unknowns: int) -> IntArray:
    """Return the block of each unknown, see `_invert`, in the prior of a case.

    What a system's anomaly does to its sojourns is common to them; all else is independent before the window.
    """
    block = np.arange(unknowns)
    for i in range(1, laws.shape[1]):
        if laws[0, i] == laws[0, i - 1]:
            block[1 + i] = block[i]
    return block


@njit(cache=True, error_model="numpy", nogil=True)
def _prior_of_case(
    case: FloatArray, laws: FloatArray, rest: FloatArray, block: IntArray, mean: FloatArray, covariance: FloatArray
) -> None:
    """Write mean, and the lower triangle within the blocks of the covariance, of the prior of one case."""
    unknowns, sojourns = mean.size, laws.shape[1]
    mean[0], covariance[0, 0] = case[0, 0], case[0, 1] * case[0, 1]
    for i in range(sojourns):
        owner = 1 + int(laws[0, i])
        factor, spread = 1.0 + case[owner, 0], case[owner, 1]
        mean[1 + i] = factor * laws[1, i]
        deviation = factor * laws[2, i]
        for j in range(block[1 + i] - 1, i):
            covariance[1 + i, 1 + j] = (spread * laws[1, i]) * (spread * laws[1, j])
        covariance[1 + i, 1 + i] = deviation * deviation + (spread * laws[1, i]) * (spread * laws[1, i])
    for i in range(1 + sojourns, unknowns - 1):
        mean[i], covariance[i, i] = 0.0, rest[0] * rest[0]
    mean[unknowns - 1], covariance[unknowns - 1, unknowns - 1] = rest[1], rest[2] * rest[2]


@njit(cache=True, error_model="numpy", nogil=True)
def evidence_of_cases(
    story: FlatStory,
    borders: IntArray,
    table: FloatArray,
    moments: FloatArray,
    cases: FloatArray,
    log_prior: FloatArray,
    rest: FloatArray,
    variance: float,
    scatter: float,
) -> float:
    """Return the log evidence alone, in a third of the time of `solve_cases`; parameters as there."""
    levels, _, laws = lay_out(story, borders, table)
    count, unknowns = cases.shape[0], levels.shape[1] + 1
    block = _blocks_of(laws, unknowns)
    mean, covariance = np.empty(unknowns), np.zeros((unknowns, unknowns))
    precision, response = np.empty((unknowns, unknowns)), np.empty(unknowns)
    scores = np.empty(count)
    for c in range(count):
        _prior_of_case(cases[c], laws, rest, block, mean, covariance)
        squares, log_determinant = _add_segments(
            levels, moments, mean, covariance, block, variance, scatter, precision, response
        )
        log_determinant += _factor(precision, np.zeros(unknowns, dtype=np.int64))
        explained = 0.0
        for i in range(unknowns):  # the response, by forward substitution in units of the posterior's deviations
            for j in range(i):
                response[i] -= precision[i, j] * response[j]
            response[i] /= precision[i, i]
            explained += response[i] * response[i]
        scores[c] = log_prior[c] - 0.5 * (squares - explained) - 0.5 * log_determinant
    best = scores.max()
    return float(best + np.log(np.exp(scores - best).sum()))


@njit(cache=True, error_model="numpy", nogil=True)
def condition(
    levels: FloatArray,
    moments: FloatArray,
    mean: FloatArray,
    covariance: FloatArray,
    block: IntArray,
    variance: float,
    scatter: float,
    posterior_mean: FloatArray,
    posterior: FloatArray,
) -> float:
    """Condition the prior N(mean, covariance) on the segments; return the log evidence.

    Parameters
    ----------
    levels
        float64 (segments, unknowns - 1): what each unknown but the slope adds to a segment's level.
    moments
        float64 (6, segments), see `Moments`.
    mean, covariance, block
        Of the prior: float64 (unknowns,), (unknowns, unknowns) of which the lower triangle is read and destroyed, and
        see `_invert`.
    variance, scatter
        See `friction_model.solve`.
    posterior_mean, posterior
        Posterior mean (unknowns,) and covariance (unknowns, unknowns), written.
    """
    unknowns = mean.size
    precision, response = np.empty((unknowns, unknowns)), np.empty(unknowns)
    squares, log_determinant = _add_segments(
        levels, moments, mean, covariance, block, variance, scatter, precision, response
    )
    log_determinant += _invert(precision, np.zeros(unknowns, dtype=np.int64), posterior)
    explained = 0.0
    for a in range(unknowns):
        shift = 0.0
        for b in range(unknowns):
            shift += posterior[a, b] * response[b]
        explained += shift * response[a]
        posterior_mean[a] = mean[a] + shift
    return -0.5 * (squares - explained) - 0.5 * log_determinant


@njit(cache=True, error_model="numpy", nogil=True)
def _add_segments(
    levels: FloatArray,
    moments: FloatArray,
    mean: FloatArray,
    covariance: FloatArray,
    block: IntArray,
    variance: float,
    scatter: float,
    precision: FloatArray,
    response: FloatArray,
) -> tuple[float, float]:
    """Add to a prior what the segments tell; return squared misses of its mean, and the log-determinant of variances.

    Parameters as in `condition`; written are the posterior's precision, its lower triangle, and (unknowns,) the
    response: precision times the shift of the mean.
    """
    segments, unknowns = levels.shape[0], mean.size
    slope_at = unknowns - 1
    log_determinant = _invert(covariance, block, precision)
    response[:] = 0.0
    row, column = np.empty(unknowns), np.empty(unknowns, dtype=np.int64)  # what is not zero in a segment's row
    slope, squares = mean[slope_at], 0.0
    for i in range(segments):
        n = moments[0, i]
        if n == 0.0:
            continue
        xx, xz, zz = moments[3, i], moments[4, i], moments[5, i]
        x_mean, z_mean = moments[1, i] / n, moments[2, i] / n
        # About the segment's own mean only the slope counts; what is left of z after its prior mean is small.
        sxx = xx - n * x_mean * x_mean
        sxz = xz - n * x_mean * z_mean
        szz = zz - n * z_mean * z_mean
        precision[slope_at, slope_at] += sxx / variance
        response[slope_at] += (sxz - slope * sxx) / variance
        squares += (szz - 2.0 * slope * sxz + slope * slope * sxx) / variance
        # The mean is one observation of level + slope x_mean.
        mean_variance = variance / n + scatter
        held = 0
        for a in range(unknowns):
            value = levels[i, a] if a < slope_at else x_mean
            if value != 0.0:
                row[held], column[held] = value, a
                held += 1
        rest = z_mean
        for k in range(held):
            rest -= row[k] * mean[column[k]]
        squares += rest * rest / mean_variance
        log_determinant += np.log(mean_variance * n / variance)  # relative to independent samples
        for k in range(held):
            response[column[k]] += row[k] * rest / mean_variance
            for other in range(k + 1):
                precision[column[k], column[other]] += row[k] * row[other] / mean_variance
    return squares, log_determinant


@njit(cache=True, error_model="numpy", nogil=True)
def _factor(matrix: FloatArray, block: IntArray) -> float:
    """Put the Cholesky factor in the place of the lower triangle; return the log-determinant. As in `_invert`."""
    size = matrix.shape[0]
    diagonal, column = np.empty(size), np.empty(size)
    for i in range(size):
        diagonal[i] = matrix[i, i]
    log_determinant = 0.0
    for j in range(size):
        # A pivot smaller than its rounding is taken for that: noise a billionth of the friction leaves no digits in it.
        pivot = max(matrix[j, j], PIVOT_ROUNDING * diagonal[j], LEAST_PIVOT)
        log_determinant += np.log(pivot)
        matrix[j, j] = root = np.sqrt(pivot)
        i = j + 1
        while i < size and block[i] <= j:
            matrix[i, j] = column[i] = matrix[i, j] / root
            for c in range(j + 1, i + 1):  # inner loops along rows, here and below: in the cache, several at once
                matrix[i, c] -= column[i] * column[c]
            i += 1
    return log_determinant


@njit(cache=True, error_model="numpy", nogil=True)
def _invert(matrix: FloatArray, block: IntArray, inverse: FloatArray) -> float:
    """Write the inverse of a symmetric positive definite matrix; return its log-determinant. By its Cholesky factor.

    Parameters
    ----------
    matrix
        float64 (n, n); its lower triangle is read, and holds the Cholesky factor afterwards.
    block
        int64 (n,): the first row of the diagonal block that each row belongs to; beyond the blocks it is zero. 0
        throughout for a full matrix.
    inverse
        float64 (n, n), written.
    """
    size = matrix.shape[0]
    log_determinant = _factor(matrix, block)
    lower = np.zeros((size, size))  # inverse of the factor
    for i in range(size):
        for c in range(block[i], i):
            for j in range(block[i], c + 1):
                lower[i, j] -= matrix[i, c] * lower[c, j]
        for j in range(block[i], i):
            lower[i, j] /= matrix[i, i]
        lower[i, i] = 1.0 / matrix[i, i]
    inverse[:] = 0.0
    for c in range(size):
        for i in range(block[c], c + 1):
            for j in range(block[c], i + 1):
                inverse[i, j] += lower[c, i] * lower[c, j]
    for i in range(size):
        for j in range(i):
            inverse[j, i] = inverse[i, j]
    return log_determinant


@njit(cache=True, error_model="numpy", nogil=True)
def _mix(
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
