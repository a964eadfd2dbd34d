from typing import Final

from rwa_monitor.samples import IntArray

CHI_MEDIAN: Final[float]
GAUSSIAN_RATIO: Final[float]

def quantiles_of(counts: IntArray) -> tuple[float, float, float]:
    """Return how many statistics a scale's histogram, int64 (BINS,), holds, their median and their 99.5 % quantile."""

def are_heavy(quantiles: tuple[float, float, float], variance: float) -> bool:
    """Return whether tails are heavier than a Gaussian's; parameters as those of `noise.estimate_outliers`."""
