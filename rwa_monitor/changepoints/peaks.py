"""The list of a window's peaks: local maxima of the wGLR at all scales, kept compact and of bounded size."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from rwa_monitor.changepoints.stage_results import Candidates
from rwa_monitor.kernels.wglr import (
    CHUNK,
    COUNT_PEAKS,
    COUNT_SETTLED,
    PEAK_CONFIRMED,
    PEAK_SCALE,
    PEAK_STATISTIC,
    peaks_above,
)
from rwa_monitor.samples import FloatArray, IntArray

MOST_PEAKS: Final = 12_288  # rows at most, 0.6 MB; a window with more peaks is pruned to the strongest half


class PeakArrays(NamedTuple):
    """The list of peaks, as the kernels take it; see `PeakList`.

    Attributes
    ----------
    slots, values
        int64 (P, 3) and float64 (P, 2): a row for each peak, columns PEAK_….
    open
        int64 (S, 3): for each scale the last peak of each sign, and the last slot above the floor; -1 for none.
    counters
        int64 (3,), entries COUNT_….
    confirmed
        int64 (P,): rows of the sure peaks that became final in the last scan, COUNT_CONFIRMED of them.
    told, told_values
        int64 (P,) and float64 (3, P): slots of the jumps that became certain, and of each jump, its standard deviation
        and the normalised statistic. As many as `gather` returns.
    """

    slots: IntArray
    values: FloatArray
    open: IntArray
    counters: IntArray
    confirmed: IntArray
    told: IntArray
    told_values: FloatArray


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


class ScanSettings(NamedTuple):
    """How a scan looks for peaks; changes at fixed slots of the window only.

    Attributes
    ----------
    scales
        int64 (S,), ascending.
    weight, slope
        The slope's prior: W_b and f̃_v.
    floors, sure
        float64 (S,), the statistics from which a peak is kept (infinite to keep none), and confirmed.
    runs
        Keep the maximum of each contiguous run instead of the maxima within ±w; the detection does not.
    """

    scales: IntArray
    weight: float
    slope: float
    floors: FloatArray
    sure: FloatArray
    runs: bool


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
            open=np.full((scales.size, 3), -1, dtype=np.int64),
            counters=np.zeros(3, dtype=np.int64),
            confirmed=np.empty(self.chunk_peaks, dtype=np.int64),
            told=np.empty(self.chunk_peaks, dtype=np.int64),
            told_values=np.empty((3, self.chunk_peaks)),
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
        confirmed, told = np.empty(room, dtype=np.int64), np.empty(room, dtype=np.int64)
        self.arrays = self.arrays._replace(
            slots=slots, values=values, confirmed=confirmed, told=told, told_values=np.empty((3, room))
        )

    def _prune(self, variances: FloatArray) -> None:
        """Keep the strongest peaks, half as many as there are, and those that are still open."""
        count = len(self)
        slots, values, last = self.arrays.slots[:count], self.arrays.values[:count], self.arrays.open[:, :2]
        strength = values[:, PEAK_STATISTIC] / variances[slots[:, PEAK_SCALE]]
        strength[slots[:, PEAK_CONFIRMED] == 0] = np.inf
        strength[last[last >= 0]] = np.inf
        kept = np.sort(np.argsort(-strength, kind="stable")[: count // 2])
        place = np.full(count, -1, dtype=np.int64)
        place[kept] = np.arange(kept.size)
        self.arrays.slots[: kept.size] = slots[kept]
        self.arrays.values[: kept.size] = values[kept]
        self.arrays.open[:, :2] = np.where(last >= 0, place[last], -1)
        self.arrays.counters[COUNT_PEAKS] = kept.size
        self.arrays.counters[COUNT_SETTLED] = 0

    def above(self, threshold: float, variances: FloatArray) -> Candidates:
        """Return the peaks whose statistic, over its scale's variance, reaches `threshold`; sorted by slot."""
        return Candidates(
            *peaks_above(self.arrays.slots, self.arrays.values, len(self), self.scales, variances, threshold)
        )
