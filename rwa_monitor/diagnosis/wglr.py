"""The windowed generalised likelihood ratio (paper, section IV-A), at several scales, from short running sums.

For a scale w the two hypotheses at slot k are one dry level over [k-w, k+w), or one over each half; both share a
slope with the Gaussian prior W_b (f_v - f̃_v)². With e = z - f̃_v x, and means and centred sums per half, the fall of
the penalised squared error is exactly (errata 3)

    statistic = jump² · λ,   jump = ē₂ - ē₁ - (x̄₂ - x̄₁) S_xe / (S_xx + W_b),
                             1/λ  = 1/n₁ + 1/n₂ + (x̄₂ - x̄₁)² / (S_xx + W_b),

in units of torque²; S_xx and S_xe are pooled over the halves, n₁ and n₂ count the used samples in them.

The sums of a range are differences of prefix sums over a short stretch of slots, which begin anew, with a new centre,
at every CHUNK-th slot of the window: the cost of a slot does not depend on the window, and rounding does not build
up. Every value is computed from the same prefix sums by the same operations however the slots are cut, so streaming
and batch agree to the last bit. Kernels are plain functions over arrays; `.py_func` runs them without a compiler.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numba
import numpy as np

from rwa_monitor.samples import BoolArray, FloatArray, IntArray

CHUNK: Final = 1024  # slots after which the prefix sums begin anew: a quarter more work for 50 kB of memory
STEP: Final = 64  # slots after which peaks are confirmed
STRETCH: Final = 512  # slots that are evaluated in one go at most; a multiple of STEP
MAX_SCALE: Final = 128
HISTORY: Final = 2 * MAX_SCALE  # slots before a chunk that its first statistics reach back to
PREFIXES: Final = 5  # n, x, e, xx, xe
NOT_EVALUATED: Final = -1.0  # a half holds too few used samples

# Histogram of the statistic: 16 bins an octave, straight from the bits of the float, from 2⁻⁶⁰ to 2³⁶ torque².
BINS_PER_OCTAVE: Final = 16
OCTAVES: Final = 96
BINS: Final = OCTAVES * BINS_PER_OCTAVE
LOWEST_EXPONENT: Final = -60
_BIN_SHIFT: Final = 48  # of 52 mantissa bits, 4 stay
_FIRST_BIN: Final = (1023 + LOWEST_EXPONENT) * BINS_PER_OCTAVE

# Columns of the list of peaks.
PEAK_SCALE: Final = 0
PEAK_INDEX: Final = 1
PEAK_CONFIRMED: Final = 2
PEAK_STATISTIC: Final = 0
PEAK_JUMP: Final = 1
# Entries of the list's counters.
COUNT_PEAKS: Final = 0
COUNT_SETTLED: Final = 1
COUNT_CONFIRMED: Final = 2


@numba.njit(cache=True, error_model="numpy", nogil=True)
def fill_prefix(
    prefix: FloatArray, x: FloatArray, z: FloatArray, used: BoolArray, chunk: int, start: int, stop: int, slope: float
) -> None:
    """Extend the prefix sums of a chunk by the slots [start, stop); begins anew where start is the chunk's first slot.

    Parameters
    ----------
    prefix
        float64 (5, HISTORY + CHUNK + 1); column HISTORY + k - chunk holds the sums of (n, x, e, xx, xe) before slot k.
    x, z, used
        (slots,), the window's samples.
    chunk
        First slot of the chunk, a multiple of CHUNK.
    start, stop
        Slots to add, within the chunk.
    slope
        f̃_v, the centre of the slope's prior.
    """
    begin = start
    if start == chunk:
        begin = max(0, chunk - HISTORY)
        prefix[:, : HISTORY + begin - chunk + 1] = 0.0
    # The centre is the first used sample that the sums of this chunk may hold.
    x_centre = 0.0
    z_centre = 0.0
    for k in range(max(0, chunk - HISTORY), stop):
        if used[k]:
            x_centre = x[k]
            z_centre = z[k]
            break
    column = HISTORY + begin - chunk
    n, sx, se, sxx, sxe = (
        prefix[0, column],
        prefix[1, column],
        prefix[2, column],
        prefix[3, column],
        prefix[4, column],
    )
    speed, friction, counted = x[begin:stop], z[begin:stop], used[begin:stop]
    sums = prefix[:, column + 1 : column + 1 + speed.size]
    for j in range(speed.size):
        if counted[j]:
            u = speed[j] - x_centre
            e = (friction[j] - z_centre) - slope * u
            n += 1.0
            sx += u
            se += e
            sxx += u * u
            sxe += u * e
        sums[0, j], sums[1, j], sums[2, j], sums[3, j], sums[4, j] = n, sx, se, sxx, sxe


@numba.njit(cache=True, error_model="numpy", nogil=True)
def evaluate(
    prefix: FloatArray, column: int, count: int, w: int, weight: float, statistic: FloatArray, jump: FloatArray
) -> None:
    """Evaluate the statistic of one scale at `count` neighbouring slots.

    Parameters
    ----------
    prefix
        As `fill_prefix` makes it.
    column
        Column of the first slot's end k + w.
    count
        Slots to evaluate.
    w
        The scale.
    weight
        W_b, with a positive floor.
    statistic, jump
        float64, outputs in [:count]; statistic is NOT_EVALUATED where a half has fewer than max(1, w/2) used samples.
    """
    # Which of the two is decided by single numbers: parts of arrays that both need would cost as much as 300 slots.
    if prefix[0, column + count - 1] - prefix[0, column - 2 * w] == 2 * w + count - 1:
        _evaluate_unmasked(prefix, column, count, w, weight, statistic, jump)
    else:
        _evaluate_masked(prefix, column, count, w, weight, statistic, jump)


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _evaluate_unmasked(
    prefix: FloatArray, column: int, count: int, w: int, weight: float, statistic: FloatArray, jump: FloatArray
) -> None:
    """Do the work of `evaluate` where every slot is used: the operations of the other, so that it does not matter."""
    left, middle, right = column - 2 * w, column - w, column
    x0, x1, x2 = prefix[1, left : left + count], prefix[1, middle : middle + count], prefix[1, right : right + count]
    e0, e1, e2 = prefix[2, left : left + count], prefix[2, middle : middle + count], prefix[2, right : right + count]
    xx0, xx2 = prefix[3, left : left + count], prefix[3, right : right + count]
    xe0, xe2 = prefix[4, left : left + count], prefix[4, right : right + count]
    share = 1.0 / w
    for j in range(count):
        xl, xr = x1[j] - x0[j], x2[j] - x1[j]
        el, er = e1[j] - e0[j], e2[j] - e1[j]
        dx = xr * share - xl * share
        spread = (xx2[j] - xx0[j]) - xl * (xl * share) - xr * (xr * share)
        tilt = (xe2[j] - xe0[j]) - xl * (el * share) - xr * (er * share)
        inverse = 1.0 / (max(spread, 0.0) + weight)
        difference = (er * share - el * share) - dx * (tilt * inverse)
        jump[j] = difference
        statistic[j] = difference * difference / (share + share + dx * dx * inverse)


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _evaluate_masked(
    prefix: FloatArray, column: int, count: int, w: int, weight: float, statistic: FloatArray, jump: FloatArray
) -> None:
    """Do the work of `evaluate` where slots are masked."""
    left, middle, right = column - 2 * w, column - w, column
    n0, n1, n2 = prefix[0, left : left + count], prefix[0, middle : middle + count], prefix[0, right : right + count]
    x0, x1, x2 = prefix[1, left : left + count], prefix[1, middle : middle + count], prefix[1, right : right + count]
    e0, e1, e2 = prefix[2, left : left + count], prefix[2, middle : middle + count], prefix[2, right : right + count]
    xx0, xx2 = prefix[3, left : left + count], prefix[3, right : right + count]
    xe0, xe2 = prefix[4, left : left + count], prefix[4, right : right + count]
    need = max(1.0, 0.5 * w)
    for j in range(count):
        nl, nr = n1[j] - n0[j], n2[j] - n1[j]
        left_share, right_share = 1.0 / max(nl, 1.0), 1.0 / max(nr, 1.0)
        xl, xr = x1[j] - x0[j], x2[j] - x1[j]
        el, er = e1[j] - e0[j], e2[j] - e1[j]
        dx = xr * right_share - xl * left_share
        spread = (xx2[j] - xx0[j]) - xl * (xl * left_share) - xr * (xr * right_share)
        tilt = (xe2[j] - xe0[j]) - xl * (el * left_share) - xr * (er * right_share)
        inverse = 1.0 / (max(spread, 0.0) + weight)
        difference = (er * right_share - el * left_share) - dx * (tilt * inverse)
        jump[j] = difference
        value = difference * difference / (left_share + right_share + dx * dx * inverse)
        statistic[j] = value if nl >= need and nr >= need else NOT_EVALUATED


@numba.njit(cache=True, error_model="numpy", nogil=True)
def counted_every(w: int) -> int:
    """Return the slots from one statistic of scale w that goes into the histogram to the next."""
    return max(1, w // 4)


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _count_bins(histogram: IntArray, bits: IntArray, first: int, count: int, stride: int) -> None:
    """Count the statistics of the slots first … first + count - 1 that are multiples of `stride`."""
    counted = bits[(-first) % stride : count : stride]
    for j in range(counted.size):
        pattern = counted[j]
        if pattern >= 0:  # the sign bit marks what was not evaluated
            place = (pattern >> _BIN_SHIFT) - _FIRST_BIN
            histogram[min(max(place, 0), BINS - 1)] += 1


class PeakArrays(NamedTuple):
    """The list of peaks, as compiled code takes it; see `peaks.PeakList`.

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
        and the normalised statistic. As many as `evidence_kernel.gather` says.
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
        float64 (5, HISTORY + CHUNK + 1), see `fill_prefix`.
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
        Keep the maximum of each contiguous run (the paper) instead of the maxima within ±w.
    """

    scales: IntArray
    weight: float
    slope: float
    floors: FloatArray
    sure: FloatArray
    runs: bool


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _keep_peaks(
    statistic: FloatArray,
    jump: FloatArray,
    first: int,
    count: int,
    scale: int,
    reach: int,
    floor: float,
    peaks: PeakArrays,
) -> None:
    """Add local maxima above `floor` to the list of peaks.

    A slot belongs to the last peak of its sign when it lies within `reach` of it: the larger of the two stays. With
    reach 0 (the paper), it belongs to it when the run above the floor is unbroken.
    """
    for j in range(count):
        if statistic[j] <= floor:
            continue
        k = first + j
        sign = 1 if jump[j] > 0.0 and reach > 0 else 0
        last = peaks.open[scale, sign]
        belongs = False
        if last >= 0:
            belongs = k - peaks.slots[last, PEAK_INDEX] <= reach if reach > 0 else peaks.open[scale, 2] == k - 1
        peaks.open[scale, 2] = k
        if not belongs:
            last = peaks.counters[COUNT_PEAKS]
            peaks.counters[COUNT_PEAKS] += 1
            peaks.open[scale, sign] = last
            peaks.slots[last, PEAK_SCALE] = scale
            peaks.slots[last, PEAK_CONFIRMED] = 0
        elif statistic[j] <= peaks.values[last, PEAK_STATISTIC]:
            continue
        peaks.slots[last, PEAK_INDEX] = k
        peaks.values[last, PEAK_STATISTIC] = statistic[j]
        peaks.values[last, PEAK_JUMP] = jump[j]


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _exceeds(values: FloatArray, floor: float) -> bool:
    """Return whether any value is above the floor; without branches, many at once."""
    above = False
    for j in range(values.size):
        above |= values[j] > floor
    return above


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _confirm_peaks(stop: int, settings: ScanSettings, peaks: PeakArrays) -> None:
    """List the sure peaks that no later slot can replace, each once; `stop` ends what was scanned."""
    settled = peaks.counters[COUNT_SETTLED]
    for p in range(settled, peaks.counters[COUNT_PEAKS]):
        if peaks.slots[p, PEAK_CONFIRMED] == 0:
            scale = peaks.slots[p, PEAK_SCALE]
            w = settings.scales[scale]
            evaluated = stop - w  # the last slot with a statistic
            if settings.runs:
                final = peaks.open[scale, 0] != p or peaks.open[scale, 2] < evaluated
            else:
                final = peaks.slots[p, PEAK_INDEX] + w <= evaluated
            if final:
                peaks.slots[p, PEAK_CONFIRMED] = 1
                if peaks.values[p, PEAK_STATISTIC] > settings.sure[scale]:
                    peaks.confirmed[peaks.counters[COUNT_CONFIRMED]] = p
                    peaks.counters[COUNT_CONFIRMED] += 1
    while settled < peaks.counters[COUNT_PEAKS] and peaks.slots[settled, PEAK_CONFIRMED] == 1:
        settled += 1
    peaks.counters[COUNT_SETTLED] = settled


@numba.njit(cache=True, error_model="numpy", nogil=True)
def scan(
    x: FloatArray,
    z: FloatArray,
    used: BoolArray,
    start: int,
    stop: int,
    count_bins: bool,
    settings: ScanSettings,
    state: ScanState,
    peaks: PeakArrays,
    chunk_peaks: int,
) -> int:
    """Advance the detection over the slots [start, stop), as far as there is room for peaks; return where it ended.

    Parameters
    ----------
    x, z, used
        (slots,), the window's samples; read from `start - HISTORY` on.
    start, stop
        The new slots; both multiples of STEP, but for a window's last slot. The statistic of scale w is evaluated at
        k = t - w for every new t, the end of its right half.
    count_bins
        Whether to add to the histogram (not when slots are scanned a second time).
    settings, state, peaks
        See their classes; state and peaks are changed in place.
    chunk_peaks
        Peaks that a chunk can give at most. There is room for those of the first chunk; it ends before another one
        for which there is none.
    """
    peaks.counters[COUNT_CONFIRMED] = 0
    scales = settings.scales
    both = np.empty((2, scales.size, STRETCH))
    statistic, jump = both[0], both[1]
    first_right, above = np.empty(scales.size, dtype=np.int64), np.empty(scales.size, dtype=np.bool_)
    begin = start
    while begin < stop:
        chunk = begin - begin % CHUNK
        if begin == chunk and begin > start and peaks.counters[COUNT_PEAKS] + chunk_peaks > peaks.slots.shape[0]:
            return begin
        end = min(begin + STRETCH, chunk + CHUNK, stop)
        fill_prefix(state.prefix, x, z, used, chunk, begin, end, settings.slope)
        for s in range(scales.size):
            w = scales[s]
            right = max(begin + 1, 2 * w)  # the first slot's end k + w, with both halves in the window
            first_right[s], above[s] = right, False
            count = end - right + 1
            if count <= 0:
                continue
            column = HISTORY + right - chunk
            evaluate(state.prefix, column, count, w, settings.weight, statistic[s], jump[s])
            above[s] = _exceeds(statistic[s, :count], settings.floors[s])  # in few stretches
            if count_bins:
                # `counted_every(w)`, written out: as a call it made all of stage 1 a quarter slower, 1.8 → 2.3 ms.
                _count_bins(state.histogram[s], statistic[s].view(np.int64), right - w, count, max(1, w // 4))
        for step in range(begin, end, STEP):
            step_end = min(step + STEP, end)
            for s in range(scales.size):
                if not above[s]:
                    continue
                w, floor = scales[s], settings.floors[s]
                right = max(step + 1, first_right[s])
                if right <= step_end:
                    first, count = right - w, step_end + 1 - right
                    here = slice(right - first_right[s], right - first_right[s] + count)
                    reach = 0 if settings.runs else w
                    _keep_peaks(statistic[s, here], jump[s, here], first, count, s, reach, floor, peaks)
            _confirm_peaks(step_end, settings, peaks)
        begin = end
    return stop


def wglr(
    x: FloatArray, z: FloatArray, used: BoolArray, scale: int, weight: float, slope: float
) -> tuple[FloatArray, FloatArray]:
    """Evaluate one scale at every slot of a whole array, with the kernels of the live detection.

    Parameters
    ----------
    x, z, used
        (n,), normalised speed and friction, and which samples to use.
    scale
        Half-width w [slots], at most MAX_SCALE.
    weight, slope
        The slope's prior: W_b and its centre f̃_v.

    Returns
    -------
    statistic, jump
        float64 (n,), unnormalised [torque²] and [torque]; NaN where a half leaves the array or lacks samples.
    """
    prefix = np.zeros((PREFIXES, HISTORY + CHUNK + 1))
    statistic, jump = np.full(x.size, np.nan), np.full(x.size, np.nan)
    _evaluate_all(x, z, used, scale, weight, slope, prefix, statistic, jump)
    return statistic, jump


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _evaluate_all(
    x: FloatArray,
    z: FloatArray,
    used: BoolArray,
    w: int,
    weight: float,
    slope: float,
    prefix: FloatArray,
    statistic: FloatArray,
    jump: FloatArray,
) -> None:
    """Evaluate one scale chunk by chunk; NaN where it cannot be."""
    for chunk in range(0, x.size, CHUNK):
        stop = min(chunk + CHUNK, x.size)
        fill_prefix(prefix, x, z, used, chunk, chunk, stop, slope)
        right = max(chunk + 1, 2 * w)
        count = stop - right + 1
        if count > 0:
            first = right - w
            values, differences = statistic[first : first + count], jump[first : first + count]
            evaluate(prefix, HISTORY + right - chunk, count, w, weight, values, differences)
            for j in range(count):
                if values[j] == NOT_EVALUATED:
                    values[j] = np.nan
                    differences[j] = np.nan
