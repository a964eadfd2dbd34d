"""The likelihood against a dense covariance, its bounded solution against scipy's, its noise's law against truth."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import linalg, optimize

from rwa_monitor.discrepancy.likelihood import Equations, NoiseLaw, Series, fit_noise
from rwa_monitor.kernels.state_space import filter_gains, whiten
from rwa_monitor.samples import FloatArray, IntArray
from tests.discrepancy.smooth import remembering

COUNT = 120
FREE = np.full(2, np.inf)
Parts = tuple[float, float, float, float]


def dense(sign: FloatArray, gap: IntArray, parts: Parts) -> FloatArray:
    """Return the covariance of all samples, entry by entry."""
    white, coloured, correlation, level_spread = parts
    recording, slot = np.cumsum(gap == 0), np.cumsum(gap)
    together = recording[:, None] == recording
    apart = np.abs(slot[:, None] - slot)
    out = np.outer(sign, sign) * level_spread + coloured * correlation**apart
    out += white * (apart == 0)
    return np.asarray(np.where(together, out, 0.0))


def whitened(
    columns: FloatArray, sign: FloatArray, gap: IntArray, jumps: IntArray, parts: Parts
) -> tuple[FloatArray, float]:
    """Return the innovations of columns, and the log-determinant."""
    rows, gains = columns.copy(), np.empty((sign.size, 4))
    log_determinant = filter_gains(sign, gap, jumps, parts, gains)
    whiten(rows, sign, gap, gains)
    return rows, log_determinant


def assert_whitened(rows: FloatArray, log_determinant: float, expected: FloatArray, covariance: FloatArray) -> None:
    """Compare with the triangular factor of a covariance."""
    factor = linalg.cholesky(covariance, lower=True)
    white = linalg.solve_triangular(factor, expected.T, lower=True).T
    assert np.allclose(rows, white, rtol=1e-10, atol=1e-10 * np.abs(white).max())
    assert log_determinant == pytest.approx(2 * np.log(factor.diagonal()).sum(), rel=1e-10, abs=1e-10)


@st.composite
def layouts(draw: st.DrawFn) -> tuple[FloatArray, IntArray]:
    """Draw signs that change, and gaps, those of zero beginning a recording."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    sign = np.where(np.cumsum(rng.random(COUNT) < draw(st.sampled_from([0.0, 0.1]))) % 2, -1.0, 1.0)
    gap = rng.choice([1, 2, 7], COUNT, p=draw(st.sampled_from([(1.0, 0.0, 0.0), (0.8, 0.1, 0.1)])))
    gap[rng.choice(COUNT, draw(st.integers(0, 4)), replace=False)] = 0
    gap[0] = 0
    return sign, gap


variances = st.sampled_from([0.0, 0.3, 2.0])
noises = st.tuples(st.sampled_from([0.1, 1.0]), variances, st.sampled_from([0.0, 0.6, 0.999]), variances)


@settings(max_examples=40)
@given(layouts(), noises, st.integers(0, 99))
def test_whitening_is_that_of_the_dense_covariance(
    layout: tuple[FloatArray, IntArray], parts: Parts, seed: int
) -> None:
    sign, gap = layout
    columns = np.random.default_rng(seed).normal(size=(3, COUNT))
    none = np.zeros(0, dtype=np.int64)
    assert_whitened(*whitened(columns, sign, gap, none, parts), columns, dense(sign, gap, parts))


@settings(max_examples=40)
@given(layouts(), noises, st.integers(0, 99))
def test_a_jump_is_a_level_of_which_nothing_is_known(
    layout: tuple[FloatArray, IntArray], parts: Parts, seed: int
) -> None:
    sign, gap = layout
    rng = np.random.default_rng(seed)
    columns = rng.normal(size=(3, COUNT))
    jumps = np.sort(rng.choice(np.arange(1, COUNT), 5, replace=False))
    jumps = jumps[gap[jumps] > 0]
    rows, log_determinant = whitened(columns, sign, gap, jumps, parts)
    assert log_determinant == whitened(columns, sign, gap, jumps[:0], parts)[1]
    recording, at = np.cumsum(gap == 0), np.arange(COUNT)
    steps = np.array([sign * ((at >= jump) & (recording == recording[jump])) for jump in jumps]).reshape(-1, COUNT)
    factor = linalg.cholesky(dense(sign, gap, parts), lower=True)
    white_columns, white_steps = (linalg.solve_triangular(factor, one.T, lower=True) for one in (columns, steps))
    left = white_columns - white_steps @ linalg.lstsq(white_steps, white_columns)[0] if jumps.size else white_columns
    # Steps of any size are least squares' coefficients: only the products of what they leave are the same.
    assert np.allclose(rows @ rows.T, left.T @ left, rtol=1e-8, atol=1e-8 * np.abs(left).max() ** 2)


def series(count: int, seed: int = 0, recordings: int = 1) -> Series:
    """Return a to and fro without friction."""
    speed = 100.0 * np.sin(np.arange(count) / 17.0 + seed) + 5.0
    gap = np.ones(count, dtype=np.int64)
    gap[:: -(-count // recordings)] = 0
    slew = np.abs(np.cos(np.arange(count) / 17.0 + seed))
    return Series(np.zeros(count), np.sign(speed), speed, gap, slew)


@pytest.mark.parametrize(("growth", "slew"), [(-1.5, 0.0), (0.0, 0.0), (2.0, 0.0), (0.0, 3.0), (1.0, 2.0)])
@pytest.mark.parametrize("level_spread", [0.0, 3.0])
def test_noise_that_grows_with_speed_and_slews_and_levels_of_recordings(
    growth: float, slew: float, level_spread: float
) -> None:
    record = series(COUNT, recordings=3)
    law = NoiseLaw(0.3, 0.9, growth, slew, level_spread)
    columns = np.random.default_rng(1).normal(size=(2, COUNT))
    rows, log_determinant = record.whitened(columns, law)
    ends = np.abs(record.speed).max()
    spread = 1.0 + (np.exp(growth) - 1.0) * np.abs(record.speed) / ends
    spread += (np.exp(slew) - 1.0) * record.slew
    spread /= np.exp(np.log(spread).mean())
    noise = dense(record.sign, record.gap, (0.3, 0.7, 0.9, 0.0))
    levels = dense(record.sign, record.gap, (0.0, 0.0, 0.0, level_spread))
    # The level's draw is friction, not noise: it does not grow with the speed.
    assert_whitened(rows, log_determinant, columns, spread[:, None] * noise * spread + levels)


@settings(max_examples=60)
@given(st.integers(0, 2**32 - 1), st.integers(1, 6), st.booleans())
def test_the_bounded_solution_is_least_squares(seed: int, count: int, alike: bool) -> None:
    rng = np.random.default_rng(seed)
    rows, target = rng.normal(size=(count, 40)), rng.normal(size=40)
    if alike and count > 1:
        rows[1] = rows[0] + 1e-3 * rows[1]
    rows *= 10.0 ** rng.uniform(-4, 4, count)[:, None]  # units differ by as much
    low = np.where(rng.random(count) < 0.5, 0.0, -np.inf)
    high = np.where(rng.random(count) < 0.3, 0.05 / np.abs(rows).max(axis=1), np.inf)
    products = np.vstack([target, rows]) @ np.vstack([target, rows]).T
    solution, deviance = Equations(products[1:, 1:], products[1:, 0], products[0, 0], low, high, 40, 7.0).solve()
    scale = np.abs(rows).max(axis=1)
    scaled = (rows / scale[:, None]).T
    expected = optimize.lsq_linear(scaled, target, (low * scale, high * scale), method="bvls", tol=1e-14)
    assert ((solution >= low) & (solution <= high)).all()
    assert np.sum((target - solution @ rows) ** 2) == pytest.approx(2 * expected.cost, rel=1e-8)
    assert deviance == pytest.approx(40 * np.log(2 * expected.cost / 40) + 7.0, rel=1e-8)
    if not alike:
        assert np.allclose(solution * scale, expected.x, rtol=1e-6, atol=1e-8)


def test_a_bound_that_is_met_exactly_is_kept() -> None:
    rows = np.vstack([np.ones(4), np.arange(4.0)])
    target = 3.0 - np.arange(4.0)
    products = np.vstack([target, rows]) @ np.vstack([target, rows]).T
    low = np.array([-np.inf, 0.0])
    solution, _ = Equations(products[1:, 1:], products[1:, 0], products[0, 0], low, FREE, 4, 0.0).solve()
    assert solution == pytest.approx([1.5, 0.0])


def test_a_regressor_of_which_levels_leave_nothing_has_no_strength() -> None:
    rows, target = np.vstack([np.arange(5.0), np.zeros(5)]), 2.0 * np.arange(5.0) + np.array([1.0, -1.0, 1.0, 0.0, 0.0])
    products = np.vstack([target, rows]) @ np.vstack([target, rows]).T
    products[0, 2] = products[2, 0] = 1e-18  # of rounding
    solution, _ = Equations(products[1:, 1:], products[1:, 0], products[0, 0], -FREE, FREE, 5, 0.0).solve()
    assert solution == pytest.approx([2.0 + 1.0 / 30.0, 0.0])


@pytest.mark.parametrize("seed", range(4))
def test_a_law_of_the_noise_is_left_for_a_likelier_one_alone(seed: int) -> None:
    record, rng = series(600, seed), np.random.default_rng([8, seed])
    record = replace(record, friction=record.base.T @ [40.0, 0.1] + np.cumsum(rng.normal(size=600)))
    for start in (
        NoiseLaw(),
        NoiseLaw(white=0.01, correlation=0.99),
        NoiseLaw(white=0.5, correlation=0.2, growth=-1.0),
    ):
        at_start = Equations.of(record, record.base, np.zeros(2), FREE, start).solve()[1] + start.price(record.size)
        assert fit_noise(record, record.base, np.zeros(2), FREE, start)[1] <= at_start


@pytest.mark.parametrize(("correlation", "white"), [(0.9, 0.5), (0.98, 0.1), (0.6, 0.02)])
def test_noise_is_found_as_it_was_made(correlation: float, white: float) -> None:
    found = []
    for seed in range(8):
        rng = np.random.default_rng([7, seed])
        record = series(2500, seed)
        noise = np.sqrt(1 - white) * remembering(2500, correlation, rng) + np.sqrt(white) * rng.normal(size=2500)
        record = replace(record, friction=record.base.T @ [40.0, 0.1] + noise)
        law, _ = fit_noise(record, record.base, np.zeros(2), FREE, NoiseLaw())
        found.append((law.correlation, law.white))
    error = np.std(found, axis=0, ddof=1)
    assert (np.abs(np.mean(found, axis=0) - (correlation, white)) < 4.0 * error / np.sqrt(8)).all()
    assert error[0] < 0.05  # or the test shows nothing
    assert error[1] < 0.1


@pytest.mark.parametrize("start", [NoiseLaw(), NoiseLaw().separate_levels], ids=["one level", "levels"])
def test_a_noise_parameter_that_pays_nothing_is_left_out(start: NoiseLaw) -> None:
    record = series(1500, recordings=3)
    record = replace(record, friction=record.base.T @ [40.0, 0.1] + np.random.default_rng(3).normal(size=1500))
    assert fit_noise(record, record.base, np.zeros(2), FREE, start)[0] == NoiseLaw()


def test_levels_that_differ_between_recordings_are_draws() -> None:
    record = series(1800, recordings=6)
    rng = np.random.default_rng(4)
    levels = np.repeat(rng.normal(40.0, 6.0, 6), 300)
    record = replace(record, friction=record.sign * levels + 0.1 * record.speed + rng.normal(size=1800))
    apart, score = fit_noise(record, record.base, np.zeros(2), FREE, NoiseLaw().separate_levels)
    assert apart.correlation == 0.0
    assert 6.0 < apart.level_spread < 200.0  # 36 of six draws
    one_level, worse = fit_noise(record, record.base, np.zeros(2), FREE, NoiseLaw())
    assert one_level.level_spread == 0.0
    assert worse > score + 20.0
