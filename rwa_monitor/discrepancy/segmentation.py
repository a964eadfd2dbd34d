"""Exact penalised segmentation of a sequence into constant levels: functional pruning optimal partitioning (FPOP).

Minimises  Σ (z_k - level_k)² + penalty · (number of jumps)  exactly. Source: Maidstone, Hocking, Rigaill, Fearnhead,
"On optimal multiple changepoint algorithms for large data", Statistics and Computing 27 (2017), algorithm FPOP.
"""

from __future__ import annotations

import numpy as np

from rwa_monitor.kernels.segmentation import segment_sums
from rwa_monitor.samples import FloatArray, IntArray


def segment(z: FloatArray, penalty: float) -> IntArray:
    """Return the first index of each segment after the first, int64 (jumps,), increasing.

    Exact for short sequences. Long ones are segmented exactly with jumps between blocks of four samples, then each
    jump is moved to the best sample between its neighbours: the search segments thousands of times.

    Parameters
    ----------
    z
        float64 (n,), finite values, n ≥ 1.
    penalty
        Cost of one jump, in the unit of z² (a few log n times the noise variance).
    """
    running = np.zeros((1, z.size + 1))
    np.cumsum(z - z.mean(), out=running[0, 1:])  # less their mean, running sums lose fewer digits
    return segment_sums(running, np.ones(1), penalty)
