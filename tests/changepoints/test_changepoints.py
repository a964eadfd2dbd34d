"""Stage 1: the wGLR against its definition, and the choice of candidates among its peaks."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from rwa_monitor.changepoints.evidence import peaks_behind_gaps, variance_table
from rwa_monitor.changepoints.running_sums import RunningSums
from rwa_monitor.kernels.changepoints import choose, contrast
from rwa_monitor.kernels.running_sums import extend_sums
from rwa_monitor.kernels.wglr import CHUNK, wglr
from tests.switching.assignment_windows import record_of, sums_of

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
