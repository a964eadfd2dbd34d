"""Stage 1, its last step: from the peaks of all scales to the candidates of a window.

A big jump shows at every scale, with side lobes at half the scale's distance (errata 4), and two near jumps blur each
other at scales wider than their distance (errata 5). So peaks are taken narrow scale first, and each is judged *given*
the candidates already accepted: its halves end at its neighbours, the slope is the window's own. Positions are refined
by likelihood, and at last the weakest candidates are taken away until all that stay are significant by themselves.
Everything comes from running sums; a few samples are read around each candidate.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from scipy import special

from rwa_monitor.changepoints.running_sums import RunningSums
from rwa_monitor.changepoints.stage_results import Candidates
from rwa_monitor.kernels.changepoints import ends_of_gaps
from rwa_monitor.kernels.wglr import MAX_SCALE
from rwa_monitor.samples import FloatArray, IntArray

# Tests that a window amounts to, per slot. The peaks of all scales are about 1.5 independent tests a slot, but a
# candidate must also stand between its final neighbours: simulated windows without a jump show this many.
TESTS_PER_SLOT: Final = 0.25
_LOG_USED: Final[FloatArray] = np.log(np.maximum(np.arange(MAX_SCALE + 1), 1))  # of 0 … MAX_SCALE used samples


def threshold_for(false_alarms: float, tests: float) -> float:
    """Return the χ² (one degree of freedom) threshold that `tests` independent tests exceed `false_alarms` times."""
    return float(special.chdtri(1, min(false_alarms / max(tests, 1.0), 0.5)))


def variance_table(scales: IntArray, variances: FloatArray) -> FloatArray:
    """Return v for a shorter half of 0 … MAX_SCALE used samples: the scales' variances, interpolated in log n."""
    return np.exp(np.interp(_LOG_USED, np.log(scales), np.log(variances)))


def join(first: Candidates, second: Candidates) -> Candidates:
    """Return the peaks of both lists, in any order."""
    return Candidates(
        index=np.concatenate([first.index, second.index]),
        scale=np.concatenate([first.scale, second.scale]),
        statistic=np.concatenate([first.statistic, second.statistic]),
        jump=np.concatenate([first.jump, second.jump]),
    )


def in_turn(peaks: Candidates) -> Candidates:
    """Return the peaks in the order in which they are tried: narrow scales and large statistics first."""
    order = np.lexsort((peaks.index, -peaks.statistic, peaks.scale))
    return Candidates(peaks.index[order], peaks.scale[order], peaks.statistic[order], peaks.jump[order])


def peaks_behind_gaps(sums: RunningSums) -> Candidates:
    """Return a peak behind each long stretch without a used sample: gaps of telemetry, the dead band around zero.

    No contrast of the fixed scales spans such a stretch, so that a jump in it would never be seen. Its scale reaches
    MAX_SCALE slots beyond the stretch; whether there is a jump is for `select` to say. The statistic is
    infinite, which only makes it the first of its scale to be tried.

    Parameters
    ----------
    sums
        Running sums of the window; their checkpoints alone tell where no sample is used.
    """
    index, scale = ends_of_gaps(sums.arrays, sums.slots)
    return Candidates(index, scale, statistic=np.full(index.size, np.inf), jump=np.zeros(index.size))


class Bar(NamedTuple):
    """What a jump must clear to be a candidate.

    Attributes
    ----------
    variances
        float64 (MAX_SCALE + 1,), see `variance_table`.
    threshold
        χ² threshold of the normalised statistic.
    outlier
        Largest outlier of the noise by chance, normalised.
    """

    variances: FloatArray
    threshold: float
    outlier: float
