from typing import Final

from rwa_monitor.samples import BoolArray, FloatArray, IntArray

LAGS: Final[int]
SMALLEST_STD: Final[float]
KEPT: Final[float]
KEPT_MEAN: Final[float]
JUMPED: Final[float]
JUMPED_RATE: Final[float]
MOST_JUMPED: Final[float]
CHI_MEDIAN: Final[float]
GAUSSIAN_RATIO: Final[float]

def lean(measured: float, borrowed: float, independent: float) -> float:
    """Return a variance from so many independent contrasts, shrunk to the next narrower scale's (`borrowed`)."""

def scale_variances(histogram: IntArray, scales: IntArray, start_variance: float) -> FloatArray:
    """Estimate the variance of each scale's contrast from the histogram of its statistic.

    Parameters
    ----------
    histogram
        int64 (S, BINS), counts of the unnormalised statistic.
    scales
        int64 (S,), ascending.
    start_variance
        Variance expected before any data; NaN if not known.

    Returns
    -------
    float64 (S,), v with statistic / v ~ χ² with one degree of freedom. With few independent contrasts it is shrunk to
    the next narrower scale's (the narrowest: to `start_variance`). NaN without any count or start value.
    """

def block_differences(
    x: FloatArray,
    z: FloatArray,
    used: BoolArray,
    first: int,
    last: int,
    hop: int,
    slope: float,
    weight: float,
    sums: FloatArray,
    pairs: FloatArray,
) -> None:
    """Sum the squared differences of blocks first … last - 1 at lags 1 … LAGS.

    Parameters
    ----------
    x, z, used
        (slots,), the window's samples.
    first, last
        Blocks; block b reads the slots [b·hop, b·hop + BLOCK + LAGS).
    hop
        Slots from one block to the next.
    slope, weight
        Prior of the block's own slope, which is subtracted: a slew is not noise.
    sums, pairs
        Outputs: float64 (B, LAGS), sum of (e_{k+l} - e_k)²/2 and number of pairs of used samples.
    """

def quiet_levels(sums: FloatArray, pairs: FloatArray, jump_share: float) -> tuple[FloatArray, FloatArray]:
    """Average the block differences, see `block_differences`, over the full blocks, without those of high variance.

    Where jumps are so frequent that most blocks hold one (`jump_share`, see `WindowSettings`), high is what lies above
    the lowest blocks, as many as are expected without a jump.

    Returns
    -------
    levels, counts
        float64 (LAGS,): γ(0) - γ(l) at the lags 1 … LAGS, and the pairs behind it; NaN and 0 without a full block.
    """

def contrast_variances(levels: FloatArray, scales: IntArray) -> FloatArray:
    """Return the variance v of each scale's contrast that the levels of `quiet_levels` imply, float64 (S,).

    The weights of a contrast, -1/w and +1/w w times each, add up to zero, so its variance needs only γ(0) - γ(l):
    with r(l) their autocorrelation, v = -w Σ r(l) (γ(0) - γ(l)) over l ≥ 1. 0 where the contrast is longer than the
    lags, or a level is not known.
    """

def quantiles_of(counts: IntArray, jump_share: float) -> tuple[float, float, float]:
    """Return the number of statistics in a scale's histogram, int64 (BINS,), their median and 99.5 % quantile.

    The quantile is of the statistics that do not lie across a jump, as a share `jump_share` of the largest ones does.
    """

def are_heavy(quantiles: tuple[float, float, float], variance: float) -> bool:
    """Return whether tails are heavier than a Gaussian's; parameters as those of `noise.largest_outlier`."""

def lagged_products(value: FloatArray, interval: IntArray, intervals: int, lags: IntArray) -> FloatArray:
    """Return the sums of products of values that are so many places apart and in one interval.

    Parameters
    ----------
    value, interval
        (n,), and the interval of each, ascending.
    lags
        int64 (L,), ascending.

    Returns
    -------
    float64 (intervals, L).
    """
