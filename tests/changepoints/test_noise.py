"""The noise beside the jumps: white, coloured, heavy-tailed, with and without anything else in the window."""

import numpy as np
import pytest
from scipy import signal, stats

from rwa_monitor.changepoints.noise import (
    OUTLIERS,
    ar_coefficient,
    estimate_noise,
    gaussian_outlier,
    largest_outlier,
    mean_variance_factor,
    outlier_chance,
)
from rwa_monitor.changepoints.stage_results import NoiseEstimate
from rwa_monitor.kernels.noise import (
    LAGS,
    block_differences,
    contrast_variances,
    lagged_products,
    quantiles_of,
    quiet_levels,
    scale_variances,
)
from rwa_monitor.kernels.running_sums import BLOCK
from rwa_monitor.kernels.wglr import BINS, BINS_PER_OCTAVE, LOWEST_EXPONENT

N = 80_000


def _histogram(values):
    """Count values in the detector's bins, independently of its bit tricks."""
    exponent = np.floor(np.log2(values))
    within = np.floor((values / 2.0**exponent - 1.0) * BINS_PER_OCTAVE)
    place = (exponent - LOWEST_EXPONENT) * BINS_PER_OCTAVE + within
    return np.bincount(np.clip(place, 0, BINS - 1).astype(np.int64), minlength=BINS)


def _ar(rng, phi, n=N):
    return signal.lfilter([np.sqrt(1 - phi**2)], [1, -phi], rng.standard_normal(n + 500))[500:]


def _blocks(z, hop=4 * BLOCK, used=None):
    count = (z.size - BLOCK - LAGS) // hop + 1
    sums, pairs = np.zeros((count, LAGS)), np.zeros((count, LAGS))
    used = np.ones(z.size, dtype=np.bool_) if used is None else used
    block_differences(np.ones(z.size), z, used, 0, count, hop, 0.0, 1.0, sums, pairs)
    return sums, pairs


def _outlier(z, variance=1.0):
    statistic = np.maximum(np.diff(z) ** 2 / 2, 1e-300)
    return largest_outlier(quantiles_of(_histogram(statistic), 0.0), variance, outlier_chance(N))


def _estimate(z, jump_share=0.0, **kwargs):
    levels, counts = quiet_levels(*_blocks(z, **kwargs), jump_share)
    return estimate_noise(levels, counts, np.ones(1, dtype=np.int64), np.full(1, np.nan), z.size, np.nan)


@pytest.mark.parametrize(("variance", "jumped"), [(1e-9, 0.0), (1.0, 0.0), (5.76e-4, 0.0), (1.0, 0.02), (1.0, 0.1)])
def test_variance_of_a_contrast_comes_from_its_histogram_whatever_jumps(variance, jumped):
    values = variance * np.random.default_rng(1).chisquare(1, 40_000)
    values[: int(jumped * values.size)] *= 1e3
    [v] = scale_variances(_histogram(values)[None], np.array([2]), np.nan)
    # Relative standard error of the trimmed mean: below 2/√n.
    assert v == pytest.approx(variance, rel=0.05 if jumped else 4 * 2 / np.sqrt(40_000))


@pytest.mark.parametrize("rate", [1 / 200, 1 / 100, 1 / 75])
@pytest.mark.parametrize("seed", range(3))
def test_noise_is_known_though_most_blocks_hold_a_jump(rate, seed):
    rng = np.random.default_rng(seed)
    z = rng.standard_normal(20_000)
    z += 10.0 * (np.cumsum(rng.random(z.size) < rate) % 2)
    noise = _estimate(z, jump_share=rate)
    # Some ten blocks of 64 + 64 samples are quiet, the lowest of them.
    assert noise.std == pytest.approx(1.0, abs=0.15)
    assert noise.long_run_factor == pytest.approx(1.0, abs=0.5)


@pytest.mark.parametrize("seed", range(3))
def test_white_noise_is_known_to_one_per_cent_and_called_white(seed):
    noise = _estimate(np.random.default_rng(seed).standard_normal(N))
    # 20,000 samples enter: a relative standard error of 1/√40,000 = 0.5 %.
    assert noise.std == pytest.approx(1.0, abs=0.015)
    assert noise.long_run_factor == pytest.approx(1.0, abs=0.05)
    assert noise.autocovariance[0] == pytest.approx(noise.std**2)


@pytest.mark.parametrize("phi", [0.3, 0.5, 0.8])
def test_coloured_noise_shows_its_autocovariance_and_long_run(phi):
    noise = _estimate(_ar(np.random.default_rng(4), phi))
    assert noise.std == pytest.approx(1.0, abs=0.05)
    np.testing.assert_allclose(noise.autocovariance[1:4], phi ** np.arange(1, 4), atol=0.06)
    assert noise.long_run_factor == pytest.approx((1 + phi) / (1 - phi), rel=0.2)


def test_differenced_noise_has_hardly_any_long_run():
    e = np.diff(np.random.default_rng(5).standard_normal(N + 1)) / np.sqrt(2)
    noise = _estimate(e)
    assert noise.autocovariance[1] == pytest.approx(-0.5, abs=0.03)
    assert noise.long_run_factor < 0.1


def test_jumps_gaps_and_outliers_do_not_become_noise():
    rng = np.random.default_rng(6)
    z = rng.standard_normal(N)
    z += 15.0 * (np.arange(N) // 5000 % 2)
    z[rng.integers(0, N, 20)] += 100.0
    noise = _estimate(z, used=rng.random(N) < 0.8)
    assert noise.std == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("freedom", [3.0, 5.0])
def test_heavy_tails_are_measured(freedom):
    rng = np.random.default_rng(7)
    expected = stats.t(freedom).isf(0.5 * OUTLIERS / N)
    assert _outlier(rng.standard_t(freedom, N)) == pytest.approx(expected, rel=0.3)


def test_gaussian_noise_has_light_tails_also_with_jumps_in_it():
    rng = np.random.default_rng(8)
    assert _outlier(rng.standard_normal(N) + 15.0 * (np.arange(N) // 2000 % 2)) < 6.0


@pytest.mark.parametrize("share", [0.9, 1.0])
def test_block_differences_are_those_of_plain_loops(share):
    rng = np.random.default_rng(10)
    z, used = rng.standard_normal(300), rng.random(300) < share
    x, slope, weight = 1.0 + 0.01 * z[::-1].copy(), 0.5, 1e-2
    sums, pairs = np.zeros((2, LAGS)), np.zeros((2, LAGS))
    block_differences(x, z, used, 0, 2, BLOCK, slope, weight, sums, pairs)
    for b in range(2):
        there = slice(b * BLOCK, b * BLOCK + BLOCK + LAGS)
        good, u, v = used[there], x[there] - x[there][used[there]].mean(), z[there] - z[there][used[there]].mean()
        e = v - (u[good] @ v[good] + weight * slope) / (u[good] @ u[good] + weight) * u
        for lag in range(1, LAGS + 1):
            both = good[:BLOCK] & good[lag : BLOCK + lag]
            assert pairs[b, lag - 1] == both.sum()
            half = 0.5 * (e[lag : BLOCK + lag] - e[:BLOCK])[both] ** 2
            assert sums[b, lag - 1] == pytest.approx(half.sum(), rel=1e-9)


def test_colour_is_called_ar_only_where_it_looks_like_it():
    rng = np.random.default_rng(12)
    assert ar_coefficient(_estimate(_ar(rng, 0.5))) == pytest.approx(0.5, abs=0.05)
    assert ar_coefficient(_estimate(rng.standard_normal(N))) == 0.0
    assert ar_coefficient(_estimate(np.diff(rng.standard_normal(N + 1)))) == 0.0
    assert ar_coefficient(NoiseEstimate(1.0, np.ones(1), 1.0)) == 0.0


@pytest.mark.parametrize("phi", [0.0, 0.5])
def test_block_differences_imply_the_variance_of_each_contrast(phi):
    z = _ar(np.random.default_rng(13), phi) if phi else np.random.default_rng(13).standard_normal(N)
    levels, _ = quiet_levels(*_blocks(z), 0.0)
    scales = np.array([1, 2, 8, 32, 64])
    v = contrast_variances(levels, scales)
    assert v[-1] == 0.0  # longer than the lags
    for w, value in zip(scales[:-1], v, strict=False):
        sums = np.cumsum(np.append(0.0, z))
        contrast = (sums[2 * w :] - 2 * sums[w:-w] + sums[: -2 * w]) / w
        # 20,000 samples enter, in contrasts of 2w.
        assert value == pytest.approx(w / 2 * contrast.var(), rel=4 * np.sqrt(2 * 2 * w / 20_000))


def test_a_lattice_has_no_heavy_tails():
    z = np.round(np.random.default_rng(14).standard_normal(N) / 5.0)
    assert _outlier(z, 0.05) == 0.05**0.5 * gaussian_outlier(outlier_chance(N))


def test_variance_of_a_mean_is_the_double_sum_over_its_samples():
    covariance = np.array([1.0, 0.6, 0.0, -0.2, 0.1, 0.0])
    long_run = 1.0 + 2.0 * covariance[1:].sum()
    counts = np.array([1.0, 2.0, 3.0, 4.0, 7.0, 40.0])
    factors = mean_variance_factor(NoiseEstimate(1.0, covariance, long_run), counts)
    for n, factor in zip(counts.astype(int).tolist(), factors, strict=True):
        apart = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
        of_pairs = np.where(apart < covariance.size, covariance[np.minimum(apart, covariance.size - 1)], 0.0)
        assert factor == pytest.approx(of_pairs.sum() / n, rel=1e-12)


@pytest.mark.parametrize("n", [1, 12, 300])
def test_lagged_products_stay_within_their_interval(n):
    rng = np.random.default_rng(n)
    value, interval = rng.standard_normal(n), np.sort(rng.integers(0, 5, n))
    expected = np.zeros((5, 7))
    for i in range(n):
        for lag in range(2, min(i, 8) + 1):
            expected[interval[i], lag - 2] += value[i] * value[i - lag] * (interval[i] == interval[i - lag])
    np.testing.assert_allclose(lagged_products(value, interval, 5, np.arange(2, 9)), expected, rtol=1e-12)
