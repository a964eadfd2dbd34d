from rwa_monitor.changepoints.running_sums import SumArrays
from rwa_monitor.samples import FloatArray, IntArray

def contrast(k: int, w: int, slope: float, weight: float, sums: SumArrays) -> tuple[float, float]:
    """Return the wGLR's statistic [torque²] and jump at slot k and scale w, for any centre and weight of the slope.

    Both are 0 where a half has no used sample.
    """

def refine_in_colour(k: int, low: int, high: int, reach: int, slope: float, correlation: float, sums: SumArrays) -> int:
    """Return the most likely slot of a jump near k in AR(1) noise.

    The levels are those of [low, k) and [k, high); slots within `reach` of k are tried.
    """

def choose(
    peak_index: IntArray,
    peak_scale: IntArray,
    peak_statistic: FloatArray,
    slots: int,
    sums: SumArrays,
    threshold: tuple[FloatArray, float, float],
    correlation: float,
    variance: float,
    prior_mean: float,
    prior_std: float,
) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """Alternately estimate the slope and choose among the peaks of all scales, until the choice does not change.

    Parameters
    ----------
    peak_index, peak_scale, peak_statistic
        (P,), of the peaks above their thresholds; narrow scales and large statistics are tried first.
    slots, sums
        Length of the window, and its running sums over all slots.
    threshold
        What a jump must exceed: float64 (MAX_SCALE + 1,), see `evidence.variance_table`; χ² threshold of the normalised
        statistic; see `noise.largest_outlier`.
    correlation
        φ of AR(1) noise, see `ar_coefficient`; 0 where the noise is not AR(1).
    variance, prior_mean, prior_std
        See `slope_within`.

    Returns
    -------
    The fields of their `Candidates`: index, scale, statistic, jump.
    """
