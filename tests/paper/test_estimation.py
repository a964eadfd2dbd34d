"""Section IV-B: least squares beside the default method's running sums, and the cost of rejecting a changepoint."""

import numpy as np
import pytest

from rwa_monitor.changepoints.noise import FALSE_POSITIVE
from rwa_monitor.changepoints.stage_results import NoiseEstimate
from rwa_monitor.paper.detection import SCALE, Signal
from rwa_monitor.paper.estimation import estimate, kept

SIGMA = 0.024
NOISE = NoiseEstimate(SIGMA, np.array([SIGMA**2]), 1.0)
INDEX = np.array([700, 760, 1900])


def _signal(seed: int = 3, share: float = 1.0) -> Signal:
    rng = np.random.default_rng(seed)
    x = 0.6 + 0.3 * np.sin(np.arange(3000) / 400.0)
    z = 1.0 + 1.1 * x + SIGMA * rng.standard_normal(3000)
    for k, jump in zip(INDEX.tolist(), (0.4, -0.4, 0.6), strict=True):
        z[k:] += jump
    return Signal(x, z, rng.random(3000) < share)


@pytest.mark.parametrize("share", [1.0, 0.7])
def test_levels_and_slope_are_those_of_the_printed_matrix(share: float) -> None:
    signal = _signal(share=share)
    found = estimate(signal, INDEX, NOISE)
    interval = np.searchsorted(INDEX, np.arange(3000), side="right")
    used = kept(signal.used, interval, INDEX, SCALE // 2)
    h = np.column_stack([np.equal.outer(interval[used], np.arange(4)), signal.x[used]])
    solution, covariance = np.linalg.lstsq(h, signal.z[used], rcond=None)[0], SIGMA**2 * np.linalg.inv(h.T @ h)
    assert [*found.friction.level, found.friction.viscous] == pytest.approx(solution, rel=1e-9)
    stds = [*found.friction.level_std, found.friction.viscous_std]
    assert stds == pytest.approx(np.sqrt(np.diag(covariance)), rel=1e-9)
    assert found.friction.rmse == pytest.approx(np.sqrt(np.mean((signal.z[used] - h @ solution) ** 2)), rel=1e-9)
    steps = np.eye(5)[1:4] - np.eye(5)[:3]
    assert found.friction.jump_std == pytest.approx(np.sqrt(np.diag(steps @ covariance @ steps.T)), rel=1e-9)


def test_samples_beside_a_misplaced_changepoint_do_not_count() -> None:
    signal = _signal()
    moved, true = (np.diff(estimate(signal, INDEX + off, NOISE).friction.level)[2] for off in (12, 0))
    assert abs(moved - true) < 0.01


def test_rejection_is_the_loss_of_likelihood_when_intervals_merge() -> None:
    """At the slope of the full fit (errata 7): -ΔSSE/2σ², from two squared errors written out."""
    signal = _signal()
    found = estimate(signal, INDEX, NOISE)
    edges, residual = np.concatenate([[0], INDEX, [3000]]), signal.z - found.friction.viscous * signal.x
    margins = [min(SCALE // 2, length // 4) for length in np.diff(edges).tolist()]
    parts = [
        residual[begin + margin * (i > 0) : end - margin * (i < INDEX.size)]
        for i, (begin, end, margin) in enumerate(zip(edges[:-1], edges[1:], margins, strict=True))
    ]
    for i in range(INDEX.size):
        merged = np.concatenate(parts[i : i + 2])
        loss = sum(part.size * part.var() for part in parts[i : i + 2]) - merged.size * merged.var()
        assert found.rejection[i] == pytest.approx(loss / (2 * SIGMA**2) + np.log(FALSE_POSITIVE), rel=1e-9)


def test_colour_cheapens_rejection() -> None:
    colour = NoiseEstimate(SIGMA, SIGMA**2 * 0.5 ** np.arange(64), 3.0)
    index = np.array([1000, 2000])
    white, wide = (estimate(_signal(), index, noise).rejection - np.log(FALSE_POSITIVE) for noise in (NOISE, colour))
    np.testing.assert_allclose(white / wide, 3.0, rtol=0.02)


def test_at_one_speed_the_slope_is_not_shown() -> None:
    blind = estimate(_signal()._replace(x=np.full(3000, 0.5)), INDEX, NOISE)
    assert blind.friction.viscous == 0.0
    assert np.isinf(blind.friction.viscous_std)
    assert np.isinf(blind.friction.level_std).all()
    assert (blind.friction.jump_std < SIGMA).all()  # jumps do not need the slope


def test_an_interval_without_samples_has_no_certainty() -> None:
    signal = _signal()
    signal.used[700:760] = False
    found = estimate(signal, INDEX, NOISE)
    assert found.friction.level[1] == found.friction.level[0]
    assert np.isinf(found.friction.level_std[1])
    assert np.isinf(found.friction.jump_std[:2]).all()
    assert found.rejection[:2].tolist() == [np.log(FALSE_POSITIVE)] * 2
    empty = estimate(signal._replace(used=np.zeros(3000, dtype=np.bool_)), INDEX, NOISE)
    assert np.isfinite(empty.friction.level).all()
    assert empty.friction.rmse == 0.0
