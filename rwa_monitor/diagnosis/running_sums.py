"""Running sums of a window: the moments of any range of slots in constant time, from little memory.

Prefix sums of (n, x, z, x², xz, z²) over the used samples are kept at every 16th slot only. A range's moments are the
difference of two of them, mended by at most 15 samples at each end. All sums are taken in slot order from the
window's first slot, so that they do not depend on how the samples arrived; x and z are centred on the window's first
samples, so that an offset far larger than the noise costs no digits.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numba
import numpy as np

from rwa_monitor.diagnosis.results import Moments
from rwa_monitor.samples import BoolArray, FloatArray, IntArray

STRIDE: Final = 16  # slots from one checkpoint to the next: 3 bytes of sums a slot instead of 48
MOMENTS: Final = 6  # n, x, z, xx, xz, zz
CENTRE_BLOCK: Final = 64  # slots whose median is the origin of the sums


class SumArrays(NamedTuple):
    """The arrays behind the running sums, as compiled code takes them.

    Attributes
    ----------
    checkpoints
        float64 (slots // STRIDE + 1, 6); row j holds the centred sums over the slots [0, j·STRIDE).
    x, z, used
        (slots,), the window's samples and which of them count.
    centre
        float64 (2,), what x and z are centred on.
    """

    checkpoints: FloatArray
    x: FloatArray
    z: FloatArray
    used: BoolArray
    centre: FloatArray


@numba.njit(cache=True, error_model="numpy", nogil=True)
def extend_checkpoints(arrays: SumArrays, running: FloatArray, start: int, stop: int) -> None:
    """Add the slots [start, stop) to the running sums and keep them at every checkpoint passed, in place.

    Parameters
    ----------
    arrays
        The sums' arrays; the checkpoints are written.
    running
        float64 (6,), the centred sums over [0, start); over [0, stop) afterwards.
    start, stop
        Slots to add.
    """
    checkpoints, x, z, used = arrays.checkpoints, arrays.x, arrays.z, arrays.used
    x_centre, z_centre = arrays.centre[0], arrays.centre[1]
    n, sx, sz, sxx, sxz, szz = running[0], running[1], running[2], running[3], running[4], running[5]
    for k in range(start, stop):
        if k % STRIDE == 0:
            row = checkpoints[k // STRIDE]
            row[0], row[1], row[2], row[3], row[4], row[5] = n, sx, sz, sxx, sxz, szz
        if used[k]:
            u = x[k] - x_centre
            v = z[k] - z_centre
            n += 1.0
            sx += u
            sz += v
            sxx += u * u
            sxz += u * v
            szz += v * v
    running[0], running[1], running[2], running[3], running[4], running[5] = n, sx, sz, sxx, sxz, szz
    if stop % STRIDE == 0:
        row = checkpoints[stop // STRIDE]
        row[0], row[1], row[2], row[3], row[4], row[5] = n, sx, sz, sxx, sxz, szz


@numba.njit(cache=True, error_model="numpy", nogil=True)
def prefix_moments(k: int, arrays: SumArrays) -> tuple[float, float, float, float, float, float]:
    """Return the centred sums (n, x, z, xx, xz, zz) over the slots [0, k); reads at most 15 samples."""
    row = arrays.checkpoints[k // STRIDE]
    n, sx, sz, sxx, sxz, szz = row[0], row[1], row[2], row[3], row[4], row[5]
    for i in range(k - k % STRIDE, k):
        if arrays.used[i]:
            u = arrays.x[i] - arrays.centre[0]
            v = arrays.z[i] - arrays.centre[1]
            n += 1.0
            sx += u
            sz += v
            sxx += u * u
            sxz += u * v
            szz += v * v
    return n, sx, sz, sxx, sxz, szz


@numba.njit(cache=True, error_model="numpy", nogil=True)
def range_moments(start: IntArray, stop: IntArray, arrays: SumArrays, out: FloatArray) -> int:
    """Write the moments of each range [start, stop), not centred, to `out` (6, m); return the samples read."""
    read = 0
    cx, cz = arrays.centre[0], arrays.centre[1]
    for i in range(start.size):
        if stop[i] <= start[i]:
            out[:, i] = 0.0
            continue
        n0, x0, z0, xx0, xz0, zz0 = prefix_moments(start[i], arrays)
        n1, x1, z1, xx1, xz1, zz1 = prefix_moments(stop[i], arrays)
        read += start[i] % STRIDE + stop[i] % STRIDE
        n, sx, sz = n1 - n0, x1 - x0, z1 - z0
        out[0, i] = n
        out[1, i] = sx + n * cx
        out[2, i] = sz + n * cz
        out[3, i] = xx1 - xx0 + 2.0 * cx * sx + n * cx * cx
        out[4, i] = xz1 - xz0 + cx * sz + cz * sx + n * cx * cz
        out[5, i] = zz1 - zz0 + 2.0 * cz * sz + n * cz * cz
    return read


class RunningSums:
    """Moments of any range of a window's slots; the `RangeSums` of the later stages.

    Parameters
    ----------
    x, z
        float64 (slots,), the samples; kept by reference, to be filled in slot order before `extend`.
    used
        bool (slots,), the samples that enter the sums.

    Attributes
    ----------
    arrays
        What compiled code works on.
    slots
        Slots that have been added.
    samples_read
        Samples that `between` and the selection of candidates have read so far: a measure of work, for tests.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.arange(100.0)
    >>> sums = RunningSums(x, 2.0 * x, np.ones(100, dtype=np.bool_))
    >>> sums.extend(100)
    >>> float(sums.between(np.array([10]), np.array([13])).xz[0])  # 2·(10² + 11² + 12²)
    730.0
    """

    def __init__(self, x: FloatArray, z: FloatArray, used: BoolArray) -> None:
        checkpoints = np.zeros((x.size // STRIDE + 1, MOMENTS))
        self.arrays = SumArrays(checkpoints, x, z, used, centre=np.zeros(2))
        self.slots = 0
        self.samples_read = 0
        self._running: FloatArray = np.zeros(MOMENTS)

    @property
    def count(self) -> int:
        """Used samples so far."""
        return int(self._running[0])

    def extend(self, stop: int) -> None:
        """Add all slots up to `stop`: a multiple of CENTRE_BLOCK, or the last slot of all.

        Then the sums do not depend on the steps in which they are extended.
        """
        if self.count == 0:
            _, x, z, used, centre = self.arrays
            new = used[self.slots : stop]
            if new.any():
                # Medians of the first used slots: one wild first sample must not become the origin of all sums.
                begin = self.slots + int(np.argmax(new))
                first = slice(begin, min(stop, begin - begin % CENTRE_BLOCK + CENTRE_BLOCK))
                centre[:] = np.median(x[first][used[first]]), np.median(z[first][used[first]])
        extend_checkpoints(self.arrays, self._running, self.slots, stop)
        self.slots = stop

    def between(self, start: IntArray, stop: IntArray) -> Moments:
        """Return the moments of the slots [start, stop), element by element; empty ranges give zeros.

        Parameters
        ----------
        start, stop
            int64, equal shape, 0 ≤ start, stop ≤ slots.

        Raises
        ------
        IndexError
            If a slot lies outside the window.
        """
        shape = np.shape(start)
        starts = np.ascontiguousarray(np.reshape(start, -1), dtype=np.int64)
        stops = np.ascontiguousarray(np.reshape(stop, -1), dtype=np.int64)
        if starts.size and (min(starts.min(), stops.min()) < 0 or max(starts.max(), stops.max()) > self.slots):
            raise IndexError(f"a range reaches beyond the window's {self.slots} slots")
        out = np.empty((MOMENTS, starts.size))
        self.samples_read += range_moments(starts, stops, self.arrays, out)
        return Moments(*(row.reshape(shape) for row in out))
