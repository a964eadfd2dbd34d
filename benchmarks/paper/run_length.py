"""The paper's figure of the average run length (ARL) at 0.1 % missed jumps, in closed form, for a stated ω(t).

The paper does not say how the speed moved (errata 3), and the information λ of a jump depends on it: within 2w samples
a step and a ramp of the speed are alike. So each curve belongs to a steady acceleration: normalised speed per sample.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import optimize, stats

from rwa_monitor.changepoints.tuning import Tuning, TuningCheck, check
from rwa_monitor.samples import FloatArray

MISSED: Final = 1e-3  # the paper's missed detection rate
JUMP_SIGMAS: Final = 3.0  # the paper's jump in its figure over w and W_b
PAPER_WEIGHTS: Final = (1e-8, 1e-6, 1e-4)  # W_b; the paper's text names the outer two
PAPER_WINDOW: Final = 20
PAPER_RUN_LENGTHS: Final = {1e-8: 1e4, 1e-4: 1e10}  # read by the paper's text off its figure, at w = 20
LONGEST_RUN: Final = 1e18  # samples; beyond, an ARL says nothing but "never"


def information(jump_sigmas: float, half_width: int, acceleration: float, prior_weight: float) -> float:
    """Return λ of a jump for a steady acceleration (errata 3).

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
    s_xx = acceleration**2 * 2 * half_width * (4 * half_width**2 - 1) / 12
    s_xz = acceleration * half_width**2 / 2
    lost = s_xz**2 / (s_xx + prior_weight) if s_xz else 0.0
    return jump_sigmas**2 * (half_width / 2 - lost)


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
    At a jump GLR/σ² is non-central χ² with λ of `information`, elsewhere central; the ARL is one over the
    probability that a sample exceeds the threshold.
    """
    threshold = _threshold(half_width, weight, acceleration, jump_sigmas, missed)
    return float(1.0 / max(stats.chi2.sf(threshold, 1), 1.0 / LONGEST_RUN))


def _threshold(half_width: int, weight: float, acceleration: float, jump_sigmas: float, missed: float) -> float:
    return float(stats.ncx2.ppf(missed, 1, information(jump_sigmas, half_width, acceleration, weight)))


def simulate_run_length(weight: float, acceleration: float, seed: int, half_width: int = PAPER_WINDOW) -> TuningCheck:
    """Measure run length and misses by simulation, for a jump of 3σ and the threshold of `run_length`.

    Parameters
    ----------
    weight, acceleration, half_width
        As for `run_length`.
    seed
        Of the noise.
    """
    tuning = Tuning(
        half_width=half_width,
        threshold=_threshold(half_width, weight, acceleration, JUMP_SIGMAS, MISSED),
        prior_weight=weight,
        information=information(JUMP_SIGMAS, half_width, acceleration, weight),
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
        Steady accelerations, each a stated ω(t); the one of the paper's figures is among them.
    by_weight
        (acceleration, W_b) → ARL over w, float64 (n,), for a jump of 3σ.
    by_jump
        Δf/σ → ARL over w, float64 (n,), with W_b = 1e-4 and the acceleration of the paper's figures.
    simulated
        W_b → the same by simulation, at w = 20 and the acceleration of the paper's figures.
    """

    half_widths: tuple[int, ...]
    accelerations: tuple[float, ...]
    by_weight: dict[tuple[float, float], FloatArray]
    by_jump: dict[float, FloatArray]
    simulated: dict[float, TuningCheck]


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
        {weight: simulate_run_length(weight, fitted, seed) for weight in PAPER_WEIGHTS},
    )
