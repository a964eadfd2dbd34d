"""The problem of a search: the used samples of a wheel's records, joined, and an estimate of their noise.

Friction is multiplied by the direction s: in z = s·friction torque, dry friction is a level and viscous friction a
slope in |ω|, in both directions (see `base_fit`).
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from operator import is_
from typing import Any, Final, Protocol, TypeVar, cast

import numpy as np
from scipy.ndimage import maximum_filter1d, median_filter

from rwa_monitor.discrepancy.plausible import MeasuredConstant, combined
from rwa_monitor.discrepancy.record import ROUNDING, Record
from rwa_monitor.samples import TINY, BoolArray, FloatArray, IntArray

# ---- the noise of the samples ----------------------------------------------------------------------------------------


ENOUGH_DIFFERENCES: Final = 20_000  # differences at a lag, from which their median is known to about one per cent
MAX_LAG: Final = 96  # slots, at which the autocorrelation of AR(1) with φ = 0.95 is below 1 %
LONGEST_QUIET: Final = 8  # insignificant lags in a row; after a longer run the autocovariance is set to zero
MEDIAN_OF_ABSOLUTE_NORMAL: Final = 0.674489750196082  # of |x| for a standard normal x: its 75 % quantile
CLIP_AT: Final = 4.0  # standard deviations; 6e-5 of Gaussian samples lie beyond
OUTLIER_NEIGHBOURHOOD: Final = 7  # slots of a running median; four deviating slots or more are a level, not an outlier


@dataclass(frozen=True, slots=True)
class Noise:
    """Noise of the friction torque.

    Attributes
    ----------
    std
        Standard deviation of one sample [N m].
    long_run_variance
        Largest variance of a mean of m samples, times m, over all m up to MAX_LAG [N² m²]; std² for white noise.
    """

    std: float
    long_run_variance: float


def estimate_noise(pieces: Sequence[FloatArray]) -> Noise:
    """Estimate the noise from the robust variogram γ(h) = ½ var(z_{k+h} - z_k) of contiguous pieces.

    γ comes from medians of absolute differences: a jump affects only h of n of them, and a slow effect changes little
    over a few slots. The sill (γ at the longest lags) is the variance, and sill - γ(h) the autocovariance (Cressie &
    Hawkins 1980 on robust variograms); beyond the last significant lag it is set to zero.

    Parameters
    ----------
    pieces
        float64 (n,) each [N m].
    """
    size, longest = sum(piece.size for piece in pieces), max(piece.size for piece in pieces)
    most, stride = min(MAX_LAG, max(longest // 4, 2)), max(size // ENOUGH_DIFFERENCES, 1)

    def half_variance(lag: int) -> float:
        pairs = [(piece[lag::stride], piece[:-lag:stride]) for piece in pieces if piece.size > lag]
        differences = np.concatenate([after - before for after, before in pairs])
        return float(0.5 * (np.median(np.abs(differences)) / MEDIAN_OF_ABSOLUTE_NORMAL) ** 2)

    gamma = np.array([half_variance(lag) for lag in range(1, most + 1)])
    # Medians ignore heavy tails: their share of the variance is the ratio of the winsorised variance to that implied by
    # the median, of differences of neighbours, of which a jump affects only one.
    steps = np.concatenate([np.diff(piece) for piece in pieces])
    scale = float(np.median(np.abs(steps))) / MEDIAN_OF_ABSOLUTE_NORMAL
    if scale > 0.0:
        gamma *= float(np.mean(np.clip(steps / scale, -CLIP_AT, CLIP_AT) ** 2))
    # Where slow waves remain, differences over long lags exceed the variance of the values themselves.
    spread = float(np.mean(np.concatenate([piece - piece.mean() for piece in pieces]) ** 2))
    sill = min(float(np.median(gamma[-max(most // 4, 1) :])), spread)
    covariance = np.pad(sill - np.append(0.0, gamma), (0, MAX_LAG - most))
    # A robust variance has a relative error of about 1.65·√(2/n); beyond the last significant lag all is set to zero.
    stands_out = np.flatnonzero(np.abs(covariance[: most + 1]) > 4.0 * 1.65 * np.sqrt(2.0 / size) * sill)
    apart = np.diff(stands_out, prepend=0, append=np.inf) > LONGEST_QUIET
    covariance[int(np.append(0, stands_out)[np.argmax(apart)]) + 1 :] = 0.0
    return Noise(max(float(np.sqrt(sill)), TINY), max(long_run_variance(covariance), TINY))


def long_run_variance(covariance: FloatArray) -> float:
    """Return the largest variance of a mean of m samples, times m: R₀ + 2 Σ (1 - h/m) R_h, of R at lags from 0 on."""
    h = np.arange(1, covariance.size)
    means = range(1, 4 * max(covariance.size - 1, 1))
    return max(float(covariance[0] + 2 * np.sum(np.clip(1 - h / m, 0, None) * covariance[1:])) for m in means)


def rms(values: FloatArray) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def clip_outliers(values: FloatArray, std: float) -> tuple[FloatArray, BoolArray]:
    """Clip single samples to within CLIP_AT standard deviations of the median of their neighbours.

    Returns
    -------
    clipped, outliers
        The values, and a mask of those that were clipped.
    """
    middle = median_filter(values, size=OUTLIER_NEIGHBOURHOOD, mode="nearest")
    clipped = np.clip(values, middle - CLIP_AT * std, middle + CLIP_AT * std)
    return clipped, clipped != values


TIMING_REACH: Final = 2  # samples: the largest time offset between channels that is allowed for
NEARLY_CONSTANT: Final = 0.05  # of the mean speed: the spread below which dry and viscous friction are not separable


# ---- how a function is applied to many candidates: in turn here; packages that may start threads pass in others ------


Item = TypeVar("Item")
Result = TypeVar("Result")


class Mapper(Protocol):
    """Applies a function to each item, in any order, and returns the values in the order of the items."""

    def __call__(self, function: Callable[[Item], Result], items: Iterable[Item], /) -> list[Result]:
        """Return the function's value for each item."""
        ...


def in_turn(function: Callable[[Item], Result], items: Iterable[Item], /) -> list[Result]:
    """Apply a function to one item after the other."""
    return [function(item) for item in items]


# ---- caches of values that a search computes repeatedly, within a limit: columns, levels -----------------------------


CACHE_BYTES: Final = 400_000_000  # some 600 columns of 80,000 samples
RECENT: Final = 4  # values that are kept: enough for the models that are being extended

Value = TypeVar("Value")


class ColumnCache:
    """A cache of evaluated columns by effect and shape: the search visits the same shapes many times."""

    def __init__(self, room: int = CACHE_BYTES) -> None:
        self._columns: dict[Hashable, FloatArray] = {}
        self._room = room  # bytes

    def get(self, key: Hashable) -> FloatArray | None:
        """Return the columns, or None where they are not cached."""
        return self._columns.get(key)

    def put(self, key: Hashable, columns: FloatArray) -> None:
        """Cache columns while the limit allows it; nothing is ever evicted."""
        if columns.nbytes <= self._room:
            self._columns[key] = columns
            self._room -= columns.nbytes


class RecentCache:
    """A cache of the last few values by all of their inputs: many effects follow the same level."""

    def __init__(self) -> None:
        # The tuple is replaced as a whole: of two values added at once by two threads, at most one is lost.
        self._values: tuple[tuple[tuple[object, ...], Any], ...] = ()

    def get(self, objects: tuple[object, ...], make: Callable[[], Value]) -> Value:
        """Return the cached value for these objects, compared by identity, or a new one from `make`."""
        for known, value in self._values:
            if all(map(is_, known, objects)):
                return cast("Value", value)
        made = make()
        self._values = (*self._values, (objects, made))[-RECENT:]
        return made


# ---- the data that a search works on ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class Problem:
    """The used samples of one or more records of a wheel, joined; arrays (n,).

    Quantities that every model needs are computed once.

    Attributes
    ----------
    records
        The records.
    z
        s·friction torque [N m]; outliers are clipped where the noise has heavy tails.
    z_measured
        The same, as measured.
    clipped_share
        Share of the samples that were clipped.
    speed
        The regressor of viscous friction [rad/s]: |ω|, unless the wheel's effects replace it (`Record`).
    sign
        s [-].
    starts
        First joined index of each record, and n at the end: a level never extends across records.
    slot
        Slot within its record of each joined sample.
    noise
        Noise of z [N m].
    nominal_viscous
        Nominal viscous coefficient [N m s/rad] as a weak prior, or None.
    derivative_taps, averaging_taps
        Taps of the filter through which noise of the speed enters derived friction [1/s]; and the weights with which
        the derivative averages the torque.
    memory
        Number of samples that carry the information of one independent sample, where friction is derived: known from
        the filter. Its noise is not whitened, because columns of the torque share it. 1 elsewhere, where the law of the
        noise is fitted.
    each
        Applies a function to each candidate; the result does not depend on the order of evaluation.
    lowest_viscous
        Lower bound of the viscous coefficient [N m s/rad]: zero where the base model's own is positive, so that no
        effect is compensated by a negative viscosity.
    """

    records: tuple[Record, ...]
    z: FloatArray
    z_measured: FloatArray
    clipped_share: float
    speed: FloatArray
    sign: FloatArray
    starts: IntArray
    slot: IntArray
    noise: Noise
    nominal_viscous: float | None
    columns: ColumnCache = field(default_factory=ColumnCache)
    recent: RecentCache = field(default_factory=RecentCache)
    derivative_taps: FloatArray = field(default_factory=lambda: np.ones(1))
    averaging_taps: FloatArray = field(default_factory=lambda: np.ones(1))
    memory: float = 1.0
    each: Mapper = in_turn
    lowest_viscous: float = -np.inf

    @cached_property
    def parts(self) -> list[slice]:
        """The joined samples of each record."""
        return [slice(begin, end) for begin, end in pairwise(self.starts.tolist())]

    @cached_property
    def top_speed(self) -> float:
        """The largest speed [rad/s]."""
        return float(self.speed.max(initial=0.0))

    @cached_property
    def largest_friction_Nm(self) -> float:
        """The range of measured friction including zero [N m]; infinite if there is none, as in a planned manoeuvre."""
        return float(self.z_measured.max(initial=0.0) - self.z_measured.min(initial=0.0)) or np.inf

    @cached_property
    def measured_constants(self) -> tuple[MeasuredConstant, ...]:
        """Constants of the wheel file as estimated from channels that are independent of friction."""
        return combined(record.measured_constants for record in self.records)

    @cached_property
    def gap(self) -> IntArray:
        """Slots since the previous sample, int64 (n,); 0 where a record begins."""
        gap = np.diff(self.slot, prepend=0)
        gap[self.starts[:-1][np.diff(self.starts) > 0]] = 0
        return gap

    @cached_property
    def slew(self) -> FloatArray:
        """The largest |Δω| per slot within TIMING_REACH samples, relative to the largest of all, float64 (n,)."""
        speed = self.sign * self.motion
        rate = np.abs(np.diff(speed, prepend=speed[0])) / np.maximum(self.gap, 1)
        rate[self.gap == 0] = 0.0
        slew = maximum_filter1d(rate, 2 * TIMING_REACH + 1)
        return np.asarray(slew / max(float(slew.max()), TINY))

    @cached_property
    def to_reversal(self) -> IntArray:
        """Distance of each sample from the first one after the nearest change of direction [samples], int64 (n,)."""
        far, at = self.size, np.arange(self.size)
        reversal = np.concatenate([[-far], np.flatnonzero(np.diff(self.sign) != 0) + 1, [2 * far]])
        after = np.searchsorted(reversal, at)
        return np.asarray(np.minimum(np.minimum(at - reversal[after - 1], reversal[after] - at), far))

    def with_empty_caches(self) -> Problem:
        """Return the same data with new caches, for objects that are themselves kept in a cache of this problem.

        Reference cycles are freed late, and the cached columns of a search may take 400 MB.
        """
        return replace(self, columns=ColumnCache(), recent=RecentCache())

    @property
    def size(self) -> int:
        """Number of used samples."""
        return int(self.z.size)

    @property
    def motion(self) -> FloatArray:
        """Return |ω| [rad/s]."""
        return np.abs(self.gather([record.channels.speed_rad_s for record in self.records]))

    @property
    def friction_is_derived(self) -> bool:
        """Return whether friction was derived from current and speed in any of the records."""
        return any(record.friction_is_derived for record in self.records)

    @property
    def is_command(self) -> bool:
        """Return whether the friction channel of any record is a command: a function of time without an error."""
        return any(record.is_command for record in self.records)

    @property
    def at_one_speed(self) -> bool:
        """Return whether the speed is nearly constant: dry and viscous friction are not separable there."""
        return float(np.std(self.speed)) < NEARLY_CONSTANT * float(np.mean(self.speed))

    @property
    def smallest_noise_Nm(self) -> float:
        """Return the standard deviation below which noise is rounding of the table [N m]."""
        return ROUNDING * rms(self.z_measured)

    @property
    def has_noise(self) -> bool:
        """Return whether there is noise beyond the rounding of the table: a simulation may have none."""
        return self.noise.std > self.smallest_noise_Nm

    @property
    def log_size(self) -> float:
        """Return log N."""
        return float(np.log(self.size))

    def gather(self, per_record: Sequence[FloatArray]) -> FloatArray:
        """Take the used slots of arrays over the slots of each record, and join them."""
        used = [np.take(values, self.slot[part], axis=0) for values, part in zip(per_record, self.parts, strict=True)]
        return used[0] if len(used) == 1 else np.concatenate(used)

    def spread(self, joined: FloatArray, unused: float | None = None) -> list[FloatArray]:
        """Return joined values on each record's slots; slots that are not used hold `unused`.

        None: they hold the previous used value.
        """
        out = []
        for record, part in zip(self.records, self.parts, strict=True):
            values = np.full(record.used.size, np.nan if unused is None else unused)
            if unused is not None:
                values[record.used] = joined[part]
            elif record.used.any():
                values = joined[part][np.maximum(np.cumsum(record.used) - 1, 0)]
            out.append(values)
        return out
