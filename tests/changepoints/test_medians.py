"""The median is numpy's, bit for bit."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from rwa_monitor.kernels.order_statistics import median

FEW = 64  # values from which they are counted in bins
NUMBERS = st.floats(-1e300, 1e300) | st.sampled_from([0.0, -0.0, 1.0, -1.0, 5e-324])


@given(hnp.arrays(np.float64, st.integers(1, 4 * FEW), elements=NUMBERS))
def test_the_median_is_that_of_numpy(values):
    assert median(values) == np.median(values)


def test_the_median_of_noise_and_of_a_lattice_is_that_of_numpy():
    rng = np.random.default_rng(1)
    for count in (FEW - 1, FEW, 1001, 20_000):
        noise = rng.standard_normal(count)
        for values in (noise, np.abs(noise), np.round(noise, 1), np.full(count, 0.3), noise * 10.0 ** (20 * noise)):
            assert median(values) == np.median(values)
