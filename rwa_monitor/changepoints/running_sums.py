"""Running sums of a window: the moments of any range of slots in constant time, from little memory.

Prefix sums of (n, x, z, x², xz, z²) over the used samples are kept at every 16th slot only. A range's moments are the
difference of two of them, mended by at most 15 samples at each end. All sums are taken in slot order from the
window's first slot, so that they do not depend on how the samples arrived; x and z are centred on the window's first
samples, so that an offset far larger than the noise costs no digits.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from rwa_monitor.kernels.running_sums import STRIDE, extend_checkpoints, find_centre, range_moments
from rwa_monitor.samples import BoolArray, FloatArray, IntArray

MOMENTS: Final = 6  # n, x, z, xx, xz, zz


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
    """The arrays behind the running sums, as the kernels take them.

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
        What the kernels work on.
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
        read = range_moments(starts.ravel(), stops.ravel(), self.slots, self.arrays, out)
        if read < 0:
            raise IndexError(f"a range reaches beyond the window's {self.slots} slots")
        self.samples_read += read
        return Moments(out.reshape(MOMENTS, *starts.shape))
