"""Section IV-A, changepoint detection: the windowed GLR at one half-width w, and the maximum of each run above it.

Corrected (errata 1 to 3, 17): friction is counted along the motion, the wGLR is the difference of squared errors with
halves [k - w, k) and [k, k + w), and the threshold uses the variance of this contrast, for autocorrelated noise too.
As printed (errata 4, 5): one w, and one changepoint for each contiguous run above the threshold.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from scipy import special

from rwa_monitor.changepoints.estimation import nominal_viscous
from rwa_monitor.changepoints.noise import FALSE_POSITIVE, chi_variance
from rwa_monitor.changepoints.stage_results import Evidence, NoiseEstimate
from rwa_monitor.kernels.evidence import SMALLEST_WEIGHT
from rwa_monitor.kernels.noise import SMALLEST_STD, lean
from rwa_monitor.samples import BoolArray, FloatArray, IntArray
from rwa_monitor.wheel.wheel import Wheel

SCALE: Final = 20  # w [samples]: the worked example of section V-A, see docs/paper.md, "Half-width"
WEIGHT: Final = 1e-4  # W_b, in the paper's units (errata 3)
THRESHOLD: Final = float(special.chdtri(1, FALSE_POSITIVE))  # GLR_thr / σ²


class Signal(NamedTuple):
    """X = {(ω_k, f_k)}: the samples of a window, normalised, float64 (n,); see `stage_results`.

    Attributes
    ----------
    x
        |ω|.
    z
        Friction along the motion, so that z = f_d + f_v x + v in both directions of rotation (errata 1).
    used
        bool (n,), good samples outside the dead band (errata 2).
    """

    x: FloatArray
    z: FloatArray
    used: BoolArray

    @classmethod
    def of(cls, evidence: Evidence) -> Signal:
        """Return the samples of a closed window."""
        samples, window = evidence.sums.arrays, slice(0, evidence.slots)
        return cls(samples.x[window], samples.z[window], samples.used[window])


def detect(
    signal: Signal, noise: NoiseEstimate, wheel: Wheel, w: int = SCALE, threshold: float = THRESHOLD
) -> IntArray:
    """Return the changepoints k_i of a window, int64 (N_cp,).

    Parameters
    ----------
    signal, noise
        The window's samples and the estimate of its noise.
    wheel
        Its nominal viscous coefficient is f̃_v.
    w, threshold
        Half-width [samples], and GLR_thr / σ².
    """
    nominal = nominal_viscous(wheel)
    statistic = wglr(signal, slope=nominal or 0.0, w=w, weight=SMALLEST_WEIGHT if nominal is None else WEIGHT)
    return maxima_of_runs(statistic / contrast_variance(statistic, noise, w), threshold)


def contrast_variance(statistic: FloatArray, noise: NoiseEstimate, w: int) -> float:
    """Return v, where the wGLR is v·χ² with one degree of freedom: σ_v² for white noise (errata 17).

    Estimated from the lower part of the statistics, so that jumps do not count, and drawn to the window's σ_v², the
    value for white noise, the more so the fewer statistics there are.
    """
    known = statistic[np.isfinite(statistic)]
    white = max(noise.std, SMALLEST_STD) ** 2
    return lean(max(chi_variance(known), SMALLEST_STD**2), white, known.size / w) if known.size else white


def wglr(signal: Signal, slope: float, w: int = SCALE, weight: float = WEIGHT) -> FloatArray:
    """Return the wGLR [torque²] at every sample, float64 (n,).

    NaN where a half leaves the window or holds less than w/2 used samples.

    Parameters
    ----------
    signal
        The window's samples.
    slope, weight
        f̃_v and W_b of the prior P(f_v).
    w
        Half-width [samples].
    """
    x, error = signal.x, signal.z - slope * signal.x
    terms = np.where(signal.used, np.stack([np.ones(x.size), x, error, x * x, x * error, error * error]), 0.0)
    before = np.concatenate([np.zeros((6, 1)), np.cumsum(terms, axis=1)], axis=1)  # sums of the samples before k
    statistic = np.full(x.size, np.nan)
    if x.size < 2 * w:
        return statistic
    middle = before[:, w : x.size - w + 1]
    left, right = middle - before[:, : x.size - 2 * w + 1], before[:, 2 * w :] - middle
    # wGLR_k = log P(X | jump at k) - log P(X | no jump at k): the squared error of one level less that of two.
    gain = squared_error([left + right], weight) - squared_error([left, right], weight)
    enough = np.minimum(left[0], right[0]) >= max(1.0, 0.5 * w)
    statistic[w : x.size - w + 1] = np.where(enough, gain, np.nan)
    return statistic


def squared_error(ranges: list[FloatArray], weight: float) -> FloatArray:
    """Return min Σ(f - f_d - f_v ω)² + W_b (f_v - f̃_v)² over one f_d for each range and one f_v for all.

    Parameters
    ----------
    ranges
        Each float64 (6, m): n, Σx, Σe, Σx², Σxe, Σe² with e = f - f̃_v ω.
    weight
        W_b.
    """
    s_xx, s_xe, s_ee = weight, 0.0, 0.0  # about the means of the ranges: f_d is minimised over
    for n, x, e, xx, xe, ee in ranges:
        count = np.maximum(n, 1.0)
        s_xx, s_xe, s_ee = s_xx + xx - x * x / count, s_xe + xe - x * e / count, s_ee + ee - e * e / count
    return np.asarray(s_ee - s_xe * s_xe / s_xx)


def maxima_of_runs(statistic: FloatArray, threshold: float) -> IntArray:
    """Return the place of the maximum of each contiguous run above the threshold, int64 (runs,)."""
    above = np.concatenate(([False], statistic > threshold, [False]))
    runs = np.flatnonzero(np.diff(above.astype(np.int8))).reshape(-1, 2)
    return np.array([begin + np.argmax(statistic[begin:end]) for begin, end in runs], dtype=np.int64)
