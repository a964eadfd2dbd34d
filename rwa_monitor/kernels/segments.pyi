from typing import Final

from rwa_monitor.changepoints.running_sums import SumArrays
from rwa_monitor.samples import FloatArray, IntArray

PREFERENCE: Final[float]

def fit_table(pairs: FloatArray, slope: float, variance: float, level_range: float) -> FloatArray:
    """Return the log-likelihood of one level, of a flat prior, between all pairs of nodes: float64 (m + 2, m + 2)."""

def refine_nodes(nodes: IntArray, reach: IntArray, slope: float, variance: float, sums: SumArrays) -> IntArray:
    """See `estimation.refine`; `nodes` are the positions with both ends of the window."""
