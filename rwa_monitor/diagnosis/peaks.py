"""The list of a window's peaks: local maxima of the wGLR at all scales, kept compact and of bounded size."""

from __future__ import annotations

from typing import Final

import numba
import numpy as np

from rwa_monitor.diagnosis.results import Candidates
from rwa_monitor.diagnosis.wglr import (
    CHUNK,
    COUNT_PEAKS,
    COUNT_SETTLED,
    PEAK_CONFIRMED,
    PEAK_INDEX,
    PEAK_JUMP,
    PEAK_SCALE,
    PEAK_STATISTIC,
    PeakArrays,
)
from rwa_monitor.samples import FloatArray, IntArray

MOST_PEAKS: Final = 12_288  # rows at most, 0.6 MB; a window with more peaks is pruned to the strongest half


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


@numba.njit(cache=True, error_model="numpy", nogil=True)
def peaks_above(
    slots: IntArray, values: FloatArray, count: int, scales: IntArray, variances: FloatArray, threshold: float
) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """Return the fields of the `Candidates` that `PeakList.above` chooses among the first `count` rows."""
    chosen, key = np.empty(count, dtype=np.int64), np.empty(count, dtype=np.int64)
    found = 0
    for p in range(count):
        if values[p, PEAK_STATISTIC] / variances[slots[p, PEAK_SCALE]] >= threshold:
            chosen[found] = p
            key[found] = slots[p, PEAK_INDEX] * scales.size + slots[p, PEAK_SCALE]  # by slot, then narrow scales first
            found += 1
    index, scale = np.empty(found, dtype=np.int64), np.empty(found, dtype=np.int64)
    statistic, jump = np.empty(found), np.empty(found)
    order = np.argsort(key[:found], kind="mergesort")
    for i in range(found):
        p = chosen[order[i]]
        index[i], scale[i] = slots[p, PEAK_INDEX], scales[slots[p, PEAK_SCALE]]
        statistic[i], jump[i] = values[p, PEAK_STATISTIC] / variances[slots[p, PEAK_SCALE]], values[p, PEAK_JUMP]
    return index, scale, statistic, jump
