from rwa_monitor.changepoints.candidates import Threshold
from rwa_monitor.changepoints.running_sums import SumArrays
from rwa_monitor.samples import FloatArray, IntArray

def contrast(k: int, w: int, slope: float, weight: float, sums: SumArrays) -> tuple[float, float]:
    """Return the wGLR's statistic [torque²] and jump at slot k and scale w, with any centre and weight of the slope.

    Both 0 where a half has no used sample.
    """

def refine_in_colour(k: int, low: int, high: int, reach: int, slope: float, correlation: float, sums: SumArrays) -> int:
    """Return the most likely slot of a jump near k where the noise is AR(1).

    The levels are those of [low, k) and [k, high); slots within `reach` of k are tried.
    """

def select(
    peak_index: IntArray,
    peak_scale: IntArray,
    peak_statistic: FloatArray,
    slots: int,
    slope: float,
    correlation: float,
    sums: SumArrays,
    threshold: Threshold,
) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """Choose the candidates of a window among the peaks of all scales.

    Parameters
    ----------
    peak_index, peak_scale, peak_statistic
        (P,), of the peaks above their thresholds; they are tried narrow scales and large statistics first.
    slots
        Of the window, all in the sums.
    slope
        f_v of the window, as well as it is known.
    correlation
        φ of AR(1) noise, see `ar_coefficient`; 0 where it is not like that.
    sums
        Running sums of the window.
    threshold
        What a jump must clear.

    Returns
    -------
    The fields of their `Candidates`: index, scale, statistic, jump.
    """

def choose(
    peak_index: IntArray,
    peak_scale: IntArray,
    peak_statistic: FloatArray,
    slots: int,
    sums: SumArrays,
    threshold: Threshold,
    correlation: float,
    variance: float,
    prior_mean: float,
    prior_std: float,
) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """Estimate the slope and choose candidates in turns, until they agree; as `select` and `slope_within` do."""
