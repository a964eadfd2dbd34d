"""The wGLR as a curve: it is where the jumps are, quiet where there are none, and the same in any unit."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from rwa_monitor.changepoints.evidence import evidence_curve
from rwa_monitor.changepoints.noise import chi_variance

SLOPE = 5.3e-6
NOISE = 3.9e-5


def window(rng: np.random.Generator, n: int, jumps: dict[int, float]) -> tuple[np.ndarray, np.ndarray]:
    """Return speed and friction of a wheel that slews slowly through both directions, with jumps of its dry torque."""
    speed = 200.0 * np.cos(np.arange(n) / n * 3.0)
    dry = 1.6e-3 + sum((np.arange(n) >= at) * size for at, size in jumps.items())
    return speed, np.sign(speed) * dry + SLOPE * speed + NOISE * rng.standard_normal(n)


@pytest.mark.parametrize("seed", range(3))
def test_it_rises_above_the_threshold_at_each_jump_and_nowhere_far_from_one(seed: int) -> None:
    n, jumps = 16_000, {3_001: 8e-4, 9_500: -4e-4, 9_560: 4e-4}
    speed, friction = window(np.random.default_rng(seed), n, jumps)
    curve = evidence_curve(speed, friction, np.ones(n, dtype=np.bool_), SLOPE, 1_500)
    above = curve.index[curve.statistic > curve.threshold]
    for at in jumps:
        assert np.abs(above - at).min() <= 8  # half of the stretch that one point stands for, and the noise's say
    far = [k for k in above if np.abs(np.array(list(jumps)) - k).min() > 128]  # further than the widest scale reaches
    # χ² exceeds the threshold with 7.5e-5; neighbours and scales share most of their samples, so that the 16,000 slots
    # times 6 scales are some 50,000 tests: about 4 by chance.
    assert len(far) <= stats.poisson(4).isf(1e-3)
    assert curve.index.size <= 1_500


@given(st.floats(1e-9, 1e9), st.floats(1e-3, 1e3))
def test_units_do_not_matter(torque: float, angle: float) -> None:
    speed, friction = window(np.random.default_rng(7), 2_000, {1_000: 8e-4})
    used = np.ones(2_000, dtype=np.bool_)
    one = evidence_curve(speed, friction, used, SLOPE, 200)
    other = evidence_curve(angle * speed, torque * friction, used, SLOPE * torque / angle, 200)
    np.testing.assert_allclose(other.statistic, one.statistic, rtol=1e-6, atol=1e-6)
    assert other.threshold == one.threshold


def test_unused_slots_say_nothing_and_too_few_give_no_curve() -> None:
    speed, friction = window(np.random.default_rng(3), 4_000, {})
    used = np.ones(4_000, dtype=np.bool_)
    used[1_000:1_400] = False
    friction[1_000:1_400] = np.nan
    curve = evidence_curve(speed, friction, used, SLOPE, 4_000)
    assert curve.statistic[1_150:1_250].max() == 0.0
    assert evidence_curve(speed, friction, np.arange(4_000) < 20, SLOPE, 100) is None


@pytest.mark.parametrize("jumped", [0.0, 0.05, 0.2])
def test_the_variance_of_contrasts_is_that_of_those_without_a_jump(jumped: float) -> None:
    rng, n = np.random.default_rng(11), 40_000
    statistic = 2.5 * stats.chi2(1).rvs(n, random_state=rng)
    statistic[: int(jumped * n)] = rng.uniform(50.0, 5_000.0, int(jumped * n))
    # A trimmed mean of χ² has a relative standard error of some 2/√n; jumps not told from noise add a per cent or two.
    assert chi_variance(statistic) == pytest.approx(2.5, rel=3 * 2 / np.sqrt(n) + 0.02)
