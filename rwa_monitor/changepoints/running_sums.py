"""Running sums of a window: the sufficient statistics of any range of slots in constant time, from little memory.

Prefix sums of (n, x, z, x², xz, z²) over the used samples are kept at every 16th slot only. A range's statistics
are the difference of two of them, corrected by at most 15 samples at each end. All sums are taken in slot order from
the window's first slot, so that they do not depend on how the samples arrived; x and z are centred on the window's
first samples, so that an offset far larger than the noise costs no digits.
"""

from typing import Final, NamedTuple, Self

import numpy as np

from rwa_monitor.kernels.running_sums import BLOCK, STRETCH, STRIDE, range_moments
from rwa_monitor.samples import BoolArray, FloatArray, IntArray
from rwa_monitor.wheel.effects.torque_ripple import MAX_HARMONIC


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
    """Sufficient statistics of any range of a window's slots; all that the later stages use of its samples.

    Parameters
    ----------
    x, z
        float64 (slots,), the samples; kept by reference, to be filled in slot order before they are added.
    used
        bool (slots,), the samples that enter the sums.

    Attributes
    ----------
    arrays
        What the kernels work on.
    running
        float64 (6,), the centred sums over all slots added.
    slots
        Slots that have been added, by `kernels.running_sums.extend_sums`: up to a multiple of BLOCK, or the last slot
        of all. Then the sums do not depend on the steps in which they are extended.

    Examples
    --------
    >>> import numpy as np
    >>> from rwa_monitor.kernels.running_sums import extend_sums
    >>> x = np.arange(100.0)
    >>> sums = RunningSums(x, 2.0 * x, np.ones(100, dtype=np.bool_))
    >>> extend_sums(sums.arrays, sums.running, 0, 100)
    >>> sums.slots = 100
    >>> float(sums.between(np.array([10]), np.array([13]))[4, 0])  # Σxz: 2·(10² + 11² + 12²)
    730.0
    """

    def __init__(self, x: FloatArray, z: FloatArray, used: BoolArray) -> None:
        checkpoints = np.empty((x.size // STRIDE + 1, 6))
        checkpoints[0] = 0.0
        self.arrays = SumArrays(checkpoints, x, z, used, centre=np.zeros(2))
        self.slots = 0
        self.running: FloatArray = np.zeros(6)

    @property
    def count(self) -> int:
        """Used samples so far."""
        return int(self.running[0])

    @property
    def mean(self) -> tuple[float, float]:
        """Means of x and z over the used samples; 0 without any."""
        count, x, z = self.intervals(np.zeros(0, dtype=np.int64))[:3, 0].tolist()
        n = max(count, 1.0)
        return x / n, z / n

    def intervals(self, index: IntArray) -> FloatArray:
        """Return `between` of the intervals between changepoints, int64 (m,): float64 (6, m + 1)."""
        edges = np.concatenate(([0], index, [self.slots]))
        return self.between(edges[:-1], edges[1:])

    def between(self, start: IntArray, stop: IntArray) -> FloatArray:
        """Return the sufficient statistics of the slots [start, stop), element by element; empty ranges give zeros.

        Parameters
        ----------
        start, stop
            int64, equal shape, 0 ≤ start, stop ≤ slots.

        Returns
        -------
        FloatArray
            float64 (6, …), over the used samples of each range: count n, Σx, Σz, Σx², Σxz, Σz².

        Raises
        ------
        IndexError
            If a slot lies outside the window.
        """
        starts, stops = np.asarray(start, dtype=np.int64), np.asarray(stop, dtype=np.int64)
        out = np.empty((6, starts.size))
        if not range_moments(starts.ravel(), stops.ravel(), self.slots, self.arrays, out):
            raise IndexError(f"a range reaches beyond the window's {self.slots} slots")
        return out.reshape(6, *starts.shape)


# ---- structure -------------------------------------------------------------------------------------------------------
# The running sums hold neither the direction of rotation, nor the samples in the dead band, nor the wheel's angle. Here
# each is kept in little memory while the samples come in: the direction of every block of slots, the statistics of the
# dead band's samples, and the power of the friction that is periodic in the wheel's angle, in some short segments.


RIPPLE_SEGMENTS: Final = 20  # at most, of a window


class Structure(NamedTuple):
    """What the running sums do not hold of a window.

    Attributes
    ----------
    direction
        float64 (blocks,), mean of sign(ω) over the used samples of each block of 64 slots; 0 where there are none.
    near_zero
        float64 (4, blocks): n, Σx, Σz, Σz² of the good samples in the dead band whose sign of ω is certain.
    ripple
        float64 (segments, harmonics), power of the friction at 1 … 96 times the wheel's angle in each segment without
        a masked slot, scaled to a mean of 2 for white noise; NaN where slow variation of friction would mimic it.
    zero_runs, plateaus
        Runs of speed readings of exactly zero, and how many of them end like a tachometer's dead zone.
    """

    direction: FloatArray
    near_zero: FloatArray
    ripple: FloatArray
    zero_runs: int
    plateaus: int


def stretch_hop(slots: int) -> int:
    """Return the slots from the begin of one segment of the ripple estimate to the next, in a window of `slots`."""
    return max(STRETCH, slots // RIPPLE_SEGMENTS // BLOCK * BLOCK)


class StructureSums(NamedTuple):
    """Gathers a window's `Structure` in slot order; the result does not depend on the steps in which slots arrive.

    Attributes
    ----------
    signs, counts
        int64 (blocks,): number of slots turning forward less those turning backward, and of good slots.
    near_zero
        As in `Structure`.
    zeros
        float64 (5,): zeros in a row, the first and the second reading after them, zero runs and plateaus so far.
    ripple
        As in `Structure`; NaN for a segment that is not complete or holds a masked slot.
    """

    signs: IntArray
    counts: IntArray
    near_zero: FloatArray
    zeros: FloatArray
    ripple: FloatArray

    @classmethod
    def of(cls, slots: int) -> Self:
        """Return the sums of a window of `slots` slots before the first of them."""
        blocks, stretches = -(-slots // BLOCK), max(0, (slots - STRETCH) // stretch_hop(slots) + 1)
        return cls(
            signs=np.zeros(blocks, dtype=np.int64),
            counts=np.zeros(blocks, dtype=np.int64),
            near_zero=np.zeros((4, blocks)),
            zeros=np.zeros(5),
            ripple=np.full((stretches, 2 * MAX_HARMONIC), np.nan),  # `torque_ripple` holds a harmonic and its double
        )

    def turns(self, filled: int) -> IntArray:
        """Return `signs` of the blocks that hold the slots [0, filled); int64."""
        return self.signs[: -(-filled // BLOCK)].copy()

    def resume(self, turns: IntArray, good: BoolArray) -> None:
        """Continue from the result of `turns` and the good slots so far, bool (n,)."""
        self.signs[: turns.size] = turns
        self.counts[: turns.size] = np.bincount(np.arange(good.size) // BLOCK, good, turns.size).astype(np.int64)

    def close(self) -> Structure:
        """Return what was gathered."""
        there = np.isfinite(self.ripple).any(axis=1)
        direction = self.signs / np.maximum(self.counts, 1)
        return Structure(direction, self.near_zero, self.ripple[there], int(self.zeros[3]), int(self.zeros[4]))
