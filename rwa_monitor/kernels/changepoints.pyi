from rwa_monitor.changepoints.evidence import Threshold
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
    """Estimate the slope and choose among the peaks of all scales in turns, until both agree.

    Parameters
    ----------
    peak_index, peak_scale, peak_statistic
        (P,), of the peaks above their thresholds; they are tried narrow scales and large statistics first.
    slots, sums
        Of the window, and its running sums, which hold all slots.
    threshold
        What a jump must clear.
    correlation
        φ of AR(1) noise, see `ar_coefficient`; 0 where it is not like that.
    variance, prior_mean, prior_std
        See `slope_within`.

    Returns
    -------
    The fields of their `Candidates`: index, scale, statistic, jump.
    """
