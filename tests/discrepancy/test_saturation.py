"""Channels at their end stops: found where values repeat to the last digit, and only there."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rwa_monitor.discrepancy.plausible import at_end_stop
from tests.discrepancy.simple import DRY_NM, record, search, swing


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), share=st.floats(0.02, 0.5), one_sided=st.booleans())
def test_what_is_clipped_is_found_to_the_sample(seed: int, share: float, one_sided: bool) -> None:
    values = np.random.default_rng(seed).normal(size=2000)
    low, high = np.quantile(values, 0.0 if one_sided else share / 2), np.quantile(values, 1 - share / 2)
    stopped = at_end_stop(np.clip(values, low, high))
    expected = (values >= high) | ((values <= low) & (not one_sided))
    assert np.array_equal(stopped, expected)


@pytest.mark.parametrize(
    "values",
    [
        np.random.default_rng(1).normal(size=2000),
        np.tile([0.2, -0.2, 0.0, 0.2], 500),  # commanded
        np.round(np.random.default_rng(2).normal(size=2000), 1),  # a coarse converter
        np.full(2000, 3.0),
        np.full(2000, np.nan),
    ],
    ids=["noise", "commanded", "coarse", "constant", "unknown"],
)
def test_what_is_not_clipped_is_left(values: np.ndarray) -> None:
    assert not at_end_stop(values).any()


def test_friction_at_its_end_stop_now_and_then_makes_no_effect() -> None:
    """The end stop alone would pass for a drag that grows less than the speed."""
    samples, _ = record(swing(4000), jumps=())
    limit = float(np.quantile(np.abs(samples.friction_torque_Nm), 0.9))
    clipped = np.clip(samples.friction_torque_Nm, -limit, limit)
    result = search(replace(samples, friction_torque_Nm=clipped)).result
    assert [effect.name for effect in result.effects if effect.family == "mean"] == []
    assert limit > DRY_NM
