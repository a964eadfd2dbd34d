"""The evidence of one window, gathered sample by sample: stage 1 as it runs live.

A `WindowAccumulator` takes the slots of one window in any pieces and keeps their running sums, the wGLR's peaks at all
scales and what is known of the noise, in memory of fixed size. `close` makes the window's `Evidence` of them without
another look at the samples, but for a few around each candidate.

Nothing depends on how the slots arrive: work is done in steps that end at fixed slots of the window, with settings
(variances, floors) that change at fixed slots only.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy import special

from rwa_monitor.diagnosis.candidates import choose
from rwa_monitor.diagnosis.changepoints import (
    TESTS_PER_SLOT,
    in_turn,
    suppress,
    threshold_for,
)
from rwa_monitor.diagnosis.estimation import (
    SlopePrior,
    estimate_slope,
    nominal_slope_prior,
)
from rwa_monitor.diagnosis.evidence_kernel import (
    CONFIRMED_STATISTIC,
    KEPT_STATISTIC,
    Judge,
    WindowArrays,
    WindowSettings,
    advance,
    bars,
    judge_confirmed,
    learn_noise,
    mark_used,
    median_bend,
    median_step,
    take,
)
from rwa_monitor.diagnosis.noise import (
    BLOCK,
    LAGS,
    SMALLEST_STD,
    estimate_noise,
)
from rwa_monitor.diagnosis.peaks import PeakList
from rwa_monitor.diagnosis.results import Candidates, Evidence, Method, NoiseEstimate
from rwa_monitor.diagnosis.running_sums import RunningSums
from rwa_monitor.diagnosis.structure import StructureSums, pieces_before
from rwa_monitor.diagnosis.tails import Tails, estimate_tails
from rwa_monitor.diagnosis.wglr import (
    BINS,
    CHUNK,
    HISTORY,
    PREFIXES,
    STEP,
    ScanSettings,
    ScanState,
    scan,
)
from rwa_monitor.physics.wheel import Wheel
from rwa_monitor.samples import BoolArray, FloatArray, IntArray

JOINT_SCALES: Final = (1, 2, 4, 8, 16, 32, 64, 128)
PAPER_SCALES: Final = (50,)
PAPER_WEIGHT: Final = 1e-4  # W_b, in the paper's units
SMALLEST_WEIGHT: Final = 1e-12  # W_b where nothing is known of the slope: only keeps 0/0 away

PEAK_TESTS_PER_SLOT: Final = 1.5  # independent tests that the peaks of all scales are, a slot: Σ 1/w, hardly less
FALSE_CANDIDATES: Final = 0.3  # bearable in a window without a jump; the assignment sorts them out
CERTAIN_STATISTIC: Final = 30.0  # peaks that split the window while its slope is first estimated
SMALLEST_SLOPE_SPREAD: Final = 0.05  # [of the slope] the slope known so far is never trusted further than that
ANY_SLOPE: Final = 3.0  # times the slope learned or nominal: no anomaly of viscous friction is further off
SMALLEST_SLOPE: Final = 0.1  # of the dry torque at nominal speed, for a wheel with next to no viscous friction
FAR_AWAY: Final = -(2**40)  # a slot that lies near none
SPEED_NOISES: Final = 5.0  # dead band in standard deviations of the speed's noise: the sign of ω is certain beyond


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
    """The samples that a window has gathered: all that another accumulator needs to go on alike.

    Attributes
    ----------
    x, z
        float64 (n,), normalised; NaN where not good.
    turns
        int64 (blocks,), see `StructureSums.turns`.
    """

    x: FloatArray
    z: FloatArray
    turns: IntArray


class WindowAccumulator:
    """Gathers the evidence of one window.

    Parameters
    ----------
    wheel
        The wheel: units, nominal slope and noise, dead band.
    method
        "joint": several scales, each by the variance of its own contrast. "paper": one scale, contiguous runs.
    slots
        Length of the window; the wheel's where None.
    slope_prior
        What earlier windows say of the viscous coefficient; the wheel's nominal one where None.
    false_candidates
        Candidates wanted by chance in a window without a jump (joint).

    Examples
    --------
    >>> import numpy as np
    >>> from rwa_monitor.physics.wheel import built_in_wheel
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

    def __init__(
        self,
        wheel: Wheel,
        method: Method = "joint",
        slots: int | None = None,
        slope_prior: SlopePrior | None = None,
        false_candidates: float = FALSE_CANDIDATES,
    ) -> None:
        self.wheel = wheel
        self.method: Method = method
        self.slots = wheel.window.samples if slots is None else slots
        self.filled = 0
        self.good = 0
        self.slope_prior = nominal_slope_prior(wheel) if slope_prior is None else slope_prior
        self.false_candidates = false_candidates
        self._speed_unit = wheel.speed_unit_rad_s
        self._torque_unit = wheel.torque_unit_Nm
        start_std = wheel.noise.friction_std_Nm
        self._start_std = None if start_std is None else start_std / self._torque_unit

        self._x: FloatArray = np.empty(self.slots)
        self._z: FloatArray = np.empty(self.slots)
        self._good: BoolArray = np.empty(self.slots, dtype=np.bool_)
        self._used: BoolArray = np.zeros(self.slots, dtype=np.bool_)
        self._sums = RunningSums(self._x, self._z, self._used)
        self._structure = StructureSums(self.slots, self._speed_unit * wheel.sample_period_s)
        self._done = 0  # slots that detection has seen
        self._closed = False

        scales: tuple[int, ...] = PAPER_SCALES if method == "paper" else JOINT_SCALES
        if self.slope_prior is None:
            # Without any idea of the slope, two neighbouring samples say nothing about a jump.
            scales = tuple(w for w in scales if w > 1)
        self._scales: IntArray = np.array(scales, dtype=np.int64)
        self._strides: IntArray = np.maximum(self._scales // 4, 1)
        self._peaks = PeakList(self._scales)
        self._announced: IntArray = np.full(STEP + 1, FAR_AWAY, dtype=np.int64)  # the last ones, in turns; how many
        self._announced[STEP] = 0
        self._variances: FloatArray = np.full(self._scales.size, np.nan)
        self._floors: FloatArray = np.full(self._scales.size, np.inf)
        self._sure: FloatArray = np.full(self._scales.size, np.inf)
        self._weight = PAPER_WEIGHT
        self._slope = 0.0 if self.slope_prior is None else self.slope_prior.mean
        self._band = np.inf  # dead band, normalised; known once the first chunk is there
        self._certain = np.inf  # speed from which its sign is certain, normalised; known with the dead band
        self._state = ScanState(
            prefix=np.empty((PREFIXES, HISTORY + CHUNK + 1)),
            histogram=np.zeros((self._scales.size, BINS), dtype=np.int64),
        )

        # Short windows let the blocks of the noise estimate overlap.
        self._hop = BLOCK if self.slots <= 128 * BLOCK else 4 * BLOCK
        blocks = max(0, (self.slots - BLOCK - LAGS) // self._hop + 1)
        self._block_sums: FloatArray = np.empty((blocks, LAGS))
        self._block_pairs: FloatArray = np.empty((blocks, LAGS))
        structure = self._structure.arrays
        self._arrays = tuple(
            WindowArrays(
                x=self._x,
                z=self._z,
                good=self._good,
                used=self._used,
                checkpoints=self._sums.arrays.checkpoints,
                centre=self._sums.arrays.centre,
                running=self._sums.running,
                signs=structure.signs,
                counts=structure.counts,
                near_zero=structure.near_zero,
                zeros=structure.zeros,
                ripple=structure.ripple,
                block_sums=self._block_sums,
                block_pairs=self._block_pairs,
                prefix=self._state.prefix,
                histogram=self._state.histogram,
            )
        )

    # ---- samples in ------------------------------------------------------------------------------------------------

    def append(self, speed_rad_s: FloatArray, torque_Nm: FloatArray, good: BoolArray) -> list[ConfirmedCandidate]:
        """Take the next slots and return the jumps that became certain.

        Parameters
        ----------
        speed_rad_s, torque_Nm
            float64 (n,), speed and resisting friction torque of consecutive slots; anything where not good.
        good
            bool (n,), slots that hold a good sample; a value that is not finite, or absurd, is not good.

        Raises
        ------
        ValueError
            If the window cannot hold that many slots, or is closed.
        """
        count = speed_rad_s.size
        if self._closed or self.filled + count > self.slots:
            raise ValueError(f"{count} more slots do not fit into a window with {self.filled} of {self.slots}")
        structure = self._structure.arrays
        self.good += take(
            speed_rad_s,
            torque_Nm,
            good,
            self.filled,
            self._speed_unit,
            self._torque_unit,
            (self._x, self._z, self._good),
            (structure.signs, structure.counts),
        )
        self.filled += count
        return self._advance(self.filled - self.filled % STEP)

    def gathered(self) -> Gathered:
        """Return the samples so far."""
        good = self._good[: self.filled]
        x, z = (np.where(good, values[: self.filled], np.nan) for values in (self._x, self._z))
        return Gathered(x, z, self._structure.turns(self.filled))

    def resume(self, gathered: Gathered) -> None:
        """Take the samples that another accumulator had gathered, instead of `append`; what they confirm was told.

        Raises
        ------
        ValueError
            If samples were taken before, or the window cannot hold so many.
        """
        count = gathered.x.size
        if self.filled or count > self.slots or gathered.z.size != count:
            raise ValueError(f"{count} slots do not fit into a window with {self.filled} of {self.slots}")
        good = np.isfinite(gathered.x) & np.isfinite(gathered.z)
        self._x[:count] = np.where(good, gathered.x, 0.0)
        self._z[:count] = np.where(good, gathered.z, 0.0)
        self._good[:count] = good
        self.good = int(good.sum())
        self._structure.resume(gathered.turns, good)
        self.filled = count
        self._advance(count - count % STEP)

    def close(self) -> Evidence:
        """End the window, full or not, and return its evidence.

        Raises
        ------
        ValueError
            If the window is closed already.
        """
        if self._closed:
            raise ValueError("the window is closed already")
        self._advance(self.filled, last=True)
        self._closed = True
        levels, counts, tails = self._refresh()
        noise = estimate_noise(levels, counts, self._scales, self._variances, self._sums.count, self._start_std)
        threshold = self._threshold()
        evidence = self._evidence(noise, self._peaks.above(threshold, self._variances), threshold)
        if self.method == "paper":
            return evidence  # the paper's runs as they are
        candidates = choose(evidence, self._scales, self._variances, tails, self.slope_prior)
        return replace(evidence, candidates=candidates)

    def _evidence(self, noise: NoiseEstimate, candidates: Candidates, threshold: float) -> Evidence:
        """Return the evidence of the slots seen so far."""
        return Evidence(
            slots=self._done,
            good=self.good,
            used=self._sums.count,
            candidates=candidates,
            sums=self._sums,
            noise=noise,
            threshold=threshold,
            structure=self._structure.close(),
        )

    # ---- detection -------------------------------------------------------------------------------------------------

    def _advance(self, ready: int, last: bool = False) -> list[ConfirmedCandidate]:
        """Detect in all slots up to `ready`. Begins when a chunk is there to learn the noise from."""
        if self._done == 0:
            if ready < CHUNK and not last:
                return []
            self._start(min(ready, CHUNK))
        events: list[ConfirmedCandidate] = []
        while self._done < ready:
            stop = min(ready, _settings_change(self._done))
            if self._done % CHUNK == 0:
                self._peaks.make_room(self._variances)
            end, confirmed = advance(
                self._done,
                stop,
                self._arrays,
                self._window_numbers,
                self._scan_numbers,
                tuple(self._peaks.arrays),
                self._peaks.chunk_peaks,
            )
            self._done = self._sums.slots = end
            if confirmed:
                events.extend(self._announce())
            chunks, rest = divmod(end, CHUNK)
            if rest == 0 and chunks > 1 and chunks & (chunks - 1) == 0:
                self._refresh()  # after 2, 4, 8 … chunks
                if chunks.bit_length() % 2 == 0:
                    self._learn_slope()  # after 2, 8, 32 … chunks
        return events

    def _start(self, stop: int) -> None:
        """Learn dead band, weight of the prior and first variances from the slots [0, stop)."""
        self._certain = self._certain_speed(stop)
        band = self.wheel.window.dead_band_rad_s
        self._band = self._certain if band is None else band / self._speed_unit
        mark_used(self._x, self._good, self._band, 0, stop, self._used)
        if self.slope_prior is None:
            self._weight = SMALLEST_WEIGHT
        elif self.method == "joint":
            std = self._start_std if self._start_std is not None else self._difference_std(stop)
            self._weight = max(std, SMALLEST_STD) ** 2 / self.slope_prior.std**2
        structure = self._structure
        self._window_settings = WindowSettings(
            self._band, self._certain, structure.angle_per_x, self._hop, structure.hop
        )
        self._window_numbers = tuple(self._window_settings)
        self._settle()
        settings, peaks = self._scan_settings, self._peaks
        scan(self._x, self._z, self._used, 0, stop, True, settings, self._state, peaks.arrays, peaks.chunk_peaks)
        self._refresh()

    def _certain_speed(self, stop: int) -> float:
        """Return the speed from which its sign is certain, normalised, from its noise in the slots [0, stop)."""
        # The second difference of a smooth speed is noise, of √6 times its standard deviation.
        bend = median_bend(self._x[:stop], self._good[:stop])
        return float(SPEED_NOISES * bend / (_NORMAL_MEDIAN * np.sqrt(6.0)))

    def _difference_std(self, stop: int) -> float:
        """Return the noise's standard deviation as neighbour differences show it in the slots [0, stop)."""
        step = median_step(self._x[:stop], self._z[:stop], self._used[:stop], self._slope)
        return float(step / (_NORMAL_MEDIAN * np.sqrt(2.0)))

    def _refresh(self) -> tuple[FloatArray, FloatArray, Tails]:
        """Bring the variance of each scale, and what is kept and announced, up to date.

        Returns what it learned: levels and counts of `quiet_levels`, and the tails of the noise.
        """
        start = math.nan if self._start_std is None else self._start_std**2
        blocks = pieces_before(self._done, BLOCK + LAGS, self._hop, self._block_sums.shape[0])
        levels, counts, self._variances, quantiles = learn_noise(
            self._block_sums[:blocks],
            self._block_pairs[:blocks],
            self._state.histogram,
            self._scales,
            self._strides,
            start,
        )
        tails = self._tails(quantiles)
        self._sure, kept = bars(self._variances, self._scales, tails.largest_outlier)
        self._floors = self._sure if self.method == "paper" else kept
        self._settle()
        return levels, counts, tails

    def _learn_slope(self) -> None:
        """Centre the slope's prior on what the window has shown so far; takes effect with the next chunk."""
        known = self._variances[np.isfinite(self._variances)]
        variance = float(known.max()) if known.size else 0.0
        if self.method == "paper" or variance == 0.0 or self._sums.count < CHUNK:
            return
        noise = NoiseEstimate(float(np.sqrt(variance)), np.full(1, variance), 1.0)
        certain = suppress(in_turn(self._peaks.above(CERTAIN_STATISTIC, self._variances)))
        slope, std = estimate_slope(self._sums, noise, certain, STEP // 4, self.slope_prior)
        if np.isfinite(std):
            self._slope = slope
            spread = max(std, SMALLEST_SLOPE_SPREAD * abs(slope), SMALLEST_STD)
            self._weight = max(variance / spread**2, SMALLEST_WEIGHT)
            self._settle()

    def _settle(self) -> None:
        """Let detection go on with the slope, variances, floors as they are known now.

        In a slew, a slope that is off by some per cent looks like jumps: that of the nominal wheel while viscous
        friction is anomalous, that of an earlier part of the window while the anomaly grows. Only a peak that stays one
        for any slope is certain while the window is open; at its close the window's own slope decides.
        """
        self._scan_settings = ScanSettings(
            self._scales, self._weight, self._slope, self._floors, self._sure, self.method == "paper"
        )
        self._scan_numbers = tuple(self._scan_settings)
        nominal = self.slope_prior.mean if self.slope_prior else 0.0
        most_slope = ANY_SLOPE * max(abs(self._slope), abs(nominal), SMALLEST_SLOPE)
        self._judge = tuple(Judge(self._scales, self._variances, self._sure, self._weight, self._slope, most_slope))

    def _tails(self, quantiles: tuple[float, int, int]) -> Tails:
        variance = float(self._variances[0])
        if self.method == "paper" or not math.isfinite(variance):
            return Tails(math.inf, 0.0)  # the paper takes the noise as Gaussian
        return estimate_tails(quantiles, variance, self.slots)

    def _announce(self) -> list[ConfirmedCandidate]:
        """Return the newly confirmed peaks, unless a narrower scale has announced the same jump."""
        if self.method == "paper":
            index, values = self._peaks.confirmed(self._variances)
        else:
            index, values = judge_confirmed(
                tuple(self._peaks.arrays), self._judge, tuple(self._sums.arrays), self._announced
            )
        chance = PEAK_TESTS_PER_SLOT * self.slots * special.chdtrc(1, values[2])
        columns = (index, values[0], values[1], np.maximum(1.0 - chance, 0.0))
        return [ConfirmedCandidate(*row) for row in zip(*(column.tolist() for column in columns), strict=True)]

    # ---- at the close ----------------------------------------------------------------------------------------------

    def _threshold(self) -> float:
        if self.method == "paper":
            return CONFIRMED_STATISTIC
        return max(threshold_for(self.false_candidates, TESTS_PER_SLOT * self._sums.count), KEPT_STATISTIC)


def _settings_change(slot: int) -> int:
    """Return the first slot beyond `slot` at which variances, floors or slope change: after 1, 2, 4, 8 … chunks."""
    return CHUNK << (slot // CHUNK).bit_length()


_NORMAL_MEDIAN: Final = float(special.ndtri(0.75))  # median of |N(0, 1)|
