"""The noise of a window, measured beside its jumps: variance of each scale's contrast, autocovariance.

Two robust views, both incremental and of fixed size:

* The wGLR of each scale goes into a histogram. Where nothing jumps it is v·χ² with one degree of freedom, whatever the
  colour of the noise, so the histogram's lower part gives v, the variance of this scale's own contrast (errata 17).
* Differences (e_{k+l} - e_k)² at lags 1 … 64, averaged over short blocks, give the autocovariance: their level at long
  lags is the variance, what short lags lack is the covariance. A block with a jump in it stands out and is left out.

How heavy its tails are, `tails` tells from the histogram of neighbour differences.
"""

from __future__ import annotations

from typing import Final

import numba
import numpy as np
from scipy import special

from rwa_monitor.diagnosis.medians import median
from rwa_monitor.diagnosis.results import NoiseEstimate
from rwa_monitor.diagnosis.sums import sum_up
from rwa_monitor.diagnosis.wglr import BINS, BINS_PER_OCTAVE, LOWEST_EXPONENT, counted_every
from rwa_monitor.samples import BoolArray, FloatArray, IntArray

LAGS: Final = 64  # lags 1 … 64 of the differences; the autocovariance is given at 0 … 63
BLOCK: Final = 64  # base slots of a block; a block reads BLOCK + LAGS samples
SMALLEST_STD: Final = 1e-9  # normalised; the rounding errors of noise-free data lie far below

# The lowest three quarters of v·χ²₁ have the mean v · P(χ²₃ < q) / 0.75, with q the quantile of χ²₁ at 0.75.
_KEPT: Final = 0.75
_KEPT_MEAN: Final = float(special.gammainc(1.5, 0.5 * float(special.chdtri(1, 1 - _KEPT))) / _KEPT)
_JUMPED: Final = 12.0  # a statistic beyond 12 v has probability 5e-4 without a jump
_JUMPED_RATE: Final = float(special.chdtrc(1, _JUMPED))
_MOST_JUMPED: Final = 0.3  # beyond that share the estimate is not corrected further
_BORROWED: Final = 30.0  # worth of the next narrower scale's variance, in independent contrasts

_LEAST_PAIRS: Final = 8  # of 64, at every lag of a block

_LEAST_COLOUR: Final = 0.1  # correlation of neighbours below which noise counts as white
_AR_TOLERANCE: Final = 0.15  # of ρ(2) = ρ(1)²: a few standard errors in a long window

_BIN: Final = np.arange(BINS)
BIN_EDGES: Final = np.ldexp(1.0 + (_BIN % BINS_PER_OCTAVE) / BINS_PER_OCTAVE, _BIN // BINS_PER_OCTAVE + LOWEST_EXPONENT)
BIN_WIDTHS: Final = np.ldexp(1.0 / BINS_PER_OCTAVE, _BIN // BINS_PER_OCTAVE + LOWEST_EXPONENT)


@numba.njit(cache=True, error_model="numpy", nogil=True)
def scale_variances(histogram: IntArray, scales: IntArray, start_variance: float) -> FloatArray:
    """Estimate the variance of each scale's contrast from the histogram of its statistic.

    Parameters
    ----------
    histogram
        int (S, BINS), counts of the unnormalised statistic.
    scales
        int64 (S,), ascending.
    start_variance
        Variance expected before any data; NaN if not known.

    Returns
    -------
    float64 (S,), v with statistic / v ~ χ² with one degree of freedom. With few independent contrasts it leans on the
    next narrower scale's (the narrowest: on `start_variance`). NaN where nothing was counted and nothing is known.
    """
    variances, borrowed = np.empty(scales.size), start_variance
    for s in range(scales.size):
        total, trimmed = _trimmed_variance(histogram[s])
        if total > 0:
            measured = max(trimmed, SMALLEST_STD**2)
            if np.isnan(borrowed):
                borrowed = measured
            borrowed = lean(measured, borrowed, total * (counted_every(scales[s]) / scales[s]))
        variances[s] = borrowed
    return variances


@numba.njit(cache=True, error_model="numpy", nogil=True)
def lean(measured: float, borrowed: float, independent: float) -> float:
    """Return a scale's variance, measured on so many independent contrasts, leaning on the next narrower scale's."""
    share = independent / (independent + _BORROWED)
    return float(np.exp(share * np.log(measured) + (1.0 - share) * np.log(borrowed)))


def chi_variance(statistic: FloatArray) -> float:
    """Return v of statistics that are v·χ² with one degree of freedom but for some jumps: from their lower part.

    As `scale_variances`, for all statistics of a window at hand: float64 (n,), n > 0.
    """
    jumped = 0.0
    variance = 0.0
    ascending = np.sort(statistic)
    for _ in range(4):
        kept = max(1, int(_KEPT * (1.0 - jumped) * ascending.size))
        variance = float(np.mean(ascending[:kept])) / _KEPT_MEAN
        beyond = float(np.mean(ascending > _JUMPED * variance))
        jumped = min(max(0.0, beyond - _JUMPED_RATE), _MOST_JUMPED)
    return variance


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _trimmed_variance(counts: IntArray) -> tuple[int, float]:
    """Return how many were counted, and v from the mean of the lowest three quarters, jumps set aside.

    A first estimate shows how many statistics lie beyond _JUMPED v; more than the noise's share are jumps, and the
    three quarters are those of the rest.
    """
    edges, widths = BIN_EDGES, BIN_WIDTHS
    total = counts.sum()
    jumped = 0.0
    variance = 0.0
    if total == 0:
        return 0, 0.0
    # Counts, and sum of the statistics, of all bins below each one, as far as three quarters of all.
    before, weight_before = np.empty(counts.size), np.empty(counts.size)
    seen = weighted = 0.0
    place = -1
    while counts[place + 1] == 0:  # half of all bins, as a rule
        place += 1
    while seen < _KEPT * total:
        place += 1
        before[place], weight_before[place] = seen, weighted
        seen += counts[place]
        weighted += counts[place] * (edges[place] + 0.5 * widths[place])
    for _ in range(4):
        kept = _KEPT * (1.0 - jumped) * total
        while before[place] >= kept:
            place -= 1
        # Within a bin counts are taken as evenly spread.
        rest = kept - before[place]
        weighted = weight_before[place] + rest * (edges[place] + 0.5 * rest / counts[place] * widths[place])
        variance = weighted / kept / _KEPT_MEAN
        seen, end = before[place], place
        while end < counts.size and edges[end] + widths[end] <= _JUMPED * variance:
            seen += counts[end]
            end += 1
        if end < counts.size:
            seen += counts[end] * max(_JUMPED * variance - edges[end], 0.0) / widths[end]
        last, jumped = jumped, min(max(1.0 - seen / total - _JUMPED_RATE, 0.0), _MOST_JUMPED)
        if jumped == last:
            break  # as nearly always, at once: nothing jumps, and another round would give the same
    return total, variance


@numba.njit(cache=True, error_model="numpy", nogil=True)
def block_differences(
    x: FloatArray,
    z: FloatArray,
    used: BoolArray,
    first: int,
    last: int,
    hop: int,
    slope: float,
    weight: float,
    sums: FloatArray,
    pairs: FloatArray,
) -> None:
    """Sum the squared differences of blocks first … last - 1 at lags 1 … LAGS.

    Parameters
    ----------
    x, z, used
        (slots,), the window's samples.
    first, last
        Blocks; block b reads the slots [b·hop, b·hop + BLOCK + LAGS).
    hop
        Slots from one block to the next.
    slope, weight
        Prior of the block's own slope, which is taken out: a slew is not noise.
    sums, pairs
        Outputs: float64 (B, LAGS), sum of (e_{k+l} - e_k)²/2 and number of pairs of used samples.
    """
    length = BLOCK + LAGS
    room = np.empty((4, length))  # in one piece: four pieces take four times as long to get
    good, u, v, e = room[0], room[1], room[2], room[3]
    total = np.empty(LAGS)
    for b in range(first, last):
        there = slice(b * hop, b * hop + length)
        speed, friction, counted = x[there], z[there], used[there]
        for i in range(length):  # without branches: several slots at once
            good[i] = counted[i]
            u[i] = (speed[i] - speed[0]) * good[i]
            v[i] = (friction[i] - friction[0]) * good[i]
        n, sx, sz, sxx, sxz = 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(length):
            n += good[i]
            sx += u[i]
            sz += v[i]
            sxx += u[i] * u[i]
            sxz += u[i] * v[i]
        share = 1.0 / max(n, 1.0)
        own = (sxz - sx * sz * share + weight * slope) / (max(sxx - sx * sx * share, 0.0) + weight)
        for i in range(length):
            e[i] = v[i] - own * u[i]
        # Lags in the inner loop: neighbouring sums, which the compiler can advance together.
        if n == length:  # the same as below, where nothing is masked; four slots in a row for each sum in memory
            total[:] = 0.0
            for i in range(0, BLOCK, 4):
                e0, e1, e2, e3 = e[i], e[i + 1], e[i + 2], e[i + 3]
                for lag in range(LAGS):
                    k = i + 1 + lag
                    d0, d1, d2, d3 = e[k] - e0, e[k + 1] - e1, e[k + 2] - e2, e[k + 3] - e3
                    total[lag] = (((total[lag] + d0 * d0) + d1 * d1) + d2 * d2) + d3 * d3
            sums[b] = 0.5 * total  # exact
            pairs[b] = BLOCK
            continue
        sums[b] = 0.0
        pairs[b] = 0.0
        for i in range(BLOCK):
            if good[i] > 0.0:
                for lag in range(LAGS):
                    difference = e[i + 1 + lag] - e[i]
                    sums[b, lag] += good[i + 1 + lag] * (0.5 * difference * difference)
                    pairs[b, lag] += good[i + 1 + lag]


@numba.njit(cache=True, error_model="numpy", nogil=True)
def quiet_levels(sums: FloatArray, pairs: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Average the block differences, in their order, over the full blocks that do not stand out upwards.

    Parameters
    ----------
    sums, pairs
        float64 (B, LAGS), see `block_differences`.

    Returns
    -------
    levels, counts
        float64 (LAGS,): γ(0) - γ(l) at the lags 1 … LAGS, and the pairs behind it; NaN and 0 without a full block.
    """
    blocks = sums.shape[0]
    score, part = np.empty(blocks), np.empty(8)
    for b in range(blocks):
        count = _sum_of_lags(pairs[b], part)
        is_full = count == LAGS * BLOCK or pairs[b].min() >= _LEAST_PAIRS
        score[b] = _sum_of_lags(sums[b], part) / count if is_full else np.nan
    full = score[np.isfinite(score)]
    level, counts = np.zeros(LAGS), np.zeros(LAGS)
    if full.size == 0:
        return np.full(LAGS, np.nan), counts
    middle = median(full)
    most = middle + 4.0 * (1.4826 * median(np.abs(full - middle)))
    for b in range(blocks):
        if score[b] <= most:
            for lag in range(LAGS):  # one array at a time: several lags at once
                level[lag] += sums[b, lag]
            for lag in range(LAGS):
                counts[lag] += pairs[b, lag]
    return level / counts, counts


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _sum_of_lags(row: FloatArray, part: FloatArray) -> float:
    """Return the sum of (LAGS,), as eight side by side; `part`, (8,), is room for these."""
    for i in range(8):
        part[i] = ((row[i] + row[8 + i]) + (row[16 + i] + row[24 + i])) + (
            (row[32 + i] + row[40 + i]) + (row[48 + i] + row[56 + i])
        )
    return float(((part[0] + part[1]) + (part[2] + part[3])) + ((part[4] + part[5]) + (part[6] + part[7])))


@numba.njit(cache=True, error_model="numpy", nogil=True)
def contrast_variances(levels: FloatArray, scales: IntArray) -> FloatArray:
    """Return the variance v of each scale's contrast that the block differences imply.

    The weights of a contrast, -1/w and +1/w w times each, add up to nothing, so its variance needs only γ(0) - γ(l):
    with r(l) their correlation, v = -w Σ r(l) (γ(0) - γ(l)) over l ≥ 1.

    Parameters
    ----------
    levels
        float64 (LAGS,), see `quiet_levels`.
    scales
        int64 (S,).

    Returns
    -------
    float64 (S,); 0 where a contrast is longer than the lags reach, or nothing is known.
    """
    variances = np.zeros(scales.size)
    for s in range(scales.size):
        w, lacking = scales[s], 0.0
        if 2 * w <= LAGS:
            for lag in range(1, 2 * w):
                lacking += (2 * w - 3 * lag if lag < w else lag - 2 * w) * levels[lag - 1]  # w² r(l)
            variances[s] = max(-lacking / w, 0.0) if np.isfinite(lacking) else 0.0
    return variances


def estimate_noise(
    levels: FloatArray,
    counts: FloatArray,
    scales: IntArray,
    variances: FloatArray,
    samples: int,
    start_std: float | None,
) -> NoiseEstimate:
    """Combine the block differences and the scales' variances to the noise of the window.

    Parameters
    ----------
    levels, counts
        float64 (LAGS,), see `quiet_levels`.
    scales, variances
        (S,), see `scale_variances`.
    samples
        Used samples of the window.
    start_std
        Standard deviation expected before any data; used when there are no blocks and no variances.
    """
    if not counts.any():
        known = [value for value in (float(variances[0]), (start_std or np.nan) ** 2) if np.isfinite(value)]
        variance = max(known[0] if known else 0.0, SMALLEST_STD**2)
        return NoiseEstimate(float(np.sqrt(variance)), np.append(variance, np.zeros(LAGS - 1)), 1.0)
    return NoiseEstimate(*_combine(levels, counts, scales, variances, samples))


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _combine(
    levels: FloatArray, counts: FloatArray, scales: IntArray, variances: FloatArray, samples: int
) -> tuple[float, FloatArray, float]:
    """Return the fields of the `NoiseEstimate` where there are blocks; parameters as those of `estimate_noise`."""
    tried = 3 * LAGS // 4  # lags at which the noise may remember
    variance = sum_up(levels[tried:]) / (LAGS - tried)
    last = 0  # the last lag whose correlation is certain
    for _ in range(2):
        correlation = 1.0 - levels / max(variance, SMALLEST_STD**2)
        spread = 1.0 + 2.0 * sum_up(np.square(correlation[:last]))
        last = 0
        for lag in range(tried):
            if abs(correlation[lag]) > 4.0 * np.sqrt(spread / counts[lag]):
                last = lag + 1
        variance = sum_up(levels[last:] * counts[last:]) / sum_up(counts[last:])
    variance = max(variance, SMALLEST_STD**2)
    autocovariance = np.zeros(LAGS)
    autocovariance[0] = variance
    # Beyond the last certain lag the autocovariance is noise of the estimate: 63 such lags would swamp the long run.
    autocovariance[1 : last + 1] = variance - levels[:last]
    factor = 1.0 + 2.0 * sum_up(autocovariance[1:]) / variance

    # The widest scale with enough independent contrasts bounds the long run from its own side. A short window has only
    # narrow ones, which cannot deny a long memory.
    for s in range(scales.size - 1, -1, -1):
        independent = samples / scales[s]
        if np.isfinite(variances[s]) and scales[s] >= 8 and independent >= (100 if scales[s] > 16 else 20):
            error = 3.0 * 1.5 * np.sqrt(2.0 / independent)
            ratio = variances[s] / variance
            highest = ratio * (1.0 + error) if independent >= 100 else np.inf
            factor = min(max(factor, ratio * max(1.0 - error, 0.5)), highest)
            break
    return np.sqrt(variance), autocovariance, max(factor, 1e-3)


def mean_variance_factor(noise: NoiseEstimate, count: FloatArray) -> FloatArray:
    """Return n·Var(mean of n neighbouring samples) / variance, float64, the shape of `count`; 1 for white noise.

    For long ranges it tends to the long-run factor.
    """
    n = np.asarray(count, dtype=np.float64)
    return np.asarray(mean_variance_factors(n.ravel(), noise.autocovariance, noise.long_run_factor)).reshape(n.shape)


@numba.njit(cache=True, error_model="numpy", nogil=True)
def mean_variance_factors(count: FloatArray, autocovariance: FloatArray, long_run_factor: float) -> FloatArray:
    """See `mean_variance_factor`; float64 (n,)."""
    factors = np.empty(count.size)
    correlation = autocovariance / autocovariance[0]
    last = 0  # beyond, the noise remembers nothing
    missing = long_run_factor - 1.0
    for lag in range(1, correlation.size):
        if correlation[lag] != 0.0:
            last = lag
            missing -= 2.0 * correlation[lag]
    for i in range(count.size):
        n = max(count[i], 1.0)
        short = 1.0
        for lag in range(1, min(last, int(min(n, last))) + 1):
            short += 2.0 * (1.0 - lag / n) * correlation[lag]
        # What the autocovariance does not show of the long run comes in once a range is longer than its lags.
        factors[i] = max(short + missing * n / (n + autocovariance.size), 1e-3)
    return factors


def ar_coefficient(noise: NoiseEstimate) -> float:
    """Return φ where the noise looks like AR(1) with a positive φ, else 0."""
    if noise.autocovariance.size < 3 or not noise.autocovariance[0] > 0.0:
        return 0.0
    variance, first, second = noise.autocovariance[:3].tolist()
    phi = first / variance
    return phi if phi > _LEAST_COLOUR and abs(second / variance - phi**2) < _AR_TOLERANCE else 0.0
