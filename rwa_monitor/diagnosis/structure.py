"""What a window keeps beside its running sums so that the adequacy check can see what the friction model leaves out.

The running sums know neither the direction of rotation, nor the samples in the dead band, nor the wheel's angle. Here
each is kept in little memory while the samples come in: the direction of every block of slots, the moments of the
dead band's samples, and how much of the friction repeats with the wheel's angle in some short stretches.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numba
import numpy as np

from rwa_monitor.physics.effects.torque_ripple import MAX_HARMONIC
from rwa_monitor.samples import BoolArray, FloatArray, IntArray

BLOCK: Final = 64  # slots of a block: a multiple of the running sums' stride, so that its moments read no sample
ZERO_RUNS: Final = 5  # zeros in a row, the first and the second reading after them, zero runs and plateaus so far
NEAR_ZERO: Final = 4  # n, Σx, Σz, Σz² of the dead band's samples of a block
# Stretches in which the friction is compared with the angle: long enough that a ripple of half the noise's standard
# deviation has five times the power of noise in one of them, short enough that the speed's noise leaves the phase
# coherent (`torque_ripple.coherent_slots`: 278 slots for the 48th harmonic at 0.01 rad/s and 8 Hz).
STRETCH: Final = 256
SIDE: Final = 16  # √STRETCH
STRETCHES: Final = 20
# A tachometer's dead zone: readings of exactly zero, then the first other one lies further off than the speed's noise
# and than the next ones from each other. On a coarse lattice they do not; a reading of zero from full speed is a fault
# of telemetry.
FEWEST_ZEROS: Final = 3
GAP_IN_STEPS: Final = 3.0
LARGEST_GAP: Final = 0.1  # of the nominal speed
HARMONICS: Final = 2 * MAX_HARMONIC  # `torque_ripple` holds a harmonic and its double
# Turns in a slot, whole ones apart, below which a harmonic looks like slow friction: four in a stretch. Of faster ones
# a jump in a stretch holds at most 0.81 / (STRETCH·turns²) = 13 where noise holds 2, whatever its size. At one speed
# each stretch shows a harmonic at the same turns: of slower ones, jumps would add up to a ripple.
SLOWEST_TURNS: Final = 4.0 / STRETCH

# A quarter of a turn in two parts, of which the first has so few digits that any whole multiple of it is exact.
QUARTER_HIGH: Final = float(np.float32(0.5 * np.pi))
QUARTER_LOW: Final = 0.5 * np.pi - QUARTER_HIGH
# (-1)^n / (2n + 1)! and (-1)^n / (2n)!, the highest power first; the next ones are below 1e-16 at an eighth of a turn.
_SINE_TERMS: Final = tuple((-1.0) ** n / math.factorial(2 * n + 1) for n in range(7, -1, -1))
_COSINE_TERMS: Final = tuple((-1.0) ** n / math.factorial(2 * n) for n in range(8, -1, -1))


@dataclass(frozen=True, slots=True)
class Structure:
    """What the running sums do not know of a window.

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

    def turn(self, first: int, speed_rad_s: FloatArray, good: BoolArray) -> None:
        """Note the direction of the slots from `first` on: float64 and bool (n,)."""
        count_signs(first, speed_rad_s, good, self.arrays.signs, self.arrays.counts)

    def turns(self, filled: int) -> IntArray:
        """Return, of the blocks that hold the slots [0, filled), the slots forward less those backward; int64."""
        return self.arrays.signs[: -(-filled // BLOCK)].copy()

    def resume(self, turns: IntArray, good: BoolArray) -> None:
        """Go on from what `turns` returned and the slots that are good so far, bool (n,)."""
        self.arrays.signs[: turns.size] = turns
        self.arrays.counts[: turns.size] = np.bincount(np.arange(good.size) // BLOCK, good, turns.size).astype(np.int64)

    def extend(
        self, samples: tuple[FloatArray, FloatArray, BoolArray, BoolArray], start: int, stop: int, certain: float
    ) -> None:
        """Add the slots [start, stop), which follow those added before.

        Parameters
        ----------
        samples
            x, z, good, used of the whole window, (slots,) each, filled up to `stop`.
        start, stop
            The new slots.
        certain
            |ω|, normalised, from which its sign is certain.
        """
        extend_structure(*samples, start, stop, certain, self.angle_per_x, self.hop, self.arrays)

    def close(self) -> Structure:
        """Return what was gathered."""
        there = np.isfinite(self.arrays.ripple).any(axis=1)
        zero_runs, plateaus = int(self.arrays.zeros[3]), int(self.arrays.zeros[4])
        direction = self.arrays.signs / np.maximum(self.arrays.counts, 1)
        return Structure(direction, self.arrays.near_zero, self.arrays.ripple[there], zero_runs, plateaus)


@numba.njit(cache=True, error_model="numpy", nogil=True)
def pieces_before(slot: int, length: int, hop: int, most: int) -> int:
    """Count the pieces of `length` slots, one every `hop` slots from 0 on, `most` of them, that end by `slot`."""
    return min(max(0, (slot - length) // hop + 1), most)


@numba.njit(cache=True, error_model="numpy", nogil=True)
def extend_structure(
    x: FloatArray,
    z: FloatArray,
    good: BoolArray,
    used: BoolArray,
    start: int,
    stop: int,
    certain: float,
    angle_per_x: float,
    hop: int,
    arrays: StructureArrays,
) -> None:
    """Do the work of `StructureSums.extend`."""
    for block in range(start // BLOCK, (stop + BLOCK - 1) // BLOCK):
        new = slice(max(block * BLOCK, start), min((block + 1) * BLOCK, stop))
        if _differ(good[new], used[new]):  # in few blocks, as the next
            _add_near_zero(x[new], z[new], good[new], used[new], certain, arrays.near_zero[:, block])
        if arrays.zeros[0] != 0.0 or _hold_zero(x[new]):
            _find_plateaus(x[new], good[new], certain, arrays.zeros)
    most = arrays.ripple.shape[0]
    for stretch in range(pieces_before(start, STRETCH, hop, most), pieces_before(stop, STRETCH, hop, most)):
        there = slice(stretch * hop, stretch * hop + STRETCH)
        if used[there].all():
            _ripple_power(x[there], z[there], angle_per_x, arrays.ripple[stretch])


@numba.njit(cache=True, error_model="numpy", nogil=True)
def count_signs(first: int, speed: FloatArray, good: BoolArray, signs: IntArray, counts: IntArray) -> None:
    """Add the slots that are good, and those forward less those backward, to their blocks."""
    start = 0
    while start < speed.size:
        block = (first + start) // BLOCK
        stop = min((block + 1) * BLOCK - first, speed.size)
        count = forward = 0
        here, there = speed[start:stop], good[start:stop]
        for k in range(here.size):
            count += there[k]
            forward += there[k] & (here[k] > 0.0)
        counts[block] += count
        signs[block] += 2 * forward - count
        start = stop


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _differ(first: BoolArray, second: BoolArray) -> bool:
    """Return whether two arrays differ anywhere; without branches, many slots at once."""
    apart = False
    for k in range(first.size):
        apart |= first[k] != second[k]
    return apart


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _hold_zero(values: FloatArray) -> bool:
    """Return whether any value is exactly zero; likewise."""
    found = False
    for k in range(values.size):
        found |= values[k] == 0.0
    return found


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _add_near_zero(
    x: FloatArray, z: FloatArray, good: BoolArray, used: BoolArray, certain: float, out: FloatArray
) -> None:
    """Add the good samples in the dead band whose direction is certain to the sums of their block, `out` (4,)."""
    for k in range(x.size):
        if good[k] and not used[k] and x[k] > certain:
            out[0] += 1.0
            out[1] += x[k]
            out[2] += z[k]
            out[3] += z[k] * z[k]


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _find_plateaus(x: FloatArray, good: BoolArray, certain: float, state: FloatArray) -> None:
    """Count runs of zeros and those that end in a gap; `state` (5,) is carried from piece to piece."""
    for k in range(x.size):
        if state[0] == 0.0 and x[k] != 0.0:
            continue
        if good[k] and x[k] == 0.0:
            state[0] += 1.0
            state[1] = state[2] = 0.0  # noise may carry a reading over the zone's edge and back
        elif not good[k] or state[0] < FEWEST_ZEROS:
            state[0] = state[1] = state[2] = 0.0
        elif state[1] == 0.0:
            state[1] = x[k]
        elif state[2] == 0.0:
            state[2] = x[k]
        else:
            largest = max(abs(x[k] - state[2]), abs(state[2] - state[1]))
            state[3] += 1.0
            if largest > 0.0 and max(GAP_IN_STEPS * largest, certain) < state[1] < LARGEST_GAP:
                state[4] += 1.0
            state[0] = state[1] = state[2] = 0.0


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _ripple_power(x: FloatArray, z: FloatArray, angle_per_x: float, power: FloatArray) -> None:
    """Write 2|Σ e exp(ihθ)|² / Σ e² to `power` (harmonics,), e the friction less a straight line in time.

    Harmonics slower than `SLOWEST_TURNS` are left as they are.
    """
    n = x.size
    middle = 0.5 * (n - 1)
    mean, tilt, spread = 0.0, 0.0, 0.0
    for k in range(n):
        mean += z[k]
        tilt += (k - middle) * z[k]
        spread += (k - middle) ** 2
    mean /= n
    tilt /= spread
    angle = np.empty(n)
    angle[0] = 0.0
    for k in range(1, n):
        angle[k] = angle[k - 1] + 0.5 * (x[k - 1] + x[k]) * angle_per_x
    real, imaginary, c, s = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    cosines_and_sines(angle, c, s)
    energy = 0.0
    for k in range(n):
        e = z[k] - mean - tilt * (k - middle)
        energy += e * e
        real[k], imaginary[k] = e * c[k], e * s[k]
    real_square, imaginary_square = real.reshape(SIDE, SIDE), imaginary.reshape(SIDE, SIDE)
    real_sums, imaginary_sums = np.empty(SIDE), np.empty(SIDE)
    for h in range(power.size):
        _add_up_columns(real_square, real_sums)
        _add_up_columns(imaginary_square, imaginary_sums)
        # All turn on by one more harmonic.
        for k in range(n):
            turned = real[k] * c[k] - imaginary[k] * s[k]
            imaginary[k] = real[k] * s[k] + imaginary[k] * c[k]
            real[k] = turned
        turns = (h + 1) * angle[n - 1] / (2.0 * np.pi * (n - 1))
        if abs(turns - np.rint(turns)) >= SLOWEST_TURNS:
            r, i = 0.0, 0.0
            for column in range(SIDE):
                r += real_sums[column]
                i += imaginary_sums[column]
            power[h] = 2.0 * (r * r + i * i) / max(energy, 1e-300)


@numba.njit(cache=True, error_model="numpy", nogil=True, inline="always")
def _add_up_columns(square: FloatArray, sums: FloatArray) -> None:
    """Write the sum of each column of (SIDE, SIDE) to `sums`, all columns side by side and no addition after all."""
    for c in range(SIDE):
        sums[c] = (
            ((square[0, c] + square[1, c]) + (square[2, c] + square[3, c]))
            + ((square[4, c] + square[5, c]) + (square[6, c] + square[7, c]))
        ) + (
            ((square[8, c] + square[9, c]) + (square[10, c] + square[11, c]))
            + ((square[12, c] + square[13, c]) + (square[14, c] + square[15, c]))
        )


@numba.njit(cache=True, error_model="numpy", nogil=True)
def cosines_and_sines(angle: FloatArray, cosine: FloatArray, sine: FloatArray) -> None:
    """Write cos and sin of each angle [rad], (n,): several at once, and the same on every machine, unlike libm's.

    Taylor's series, to the last digit within an eighth of a turn of the nearest quarter; what the quarters' own
    rounding adds is below 1e-16 of the angle.
    """
    for k in range(angle.size):
        quarters = np.rint(angle[k] * (2.0 / np.pi))
        r = (angle[k] - quarters * QUARTER_HIGH) - quarters * QUARTER_LOW
        y = r * r
        near_sine, near_cosine = 0.0, 0.0
        for term in _SINE_TERMS:
            near_sine = near_sine * y + term
        for term in _COSINE_TERMS:
            near_cosine = near_cosine * y + term
        near_sine *= r
        place = quarters - 4.0 * np.floor(0.25 * quarters)  # 0, 1, 2 or 3
        odd = (place == 1.0) | (place == 3.0)
        sine[k] = (near_cosine if odd else near_sine) * (-1.0 if place >= 2.0 else 1.0)
        cosine[k] = (near_sine if odd else near_cosine) * (-1.0 if (place == 1.0) | (place == 2.0) else 1.0)
