"""Window, prior weight and threshold of the wGLR for a wanted rate of misses and false alarms (paper, section V-A).

In closed form, for white noise and a steady acceleration of a per sample, in normalised speed. With halves of w
samples, S_xx = a²·2w(4w² - 1)/12 and S_xz = a·w²/2 describe how the speed moves within the window. Then GLR/σ² is the
square of a normal variable: its mean at a jump Δ is √λ, elsewhere 0, with

    λ = (Δ/σ)² · D,   D = w/2 - S_xz² / (S_xx + W_b)

(errata 3): without a prior a ramp costs three quarters of the information, as a step and a ramp are alike. The prior
has its price. Where the slope is off by e, it shifts that mean by e/σ · S_xz · W_b / (S_xx + W_b) / √D, towards a false
alarm or towards a miss; and it takes W_b · S_xz² / (S_xx + W_b)² / D off the variance, which is 1 without it. Both are
taken into account, the shift with its worst sign.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import signal, special

from rwa_monitor.errors import InputError
from rwa_monitor.samples import FloatArray

LONGEST_HALF: Final = 100_000  # slots; a longer window is no answer
BIAS_BUDGET: Final = 0.1  # of the statistic's unit that an error of the prior slope may add
TRIALS: Final = 20_000  # of the check
SIMULATED: Final = 6_000_000  # samples at most that the check simulates for each rate
TOLERANCE: Final = 2.5  # half-widths of a 95 % interval: five standard errors, that a check does not fail by chance
CONTEXT: Final = 2  # halves of a window on each side of a false alarm, to see how long it lasts


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


@dataclass(frozen=True, slots=True)
class StatisticLaw:
    """√GLR/σ at half-widths, a normal variable: D, its standard deviation, its shift by a slope error of one σ."""

    energy: FloatArray
    std: FloatArray
    shift: FloatArray


def statistic_law(half_width: FloatArray, acceleration: float, prior_weight: float) -> StatisticLaw:
    """Return the law of √GLR/σ, see the module text.

    Parameters
    ----------
    half_width
        float64 (n,), w [slots].
    acceleration
        Steady change of the normalised speed from sample to sample [-].
    prior_weight
        W_b, in the paper's normalised units.
    """
    w = half_width.astype(np.float64)
    s_xx, s_xz = acceleration**2 * 2 * w * (4 * w * w - 1) / 12, abs(acceleration) * w * w / 2
    total = s_xx + prior_weight
    share = np.divide(s_xz, total, out=np.zeros_like(w), where=s_xz > 0)
    energy = w / 2 - share * s_xz
    return StatisticLaw(energy, np.sqrt(1.0 - prior_weight * share**2 / energy), prior_weight * share / np.sqrt(energy))


def tune(
    missed: float,
    run_length: float,
    jump_sigmas: float,
    *,
    acceleration: float = 0.0,
    slope_error: float = 0.3,
    noise_std: float = 0.024,
) -> Tuning:
    """Choose the smallest window that keeps both wanted rates.

    Parameters
    ----------
    missed
        Wanted probability of missing a jump, 0 … 1.
    run_length
        Wanted mean number of samples between false alarms.
    jump_sigmas
        Size of the jump in standard deviations of the noise.
    acceleration
        Steady change of the normalised speed from sample to sample for which the rates must hold [-].
    slope_error
        By how much the nominal viscous coefficient may be off, normalised. The prior is made as strong as such an
        error allows: W_b·error² stays a small part of σ².
    noise_std
        σ, normalised.

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
    prior_weight = BIAS_BUDGET * (noise_std / slope_error) ** 2
    half_width: FloatArray = np.arange(1, LONGEST_HALF + 1, dtype=np.float64)
    terms = statistic_law(half_width, acceleration, prior_weight)
    shift = terms.shift * slope_error / noise_std
    threshold = _threshold(shift, terms.std, 1.0 / run_length)
    reached = jump_sigmas * np.sqrt(terms.energy) - shift - threshold
    enough = np.flatnonzero(reached >= -float(special.ndtri(missed)) * terms.std)
    if enough.size == 0:
        raise InputError(
            "tune", f"no window up to {LONGEST_HALF} slots shows a jump of {jump_sigmas:g} σ at these rates"
        )
    k = int(enough[0])
    return Tuning(
        half_width=k + 1,
        threshold=float(threshold[k] ** 2),
        prior_weight=prior_weight,
        information=jump_sigmas**2 * float(terms.energy[k]),
        missed=float(special.ndtr(-reached[k] / terms.std[k])),
        run_length=1.0 / float(_above(threshold[k], shift[k], terms.std[k])),
    )


def _above(threshold: FloatArray, shift: FloatArray, std: FloatArray) -> FloatArray:
    """Return the probability that |shift + std · N(0, 1)| exceeds the threshold."""
    return np.asarray(special.ndtr((shift - threshold) / std) + special.ndtr(-(threshold + shift) / std))


def _threshold(shift: FloatArray, std: FloatArray, probability: float) -> FloatArray:
    """Return the threshold that |shift + std · N(0, 1)| exceeds with a probability, by bisection; float64 (n,)."""
    low = np.zeros_like(shift)
    high = shift + std * float(-special.ndtri(probability / 2.0))  # enough: both tails are below half of it there
    for _ in range(60):  # bisections of a number of order 10: down to its last bit
        middle = 0.5 * (low + high)
        too_low = _above(middle, shift, std) > probability
        low, high = np.where(too_low, middle, low), np.where(too_low, high, middle)
    return high


# ---- the check -------------------------------------------------------------------------------------------------------


def check(
    tuning: Tuning,
    jump_sigmas: float,
    acceleration: float,
    rng: np.random.Generator,
    *,
    slope_error: float = 0.3,
    noise_std: float = 0.024,
    trials: int = TRIALS,
) -> TuningCheck:
    """Measure the rates of a tuning by simulation, however rare the events are.

    Windows of noise are drawn where misses and false alarms happen, and weighted back (importance sampling): with the
    noise moved along the contrast so that the statistic lies about its threshold. The contrast comes from the two
    regressions themselves, solved numerically. How long a false alarm lasts is seen by sliding the window: an alarm of
    C samples in a row counts 1/C at each of them.

    Parameters
    ----------
    tuning, jump_sigmas, acceleration, slope_error, noise_std
        What was tuned, and the arguments that it was tuned for. The slope is off by `slope_error`, to the worse side.
    rng
        For the noise.
    trials
        Windows for each rate; fewer where windows are long.
    """
    w, threshold = tuning.half_width, np.sqrt(tuning.threshold)
    contrast, ramp = _contrast(w, acceleration, tuning.prior_weight)
    length = 2 * w * (1 + CONTEXT)
    trials = max(min(trials, SIMULATED // length), 100)
    step = np.where(np.arange(2 * w) < w, 0.0, jump_sigmas)
    off = slope_error / noise_std
    towards = -np.sign(contrast @ ramp) or 1.0  # the sign of the slope error that makes the jump look smaller
    signal_ = step + towards * off * ramp
    mean, norm = float(contrast @ signal_), float(np.linalg.norm(contrast))
    tilt = (threshold - mean) / norm
    noise = rng.standard_normal((trials, 2 * w)) + tilt * contrast / norm
    weight = np.exp(-tilt * (noise @ contrast) / norm + tilt**2 / 2.0)
    missed = weight * ((noise + signal_) @ contrast < threshold)
    above, alarms = _false_alarms(contrast, ramp, off, threshold, rng, trials, length)
    per_sample, per_alarm = _mean(above), _mean(alarms)
    return TuningCheck(_mean(missed), _inverse(per_sample), _inverse(per_alarm), trials)


def _contrast(w: int, acceleration: float, prior_weight: float) -> tuple[FloatArray, FloatArray]:
    """Return c with GLR = (c · y)², and the ramp of the speed; float64 (2w,) each.

    The prior of the slope is one more observation: the value 0 of √W_b · f_v.
    """
    ramp: FloatArray = acceleration * (np.arange(2 * w, dtype=np.float64) - w + 0.5)
    step = np.append(np.arange(2 * w) >= w, 0.0)
    slope = np.append(ramp, np.sqrt(prior_weight))
    common = np.column_stack([np.append(np.ones(2 * w), 0.0), slope])
    basis, _ = np.linalg.qr(common)
    left: FloatArray = step - basis @ (basis.T @ step)
    return left[:-1] / float(np.linalg.norm(left)), ramp


def _false_alarms(
    contrast: FloatArray,
    ramp: FloatArray,
    off: float,
    threshold: float,
    rng: np.random.Generator,
    trials: int,
    length: int,
) -> tuple[FloatArray, FloatArray]:
    """Return for each trial its weighted count of samples above the threshold and of alarms; float64 (trials,) each."""
    w, norm = contrast.size // 2, float(np.linalg.norm(contrast))
    shift = off * float(contrast @ ramp)
    begin = length // 2 - w  # of the window in the middle of a stretch
    toward = rng.choice([-1.0, 1.0], trials)
    # Both sides of the threshold are drawn, each as often; the slope's shift makes one nearer than the other.
    tilt = (toward * threshold - shift) / norm
    noise = rng.standard_normal((trials, length))
    noise[:, begin : begin + 2 * w] += tilt[:, None] * contrast / norm
    along = noise[:, begin : begin + 2 * w] @ contrast / norm
    sides = [np.exp(t * along - t * t / 2.0) for t in ((threshold - shift) / norm, (-threshold - shift) / norm)]
    weight = 2.0 / (sides[0] + sides[1])
    # The shift by the slope's error is the same at every place: a steady acceleration looks alike everywhere.
    statistic = np.abs(signal.fftconvolve(noise, contrast[None, ::-1], mode="valid", axes=1) + shift) > threshold
    above = statistic[:, begin]
    # The run of samples above the threshold that holds the middle one.
    after = np.argmin(statistic[:, begin:], axis=1)
    before = np.argmin(statistic[:, begin::-1], axis=1)
    # argmin gives 0 where all are above: a run longer than what was looked at counts with the length seen.
    after = np.where(statistic[:, begin:].all(axis=1), statistic.shape[1] - begin, after)
    before = np.where(statistic[:, begin::-1].all(axis=1), begin + 1, before)
    run = np.maximum(after + before - 1, 1)
    return weight * above, weight * above / run


def _mean(values: FloatArray) -> Measured:
    mean = float(values.mean())
    half = float(-special.ndtri(0.025) * values.std() / np.sqrt(values.size))
    return Measured(mean, max(mean - half, 0.0), mean + half)


def _inverse(rate: Measured) -> Measured:
    infinite = float("inf")
    return Measured(*(1.0 / rate_ if rate_ > 0 else infinite for rate_ in (rate.value, rate.high, rate.low)))
