"""The windowed generalised likelihood ratio (paper, section IV-A), at several scales, from short running sums.

For a scale w the two hypotheses at slot k are one dry level over [k-w, k+w), or one over each half; both share a
slope with the Gaussian prior W_b (f_v - f̃_v)². With e = z - f̃_v x, and means and centred sums per half, the decrease
of the penalised squared error is exactly (errata 3)

    statistic = jump² · λ,   jump = ē₂ - ē₁ - (x̄₂ - x̄₁) S_xe / (S_xx + W_b),
                             1/λ  = 1/n₁ + 1/n₂ + (x̄₂ - x̄₁)² / (S_xx + W_b),

in units of torque²; S_xx and S_xe are pooled over the halves, n₁ and n₂ count the used samples in them.

The sums of a range are differences of prefix sums over a short segment of slots, which restart, with a new centre, at
every CHUNK-th slot of the window: the cost of a slot does not depend on the window's length, and rounding does not
accumulate. Every value is computed from the same prefix sums by the same operations, however the slots are split, so
streaming and batch agree to the last bit.
"""

from typing import Final

from rwa_monitor.samples import BoolArray, FloatArray, IntArray

CHUNK: Final[int]
MAX_SCALE: Final[int]
MOST_PEAKS: Final[int]
BINS: Final[int]
BINS_PER_OCTAVE: Final[int]
LOWEST_EXPONENT: Final[int]

class Detector:
    """The state of the detection in a window; `scales` int64 (S,), half-widths [slots], ascending."""

    def __init__(self, scales: IntArray) -> None: ...
    def scan(
        self,
        x: FloatArray,
        z: FloatArray,
        used: BoolArray,
        start: int,
        stop: int,
        counting: bool,
        settings: tuple[float, float, FloatArray, FloatArray, FloatArray],
    ) -> None:
        """Advance the detection over the slots [start, stop).

        Parameters
        ----------
        x, z, used
            (slots,), the window's samples; read from 2 · MAX_SCALE slots before `start` on.
        start, stop
            The new slots; both multiples of BLOCK, except at the window's end. The statistic of scale w is evaluated
            at k = t - w for every new t, the end of its right half.
        counting
            Whether to add to the histogram (not when slots are scanned a second time).
        settings
            W_b and f̃_v; float64 (S,) each, the variances of the scales' contrasts, and the statistics from which a
            peak is kept (infinite to keep none), and confirmed.
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
