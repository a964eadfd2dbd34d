"""Running sums: any range's moments, exactly, from few reads."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rwa_monitor.changepoints.running_sums import RunningSums
from rwa_monitor.kernels.running_sums import STRIDE
from rwa_monitor.kernels.structure import BLOCK

FIELDS = ("n", "x", "z", "xx", "xz", "zz")


def _sums(x, z, used, step=BLOCK):
    sums = RunningSums(x, z, used)
    for stop in range(step, x.size, step):
        sums.extend(stop)
    sums.extend(x.size)
    return sums


def _exact(x, z, used, start, stop):
    """Return the six moments of one range, each correctly rounded."""
    u, v = x[start:stop][used[start:stop]], z[start:stop][used[start:stop]]
    return (
        float(u.size),
        math.fsum(u),
        math.fsum(v),
        math.fsum(u * u),
        math.fsum(u * v),
        math.fsum(v * v),
    )


def _record(rng, n, offset=0.0, share=0.9):
    x = 1.0 + 0.3 * np.sin(np.arange(n) / 200.0)
    z = offset + x + 0.024 * rng.standard_normal(n)
    return x, z, rng.random(n) < share


@pytest.mark.parametrize("offset", [0.0, 1e3, -1e6])
def test_moments_of_random_ranges_equal_exact_sums(offset):
    rng = np.random.default_rng(1)
    x, z, used = _record(rng, 5000, offset)
    sums = _sums(x, z, used)
    start, stop = np.sort(rng.integers(0, 5001, (2, 200)), axis=0)
    moments = sums.between(start, stop)
    for i in range(200):
        expected = _exact(x, z, used, start[i], stop[i])
        for name, value in zip(FIELDS, expected, strict=True):
            assert getattr(moments, name)[i] == pytest.approx(value, rel=1e-12, abs=1e-9), name


def test_variance_of_a_short_range_survives_a_large_offset():
    """The spread of 100 samples after 80,000 others, with an offset of 40,000 standard deviations."""
    rng = np.random.default_rng(2)
    x, z, used = _record(rng, 80_000, offset=1e3, share=1.0)
    m = _sums(x, z, used).between(np.array([79_900]), np.array([80_000]))
    spread = m.zz[0] - m.z[0] ** 2 / m.n[0]
    assert spread == pytest.approx(100 * np.var(z[79_900:]), rel=1e-6)


@given(seed=st.integers(0, 2**32 - 1), steps=st.lists(st.integers(1, 5), min_size=1, max_size=20))
@settings(max_examples=30, deadline=None)
def test_sums_do_not_depend_on_the_steps_of_extension(seed, steps):
    rng = np.random.default_rng(seed)
    x, z, used = _record(rng, 1000, offset=rng.normal(), share=0.05)
    at_once = _sums(x, z, used, step=1000)
    in_steps = RunningSums(x, z, used)
    stop = 0
    for step in steps:
        stop = min(stop + step * BLOCK, 1000)
        in_steps.extend(stop)
    in_steps.extend(1000)
    assert in_steps.arrays.checkpoints.tobytes() == at_once.arrays.checkpoints.tobytes()
    assert in_steps.arrays.centre.tobytes() == at_once.arrays.centre.tobytes()


def test_a_wild_first_sample_does_not_become_the_centre():
    rng = np.random.default_rng(3)
    x, z, _ = _record(rng, 1000, share=1.0)
    z[0] = 1e4  # 400,000 standard deviations; beyond this a value is not taken as friction
    sums = _sums(x, z, np.ones(1000, dtype=np.bool_))
    m = sums.between(np.array([500]), np.array([900]))
    assert m.zz[0] - m.z[0] ** 2 / m.n[0] == pytest.approx(400 * np.var(z[500:900]), rel=1e-6)


def test_range_reads_at_most_one_stride_at_each_end():
    rng = np.random.default_rng(4)
    sums = _sums(*_record(rng, 5000))
    here, there = np.array([3]), np.array([4999])
    whole = sums.between(here, there).table
    sums.arrays.x[STRIDE - 1 : 5000 - STRIDE + 1] = sums.arrays.z[STRIDE - 1 : 5000 - STRIDE + 1] = np.nan
    np.testing.assert_array_equal(sums.between(here, there).table, whole)


def test_empty_and_reversed_ranges_are_zero_and_shapes_are_kept():
    rng = np.random.default_rng(5)
    sums = _sums(*_record(rng, 100))
    m = sums.between(np.array([[5, 9], [50, 0]]), np.array([[5, 3], [60, 100]]))
    assert m.n.shape == (2, 2)
    assert m.n[0].tolist() == [0.0, 0.0]
    assert m.zz[0].tolist() == [0.0, 0.0]
    assert sums.between(np.array(3), np.array(7)).n.shape == ()
    assert sums.between(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)).n.size == 0


@pytest.mark.parametrize(("start", "stop"), [(-1, 5), (0, 101), (101, 101)])
def test_a_range_beyond_the_window_is_refused(start, stop):
    sums = _sums(*_record(np.random.default_rng(6), 100))
    with pytest.raises(IndexError, match="100 slots"):
        sums.between(np.array([start]), np.array([stop]))
