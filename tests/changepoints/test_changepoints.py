"""Stages 1 and 2 against the fits they stand for: the wGLR, the choice among its peaks; levels and slope between."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from rwa_monitor.changepoints.estimation import (
    SlopePrior,
    estimate,
    nominal_slope_prior,
    residual_blocks,
)
from rwa_monitor.changepoints.evidence import peaks_behind_gaps, variance_table
from rwa_monitor.changepoints.running_sums import RunningSums
from rwa_monitor.kernels.changepoints import choose, contrast
from rwa_monitor.kernels.running_sums import extend_sums, slope_within
from rwa_monitor.kernels.wglr import CHUNK, wglr
from rwa_monitor.wheel.wheel import built_in_wheel
from tests.switching.assignment_windows import NO_CANDIDATES, evidence_of, record_of, sums_of

SIGMA = 0.024  # the paper's noise, normalised


def _glr_by_least_squares(x, z, used, k, w, weight, slope):
    """Return SSR₀ - SSR₁ and the jump as the paper defines them: two penalised fits, solved as they stand."""
    keep = used[k - w : k + w]
    u, v = x[k - w : k + w][keep], z[k - w : k + w][keep]
    after = (np.arange(k - w, k + w) >= k)[keep]
    prior = np.sqrt(weight)
    target = np.append(v, prior * slope)

    def squared_error(levels):
        matrix = np.vstack((np.column_stack((*levels, u)), [0.0] * len(levels) + [prior]))
        solution = np.linalg.lstsq(matrix, target, rcond=None)[0]
        return float(np.sum((target - matrix @ solution) ** 2)), solution

    without, _ = squared_error([np.ones(u.size)])
    with_jump, solution = squared_error([~after, after])
    return without - with_jump, solution[1] - solution[0]


@pytest.mark.parametrize("w", [1, 2, 4, 16, 50, 128])
@pytest.mark.parametrize("share", [1.0, 0.8])
@pytest.mark.parametrize("weight", [1e-4, 1e-2, 10.0])
def test_statistic_is_the_papers_ratio(w, share, weight):
    x, z, used = record_of(w, 3000, [(1500, 0.4)], share)
    statistic, jump = wglr(x, z, used, w, weight, 0.9)
    rng = np.random.default_rng(w)
    at = np.append(rng.integers(w, x.size - w, 40), [w, x.size - w, x.size // 2, CHUNK, CHUNK + w])
    checked = 0
    for k in at:
        if np.isnan(statistic[k]):
            assert min(used[k - w : k].sum(), used[k : k + w].sum()) < max(1, w / 2)
            continue
        expected, difference = _glr_by_least_squares(x, z, used, k, w, weight, 0.9)
        assert statistic[k] == pytest.approx(expected, rel=1e-8, abs=1e-12)
        assert jump[k] == pytest.approx(difference, rel=1e-8, abs=1e-10)
        checked += 1
    assert checked >= 15


def test_masked_and_full_branches_agree_to_the_last_bit():
    """One masked sample far away must not change what is computed elsewhere."""
    x, z, used = record_of(5, 3000, [(1500, 0.4)])
    full, _ = wglr(x, z, used, 64, 1e-3, 1.0)
    used[-1] = False
    masked, _ = wglr(x, z, used, 64, 1e-3, 1.0)
    assert full[64:-200].tobytes() == masked[64:-200].tobytes()
    assert np.isfinite(full[64:-64]).all()


def test_in_coloured_noise_places_are_found_better_with_its_colour():
    """Jumps of 3–4 σ in AR(0.5) noise: more of them exactly in place than the white likelihood finds."""
    rng = np.random.default_rng(11)
    phi, n, every = 0.5, 60_000, 500
    noise = SIGMA * signal.lfilter([np.sqrt(1 - phi**2)], [1, -phi], rng.standard_normal(n))
    jumps = np.arange(every, n, every)
    z = noise + np.cumsum(np.isin(np.arange(n), jumps) * rng.choice([-3.5, 3.5], n)) * SIGMA
    sums = sums_of(np.ones(n), z)
    peaks = jumps + 3, np.full(jumps.size, 32), np.full(jumps.size, 100.0)
    threshold = variance_table(np.array([1, 32]), np.array([0.5, 2.8]) * SIGMA**2), 20.0, 0.0
    slope = SIGMA**2, 0.0, 1.0  # the speed is constant: the slope is that of its prior
    chosen = [choose(*peaks, n, sums.arrays, threshold, correlation, *slope)[0] for correlation in (0.0, phi)]
    exact = [np.isin(jumps, index).sum() for index in chosen]
    # 119 jumps; the white likelihood places about 75 % of them exactly, the right one about 90 %.
    assert exact[1] >= exact[0] + 5


# ---- one contrast, and gaps ------------------------------------------------------------------------------------------


@given(seed=st.integers(0, 1000), share=st.sampled_from([1.0, 0.7]), w=st.sampled_from([2, 16, 128]))
@settings(max_examples=30, deadline=None)
def test_one_contrast_from_running_sums_is_the_two_fits(seed, share, w):
    rng = np.random.default_rng(seed)
    x = 0.5 + 0.1 * np.cumsum(rng.normal(0.0, 0.02, 600))
    z = 1.0 + 1.3 * x + SIGMA * rng.standard_normal(600)
    used = rng.random(600) < share
    used[295:305] = True  # so that neither half is empty
    sums = sums_of(x, z, used)
    statistic, jump = contrast(300, w, 1.0, 0.01, sums.arrays)
    expected, expected_jump = _glr_by_least_squares(x, z, used, 300, w, 0.01, 1.0)
    assert statistic == pytest.approx(expected, rel=1e-6, abs=1e-10)
    assert jump == pytest.approx(expected_jump, rel=1e-6, abs=1e-9)


def test_a_gap_at_the_end_of_a_short_window_looks_at_no_slot_behind_it() -> None:
    used = np.ones(6_000, dtype=np.bool_)
    used[1_000:4_000] = False
    sums = RunningSums(np.ones(6_000), np.ones(6_000), used)
    extend_sums(sums.arrays, sums.running, 0, 4_000)
    sums.slots = 4_000  # what lies behind was never written: it may be anything
    assert peaks_behind_gaps(sums)[0].size == 0


# ---- stage 2: least squares through the arrow structure, against the matrix it stands for ----------------------------


def _evidence(x, z, used=None):
    return evidence_of(x, z, NO_CANDIDATES, SIGMA, used)


def _record(n=2000, jumps=((600, 0.5), (1400, -0.3))):
    x, z, _ = record_of(1, n, jumps)
    return x, z, np.array([index for index, _ in jumps], dtype=np.int64)


def _least_squares(x, z, used, index, prior):
    """Solve the paper's Y = H [F, f_v] as it stands, with the matrix written out; the prior is one more row."""
    interval = np.searchsorted(index, np.flatnonzero(used), side="right")
    matrix = np.column_stack([np.equal.outer(interval, np.arange(index.size + 1)), x[used]]) / SIGMA
    target = z[used] / SIGMA
    if np.isfinite(prior.std):
        matrix = np.vstack([matrix, np.eye(1, index.size + 2, index.size + 1) / prior.std])
        target = np.append(target, prior.mean / prior.std)
    return np.linalg.lstsq(matrix, target, rcond=None)[0], np.linalg.inv(matrix.T @ matrix)


@pytest.mark.parametrize("prior", [SlopePrior(), SlopePrior(1.0, 0.01)])
@pytest.mark.parametrize("share", [1.0, 0.7])
def test_levels_slope_and_stds_are_those_of_least_squares(prior, share):
    x, z, index = _record()
    used = np.random.default_rng(2).random(z.size) < share
    fit = estimate(_evidence(x, z, used), index, prior)
    solution, covariance = _least_squares(x, z, used, index, prior)
    np.testing.assert_allclose([*fit.level, fit.viscous], solution, rtol=1e-9)
    window = _evidence(x, z, used)
    noise = window.noise
    margin, variance = np.zeros(index.size, dtype=np.int64), noise.std**2 * noise.long_run_factor
    slope = slope_within(window.slots, index, margin, window.sums.arrays, variance, *prior)
    assert slope == pytest.approx((fit.viscous, fit.viscous_std))
    np.testing.assert_allclose([*fit.level_std, fit.viscous_std], np.sqrt(np.diag(covariance)), rtol=1e-7)
    contrasts = np.diff(np.eye(4)[:3], axis=0)  # the slope's share is common to both levels of a jump
    np.testing.assert_allclose(fit.jump_std**2, np.diag(contrasts @ covariance @ contrasts.T), rtol=1e-7)


def test_rmse_is_that_of_the_residuals_and_excess_is_near_zero_with_the_true_jumps():
    x, z, index = _record(n=20_000, jumps=((6000, 0.5), (14_000, -0.3)))
    window = _evidence(x, z)
    fit = estimate(window, index)
    level = fit.level[np.searchsorted(index, np.arange(z.size), side="right")]
    assert fit.rmse == pytest.approx(np.sqrt(np.mean((z - level - fit.viscous * x) ** 2)), rel=1e-9)
    # Four standard errors of a standard deviation.
    assert abs(fit.rmse - window.noise.std) < 4 * SIGMA / np.sqrt(2 * z.size)
    one_level = estimate(window, np.zeros(0, dtype=np.int64))
    assert one_level.rmse - window.noise.std > 0.1


def test_at_constant_speed_the_slope_is_unknown_without_a_prior_and_the_nominal_one_with_it():
    _, z, index = _record()
    evidence = _evidence(np.ones(z.size), z)
    blind = estimate(evidence, index)
    assert blind.viscous == 0.0
    assert np.isinf(blind.viscous_std)
    assert np.isinf(blind.level_std).all()
    prior = nominal_slope_prior(built_in_wheel())
    fit = estimate(evidence, index, prior=prior)
    assert fit.viscous == pytest.approx(prior.mean)
    assert fit.viscous_std == pytest.approx(prior.std)
    # Jumps do not need the slope.
    np.testing.assert_allclose(np.diff(fit.level), np.diff(blind.level), atol=1e-9)
    assert (blind.jump_std < 2 * SIGMA / np.sqrt(300)).all()


def test_an_interval_without_samples_has_no_certainty():
    x, z, index = _record()
    used = np.ones(z.size, dtype=np.bool_)
    used[600:1400] = False
    evidence = _evidence(x, z, used)
    fit = estimate(evidence, index)
    assert fit.level[1] == fit.level[0]
    assert np.isinf(fit.level_std[1])
    assert np.isinf(fit.jump_std).all()
    empty = estimate(_evidence(x, z, np.zeros(z.size, dtype=np.bool_)), index)
    assert np.isfinite(empty.level).all()
    assert empty.rmse == 0.0


def test_exclusion_leaves_at_least_half_of_every_interval():
    """A quarter of an interval at each end with a neighbour: what is left out there has another slope."""
    index = np.array([100, 103, 111, 500])
    kept = ((0, 75), (100, 103), (105, 109), (175, 436), (564, 1000))
    x = 1.0 + 0.3 * np.sin(np.arange(1000) / 50.0)
    z = np.full(1000, 1e3)
    for start, stop in kept:
        z[start:stop] = 2.0 + 1.1 * x[start:stop]
    slope, _ = slope_within(
        1000, index, np.full(4, 64), sums_of(x, z, np.ones(1000, dtype=bool)).arrays, 1.0, np.nan, np.nan
    )
    assert slope == pytest.approx(1.1, rel=1e-6)


def test_residual_blocks_are_those_of_the_samples():
    x, z, index = _record(n=4_000, jumps=((320, 0.4), (1_003, -0.3), (1_040, 0.5), (2_500, -0.6), (3_900, 0.2)))
    used, size = np.random.default_rng(71).random(z.size) > 0.1, 64
    evidence = _evidence(x, z, used)
    fit = estimate(evidence, index)
    blocks = residual_blocks(evidence, fit, size)
    residual = z - fit.viscous * x
    inside = {int(k // size) for k in index if k % size}
    for b in range(z.size // size):
        there = slice(b * size, (b + 1) * size)
        assert blocks.usable[b] == (b not in inside and used[there].sum() >= size // 2)
        assert blocks.friction[b] == pytest.approx(residual[there][used[there]].mean(), rel=1e-10)
        assert blocks.interval[b] == int((-(-index // size) <= b).sum())
    for i in range(index.size + 1):
        own = blocks.usable & (blocks.interval == i)
        assert np.sum(blocks.n[own] * blocks.residual[own]) == pytest.approx(0.0, abs=1e-9)
