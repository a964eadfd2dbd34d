"""The wGLR over a window as one curve, for a person to look at: the evidence of a jump of the friction, slot by slot.

The detection itself keeps only its peaks. Here the same kernel is run once more over a window's samples, at its wider
scales, and at each slot the largest of them is shown, each in units of the variance of its own contrast (errata 17).
The threshold is the one that the window's candidates must clear. A slot above it is no jump yet: near a large jump the
curve has side lobes (errata 4), and of so many slots and scales some rise above it by chance.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from rwa_monitor.changepoints.candidates import TESTS_PER_SLOT, threshold_for
from rwa_monitor.changepoints.evidence import FALSE_CANDIDATES, SCALES
from rwa_monitor.changepoints.noise import chi_variance
from rwa_monitor.kernels.evidence import KEPT_STATISTIC
from rwa_monitor.kernels.noise import SMALLEST_STD, lean
from rwa_monitor.kernels.wglr import wglr
from rwa_monitor.samples import BoolArray, FloatArray, IntArray

# The slope is the window's own, known: W_b so large against any window's Σ(x - x̄)² that it is not estimated again.
KNOWN_SLOPE: Final = 1e12
# Most tests of a window, and so most peaks by chance, are those of one or two samples; what they alone see is a spike.
SHOWN_SCALES: Final = tuple(scale for scale in SCALES if scale >= 4)
LEAST_USED: Final = 64  # slots below which no variance can be estimated


@dataclass(frozen=True, slots=True)
class EvidenceCurve:
    """The wGLR of a window, thinned so that no peak is lost.

    Attributes
    ----------
    index
        int64 (m,), slots within the window, ascending: the largest of each of m equal stretches.
    statistic
        float64 (m,), wGLR there, the largest of all scales, in variances of its noise; about χ² with one degree of
        freedom where nothing jumps.
    threshold
        What a candidate must clear.
    """

    index: IntArray
    statistic: FloatArray
    threshold: float


def evidence_curve(
    speed: FloatArray, friction: FloatArray, used: BoolArray, slope: float, points: int
) -> EvidenceCurve | None:
    """Return the curve of a window, None where it has too few samples.

    Parameters
    ----------
    speed, friction
        float64 (n,), speed and resisting friction torque of the window's slots, each in a unit of its own choice;
        anything where not used.
    used
        bool (n,), slots with a good sample, outside the dead band.
    slope
        The window's viscous coefficient, in those units.
    points
        How many points the curve has at most.
    """
    if np.count_nonzero(used) < LEAST_USED:
        return None
    x = np.where(used, np.abs(speed), 0.0)
    z = np.where(used, np.sign(speed) * friction, 0.0)
    # So that what is small is small whatever the units.
    speed_unit, unit = float(x.max()) or 1.0, float(np.ptp(z[used])) or 1.0
    largest, variance = np.zeros(x.size), 0.0
    for scale in SHOWN_SCALES:
        statistic, _ = wglr(x / speed_unit, z / unit, used, scale, KNOWN_SLOPE, slope * speed_unit / unit)
        known = np.isfinite(statistic)
        if np.count_nonzero(known) >= LEAST_USED:
            measured = max(chi_variance(statistic[known]), SMALLEST_STD**2)
            variance = lean(measured, variance or measured, np.count_nonzero(known) / scale)
            largest = np.fmax(largest, statistic / variance)
    stretch = -(-x.size // points)
    starts = np.arange(0, x.size, stretch)
    index = np.array([s + int(np.argmax(largest[s : s + stretch])) for s in starts.tolist()], dtype=np.int64)
    tests = TESTS_PER_SLOT * int(np.count_nonzero(used))
    return EvidenceCurve(index, largest[index], max(threshold_for(FALSE_CANDIDATES, tests), KEPT_STATISTIC))
