"""The compiled loops of `friction_model`: a story laid out as a linear model, and its Gaussian prior conditioned.

Plain loops over small matrices: a tuned library is slower here, and its sums depend on the machine.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numba import njit

from rwa_monitor.diagnosis.results import FlatStory
from rwa_monitor.samples import FloatArray, IntArray

PIVOT_ROUNDING: Final = 2.0**-52  # of a pivot, relative to the diagonal
LEAST_PIVOT: Final = 1e-60  # of a coefficient that a wheel file leaves no room for
PANEL: Final = 4  # columns of a factor


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


class Cases(NamedTuple):
    """The prior as a mixture: the base and each system are in one of a few states, and each case chooses them.

    Attributes
    ----------
    states
        float64 (states, 1 + systems, 2): mean and std of the base and of each system's anomaly in each of its states.
        A part with fewer states repeats its first.
    choice
        int64 (cases, 1 + systems), the state of each part.
    log_prior
        float64 (cases,), log-probability of each case.
    rest
        Standard deviation of an unattributed jump; mean and standard deviation of the slope.
    """

    states: FloatArray
    choice: IntArray
    log_prior: FloatArray
    rest: FloatArray


@njit(cache=True, error_model="numpy", nogil=True)
def solve_cases(
    story: FlatStory,
    borders: IntArray,
    table: FloatArray,
    moments: FloatArray,
    cases: Cases,
    variance: float,
    scatter: float,
) -> tuple[float, FloatArray, FloatArray, FloatArray, IntArray]:
    """Lay a story out, condition its prior of each case on the segments, and mix what comes out.

    Parameters
    ----------
    story, borders, table
        See `lay_out`.
    moments, variance, scatter
        As in `condition`.
    cases
        The prior.

    Returns
    -------
    tuple
        Log evidence, mean, standard deviation and covariance of the mixture, and `column` as `lay_out` gives it.
    """
    levels, column, laws = lay_out(story, borders, table)
    count, unknowns = cases.choice.shape[0], levels.shape[1] + 1
    prior = _prior_of_states(cases, laws, unknowns)
    log_evidences = np.empty(count)
    means, covariances = np.empty((count, unknowns)), np.empty((count, unknowns, unknowns))
    mean, precision = np.empty(unknowns), np.empty((unknowns, unknowns))
    for c in range(count):
        log_determinant = _choose(prior, cases.choice[c], mean, precision)
        log_evidences[c] = _condition(
            levels, moments, mean, precision, log_determinant, variance, scatter, means[c], covariances[c]
        )
    log_evidence, mean, std, covariance = _mix(log_evidences, means, covariances, cases.log_prior)
    return log_evidence, mean, std, covariance, column


class _Prior(NamedTuple):
    """The prior with all parts in their first state, with all in their second, and so on.

    What a system's anomaly does to its sojourns is common to them; all else is independent before the window. So each
    part is a diagonal block, see `_invert`, which a case takes from the state that it chooses.

    Attributes
    ----------
    part, block
        int64 (unknowns,): whose state tells of each unknown, and its block.
    mean, log_variance
        float64 (states, unknowns): mean, and logarithm of each pivot of the covariance.
    precision
        float64 (states, unknowns, unknowns).
    """

    part: IntArray
    block: IntArray
    mean: FloatArray
    log_variance: FloatArray
    precision: FloatArray


@njit(cache=True, error_model="numpy", nogil=True)
def _prior_of_states(cases: Cases, laws: FloatArray, unknowns: int) -> _Prior:
    """Return mean and precision of the unknowns in all states; `laws` as from `lay_out`."""
    states = cases.states.shape[0]
    part, block = np.zeros(unknowns, dtype=np.int64), np.arange(unknowns)
    for i in range(laws.shape[1]):
        part[1 + i] = 1 + int(laws[0, i])
        if i > 0 and laws[0, i] == laws[0, i - 1]:
            block[1 + i] = block[i]
    mean, log_variance = np.empty((states, unknowns)), np.empty((states, unknowns))
    precision, covariance = np.empty((states, unknowns, unknowns)), np.zeros((unknowns, unknowns))
    for state in range(states):
        _prior_of_state(cases.states[state], laws, cases.rest, block, mean[state], covariance)
        _invert(covariance, block, precision[state], log_variance[state])
    return _Prior(part, block, mean, log_variance, precision)


@njit(cache=True, error_model="numpy", nogil=True)
def _prior_of_state(
    state: FloatArray, laws: FloatArray, rest: FloatArray, block: IntArray, mean: FloatArray, covariance: FloatArray
) -> None:
    """Write mean, and the lower triangle within the blocks of the covariance, with each part in a state of `Cases`."""
    unknowns, sojourns = mean.size, laws.shape[1]
    mean[0], covariance[0, 0] = state[0, 0], state[0, 1] * state[0, 1]
    for i in range(sojourns):
        owner = 1 + int(laws[0, i])
        factor, spread = 1.0 + state[owner, 0], state[owner, 1]
        mean[1 + i] = factor * laws[1, i]
        deviation = factor * laws[2, i]
        for j in range(block[1 + i] - 1, i):
            covariance[1 + i, 1 + j] = (spread * laws[1, i]) * (spread * laws[1, j])
        covariance[1 + i, 1 + i] = deviation * deviation + (spread * laws[1, i]) * (spread * laws[1, i])
    for i in range(1 + sojourns, unknowns - 1):
        mean[i], covariance[i, i] = 0.0, rest[0] * rest[0]
    mean[unknowns - 1], covariance[unknowns - 1, unknowns - 1] = rest[1], rest[2] * rest[2]


@njit(cache=True, error_model="numpy", nogil=True)
def _choose(prior: _Prior, choice: IntArray, mean: FloatArray, precision: FloatArray) -> float:
    """Write mean, and the lower triangle of the precision, of one case; return its covariance's log-determinant."""
    log_determinant = 0.0
    for i in range(mean.size):
        state = choice[prior.part[i]]
        mean[i] = prior.mean[state, i]
        precision[i, : prior.block[i]] = 0.0
        for j in range(prior.block[i], i + 1):
            precision[i, j] = prior.precision[state, i, j]
        log_determinant += prior.log_variance[state, i]
    return log_determinant


@njit(cache=True, error_model="numpy", nogil=True)
def evidence_of_cases(
    story: FlatStory,
    borders: IntArray,
    table: FloatArray,
    moments: FloatArray,
    cases: Cases,
    variance: float,
    scatter: float,
) -> float:
    """Return the log evidence alone, in a third of the time of `solve_cases`; parameters as there."""
    levels, _, laws = lay_out(story, borders, table)
    count, unknowns = cases.choice.shape[0], levels.shape[1] + 1
    prior = _prior_of_states(cases, laws, unknowns)
    mean, precision = np.empty(unknowns), np.empty((unknowns, unknowns))
    response, log_variance = np.empty(unknowns), np.empty(unknowns)
    whole, scores = np.zeros(unknowns, dtype=np.int64), np.empty(count)
    for c in range(count):
        log_determinant = _choose(prior, cases.choice[c], mean, precision)
        squares, log_determinant = _add_segments(
            levels, moments, mean, variance, scatter, precision, response, log_determinant
        )
        log_determinant += _factor(precision, whole, log_variance)
        explained = 0.0
        for i in range(unknowns):  # the response, by forward substitution in units of the posterior's deviations
            for j in range(i):
                response[i] -= precision[i, j] * response[j]
            response[i] /= precision[i, i]
            explained += response[i] * response[i]
        scores[c] = cases.log_prior[c] - 0.5 * (squares - explained) - 0.5 * log_determinant
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
    precision, log_variance = np.empty_like(posterior), np.empty_like(mean)
    log_determinant = _invert(covariance, block, precision, log_variance)
    return _condition(levels, moments, mean, precision, log_determinant, variance, scatter, posterior_mean, posterior)


@njit(cache=True, error_model="numpy", nogil=True)
def _condition(
    levels: FloatArray,
    moments: FloatArray,
    mean: FloatArray,
    precision: FloatArray,
    log_determinant: float,
    variance: float,
    scatter: float,
    posterior_mean: FloatArray,
    posterior: FloatArray,
) -> float:
    """Do the work of `condition` with the prior's precision and its covariance's log-determinant.

    Of the precision, float64 (unknowns, unknowns), the lower triangle is read and destroyed.
    """
    unknowns = mean.size
    response, log_variance = np.empty(unknowns), np.empty(unknowns)
    squares, log_determinant = _add_segments(
        levels, moments, mean, variance, scatter, precision, response, log_determinant
    )
    log_determinant += _invert(precision, np.zeros(unknowns, dtype=np.int64), posterior, log_variance)
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
    variance: float,
    scatter: float,
    precision: FloatArray,
    response: FloatArray,
    log_determinant: float,
) -> tuple[float, float]:
    """Add to a prior what the segments tell; return squared misses of its mean, and the log-determinant of variances.

    Parameters as in `_condition`; the lower triangle of the precision becomes the posterior's, and written is, float64
    (unknowns,), the response: precision times the shift of the mean.
    """
    segments, unknowns = levels.shape[0], mean.size
    slope_at = unknowns - 1
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
def _factor(matrix: FloatArray, block: IntArray, log_pivot: FloatArray) -> float:
    """Put the Cholesky factor in the place of the lower triangle; return the log-determinant. As in `_invert`.

    `PANEL` columns are finished before they are taken from those beyond: a matrix larger than the fastest cache is then
    read so much less often. Each element is still reached by one column after the other.
    """
    size = matrix.shape[0]
    diagonal, panel = np.empty(size), np.empty((PANEL, size))
    for i in range(size):
        diagonal[i] = matrix[i, i]
    log_determinant = 0.0
    first, end = 0, 0  # of the panel; the end of its block
    while first < size:
        while end < size and block[end] <= first:
            end += 1
        last = min(first + PANEL, end)
        for j in range(first, last):
            # A pivot smaller than its rounding is taken for that: noise a billionth of the friction leaves no digits.
            pivot = max(matrix[j, j], PIVOT_ROUNDING * diagonal[j], LEAST_PIVOT)
            log_pivot[j] = np.log(pivot)
            log_determinant += log_pivot[j]
            matrix[j, j] = root = np.sqrt(pivot)
            column = panel[j - first]
            for i in range(j + 1, end):
                matrix[i, j] = column[i] = matrix[i, j] / root
                for c in range(j + 1, min(i + 1, last)):
                    matrix[i, c] -= column[i] * column[c]
        if last < end:
            _take_panel(matrix, panel, last, end)
        first = last
    return log_determinant


@njit(cache=True, error_model="numpy", nogil=True)
def _take_panel(matrix: FloatArray, panel: FloatArray, first: int, end: int) -> None:
    """Take finished columns of a factor from the lower triangle of the rows and columns [first, end)."""
    a, b, c, d = panel[0], panel[1], panel[2], panel[3]
    for i in range(first, end):
        row = matrix[i]
        ai, bi, ci, di = a[i], b[i], c[i], d[i]
        for j in range(first, i + 1):
            row[j] = (((row[j] - ai * a[j]) - bi * b[j]) - ci * c[j]) - di * d[j]


@njit(cache=True, error_model="numpy", nogil=True)
def _invert(matrix: FloatArray, block: IntArray, inverse: FloatArray, log_pivot: FloatArray) -> float:
    """Write the inverse of a symmetric positive definite matrix; return its log-determinant. By its Cholesky factor.

    Parameters
    ----------
    matrix
        float64 (n, n); its lower triangle is read, and holds the Cholesky factor afterwards.
    block
        int64 (n,): the first row of the diagonal block that each row belongs to; beyond the blocks it is zero. 0
        throughout for a full matrix.
    inverse, log_pivot
        float64 (n, n) and (n,), written; the latter adds up to the log-determinant.
    """
    size = matrix.shape[0]
    log_determinant = _factor(matrix, block, log_pivot)
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
