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
def test_whitening_is_that_of_the_dense_covariance_and_of_a_level_after_a_jump_nothing_is_known(
    layout: tuple[FloatArray, IntArray], parts: Parts, seed: int
) -> None:
    sign, gap = layout
    rng, covariance = np.random.default_rng(seed), dense(sign, gap, parts)
    columns = rng.normal(size=(3, COUNT))
    jumps = np.sort(rng.choice(np.arange(1, COUNT), 5, replace=False))
    jumps = jumps[gap[jumps] > 0]
    plain, plain_determinant = whitened(columns, sign, gap, jumps[:0], parts)
    assert_whitened(plain, plain_determinant, columns, covariance)
    rows, log_determinant = whitened(columns, sign, gap, jumps, parts)
    assert log_determinant == plain_determinant
    recording, at = np.cumsum(gap == 0), np.arange(COUNT)
    steps = np.array([sign * ((at >= jump) & (recording == recording[jump])) for jump in jumps]).reshape(-1, COUNT)
    factor = linalg.cholesky(covariance, lower=True)
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


def noisy(noise: FloatArray, seed: int = 0, recordings: int = 1, levels: FloatArray | float = 40.0) -> Series:
    """Return a to and fro with friction and noise."""
    record = series(noise.size, seed, recordings)
    return replace(record, friction=record.sign * levels + 0.1 * record.speed + noise)


def fitted(record: Series, start: NoiseLaw) -> tuple[NoiseLaw, float]:
    """Fit the noise of the base law."""
    return fit_noise(record, record.base, np.zeros(2), FREE, start)


def solved(rows: FloatArray, target: FloatArray, low: FloatArray, high: FloatArray) -> tuple[FloatArray, float]:
    """Solve equations of a log-determinant of 7."""
    products = np.vstack([target, rows]) @ np.vstack([target, rows]).T
    return Equations(products[1:, 1:], products[1:, 0], products[0, 0], low, high, target.size, 7.0).solve()


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
    solution, deviance = solved(rows, target, low, high)
    scale = np.abs(rows).max(axis=1)
    scaled = (rows / scale[:, None]).T
    expected = optimize.lsq_linear(scaled, target, (low * scale, high * scale), method="bvls", tol=1e-14)
    assert ((solution >= low) & (solution <= high)).all()
    assert np.sum((target - solution @ rows) ** 2) == pytest.approx(2 * expected.cost, rel=1e-8)
    assert deviance == pytest.approx(40 * np.log(2 * expected.cost / 40) + 7.0, rel=1e-8)
    if not alike:
        assert np.allclose(solution * scale, expected.x, rtol=1e-6, atol=1e-8)


def test_a_bound_that_is_met_exactly_is_kept() -> None:
    rows, low = np.vstack([np.ones(4), np.arange(4.0)]), np.array([-np.inf, 0.0])
    assert solved(rows, 3.0 - np.arange(4.0), low, FREE)[0] == pytest.approx([1.5, 0.0])


def test_a_regressor_of_which_levels_leave_nothing_has_no_strength() -> None:
    rows = np.vstack([np.arange(5.0), np.full(5, 1e-170)])  # of rounding
    target = 2.0 * np.arange(5.0) + np.array([1.0, -1.0, 1.0, 0.0, 0.0])
    assert solved(rows, target, -FREE, FREE)[0] == pytest.approx([2.0 + 1.0 / 30.0, 0.0])


@pytest.mark.parametrize("seed", range(4))
def test_a_law_of_the_noise_is_left_for_a_likelier_one_alone(seed: int) -> None:
    record = noisy(np.cumsum(np.random.default_rng([8, seed]).normal(size=600)), seed)
    for start in (
        NoiseLaw(),
        NoiseLaw(white=0.01, correlation=0.99),
        NoiseLaw(white=0.5, correlation=0.2, growth=-1.0),
    ):
        at_start = Equations.of(record, record.base, np.zeros(2), FREE, start).solve()[1] + start.price(record.size)
        assert fitted(record, start)[1] <= at_start


@pytest.mark.parametrize(("correlation", "white"), [(0.9, 0.5), (0.98, 0.1), (0.6, 0.02)])
def test_noise_is_found_as_it_was_made(correlation: float, white: float) -> None:
    found = []
    for seed in range(8):
        rng = np.random.default_rng([7, seed])
        noise = np.sqrt(1 - white) * remembering(2500, correlation, rng) + np.sqrt(white) * rng.normal(size=2500)
        law, _ = fitted(noisy(noise, seed), NoiseLaw())
        found.append((law.correlation, law.white))
    error = np.std(found, axis=0, ddof=1)
    assert (np.abs(np.mean(found, axis=0) - (correlation, white)) < 4.0 * error / np.sqrt(8)).all()
    assert error[0] < 0.05  # or the test shows nothing
    assert error[1] < 0.1


@pytest.mark.parametrize("start", [NoiseLaw(), NoiseLaw().separate_levels], ids=["one level", "levels"])
def test_a_noise_parameter_that_pays_nothing_is_left_out(start: NoiseLaw) -> None:
    noise = np.random.default_rng(3).normal(size=1500)
    assert fitted(noisy(noise, recordings=3), start)[0] == NoiseLaw()


def test_levels_that_differ_between_recordings_are_draws() -> None:
    rng = np.random.default_rng(4)
    levels = np.repeat(rng.normal(40.0, 6.0, 6), 300)
    record = noisy(rng.normal(size=1800), recordings=6, levels=levels)
    apart, score = fitted(record, NoiseLaw().separate_levels)
    assert apart.correlation == 0.0
    assert 6.0 < apart.level_spread < 200.0  # 36 of six draws
    one_level, worse = fitted(record, NoiseLaw())
    assert one_level.level_spread == 0.0
    assert worse > score + 20.0
