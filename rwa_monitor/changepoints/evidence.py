"""The evidence of one window, gathered sample by sample: stage 1 as it runs live.

A `WindowAccumulator` takes the slots of one window in batches of any size and keeps their running sums, the wGLR's
peaks at all scales and statistics of the noise, in memory of fixed size. `close` computes the window's `Evidence` from
these; it reads again only a few samples around each candidate.

The result does not depend on the batches: work is done in steps that end at fixed slots of the window, with settings
(variances, floors) that change at fixed slots only.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, Final, NamedTuple

import numpy as np
from pydantic import Field
from scipy import special

from rwa_monitor.changepoints.estimation import nominal_slope_prior
from rwa_monitor.changepoints.noise import (
    FALSE_POSITIVE,
    ar_coefficient,
    estimate_noise,
    gaussian_outlier,
    largest_outlier,
    outlier_chance,
)
from rwa_monitor.changepoints.running_sums import RunningSums, StructureSums, stretch_hop
from rwa_monitor.changepoints.stage_results import Candidates, Evidence, NoiseEstimate, Temperature
from rwa_monitor.kernels import changepoints as kernel
from rwa_monitor.kernels.evidence import KEPT_STATISTIC, Window
from rwa_monitor.kernels.noise import KEPT, LAGS, MOST_JUMPED
from rwa_monitor.kernels.running_sums import BLOCK, STRIDE
from rwa_monitor.kernels.wglr import MAX_SCALE
from rwa_monitor.samples import BoolArray, FloatArray, IntArray
from rwa_monitor.wheel.effects.catalogue import viscous_effects
from rwa_monitor.wheel.switching_systems import jump_rate
from rwa_monitor.wheel.wheel import Wheel

SCALES: Final = tuple(1 << k for k in range(MAX_SCALE.bit_length()))  # half-widths [slots] (errata 5)

PEAK_TESTS_PER_SLOT: Final = 1.5  # independent tests per slot to which the peaks of all scales amount: about Σ 1/w
# The most that the samples around an outlier add to its contrast, over slots and scales: calibrated on Student-t noise
# with 4 degrees of freedom, so that its run length is the one requested (docs/false_alarms.md).
NEIGHBOUR_CONTRAST: Final = 2.7
TAIL_FACTOR: Final = 2.0  # safety factor on the largest outlier by chance, where no run length is requested
FALSE_CANDIDATES: Final = 0.3  # tolerated on average in a window without a jump; the assignment rejects them
# Independent tests per slot to which the choice of candidates amounts. The peaks of all scales are about 1.5, but a
# candidate must also stay significant between its final neighbours: found on simulated windows without a jump.
TESTS_PER_SLOT: Final = 0.25
UNKNOWN_ERROR_K: Final = 1.0  # K: a temperature with this error or more counts as unknown: viscosity is off by 2 to 8 %
# Speed, torque, whether they are good, and the speed of `ViscousSpeed` (or no values), as `Window.gather` takes them.
_Slots = tuple[FloatArray, FloatArray, BoolArray, FloatArray]
_NO_VALUES: Final[FloatArray] = np.empty(0)
_NO_SLOTS: Final[_Slots] = (_NO_VALUES, _NO_VALUES, np.empty(0, dtype=np.bool_), _NO_VALUES)


class ViscousSpeed(NamedTuple):
    """The quantity to which viscous friction is proportional, slot by slot, where not the speed itself; float64 (n,).

    Attributes
    ----------
    speed_rad_s
        ω·ν(T)/ν(T₀) and the like, of the sign of ω [rad/s]; finite wherever the speed is.
    temperature_degC
        The bearing temperature used for it [°C]; NaN where the wheel's viscous friction depends on none.
    error_K
        Uncertainty of that temperature [K], which may be held over from earlier slots.
    """

    speed_rad_s: FloatArray
    temperature_degC: FloatArray
    error_K: FloatArray


@dataclass(frozen=True, slots=True)
class ConfirmedCandidate:
    """A jump that is certain while its window is still open; provisional until the window's diagnosis.

    Attributes
    ----------
    index
        Slot within the window, the first of the new level.
    jump, std
        Its size and standard deviation, normalised.
    confidence
        Probability that the noise alone has no such jump in a whole window.
    """

    index: int
    jump: float
    std: float
    confidence: float


@dataclass(frozen=True, slots=True)
class Gathered:
    """The samples that a window has gathered: all that another accumulator needs to continue with the same results.

    Attributes
    ----------
    x, z
        float64 (n,), normalised; NaN where not good.
    turns
        int64 (blocks,), see `StructureSums.turns`.
    heat
        float64 (n,) each: |ω|, normalised, and temperature and its error of `ViscousSpeed`; None where viscous friction
        is proportional to |ω| itself, which is then x.
    """

    x: FloatArray
    z: FloatArray
    turns: IntArray
    heat: Annotated[tuple[FloatArray, FloatArray, FloatArray] | None, Field(exclude_if=lambda heat: heat is None)] = (
        None
    )


class WindowSettings(NamedTuple):
    """Settings with which the kernels process a window's slots; NaN where unknown.

    Attributes
    ----------
    speed_unit, torque_unit
        What x and z are normalised by [rad/s], [N m].
    angle_per_x
        Angle by which the wheel turns in one slot at x = 1 [rad].
    block_hop, stretch_hop
        Slots from one block of the noise estimate, and from one segment of the ripple estimate, to the next.
    dead_band
        Speed below which samples are not used, normalised; NaN: `SPEED_NOISES` of the kernel.
    start_std
        Standard deviation of the noise expected before any data, normalised.
    prior_mean, prior_std
        Gaussian prior of the slope.
    nominal_slope
        Nominal viscous coefficient, normalised; 0 where there is none.
    outlier, sure_outlier
        Largest outlier by chance of Gaussian noise, and the size from which one is reported at once, in standard
        deviations.
    sure_margin
        What the samples around such an outlier add to it at most, in standard deviations of a scale's contrast.
    sure_statistic
        The statistic from which a jump is reported at once, normalised.
    jump_share
        Share of neighbouring samples with a jump between them, where it is too large to leave the tails as they are.
    """

    speed_unit: float
    torque_unit: float
    angle_per_x: float
    block_hop: int
    stretch_hop: int
    dead_band: float
    start_std: float
    prior_mean: float
    prior_std: float
    nominal_slope: float
    outlier: float
    sure_outlier: float
    sure_margin: float
    sure_statistic: float
    jump_share: float


class WindowAccumulator:
    """Gathers the evidence of one window.

    Parameters
    ----------
    wheel
        The wheel: units, nominal slope and noise, dead band.
    slots
        Length of the window; the wheel's where None.

    Attributes
    ----------
    settings
        Settings passed to the kernel.

    Examples
    --------
    >>> import numpy as np
    >>> from rwa_monitor.wheel.wheel import built_in_wheel
    >>> rng = np.random.default_rng(1)
    >>> speed = 200.0 + np.sin(np.arange(4000) / 500.0)
    >>> torque = 1.6e-3 + 5.333e-6 * speed + 3.9e-5 * rng.standard_normal(4000)
    >>> torque[2500:] += 8e-4  # half the nominal dry torque
    >>> window = WindowAccumulator(built_in_wheel(), slots=4000)
    >>> [event.index for event in window.append(speed, torque, np.ones(4000, dtype=np.bool_))]
    [2500]
    >>> window.close().candidates.index.tolist()
    [2500]
    """

    def __init__(self, wheel: Wheel, slots: int | None = None) -> None:
        self.wheel = wheel
        self.slots = wheel.window.samples if slots is None else slots
        self.good = 0
        self.slope_prior = nominal_slope_prior(wheel)

        self._x: FloatArray = np.empty(self.slots)
        # |ω|; where viscous friction is proportional to another quantity (x), also the temperature and its error.
        self._own_viscous = bool(viscous_effects(wheel))
        self._motion: FloatArray = np.empty(self.slots) if self._own_viscous else self._x
        self._heat: FloatArray = np.empty((2, self.slots if self._own_viscous else 0))
        self._z: FloatArray = np.empty(self.slots)
        self._good: BoolArray = np.empty(self.slots, dtype=np.bool_)
        used: BoolArray = np.empty(self.slots, dtype=np.bool_)  # memory is not touched before there are samples for it
        self._sums = RunningSums(self._x, self._z, used)
        self._structure = StructureSums.of(self.slots)
        self._closed = False

        # Without a prior of the slope, two neighbouring samples carry no information on a jump: no scale of 1 slot.
        prior = self.slope_prior
        known = math.isfinite(prior.std)
        self._scales: IntArray = np.array(SCALES if known else SCALES[1:], dtype=np.int64)
        # Scales whose variance is that of jumps: more contrasts lie across one than can be left out.
        rate = sum(map(jump_rate, wheel.fss))
        self._masked: BoolArray = np.exp(-2.0 * rate * self._scales) < KEPT * (1.0 - MOST_JUMPED)
        self._masked[0] = False
        asked, stated = wheel.window.run_length, wheel.window.dead_band_rad_s
        outlier = gaussian_outlier(outlier_chance(self.slots))
        self.settings = WindowSettings(
            speed_unit=wheel.speed_unit_rad_s,
            torque_unit=wheel.torque_unit_Nm,
            angle_per_x=wheel.speed_unit_rad_s * wheel.sample_period_s,
            # Short windows let the blocks of the noise estimate overlap.
            block_hop=BLOCK if self.slots <= 128 * BLOCK else 4 * BLOCK,
            stretch_hop=stretch_hop(self.slots),
            dead_band=math.nan if stated is None else stated / wheel.speed_unit_rad_s,
            start_std=(wheel.noise.friction_std_Nm or math.nan) / wheel.torque_unit_Nm,
            prior_mean=prior.mean,
            prior_std=prior.std,
            nominal_slope=prior.mean if known else 0.0,
            outlier=outlier,
            sure_outlier=TAIL_FACTOR * outlier if asked is None else 0.0,
            sure_margin=0.0 if asked is None else NEIGHBOUR_CONTRAST,
            sure_statistic=(
                threshold_for(FALSE_POSITIVE, 1.0)
                if asked is None
                else threshold_of_run_length(asked, tuple(self._scales.tolist()))
            ),
            jump_share=rate if self._masked.any() else 0.0,
        )
        sums = self._sums
        blocks: FloatArray = np.empty((2, self.slots // self.settings.block_hop + 1, LAGS))
        arrays = (self._motion, self._good, sums.arrays, sums.running, *blocks, self._structure)
        self._window = Window(arrays, self.settings, self._scales)

    @property
    def filled(self) -> int:
        """Slots that the window holds."""
        return self._window.filled

    # ---- samples in ------------------------------------------------------------------------------------------------

    def append(
        self, speed_rad_s: FloatArray, torque_Nm: FloatArray, good: BoolArray, viscous: ViscousSpeed | None = None
    ) -> list[ConfirmedCandidate]:
        """Take the next slots and return the jumps that became certain.

        Parameters
        ----------
        speed_rad_s, torque_Nm
            float64 (n,), speed and resisting friction torque of consecutive slots; any value where not good.
        good
            bool (n,), slots that hold a good sample; a value that is not finite, or absurd, is not good.
        viscous
            The quantity to which viscous friction is proportional, where the wheel's effects make it differ from the
            speed; None: the speed.

        Raises
        ------
        ValueError
            If the window cannot hold that many slots, or is closed.
        """
        count = speed_rad_s.size
        if self._closed or self.filled + count > self.slots:
            raise ValueError(f"{count} more slots do not fit into a window with {self.filled} of {self.slots}")
        if not self._own_viscous:
            return self._gather((speed_rad_s, torque_Nm, good, _NO_VALUES))
        part = slice(self.filled, self.filled + count)
        self._heat[0, part], self._heat[1, part] = (np.nan, 0.0) if viscous is None else viscous[1:]
        return self._gather((speed_rad_s, torque_Nm, good, speed_rad_s if viscous is None else viscous.speed_rad_s))

    def gathered(self) -> Gathered:
        """Return the samples so far."""
        good = self._good[: self.filled]
        x, z, motion = (np.where(good, values[: self.filled], np.nan) for values in (self._x, self._z, self._motion))
        temperature, error = self._heat[:, : self.filled].copy()
        heat = (motion, temperature, error) if self._own_viscous else None
        return Gathered(x, z, self._structure.turns(self.filled), heat)

    def resume(self, gathered: Gathered) -> None:
        """Take the samples that another accumulator gathered, in place of `append`; report none of their jumps again.

        Raises
        ------
        ValueError
            If samples were taken before, the window cannot hold so many, or the arrays do not match.
        """
        count = gathered.x.size
        heat = gathered.heat or ()
        alike = {values.size for values in (gathered.z, *heat)} == {count} and bool(heat) == self._own_viscous
        if self.filled or count > self.slots or not alike:
            raise ValueError(f"{count} slots do not fit into a window with {self.filled} of {self.slots}")
        good = np.isfinite(gathered.x) & np.isfinite(gathered.z)
        self._x[:count] = np.where(good, gathered.x, 0.0)
        self._z[:count] = np.where(good, gathered.z, 0.0)
        if heat:
            self._motion[:count] = np.where(good, heat[0], 0.0)
            self._heat[:, :count] = heat[1:]
        self._good[:count] = good
        self.good = int(good.sum())
        self._structure.resume(gathered.turns, good)
        self._window.filled = count
        self._gather()

    def close(self) -> Evidence:
        """End the window, full or not, and return its evidence.

        Raises
        ------
        ValueError
            If the window is closed already.
        """
        if self._closed:
            raise ValueError("the window is closed already")
        self._gather(last=True)
        self._closed = True
        levels, counts, variances, quantiles = self._window.noise()
        variances[self._masked] = np.nan
        noise = estimate_noise(levels, counts, self._scales, variances, self._sums.count, self.settings.start_std)
        return Evidence(
            slots=self._sums.slots,
            good=self.good,
            used=self._sums.count,
            candidates=self._candidates(variances, noise, self._outliers(variances, quantiles)[0]),
            sums=self._sums,
            noise=noise,
            structure=self._structure.close(),
            heat=self._temperature(),
        )

    def _candidates(self, variances: FloatArray, noise: NoiseEstimate, outlier: float) -> Candidates:
        """Choose the candidates among the peaks of the window and the possible jumps behind its gaps.

        `outlier`: see `noise.largest_outlier`.
        """
        threshold = max(threshold_for(FALSE_CANDIDATES, TESTS_PER_SLOT * self._sums.count), KEPT_STATISTIC)
        index, scale, statistic, jump = self._window.peaks_above(threshold, variances)
        known = np.isfinite(variances)
        if not known.any():
            return Candidates(index, scale, statistic, jump)  # none
        behind, reach = peaks_behind_gaps(self._sums)
        chosen = kernel.choose(
            np.concatenate((index, behind)),
            np.concatenate((scale, reach)),
            np.concatenate((statistic, np.full(behind.size, np.inf))),  # each is the first of its scale to be tried
            self._sums.slots,
            self._sums.arrays,
            (variance_table(self._scales[known], variances[known]), threshold, outlier),
            ar_coefficient(noise),
            noise.std**2 * noise.long_run_factor,
            *self.slope_prior,
        )
        return Candidates(*chosen)

    def _temperature(self) -> Temperature | None:
        """Return the temperature with which the window's viscous friction was computed; None where none is known."""
        temperature, error = self._heat[:, : self._sums.slots]
        used = self._sums.arrays.used[: temperature.size] & np.isfinite(temperature)
        if not used.any():
            return None
        temperature, error = temperature[used], error[used]
        mean, low, high = (float(of(temperature)) for of in (np.mean, np.min, np.max))
        return Temperature(mean, low, high, float(np.mean(error)), float(np.mean(error >= UNKNOWN_ERROR_K)))

    # ---- detection -------------------------------------------------------------------------------------------------

    def _gather(self, slots: _Slots = _NO_SLOTS, *, last: bool = False) -> list[ConfirmedCandidate]:
        """Take new slots and run detection on all slots present; return the jumps that became certain."""
        events: list[ConfirmedCandidate] = []
        heavy = True
        while heavy:
            count, reported, heavy = self._window.gather(*slots, last)
            self.good += count
            self._sums.slots = self._window.done
            if reported:
                events += self._announced()
            if heavy:
                self._window.set_outlier(*self._outliers(self._window.variances, self._window.quantiles))
            slots = _NO_SLOTS
        return events

    def _outliers(self, variances: FloatArray, quantiles: tuple[float, float, float]) -> tuple[float, float]:
        """Return the size of the largest outlier by chance, and that from which one is reported at once."""
        variance, asked = float(variances[0]), self.wheel.window.run_length
        if not math.isfinite(variance):
            return 0.0, 0.0
        largest = largest_outlier(quantiles, variance, outlier_chance(self.slots))
        return largest, TAIL_FACTOR * largest if asked is None else largest_outlier(quantiles, variance, 1.0 / asked)

    def _announced(self) -> list[ConfirmedCandidate]:
        """Return the reported peaks as events."""
        index, jump, std, normalised = self._window.reported
        chance = PEAK_TESTS_PER_SLOT * self.slots * special.chdtrc(1, normalised)
        columns = (index, jump, std, np.maximum(1.0 - chance, 0.0))
        return [ConfirmedCandidate(*row) for row in zip(*(column.tolist() for column in columns), strict=True)]


# ---- from the peaks of all scales, kept compact and of bounded size, to the candidates of a closed window ------------
# A large jump gives a peak at every scale, with side lobes at half the scale's distance (errata 4), and two close jumps
# blur each other at scales wider than their distance (errata 5). So peaks are taken narrow scale first, and each is
# tested *given* the candidates already accepted: its halves end at its neighbours, the slope is the window's own.
# Positions are refined by likelihood; last, the weakest candidates are removed until all that remain are significant by
# themselves. Everything comes from running sums; a few samples are read around each candidate.


_BOUNDS: Final = (2.0, 12.0, 10_001)  # standard deviations: run lengths of 10 to 1e30 samples
_LOG_USED: Final[FloatArray] = np.log(np.maximum(np.arange(MAX_SCALE + 1), 1))  # of 0 … MAX_SCALE used samples


def threshold_for(false_alarms: float, tests: float) -> float:
    """Return the χ² (one degree of freedom) threshold that `tests` independent tests exceed `false_alarms` times."""
    return float(special.chdtri(1, min(false_alarms / max(tests, 1.0), 0.5)))


@lru_cache
def threshold_of_run_length(run_length: float, half_widths: tuple[int, ...]) -> float:
    """Return the χ² threshold that the wGLR at these half-widths exceeds once in `run_length` samples without a jump.

    At half-width w the contrast of both means is, over its standard deviation, a stationary process whose
    autocorrelation falls by α = 3/(2w) from slot to slot. Its maxima beyond ±b occur at a rate of 2·α·b·φ(b)·ν(b·√(2α))
    per slot, where ν corrects for sampling the process at slots only (D. Siegmund, B. Yakir, The Statistics of Gene
    Mapping, Springer 2007, section 5.3).
    """
    b = np.linspace(*_BOUNDS)
    rate = np.zeros(b.size)
    for w in half_widths:
        alpha = 1.5 / w
        x = b * np.sqrt(2.0 * alpha)
        density, share = np.exp(-x * x / 8.0) / np.sqrt(2.0 * np.pi), special.ndtr(x / 2.0)
        nu = (2.0 / x) * (share - 0.5) / (x / 2.0 * share + density)
        rate += 2.0 * alpha * b * np.exp(-b * b / 2.0) / np.sqrt(2.0 * np.pi) * nu
    return float(np.interp(-np.log(run_length), np.log(rate[::-1]), b[::-1])) ** 2


def variance_table(scales: IntArray, variances: FloatArray) -> FloatArray:
    """Return the contrast's variance for a shorter half of n = 0 … MAX_SCALE used samples, interpolated in log n."""
    return np.exp(np.interp(_LOG_USED, np.log(scales), np.log(variances)))


def peaks_behind_gaps(sums: RunningSums) -> tuple[IntArray, IntArray]:
    """Return slot and scale of a peak behind each long gap without a used sample: missing telemetry, the dead band.

    No contrast of the fixed scales spans such a gap, so that a jump in it would never be detected. The peak's scale
    reaches MAX_SCALE slots beyond the gap; `kernels.changepoints.choose` tests whether there is a jump.

    Parameters
    ----------
    sums
        Running sums of the window; their checkpoints alone show where no sample is used.
    """
    arrays, slots = sums.arrays, sums.slots
    count = arrays.checkpoints[: slots // STRIDE + 1, 0]
    empty = count[1:] == count[:-1]
    begin, end = STRIDE * np.flatnonzero(np.diff(np.concatenate(([False], empty, [False])))).reshape(-1, 2).T
    found = []
    for first, stop in zip(begin.tolist(), end.tolist(), strict=True):
        there = np.flatnonzero(arrays.used[stop : min(stop + STRIDE, slots)])
        if first > 0 and stop - first >= MAX_SCALE // 2 and there.size:
            found.append((stop + int(there[0]), stop - first + MAX_SCALE))
    index, scale = np.array(found, dtype=np.int64).reshape(-1, 2).T.copy()
    return index, scale
