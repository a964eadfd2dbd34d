"""Section IV-B: least squares beside the default method's running sums, and the cost of rejecting a changepoint."""

from __future__ import annotations

import numpy as np
import pytest

from rwa_monitor.changepoints import estimation
from rwa_monitor.changepoints.stage_results import NoiseEstimate
from rwa_monitor.paper.detection import FALSE_POSITIVE, Signal
from rwa_monitor.paper.estimation import ERROR_SAMPLES, estimate
from tests.switching.assignment_windows import NO_CANDIDATES, evidence_of

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
def test_levels_and_slope_are_those_of_the_running_sums(share: float) -> None:
    signal = _signal(share=share)
    found = estimate(signal, INDEX, NOISE)
    evidence = evidence_of(signal.x, signal.z, NO_CANDIDATES, SIGMA, signal.used)
    expected = estimation.estimate(evidence, INDEX, ERROR_SAMPLES)
    for field in ("level", "level_std", "viscous", "viscous_std", "rmse", "excess_rmse"):
        assert getattr(found.friction, field) == pytest.approx(getattr(expected, field), rel=1e-9), field
    assert found.jump_std == pytest.approx(estimation.jump_std(evidence, expected, ERROR_SAMPLES), rel=1e-9)


def test_rejection_is_the_loss_of_likelihood_when_intervals_merge() -> None:
    """At the slope of the full fit (errata 7): -ΔSSE/2σ², from two squared errors written out."""
    signal = _signal()
    found = estimate(signal, INDEX, NOISE)
    edges, residual = np.concatenate([[0], INDEX, [3000]]), signal.z - found.friction.viscous * signal.x
    margins = [min(ERROR_SAMPLES, length // 4) for length in np.diff(edges).tolist()]
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
    assert (blind.jump_std < SIGMA).all()  # jumps do not need the slope


def test_an_interval_without_samples_has_no_certainty() -> None:
    signal = _signal()
    signal.used[700:760] = False
    found = estimate(signal, INDEX, NOISE)
    assert found.friction.level[1] == found.friction.level[0]
    assert np.isinf(found.friction.level_std[1])
    assert np.isinf(found.jump_std[:2]).all()
    assert found.rejection[:2].tolist() == [np.log(FALSE_POSITIVE)] * 2
    empty = estimate(signal._replace(used=np.zeros(3000, dtype=np.bool_)), INDEX, NOISE)
    assert np.isfinite(empty.friction.level).all()
    assert empty.friction.rmse == 0.0
