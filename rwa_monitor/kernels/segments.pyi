from typing import Final

from rwa_monitor.changepoints.running_sums import SumArrays
from rwa_monitor.samples import FloatArray, IntArray

PREFERENCE: Final[float]
LEVEL_SCATTER: Final[float]

def pair_moments(nodes: IntArray, sums: SumArrays) -> FloatArray:
    """Return the statistics between all pairs of nodes: float64 (6, m + 2, m + 2), zero on and below the diagonal.

    `nodes`, int64 (m + 2,): the window's begin, the candidates' slots, the window's end; strictly increasing.
    """

def shared_slope(
    pairs: FloatArray, nodes: IntArray, variance: float, prior_mean: float, prior_std: float
) -> tuple[float, float]:
    """Return the slope that the segments between consecutive `nodes` share, and its information (inverse variance)."""

def jumps_of(
    pairs: FloatArray, nodes: IntArray, slope: float, information: float, variance: float
) -> tuple[FloatArray, FloatArray]:
    """Return size and variance of the jump at each candidate, between the accepted candidates beside it, (m,) each.

    Beside a segment without samples the size is 0 and its variance infinite. `nodes` see `segments.Level`.
    """

def fit_table(pairs: FloatArray, slope: float, variance: float, level_range: float) -> FloatArray:
    """Return the log-likelihood of one level, of a flat prior, between all pairs of nodes: float64 (m + 2, m + 2)."""

def refine_nodes(nodes: IntArray, reach: IntArray, slope: float, variance: float, sums: SumArrays) -> IntArray:
    """See `segments.refine`; `nodes` are the positions with both ends of the window."""
