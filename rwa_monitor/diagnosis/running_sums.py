"""Running sums of a window: the moments of any range of slots in constant time, from little memory.

Prefix sums of (n, x, z, x², xz, z²) over the used samples are kept at every 16th slot only. A range's moments are the
difference of two of them, mended by at most 15 samples at each end. All sums are taken in slot order from the
window's first slot, so that they do not depend on how the samples arrived; x and z are centred on the window's first
samples, so that an offset far larger than the noise costs no digits.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numba
import numpy as np

from rwa_monitor.samples import BoolArray, FloatArray, IntArray

STRIDE: Final = 16  # slots from one checkpoint to the next: 3 bytes of sums a slot instead of 48
MOMENTS: Final = 6  # n, x, z, xx, xz, zz
CENTRE_BLOCK: Final = 64  # slots whose median is the origin of the sums


@dataclass(frozen=True, slots=True)
class Moments:
    """Sums over the used samples of ranges of slots.

    Attributes
    ----------
    table
        float64 (6, …): count, Σx, Σz, Σx², Σxz, Σz² of each range; the properties name its rows.
    """

    table: FloatArray

    @property
    def n(self) -> FloatArray:
        """Count, as all of these an array of the shape of the ranges."""
        return np.asarray(self.table[0])

    @property
    def x(self) -> FloatArray:
        """Σx."""
        return np.asarray(self.table[1])

    @property
    def z(self) -> FloatArray:
        """Σz."""
        return np.asarray(self.table[2])

    @property
    def xx(self) -> FloatArray:
        """Σx²."""
        return np.asarray(self.table[3])

    @property
    def xz(self) -> FloatArray:
        """Σxz."""
        return np.asarray(self.table[4])

    @property
    def zz(self) -> FloatArray:
        """Σz²."""
        return np.asarray(self.table[5])


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
def find_centre(arrays: SumArrays, running: FloatArray, start: int, stop: int) -> None:
    """Centre sums that hold nothing yet on the medians of the first used slots of [start, stop), about to be added.

    One wild first sample must not become the origin of all sums.
    """
    if running[0] > 0.0:
        return
    x, z, used, centre = arrays.x, arrays.z, arrays.used, arrays.centre
    for begin in range(start, stop):
        if used[begin]:
            first = slice(begin, min(stop, begin - begin % CENTRE_BLOCK + CENTRE_BLOCK))
            centre[0], centre[1] = np.median(x[first][used[first]]), np.median(z[first][used[first]])
            return


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
    x, z, used = arrays.x[start:stop], arrays.z[start:stop], arrays.used[start:stop]
    x_centre, z_centre = arrays.centre[0], arrays.centre[1]
    n, sx, sz, sxx, sxz, szz = running[0], running[1], running[2], running[3], running[4], running[5]
    for j in range(x.size):
        if used[j]:
            u = x[j] - x_centre
            v = z[j] - z_centre
            n += 1.0
            sx += u
            sz += v
            sxx += u * u
            sxz += u * v
            szz += v * v
        before = start + j + 1  # slots that the sums hold now
        if before % STRIDE == 0:
            row = arrays.checkpoints[before // STRIDE]
            row[0], row[1], row[2], row[3], row[4], row[5] = n, sx, sz, sxx, sxz, szz
    running[0], running[1], running[2], running[3], running[4], running[5] = n, sx, sz, sxx, sxz, szz


@numba.njit(cache=True, error_model="numpy", nogil=True, inline="always")
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


@numba.njit(cache=True, error_model="numpy", nogil=True, inline="always")
def moments_between(
    first: tuple[float, float, float, float, float, float],
    last: tuple[float, float, float, float, float, float],
    centre: FloatArray,
) -> tuple[float, float, float, float, float, float]:
    """Return the moments, not centred, of the slots between two of `prefix_moments`."""
    n0, x0, z0, xx0, xz0, zz0 = first
    n1, x1, z1, xx1, xz1, zz1 = last
    cx, cz = centre[0], centre[1]
    n, sx, sz = n1 - n0, x1 - x0, z1 - z0
    return (
        n,
        sx + n * cx,
        sz + n * cz,
        xx1 - xx0 + 2.0 * cx * sx + n * cx * cx,
        xz1 - xz0 + cx * sz + cz * sx + n * cx * cz,
        zz1 - zz0 + 2.0 * cz * sz + n * cz * cz,
    )


@numba.njit(cache=True, error_model="numpy", nogil=True)
def range_moments(start: IntArray, stop: IntArray, slots: int, arrays: SumArrays, out: FloatArray) -> int:
    """Write the moments of each range [start, stop), not centred, to `out` (6, m).

    Returns the samples read, or -1 if a slot lies outside [0, slots].
    """
    read = 0
    for i in range(start.size):
        if min(start[i], stop[i]) < 0 or max(start[i], stop[i]) > slots:
            return -1
        if stop[i] <= start[i]:
            out[:, i] = 0.0
            continue
        first, last = prefix_moments(start[i], arrays), prefix_moments(stop[i], arrays)
        read += start[i] % STRIDE + stop[i] % STRIDE
        out[0, i], out[1, i], out[2, i], out[3, i], out[4, i], out[5, i] = moments_between(first, last, arrays.centre)
    return read


class RunningSums:
    """Moments of any range of a window's slots; all that the later stages see of its samples.

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
    running
        float64 (6,), the centred sums over all slots added.
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
        checkpoints = np.empty((x.size // STRIDE + 1, MOMENTS))
        checkpoints[0] = 0.0
        self.arrays = SumArrays(checkpoints, x, z, used, centre=np.zeros(2))
        self.slots = 0
        self.samples_read = 0
        self.running: FloatArray = np.zeros(MOMENTS)

    @property
    def count(self) -> int:
        """Used samples so far."""
        return int(self.running[0])

    def extend(self, stop: int) -> None:
        """Add all slots up to `stop`: a multiple of CENTRE_BLOCK, or the last slot of all.

        Then the sums do not depend on the steps in which they are extended.
        """
        find_centre(self.arrays, self.running, self.slots, stop)
        extend_checkpoints(self.arrays, self.running, self.slots, stop)
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
        starts, stops = np.asarray(start, dtype=np.int64), np.asarray(stop, dtype=np.int64)
        out = np.empty((MOMENTS, starts.size))
        read = int(range_moments(starts.ravel(), stops.ravel(), self.slots, self.arrays, out))
        if read < 0:
            raise IndexError(f"a range reaches beyond the window's {self.slots} slots")
        self.samples_read += read
        return Moments(out.reshape(MOMENTS, *starts.shape))
