"""Window, prior weight and threshold of the wGLR for a wanted rate of misses and false alarms (paper, section V-A).

All in closed form for white noise. With halves of w samples and a jump Δ, the statistic GLR/σ² is χ² with one degree of
freedom without a jump, and non-central with

    λ = (Δ/σ)² · [ w/2 - S_xz² / (S_xx + W_b) ]

at a jump (errata 3), where S_xx and S_xz describe how the normalised speed moves within the 2w samples. For a steady
acceleration of a per sample, S_xx = a²·2w(4w² - 1)/12 and S_xz = a·w²/2: without a prior a ramp costs three quarters
of the information, as a step and a ramp are alike.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import stats

from rwa_monitor.errors import InputError

LONGEST_HALF: Final = 100_000  # slots; a longer window is no answer
BIAS_BUDGET: Final = 0.1  # of the statistic's unit that an error of the prior slope may add


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
        Predicted probability of a miss and mean number of samples between false alarms.
    """

    half_width: int
    threshold: float
    prior_weight: float
    information: float
    missed: float
    run_length: float


@dataclass(frozen=True, slots=True)
class TuningCheck:
    """Rates counted in a simulation, with the number of trials they rest on."""

    missed: float
    trials: int
    false_alarms: int
    samples: int


def information(jump_sigmas: float, half_width: int, acceleration: float, prior_weight: float) -> float:
    """Return λ of a jump for a steady acceleration.

    Parameters
    ----------
    jump_sigmas
        Δ/σ.
    half_width
        w [slots].
    acceleration
        Change of the normalised speed from sample to sample [-].
    prior_weight
        W_b [-].
    """
    w = float(half_width)
    s_xx = acceleration**2 * 2 * w * (4 * w * w - 1) / 12
    s_xz = acceleration * w * w / 2
    lost = s_xz**2 / (s_xx + prior_weight) if s_xz else 0.0
    return jump_sigmas**2 * (w / 2 - lost)


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
    threshold = float(stats.chi2.isf(1.0 / run_length, 1))
    prior_weight = BIAS_BUDGET * (noise_std / slope_error) ** 2
    needed = (np.sqrt(threshold) + float(stats.norm.isf(missed))) ** 2
    low, high = 1, LONGEST_HALF
    if information(jump_sigmas, high, acceleration, prior_weight) < needed:
        raise InputError(
            "tune", f"no window up to {LONGEST_HALF} slots shows a jump of {jump_sigmas:g} σ at these rates"
        )
    while low < high:
        middle = (low + high) // 2
        if information(jump_sigmas, middle, acceleration, prior_weight) >= needed:
            high = middle
        else:
            low = middle + 1
    found = information(jump_sigmas, low, acceleration, prior_weight)
    return Tuning(
        low,
        threshold,
        prior_weight,
        found,
        float(stats.ncx2.cdf(threshold, 1, found)),
        1.0 / float(stats.chi2.sf(threshold, 1)),
    )


def check(
    tuning: Tuning, jump_sigmas: float, acceleration: float, rng: np.random.Generator, trials: int = 20_000
) -> TuningCheck:
    """Count misses and false alarms of a tuning in simulated windows.

    Each trial is one window of 2w samples with unit noise, once with the jump in its middle and once without.
    """
    w = tuning.half_width
    x = acceleration * (np.arange(2 * w) - w + 0.5)
    z = np.where(np.arange(2 * w) < w, -0.5, 0.5)
    # Contrast of the jump, orthogonal to level and slope under the prior: a linear functional of the samples.
    s_xx, s_xz = float(x @ x), float(x @ z)
    direction = z - x * (s_xz / (s_xx + tuning.prior_weight)) if s_xz else z
    energy = float(direction @ z)
    missed = alarms = 0
    for begin in range(0, trials, 1000):
        count = min(1000, trials - begin)
        noise = rng.standard_normal((count, 2 * w)) @ direction
        alarms += int(np.count_nonzero(noise**2 / energy > tuning.threshold))
        missed += int(np.count_nonzero((noise + jump_sigmas * energy) ** 2 / energy <= tuning.threshold))
    return TuningCheck(missed / trials, trials, alarms, trials)
