from rwa_monitor.changepoints.running_sums import SumArrays
from rwa_monitor.samples import FloatArray, IntArray

def interval_bounds(slots: int, index: IntArray, exclude: IntArray) -> tuple[IntArray, IntArray]:
    """Return first slot and end, int64 (m + 1,) each, of the intervals, without the slots around each changepoint.

    Parameters
    ----------
    slots
        Length of the window.
    index
        int64 (m,), changepoints, ascending.
    exclude
        int64 (m,), slots left out on each side of each changepoint (Δk_error of the paper). At least half of every
        interval stays: an interval gives at most a quarter of its slots at each end.
    """

def interval_moments(slots: int, index: IntArray, exclude: IntArray, sums: SumArrays) -> FloatArray:
    """Return the statistics of the intervals, float64 (6, m + 1); one without a used sample left gets all its slots."""

def slope_within(
    slots: int,
    index: IntArray,
    exclude: IntArray,
    sums: SumArrays,
    variance: float,
    prior_mean: float,
    prior_std: float,
) -> tuple[float, float]:
    """Return the shared slope and its standard deviation from the slots so far, see `estimation.estimate`.

    `variance` is the noise's in the long run; the prior is NaN where nothing is known.
    """
