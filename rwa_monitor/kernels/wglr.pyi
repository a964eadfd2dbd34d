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
and batch agree to the last bit.
"""

from typing import Final

from rwa_monitor.changepoints.candidates import PeakArrays, ScanState
from rwa_monitor.samples import BoolArray, FloatArray, IntArray

CHUNK: Final[int]
STEP: Final[int]
MAX_SCALE: Final[int]
HISTORY: Final[int]
PREFIXES: Final[int]
BINS: Final[int]
BINS_PER_OCTAVE: Final[int]
LOWEST_EXPONENT: Final[int]
PEAK_SCALE: Final[int]
PEAK_CONFIRMED: Final[int]
PEAK_STATISTIC: Final[int]
COUNT_PEAKS: Final[int]
COUNT_SETTLED: Final[int]

def scan(
    x: FloatArray,
    z: FloatArray,
    used: BoolArray,
    start: int,
    stop: int,
    counting: bool,
    settings: tuple[IntArray, float, float, FloatArray, FloatArray],
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
    counting
        Whether to add to the histogram (not when slots are scanned a second time).
    settings
        int64 (S,), the scales, ascending; W_b and f̃_v; float64 (S,) each, the statistics from which a peak is kept
        (infinite to keep none), and confirmed.
    state, peaks
        See their classes; both are changed in place.
    chunk_peaks
        Peaks that a chunk can give at most. There is room for those of the first chunk; it ends before another one
        for which there is none.
    """

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

def peaks_above(
    slots: IntArray, values: FloatArray, count: int, scales: IntArray, variances: FloatArray, threshold: float
) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """Return the fields of the `Candidates` that `PeakList.above` chooses among the first `count` rows."""
