from typing import Final

from rwa_monitor.changepoints.evidence import WindowSettings
from rwa_monitor.changepoints.running_sums import StructureSums, SumArrays
from rwa_monitor.samples import BoolArray, FloatArray, IntArray

KEPT_STATISTIC: Final[float]
SMALLEST_WEIGHT: Final[float]
SPEED_NOISES: Final[float]

# motion, good, (slots,): |ω|, normalised, the same array as x of the sums where viscous friction is proportional to it;
# and which samples are good. Running sums, see `RunningSums`; sums and pairs of the noise's blocks, see
# `kernels.noise.block_differences`; structure.
_WindowArrays = tuple[FloatArray, BoolArray, SumArrays, FloatArray, FloatArray, FloatArray, StructureSums]

class Window:
    """A window: arrays that are filled in place, and must not be replaced while it is in use, and its own estimates.

    Parameters
    ----------
    arrays, settings
        The arrays to fill, and the settings of normalisation and detection.
    scales
        int64 (S,), half-widths [slots], ascending.

    Attributes
    ----------
    filled, done
        Slots that the window holds, and that detection has seen.
    variances
        float64 (S,), of the contrast of each scale; NaN where it is not known.
    quantiles
        Of the narrowest scale's statistic, see `kernels.noise.quantiles_of`; NaN until the first chunk is complete.
    reported
        Of the jumps that became certain in the last call of `gather`: int64 slots; float64 jumps, their standard
        deviations, and the normalised statistics.
    """

    filled: int
    done: int
    variances: FloatArray
    quantiles: tuple[float, float, float]
    reported: tuple[IntArray, FloatArray, FloatArray, FloatArray]

    def __init__(self, arrays: _WindowArrays, settings: WindowSettings, scales: IntArray) -> None: ...
    def gather(
        self,
        speed: FloatArray,
        torque: FloatArray,
        good: BoolArray,
        viscous_speed: FloatArray,
        last: bool,
    ) -> tuple[int, int, bool]:
        """Add new slots to the window, and run the detection up to the last complete block.

        Parameters
        ----------
        speed, torque, good
            (n,), the new slots as measured.
        viscous_speed
            (n,), to which viscous friction is proportional; empty where that is the speed.
        last
            Whether no slot will follow: otherwise the last ones wait until a block is full, the first until a chunk
            is.

        Returns
        -------
        tuple[int, int, bool]
            Number of good new slots, number of jumps reported, and whether the detection ended early because the noise
            is heavy-tailed: then call `set_outlier`, and this again without new slots.
        """

    def set_outlier(self, outlier: float, sure_outlier: float) -> None:
        """Set the largest outliers by chance, for keeping peaks and for reporting jumps at once; normalised."""

    def noise(self) -> tuple[FloatArray, FloatArray, FloatArray, tuple[float, float, float]]:
        """Return the noise of the slots that detection has seen.

        Levels and counts as from `kernels.noise.quiet_levels`, float64 (LAGS,); the variance of each scale's contrast,
        float64 (S,); the quantiles of the narrowest scale's statistic.
        """

    def peaks_above(self, threshold: float, variances: FloatArray) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
        """Return the fields of the `Candidates`: peaks whose statistic, over its scale's variance, reaches `threshold`.

        Sorted by slot, then narrow scales first.
        """
