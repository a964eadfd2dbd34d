"""The paper's figure of the average run length (ARL) at 0.1 % missed jumps, in closed form, for a stated ω(t).

The paper does not state the speed profile (errata 3), and the information λ of a jump depends on it: within 2w samples
a step and a ramp of the speed are similar. So each curve is for a constant acceleration: normalised speed per sample.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import optimize, special, stats

from rwa_monitor.changepoints.tuning import Tuning, TuningCheck, check
from rwa_monitor.samples import FloatArray

MISSED: Final = 1e-3  # the paper's missed detection rate
JUMP_SIGMAS: Final = 3.0  # the paper's jump in its figure over w and W_b
PAPER_WEIGHTS: Final = (1e-8, 1e-6, 1e-4)  # W_b; the paper's text names the outer two
PAPER_WINDOW: Final = 20
PAPER_RUN_LENGTHS: Final = {1e-8: 1e4, 1e-4: 1e10}  # as the paper's text reads them off its figure, at w = 20
NOISE_STD: Final = 0.024  # σ of the paper's data, normalised (errata, figures of the paper)
SLOPE_ERRORS: Final = (0.0, 0.03, 0.1, 0.3, 1.0, 3.0)  # f̃_v - f_v, normalised: f_v is about 1
SIMULATED_AT: Final = (10, 20, 40)  # w [slots] of the simulated points in the picture
LONGEST_RUN: Final = 1e18  # samples; a longer ARL only means "never"


@dataclass(frozen=True, slots=True)
class StatisticLaw:
    """Law of √GLR/σ, a normal variable: D, its standard deviation, and its shift by a slope error of one σ."""

    energy: float
    std: float
    shift: float


def law_of(half_width: int, weight: float, acceleration: float) -> StatisticLaw:
    """Return the law of √GLR/σ at a half-width w [slots]; the arguments are those of `run_length`.

    S_xx = a²·2w(4w² - 1)/12 and S_xz = a·w²/2 describe how the speed moves within the window. The mean at a jump is
    (Δ/σ)·√D with D = w/2 - S_xz²/(S_xx + W_b) (errata 3). A slope error e shifts it by
    e/σ · S_xz·W_b/(S_xx + W_b)/√D; the prior reduces the variance, 1 without it, by W_b·S_xz²/(S_xx + W_b)²/D.
    """
    w = float(half_width)
    s_xx, s_xz = acceleration**2 * 2 * w * (4 * w * w - 1) / 12, abs(acceleration) * w * w / 2
    share = s_xz / (s_xx + weight) if s_xz else 0.0
    energy = w / 2 - share * s_xz
    return StatisticLaw(
        energy, float(np.sqrt(1.0 - weight * share**2 / energy)), weight * share / float(np.sqrt(energy))
    )


def run_length(
    half_width: int, weight: float, acceleration: float, jump_sigmas: float = JUMP_SIGMAS, missed: float = MISSED
) -> float:
    """Return the ARL [samples] of the threshold at which a jump is missed with a given probability (paper, V-A).

    Parameters
    ----------
    half_width
        w [slots].
    weight
        W_b, in the paper's normalised units.
    acceleration
        Change of the normalised speed from sample to sample.
    jump_sigmas
        Δf/σ.
    missed
        Probability of a miss.

    Notes
    -----
    As the paper: at a jump GLR/σ² is non-central χ² with λ = (Δf/σ)²·D, elsewhere central; the ARL is one over the
    probability that a sample exceeds the threshold.
    """
    return _at_most(stats.chi2.sf(_threshold(half_width, weight, acceleration, jump_sigmas, missed), 1))


def true_run_length(half_width: int, weight: float, acceleration: float, slope_error: float = 0.0) -> float:
    """Return the ARL [samples] at the same threshold by GLR's true law, where f̃_v - f_v is `slope_error`.

    A prior acts as one more observation, without noise: it reduces the variance of the statistic, which is then not χ².
    A wrong prior of the slope also shifts the statistic; the less favourable sign of the error is assumed.
    """
    law, threshold = law_of(half_width, weight, acceleration), _threshold(half_width, weight, acceleration)
    shift = law.shift * slope_error / NOISE_STD
    sides = special.ndtr((np.array([shift, -shift]) - np.sqrt(threshold)) / law.std)
    return _at_most(float(sides.sum()))


def true_missed(half_width: int, weight: float, acceleration: float, slope_error: float = 0.0) -> float:
    """Return the probability of missing a jump of 3σ at the same threshold, by GLR's true law."""
    law, threshold = law_of(half_width, weight, acceleration), _threshold(half_width, weight, acceleration)
    mean = JUMP_SIGMAS * np.sqrt(law.energy) - law.shift * slope_error / NOISE_STD
    return float(special.ndtr((np.sqrt(threshold) - mean) / law.std))


def _at_most(probability: float) -> float:
    return float(1.0 / max(probability, 1.0 / LONGEST_RUN))


def _threshold(
    half_width: int, weight: float, acceleration: float, jump_sigmas: float = JUMP_SIGMAS, missed: float = MISSED
) -> float:
    information = jump_sigmas**2 * law_of(half_width, weight, acceleration).energy
    return float(stats.ncx2.ppf(missed, 1, information))


def simulate_run_length(weight: float, acceleration: float, seed: int, half_width: int = PAPER_WINDOW) -> TuningCheck:
    """Measure run length and misses by simulation, for a jump of 3σ and the threshold of `run_length`.

    Parameters
    ----------
    weight, acceleration, half_width
        As for `run_length`; the slope's prior is right.
    seed
        Of the noise.
    """
    tuning = Tuning(
        half_width=half_width,
        threshold=_threshold(half_width, weight, acceleration),
        prior_weight=weight,
        information=JUMP_SIGMAS**2 * law_of(half_width, weight, acceleration).energy,
        missed=MISSED,
        run_length=run_length(half_width, weight, acceleration),
    )
    return check(tuning, JUMP_SIGMAS, acceleration, np.random.default_rng(seed))


def acceleration_of_the_paper() -> float:
    """Return the steady acceleration at which w = 20 and W_b = 1e-8 give the paper's ARL of 1e4 [1/sample]."""
    wanted = PAPER_RUN_LENGTHS[PAPER_WEIGHTS[0]]

    def error(log_acceleration: float) -> float:
        found = run_length(PAPER_WINDOW, PAPER_WEIGHTS[0], float(10.0**log_acceleration))
        return float(np.log(found / wanted))

    return float(10.0 ** optimize.brentq(error, -8.0, -3.0))


@dataclass(frozen=True, slots=True)
class RunLengths:
    """The curves of the paper's figure.

    Attributes
    ----------
    half_widths
        int64 (n,), w [slots].
    accelerations
        Constant accelerations, each a stated ω(t); the one of the paper's figures is among them.
    by_weight
        (acceleration, W_b) → ARL over w, float64 (n,), for a jump of 3σ.
    by_jump
        Δf/σ → ARL over w, float64 (n,), with W_b = 1e-4 and the acceleration of the paper's figures.
    true
        W_b → ARL over w by the statistic's true law, float64 (n,), at the acceleration of the paper's figures.
    simulated
        (w, W_b) → the same by simulation.
    """

    half_widths: tuple[int, ...]
    accelerations: tuple[float, ...]
    by_weight: dict[tuple[float, float], FloatArray]
    by_jump: dict[float, FloatArray]
    true: dict[float, FloatArray]
    simulated: dict[tuple[int, float], TuningCheck]


def run_lengths(seed: int) -> RunLengths:
    """Compute all curves; `seed` is that of the simulated check."""
    widths = tuple(range(2, 81, 2))
    fitted = acceleration_of_the_paper()
    accelerations = (0.0, fitted, 4.0 * fitted, 30.0 * fitted)
    return RunLengths(
        widths,
        accelerations,
        {
            (a, weight): np.array([run_length(w, weight, a) for w in widths])
            for a in accelerations
            for weight in PAPER_WEIGHTS
        },
        {jump: np.array([run_length(w, 1e-4, fitted, jump) for w in widths]) for jump in (1.0, 2.0, 3.0, 5.0)},
        {weight: np.array([true_run_length(w, weight, fitted) for w in widths]) for weight in PAPER_WEIGHTS},
        {(w, weight): simulate_run_length(weight, fitted, seed, w) for w in SIMULATED_AT for weight in PAPER_WEIGHTS},
    )
