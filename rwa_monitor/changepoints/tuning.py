"""Window, prior weight and threshold of the wGLR for a wanted rate of misses and false alarms (paper, section V-A).

In closed form, for white noise at constant speed: with halves of w samples GLR/σ² is the square of a normal variable of
variance 1, whose mean at a jump Δ is √λ, λ = (Δ/σ)² · w/2, and elsewhere 0. The check by simulation assumes a steady
acceleration too, which costs information (errata 3): within a window a step and a ramp of the speed are correlated.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.random import Generator
from scipy import signal, special

from rwa_monitor.errors import InputError
from rwa_monitor.samples import FloatArray

LONGEST_HALF: Final = 100_000  # slots; a longer window is of no practical use
# W_b, normalised: an error of 0.3 in the viscous coefficient then costs W_b·0.3², a tenth of σ² (the unit of the
# statistic), for noise with a σ of 0.024.
PRIOR_WEIGHT: Final = 0.1 * (0.024 / 0.3) ** 2
TRIALS: Final = 20_000  # of the check
SIMULATED: Final = 6_000_000  # samples at most that the check simulates for each rate
TOLERANCE: Final = 2.5  # half-widths of a 95 % interval: five standard errors, so that no check fails by chance
CONTEXT: Final = 2  # half-windows on each side of a false alarm, to measure its duration


@dataclass(frozen=True, slots=True)
class Tuning:
    """Settings of the wGLR.

    Attributes
    ----------
    half_width
        w [slots].
    threshold
        Of GLR/σ² [-].
    prior_weight
        W_b, in the paper's normalised units, for the stated noise.
    information
        λ of the jump with these settings.
    missed, run_length
        Predicted probability of a miss and mean number of samples between samples above the threshold.
    """

    half_width: int
    threshold: float
    prior_weight: float
    information: float
    missed: float
    run_length: float


@dataclass(frozen=True, slots=True)
class Measured:
    """A figure from a simulation with its 95 % interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class TuningCheck:
    """The result of a simulation of a tuning.

    Attributes
    ----------
    missed
        Probability of a miss.
    run_length
        Mean number of samples between samples above the threshold, as the closed form counts.
    alarm_run_length
        Mean number of samples between alarms: samples in a row above the threshold are one alarm.
    trials
        Windows simulated for each rate.
    """

    missed: Measured
    run_length: Measured
    alarm_run_length: Measured
    trials: int

    def keeps(self, missed: float, run_length: float) -> bool:
        """Whether the simulation does not contradict the wanted rates, by more than five standard errors."""
        least = self.missed.value - TOLERANCE * (self.missed.value - self.missed.low)
        rate = 1.0 / self.run_length.value
        least_rate = rate - TOLERANCE * (1.0 / self.run_length.low - rate)
        return least <= missed and least_rate <= 1.0 / run_length


def tune(missed: float, run_length: float, jump_sigmas: float) -> Tuning:
    """Choose the smallest window that keeps both wanted rates.

    Parameters
    ----------
    missed
        Wanted probability of missing a jump, 0 … 1.
    run_length
        Wanted mean number of samples between false alarms.
    jump_sigmas
        Size of the jump in standard deviations of the noise.

    Raises
    ------
    InputError
        If a wish is out of range, or no window keeps it.
    """
    for name, value, low, high in (
        ("--missed", missed, 0.0, 0.5),
        ("--run-length", run_length, 2.0, 1e300),
        ("--jump", jump_sigmas, 0.0, 1e6),
    ):
        if not low < value < high:
            raise InputError(name, f"{value:g} is not between {low:g} and {high:g}")
    energy = np.arange(1, LONGEST_HALF + 1) / 2
    threshold = -float(special.ndtri(0.5 / run_length))
    reached = jump_sigmas * np.sqrt(energy) - threshold
    enough = np.flatnonzero(reached >= -float(special.ndtri(missed)))
    if enough.size == 0:
        raise InputError(
            "tune", f"no window up to {LONGEST_HALF} slots shows a jump of {jump_sigmas:g} σ at these rates"
        )
    k = int(enough[0])
    return Tuning(
        half_width=k + 1,
        threshold=threshold**2,
        prior_weight=PRIOR_WEIGHT,
        information=jump_sigmas**2 * float(energy[k]),
        missed=float(special.ndtr(-reached[k])),
        run_length=0.5 / float(special.ndtr(-threshold)),
    )


# ---- the check -------------------------------------------------------------------------------------------------------


def check(
    tuning: Tuning, jump_sigmas: float, acceleration: float, rng: Generator, *, trials: int = TRIALS
) -> TuningCheck:
    """Measure the rates of a tuning by simulation, however rare the events are.

    Importance sampling: the noise is shifted along the contrast so that the statistic scatters about its threshold,
    and each draw is weighted by its likelihood ratio. The contrast comes from the two regressions themselves, solved
    numerically. Sliding the window gives the duration of a false alarm: one of C samples in a row counts 1/C at each.

    Parameters
    ----------
    tuning, jump_sigmas
        The tuning, and the jump that it was made for [standard deviations of the noise].
    acceleration
        Steady change of the normalised speed from sample to sample [-]; the prior slope is correct.
    rng
        For the noise.
    trials
        Windows for each rate; fewer where windows are long.
    """
    w, threshold = tuning.half_width, np.sqrt(tuning.threshold)
    contrast = _contrast(w, acceleration, tuning.prior_weight)
    length = 2 * w * (1 + CONTEXT)
    trials = max(min(trials, SIMULATED // length), 100)
    step = np.where(np.arange(2 * w) < w, 0.0, jump_sigmas)
    mean, norm = float(contrast @ step), float(np.linalg.norm(contrast))
    tilt = (threshold - mean) / norm
    noise = rng.standard_normal((trials, 2 * w)) + tilt * contrast / norm
    weight = np.exp(-tilt * (noise @ contrast) / norm + tilt**2 / 2.0)
    missed = weight * ((noise + step) @ contrast < threshold)
    above, alarms = _false_alarms(contrast, threshold, rng, trials, length)
    per_sample, per_alarm = _mean(above), _mean(alarms)
    return TuningCheck(_mean(missed), _inverse(per_sample), _inverse(per_alarm), trials)


def _contrast(w: int, acceleration: float, prior_weight: float) -> FloatArray:
    """Return c with GLR = (c · y)², float64 (2w,).

    The prior of the slope is one more observation: the value 0 of √W_b · f_v.
    """
    ramp: FloatArray = acceleration * (np.arange(2 * w, dtype=np.float64) - w + 0.5)
    step = np.append(np.arange(2 * w) >= w, 0.0)
    slope = np.append(ramp, np.sqrt(prior_weight))
    common = np.column_stack([np.append(np.ones(2 * w), 0.0), slope])
    basis, _ = np.linalg.qr(common)
    left: FloatArray = step - basis @ (basis.T @ step)
    return left[:-1] / float(np.linalg.norm(left))


def _false_alarms(
    contrast: FloatArray, threshold: float, rng: Generator, trials: int, length: int
) -> tuple[FloatArray, FloatArray]:
    """Return for each trial its weighted count of samples above the threshold and of alarms; float64 (trials,) each."""
    w, norm = contrast.size // 2, float(np.linalg.norm(contrast))
    begin = length // 2 - w  # of the window in the middle of the simulated segment
    toward = rng.choice([-1.0, 1.0], trials)
    tilt = toward * threshold / norm  # both sides of the threshold are drawn, each as often
    noise = rng.standard_normal((trials, length))
    noise[:, begin : begin + 2 * w] += tilt[:, None] * contrast / norm
    along = noise[:, begin : begin + 2 * w] @ contrast / norm
    sides = [np.exp(t * along - t * t / 2.0) for t in (threshold / norm, -threshold / norm)]
    weight = 2.0 / (sides[0] + sides[1])
    statistic = np.abs(signal.fftconvolve(noise, contrast[None, ::-1], mode="valid", axes=1)) > threshold
    above = statistic[:, begin]
    # The run of samples above the threshold that holds the middle one.
    ended = np.pad(statistic, ((0, 0), (1, 1)))  # a run beyond the simulated segment is cut to it
    after, before = (np.argmin(ended[:, begin + 1 :: step], axis=1) for step in (1, -1))
    run = np.maximum(after + before - 1, 1)
    return weight * above, weight * above / run


def _mean(values: FloatArray) -> Measured:
    mean = float(values.mean())
    half = float(-special.ndtri(0.025) * values.std() / np.sqrt(values.size))
    return Measured(mean, max(mean - half, 0.0), mean + half)


def _inverse(rate: Measured) -> Measured:
    infinite = float("inf")
    return Measured(*(1.0 / rate_ if rate_ > 0 else infinite for rate_ in (rate.value, rate.high, rate.low)))
