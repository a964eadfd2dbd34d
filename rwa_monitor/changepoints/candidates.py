"""From the peaks of the wGLR at all scales, kept compact and of bounded size, to the candidates of a closed window.

A big jump shows at every scale, with side lobes at half the scale's distance (errata 4), and two near jumps blur each
other at scales wider than their distance (errata 5). So peaks are taken narrow scale first, and each is judged *given*
the candidates already accepted: its halves end at its neighbours, the slope is the window's own. Positions are refined
by likelihood, and at last the weakest candidates are taken away until all that stay are significant by themselves.
Everything comes from running sums; a few samples are read around each candidate.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from scipy import special

from rwa_monitor.changepoints.estimation import SlopePrior
from rwa_monitor.changepoints.noise import OutlierModel, ar_coefficient
from rwa_monitor.changepoints.running_sums import RunningSums
from rwa_monitor.changepoints.stage_results import Candidates, Evidence
from rwa_monitor.kernels import changepoints as kernel
from rwa_monitor.kernels.running_sums import STRIDE
from rwa_monitor.kernels.wglr import (
    CHUNK,
    COUNT_PEAKS,
    COUNT_SETTLED,
    MAX_SCALE,
    PEAK_CONFIRMED,
    PEAK_SCALE,
    PEAK_STATISTIC,
    peaks_above,
)
from rwa_monitor.samples import FloatArray, IntArray

MOST_PEAKS: Final = 12_288  # rows at most, 0.6 MB; a window with more peaks is pruned to the strongest half
# Tests that a window amounts to, per slot. The peaks of all scales are about 1.5 independent tests a slot, but a
# candidate must also stand between its final neighbours: simulated windows without a jump show this many.
TESTS_PER_SLOT: Final = 0.25
LONG_GAP: Final = MAX_SCALE // 2  # slots without a used sample: too few left on either side
_LOG_USED: Final[FloatArray] = np.log(np.maximum(np.arange(MAX_SCALE + 1), 1))  # of 0 … MAX_SCALE used samples


# ---- peaks -----------------------------------------------------------------------------------------------------------


class PeakArrays(NamedTuple):
    """The list of peaks, as the kernels take it; see `PeakList`.

    Attributes
    ----------
    slots, values
        int64 (P, 3) and float64 (P, 2): a row for each peak, columns PEAK_….
    open
        int64 (S, 2): for each scale the last peak of each sign; -1 for none.
    counters
        int64 (3,), entries COUNT_….
    confirmed
        int64 (P,): rows of the sure peaks that became final in the last scan, COUNT_CONFIRMED of them.
    reported, reported_values
        int64 (P,) and float64 (3, P): slots of the jumps that became certain, and of each jump, its standard deviation
        and the normalised statistic. As many as `gather` returns.
    """

    slots: IntArray
    values: FloatArray
    open: IntArray
    counters: IntArray
    confirmed: IntArray
    reported: IntArray
    reported_values: FloatArray


class ScanState(NamedTuple):
    """What a scan carries from slot to slot.

    Attributes
    ----------
    prefix
        float64 (PREFIXES, HISTORY + CHUNK + 1); column HISTORY + k - chunk holds the sums of (n, x, e, xx, xe) before
        slot k.
    histogram
        int64 (S, BINS), the statistic at every (w/4)-th slot.
    """

    prefix: FloatArray
    histogram: IntArray


class PeakList:
    """Peaks of the wGLR, with what the scan needs to go on.

    Parameters
    ----------
    scales
        int64 (S,), half-widths w, ascending.

    Attributes
    ----------
    chunk_peaks
        Peaks that a chunk can give at most.
    """

    def __init__(self, scales: IntArray) -> None:
        self.scales = scales
        # Peaks of one sign at one scale lie more than w apart, so a chunk cannot give more than this.
        self.chunk_peaks = int(np.ceil((2.0 / (scales + 1.0)).sum() * CHUNK)) + 2 * scales.size
        self.arrays = PeakArrays(
            slots=np.empty((self.chunk_peaks, 3), dtype=np.int64),
            values=np.empty((self.chunk_peaks, 2)),
            open=np.full((scales.size, 2), -1, dtype=np.int64),
            counters=np.zeros(3, dtype=np.int64),
            confirmed=np.empty(self.chunk_peaks, dtype=np.int64),
            reported=np.empty(self.chunk_peaks, dtype=np.int64),
            reported_values=np.empty((3, self.chunk_peaks)),
        )

    def __len__(self) -> int:
        """Count the peaks."""
        return int(self.arrays.counters[COUNT_PEAKS])

    def make_room(self, variances: FloatArray) -> None:
        """Make room for the peaks of a chunk: by growth or, beyond MOST_PEAKS, by leaving out the weaker half.

        To be called where a chunk begins, and only there: what is left out must not depend on how slots arrive.

        Parameters
        ----------
        variances
            float64 (S,), by which the scales' statistics compare.
        """
        room = self.arrays.slots.shape[0]
        if len(self) + self.chunk_peaks <= room:
            return
        if len(self) + self.chunk_peaks > MOST_PEAKS:
            self._prune(variances)
            return
        room = min(2 * room, MOST_PEAKS)
        # Only the rows of peaks are copied: memory that no peak needs is not even touched.
        slots, values = np.empty((room, 3), dtype=np.int64), np.empty((room, 2))
        slots[: len(self)], values[: len(self)] = self.arrays.slots[: len(self)], self.arrays.values[: len(self)]
        confirmed, reported = np.empty(room, dtype=np.int64), np.empty(room, dtype=np.int64)
        self.arrays = self.arrays._replace(
            slots=slots, values=values, confirmed=confirmed, reported=reported, reported_values=np.empty((3, room))
        )

    def _prune(self, variances: FloatArray) -> None:
        """Keep the strongest peaks, half as many as there are, and those that are still open."""
        count = len(self)
        slots, values, last = self.arrays.slots[:count], self.arrays.values[:count], self.arrays.open
        strength = values[:, PEAK_STATISTIC] / variances[slots[:, PEAK_SCALE]]
        strength[slots[:, PEAK_CONFIRMED] == 0] = np.inf
        strength[last[last >= 0]] = np.inf
        kept = np.sort(np.argsort(-strength, kind="stable")[: count // 2])
        place = np.full(count, -1, dtype=np.int64)
        place[kept] = np.arange(kept.size)
        self.arrays.slots[: kept.size] = slots[kept]
        self.arrays.values[: kept.size] = values[kept]
        self.arrays.open[:] = np.where(last >= 0, place[last], -1)
        self.arrays.counters[COUNT_PEAKS] = kept.size
        self.arrays.counters[COUNT_SETTLED] = 0

    def above(self, threshold: float, variances: FloatArray) -> Candidates:
        """Return the peaks whose statistic, over its scale's variance, reaches `threshold`; sorted by slot."""
        return Candidates(
            *peaks_above(self.arrays.slots, self.arrays.values, len(self), self.scales, variances, threshold)
        )


# ---- candidates ------------------------------------------------------------------------------------------------------


def choose(
    evidence: Evidence, scales: IntArray, variances: FloatArray, outliers: OutlierModel, slope_prior: SlopePrior | None
) -> Candidates:
    """Choose among the peaks of a window, and the jumps behind its gaps.

    Parameters
    ----------
    evidence
        Of the window, all its peaks as candidates.
    scales, variances
        int64 and float64 (S,), half-widths of the scales [slots] and the variance of each one's contrast; NaN where it
        is not known.
    outliers
        Of the noise.
    slope_prior
        What is known of the slope before the window, or None.
    """
    known = np.isfinite(variances)
    found, behind = evidence.candidates, peaks_behind_gaps(evidence.sums)
    if len(found) + len(behind) == 0 or not known.any():
        return found
    table = variance_table(scales[known], variances[known])
    noise = evidence.noise
    chosen = kernel.choose(
        np.concatenate((found.index, behind.index)),
        np.concatenate((found.scale, behind.scale)),
        np.concatenate((found.statistic, behind.statistic)),
        evidence.slots,
        evidence.sums.arrays,
        Threshold(table, evidence.threshold, outliers.largest_outlier),
        ar_coefficient(noise),
        noise.std**2 * noise.long_run_factor,
        *((math.nan, math.nan) if slope_prior is None else (slope_prior.mean, slope_prior.std)),
    )
    return Candidates(*chosen)


def threshold_for(false_alarms: float, tests: float) -> float:
    """Return the χ² (one degree of freedom) threshold that `tests` independent tests exceed `false_alarms` times."""
    return float(special.chdtri(1, min(false_alarms / max(tests, 1.0), 0.5)))


def variance_table(scales: IntArray, variances: FloatArray) -> FloatArray:
    """Return v for a shorter half of 0 … MAX_SCALE used samples: the scales' variances, interpolated in log n."""
    return np.exp(np.interp(_LOG_USED, np.log(scales), np.log(variances)))


def peaks_behind_gaps(sums: RunningSums) -> Candidates:
    """Return a peak behind each long stretch without a used sample: gaps of telemetry, the dead band around zero.

    No contrast of the fixed scales spans such a stretch, so that a jump in it would never be seen. Its scale reaches
    MAX_SCALE slots beyond the stretch; whether there is a jump is for the selection to decide. The statistic is
    infinite, which only makes it the first of its scale to be tried.

    Parameters
    ----------
    sums
        Running sums of the window; their checkpoints alone show where no sample is used.
    """
    arrays, slots = sums.arrays, sums.slots
    count = arrays.checkpoints[: slots // STRIDE + 1, 0]
    empty = count[1:] == count[:-1]
    begin, end = STRIDE * np.flatnonzero(np.diff(np.concatenate(([False], empty, [False])))).reshape(-1, 2).T
    index, scale = [], []
    for first, stop in zip(begin.tolist(), end.tolist(), strict=True):
        there = np.flatnonzero(arrays.used[stop : min(stop + STRIDE, slots)])
        if first > 0 and stop - first >= LONG_GAP and there.size:
            index.append(stop + int(there[0]))
            scale.append(stop - first + MAX_SCALE)
    found = np.array(index, dtype=np.int64)
    return Candidates(found, np.array(scale, dtype=np.int64), np.full(found.size, np.inf), np.zeros(found.size))


class Threshold(NamedTuple):
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
