"""Section IV-A: the wGLR beside the compiled one, and its changepoints with what the errata state of them."""

import numpy as np
import pytest

from rwa_monitor.changepoints.stage_results import Evidence
from rwa_monitor.kernels.wglr import wglr as compiled
from rwa_monitor.paper.detection import SCALE, THRESHOLD, Signal, detect, maxima_of_runs, wglr
from rwa_monitor.wheel.wheel import built_in_wheel
from tests.changepoints.test_evidence import _gather, _telemetry

WHEEL = built_in_wheel()


def _found(evidence: Evidence, w: int = SCALE) -> list[int]:
    return detect(Signal.of(evidence), evidence.noise, WHEEL, w).tolist()


@pytest.mark.parametrize("w", [2, 50, 128])
@pytest.mark.parametrize("share", [1.0, 0.8])
def test_the_wglr_is_that_of_the_compiled_kernel(w: int, share: float) -> None:
    rng = np.random.default_rng(w)
    x, z = 0.6 + 0.3 * np.sin(np.arange(9000) / 700.0), 1.5 + 0.02 * rng.standard_normal(9000)
    used = rng.random(9000) < share
    expected, _ = compiled(x, z, used, w, 1e-4, 0.9)
    np.testing.assert_allclose(wglr(Signal(x, z, used), 0.9, w), expected, rtol=1e-6, atol=1e-9)


def test_a_signal_shorter_than_the_window_shows_nothing() -> None:
    signal = Signal(np.ones(2 * SCALE - 1), np.ones(2 * SCALE - 1), np.ones(2 * SCALE - 1, dtype=np.bool_))
    assert np.isnan(wglr(signal, 1.0)).all()
    assert maxima_of_runs(wglr(signal, 1.0), THRESHOLD).size == 0


def test_each_run_above_the_threshold_gives_its_maximum() -> None:
    assert maxima_of_runs(np.array([9.0, 0, 2, 3, 2, np.nan, 2, 0, 5, 5]), 1.0).tolist() == [0, 3, 6, 8]


def test_jumps_are_found() -> None:
    found = _found(_gather(*_telemetry(18, 9000, [(3000, 8.0), (6000, -8.0)]))[0])
    assert {3000, 6000} <= {k + d for k in found for d in (-1, 0, 1)}


def test_big_jumps_have_side_lobes() -> None:
    """Errata 4: jumps of 10 to 25 σ show again 20 to 30 slots away, where the speed changes."""
    jumps = [(k, 25.0 * (-1) ** i) for i, k in enumerate(range(2500, 40_000, 1000))]
    evidence, _ = _gather(*_telemetry(19, 40_000, jumps, crossing=True))
    assert evidence.candidates.index.tolist() == [index for index, _ in jumps]
    assert len(_found(evidence, w=50)) > len(jumps)
