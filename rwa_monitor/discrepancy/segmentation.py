"""Exact penalised segmentation of a sequence into levels: functional pruning optimal partitioning.

`segment` minimises  Σ (z_k - level_k)² + penalty · (number of jumps)  exactly. Source: Maidstone, Hocking, Rigaill,
Fearnhead, "On optimal multiple changepoint algorithms for large data", Statistics and Computing 27 (2017), algorithm
FPOP. `segment_correlated` does so in autoregressive noise and lets the level walk at random between its jumps.
"""

from __future__ import annotations

import numpy as np

from rwa_monitor.kernels.segmentation import decafs, fpop, segment_sums
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


def segment_correlated(
    z: FloatArray, correlation: FloatArray, innovation_variance: FloatArray, walk_variance: float, penalty: float
) -> IntArray:
    """Return the first index of each segment after the first, int64 (jumps,), increasing.

    Minimises exactly, over the levels μ and the jumps, with the noise e_k = z_k - μ_k,

        e_0² / v_0 + Σ_{k≥1} [(e_k - φ_k e_{k-1})² / v_k + min((μ_k - μ_{k-1})² / walk_variance, penalty)].

    Without correlation, walk and differing variances, that is FPOP, here without blocks. Source: Romano, Rigaill,
    Runge, Fearnhead, "Detecting abrupt changes in the presence of local fluctuations and autocorrelated noise", Journal
    of the American Statistical Association 117 (2022), algorithm DeCAFS, section 3. Here, φ and v may differ from step
    to step, and costs far above the least are cut off until the jumps found are proven to be the best (see the kernel).

    Parameters
    ----------
    z
        float64 (n,), finite values, n ≥ 1.
    correlation
        float64 (n,), φ_k of the noise at k with that at k - 1, |φ_k| < 1; entry 0 is not read. Over a gap of g slots,
        φ^g; negative where the noise changes its sign.
    innovation_variance
        float64 (n,), v_k > 0: the variance of e_k given e_{k-1}, and v_0 that of e_0; in the unit of z².
    walk_variance
        Variance of a step of the level's random walk, ≥ 0, in the unit of z²; 0: constant between jumps.
    penalty
        Cost of one jump, > 0, without unit (a few log n).
    """
    variance = float(innovation_variance[0])
    if walk_variance == 0.0 and not correlation[1:].any() and (innovation_variance == variance).all():
        return fpop(z - z.mean(), np.ones(z.size), penalty * variance)
    return decafs(z, correlation, innovation_variance, walk_variance, penalty)
