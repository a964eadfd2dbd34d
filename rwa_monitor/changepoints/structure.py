"""What a window keeps beside its running sums so that the adequacy check can see what the friction model leaves out.

The running sums hold neither the direction of rotation, nor the samples in the dead band, nor the wheel's angle. Here
each is kept in little memory while the samples come in: the direction of every block of slots, the moments of the
dead band's samples, and how much of the friction repeats with the wheel's angle in some short stretches.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from rwa_monitor.kernels.structure import BLOCK, STRETCH
from rwa_monitor.samples import BoolArray, FloatArray, IntArray
from rwa_monitor.wheel.effects.torque_ripple import MAX_HARMONIC

ZERO_RUNS: Final = 5  # zeros in a row, the first and the second reading after them, zero runs and plateaus so far
NEAR_ZERO: Final = 4  # n, Σx, Σz, Σz² of the dead band's samples of a block
STRETCHES: Final = 20
HARMONICS: Final = 2 * MAX_HARMONIC  # `torque_ripple` holds a harmonic and its double


@dataclass(frozen=True, slots=True)
class Structure:
    """What the running sums do not hold of a window.

    Attributes
    ----------
    direction
        float64 (blocks,), mean of sign(ω) over the used samples of each block of 64 slots; 0 where there are none.
    near_zero
        float64 (4, blocks): n, Σx, Σz, Σz² of the good samples in the dead band whose sign of ω is certain.
    ripple
        float64 (stretches, harmonics), power of the friction at 1 … 96 times the wheel's angle in each stretch without
        a masked slot, in units that are 2 on average for white noise; NaN where slow friction would look like it.
    zero_runs, plateaus
        Runs of speed readings of exactly zero, and how many of them end like a tachometer's dead zone.
    """

    direction: FloatArray
    near_zero: FloatArray
    ripple: FloatArray
    zero_runs: int
    plateaus: int


class StructureArrays(NamedTuple):
    """The arrays behind `StructureSums`, as compiled code takes them.

    Attributes
    ----------
    signs, counts
        int64 (blocks,): slots forward less those backward, and good slots.
    near_zero
        As in `Structure`.
    zeros
        float64 (5,), see `ZERO_RUNS`.
    ripple
        As in `Structure`; NaN for a stretch that is not complete or holds a masked slot.
    """

    signs: IntArray
    counts: IntArray
    near_zero: FloatArray
    zeros: FloatArray
    ripple: FloatArray


class StructureSums:
    """Gathers a window's `Structure` in slot order; nothing depends on the steps in which the slots come.

    Parameters
    ----------
    slots
        Length of the window.
    angle_per_x
        Angle by which the wheel turns in one slot at x = 1 [rad].

    Attributes
    ----------
    arrays
        What compiled code works on.
    hop
        Slots from one stretch that is compared with the angle to the next.
    """

    def __init__(self, slots: int, angle_per_x: float) -> None:
        blocks = -(-slots // BLOCK)
        self.angle_per_x = angle_per_x
        self.hop = max(STRETCH, slots // STRETCHES // BLOCK * BLOCK)
        self.arrays = StructureArrays(
            signs=np.zeros(blocks, dtype=np.int64),
            counts=np.zeros(blocks, dtype=np.int64),
            near_zero=np.zeros((NEAR_ZERO, blocks)),
            zeros=np.zeros(ZERO_RUNS),
            ripple=np.full((max(0, (slots - STRETCH) // self.hop + 1), HARMONICS), np.nan),
        )

    def turns(self, filled: int) -> IntArray:
        """Return, of the blocks that hold the slots [0, filled), the slots forward less those backward; int64."""
        return self.arrays.signs[: -(-filled // BLOCK)].copy()

    def resume(self, turns: IntArray, good: BoolArray) -> None:
        """Go on from what `turns` returned and the slots that are good so far, bool (n,)."""
        self.arrays.signs[: turns.size] = turns
        self.arrays.counts[: turns.size] = np.bincount(np.arange(good.size) // BLOCK, good, turns.size).astype(np.int64)

    def close(self) -> Structure:
        """Return what was gathered."""
        there = np.isfinite(self.arrays.ripple).any(axis=1)
        zero_runs, plateaus = int(self.arrays.zeros[3]), int(self.arrays.zeros[4])
        direction = self.arrays.signs / np.maximum(self.arrays.counts, 1)
        return Structure(direction, self.arrays.near_zero, self.arrays.ripple[there], zero_runs, plateaus)
