from typing import Final

from rwa_monitor.changepoints.evidence import WindowSettings
from rwa_monitor.changepoints.running_sums import StructureSums, SumArrays
from rwa_monitor.samples import BoolArray, FloatArray, IntArray

KEPT_STATISTIC: Final[float]
SMALLEST_WEIGHT: Final[float]
SPEED_NOISES: Final[float]

# motion, x, z, good, used, (slots,): the samples, normalised, |ω| first (the same array as x where viscous friction is
# in proportion to it); which are good, and which of those are used. Running sums, see `RunningSums`; sums and pairs of
# the noise's blocks, see `kernels.noise.block_differences`; structure.
_WindowArrays = tuple[
    FloatArray,
    FloatArray,
    FloatArray,
    BoolArray,
    BoolArray,
    SumArrays,
    FloatArray,
    FloatArray,
    FloatArray,
    StructureSums,
]

class Window:
    """A window: arrays that are filled in place, and must not be replaced while it is in use; what it learns of itself.

    Parameters
    ----------
    arrays, settings
        What to fill, and how slots are taken.
    scales
        int64 (S,), half-widths [slots], ascending.

    Attributes
    ----------
    variances
        float64 (S,), of the contrast of each scale; NaN where it is not known.
    quantiles
        Of the narrowest scale's statistic, see `kernels.noise.quantiles_of`; NaN until the first chunk is there.
    reported
        Of the jumps that became certain in the last call of `gather`: int64 slots; float64 jumps, their standard
        deviations, and the normalised statistics.
    """

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
        filled: int,
        done: int,
        last: bool,
    ) -> tuple[int, int, int, bool]:
        """Take new slots into the window, and detect in all that are there.

        Parameters
        ----------
        speed, torque, good
            (n,), the new slots as they were measured.
        viscous_speed
            (n,), what viscous friction is in proportion to; empty where that is the speed.
        filled, done
            Slots that the window holds, and those in which it has detected.
        last
            Whether no slot will follow: else the last ones wait until a block is full, the first until a chunk
            is.

        Returns
        -------
        tuple[int, int, int, bool]
            How many of the new slots are good, where detection ended, how many jumps it reports, and whether it ended
            early: the tails of the noise look heavy; `set_outlier` is to be called, and this again, without a slot.
        """

    def set_outlier(self, outlier: float, sure_outlier: float) -> None:
        """Set the largest outlier by chance, and the size from which one is reported at once; normalised."""

    def noise(self, done: int) -> tuple[FloatArray, FloatArray, FloatArray, tuple[float, float, float]]:
        """Return the noise of the slots [0, done).

        Levels and counts as from `kernels.noise.quiet_levels`, float64 (LAGS,); the variance of each scale's contrast,
        float64 (S,); the quantiles of the narrowest scale's statistic.
        """

    def peaks_above(self, threshold: float, variances: FloatArray) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
        """Return the fields of the `Candidates`: peaks whose statistic, over its scale's variance, reaches `threshold`.

        Sorted by slot, then narrow scales first.
        """
