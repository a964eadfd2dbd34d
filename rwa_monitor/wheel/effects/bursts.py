"""Bursts of noise in a band of speeds: a hidden Markov chain of two states, quiet and shaking.

Seen in the differences of neighbouring residuals, pair by pair: they know nothing of levels, jumps or slow effects.
Each difference is Student-t with a scale that is a free function of |ω|; inside the band the scale also depends on the
state. The gain is over the same law without states: what no law of speed and no heavy tail explains, since the one has
no memory of time and the other no memory at all. The likelihood is the forward recursion of L. R. Rabiner, A tutorial
on hidden Markov models, Proceedings of the IEEE 77(2), 1989.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import special

from rwa_monitor.kernels.effects import forward, smooth
from rwa_monitor.samples import BoolArray, FloatArray

BINS: Final = 40  # of |ω|, in each of which the differences have a scale of their own
FEWEST_IN_BIN: Final = 20  # differences for a scale
CLIP_AT: Final = 4.0  # robust standard deviations, for that scale
SHORTEST_STAY: Final = 16.0  # slots, mean: shorter bursts are heavy tails
FIRST_STAY: Final = 100.0  # slots, mean, where the fit begins
HALF_WIDTHS: Final = (0.03, 0.06, 0.12, 0.25)  # of bands tried, as shares of the speeds' range
WIDEST_BAND: Final = 0.3  # half width over the range of the speeds: wider is no band
FIRST_SCALES: Final = ((-0.25, 0.25), (-0.5, 0.4))  # logarithms of the quiet and the shaking scale over the bin's
LEAST_FREEDOM: Final = 2.05  # degrees of freedom: a variance exists
GAUSSIAN_FROM: Final = float(np.log(400.0))  # log of degrees of freedom from which the law is Gaussian
MOST_EVALUATIONS: Final = 800
FIRST_EVALUATIONS: Final = 120  # of each width: enough to find which is best
PARAMETERS: Final = 6  # two scales, two mean stays, place and width of the band


@dataclass(frozen=True, slots=True)
class Bursts:
    """Bursts of noise in a band of speeds.

    Attributes
    ----------
    log_likelihood_gain
        Over differences whose scale depends on the speed alone.
    ratio
        Scale in bursts over that in pauses [-].
    centre, half_width
        Of the band, in the unit of the speed.
    burst_slots, quiet_slots
        Mean stays.
    inside, on
        bool (n,), slots in the band, and in a burst more likely than not.
    """

    log_likelihood_gain: float
    ratio: float
    centre: float
    half_width: float
    burst_slots: float
    quiet_slots: float
    inside: BoolArray
    on: BoolArray


def find_bursts(residual: FloatArray, speed: FloatArray, usable: BoolArray) -> Bursts | None:
    """Fit bursts of noise in a band of speeds.

    Parameters
    ----------
    residual
        float64 (n,), on consecutive slots.
    speed
        float64 (n,), |ω|.
    usable
        bool (n,), slots that count.

    Returns
    -------
    Bursts | None
        At the maximum of the likelihood; None where the speed does not vary or too little is usable.
    """
    pairs = usable & np.concatenate([[False], usable[:-1]])
    pairs[::2] = False  # neighbouring differences share a sample: an outlier would be two, and pass for a burst
    if np.count_nonzero(pairs) < 2 * FEWEST_IN_BIN or np.ptp(speed[pairs]) == 0.0:
        return None
    difference = np.concatenate([[0.0], np.diff(np.nan_to_num(residual))])
    scale = _scale_by_speed(difference, speed, pairs)
    if scale is None:
        return None
    return _fit(np.where(pairs, (difference / scale) ** 2, np.nan), speed, pairs)


def _scale_by_speed(difference: FloatArray, speed: FloatArray, pairs: BoolArray) -> FloatArray | None:
    """Return the scale of the differences as a function of the speed, float64 (n,); None where they hold nothing."""
    edges = np.linspace(speed[pairs].min(), speed[pairs].max(), BINS + 1)
    at = np.clip(np.searchsorted(edges, speed, side="right") - 1, 0, BINS - 1)
    scale = np.zeros(BINS)
    for i in range(BINS):
        values = difference[pairs & (at == i)]
        if values.size >= FEWEST_IN_BIN:
            limit = CLIP_AT * float(np.median(np.abs(values))) / 0.6745
            scale[i] = np.sqrt(np.mean(np.clip(values, -limit, limit) ** 2))
    known = np.flatnonzero(scale > 0)
    if known.size == 0:
        return None
    middle = 0.5 * (edges[1:] + edges[:-1])
    return np.exp(np.interp(speed, middle[known], np.log(scale[known])))


def _fit(squares: FloatArray, speed: FloatArray, pairs: BoolArray) -> Bursts:
    count = int(np.count_nonzero(pairs))
    probability = np.zeros(squares.size)
    nowhere = np.zeros(squares.size, dtype=np.bool_)
    low, span = float(speed[pairs].min()), float(np.ptp(speed[pairs]))
    widest = WIDEST_BAND * span

    def plain(x: FloatArray) -> float:
        freedom = _freedom(x[0])
        scaled = squares * np.exp(-2.0 * x[1])
        log_likelihood = forward(scaled, nowhere, 0.0, 0.0, freedom, 0.5, 0.5, probability)
        return float(count * (x[1] - _constant(freedom)) - log_likelihood)

    def loss(x: FloatArray) -> float:
        inside = np.abs(speed - x[6]) < min(abs(x[7]), widest)
        freedom, (on, off) = _freedom(x[0]), _rates(x)
        shaking = x[2] + float(np.exp(x[3]))
        scaled = squares * np.exp(-2.0 * x[1])
        log_likelihood = forward(scaled, inside, x[2], shaking, freedom, on, off, probability)
        return float(count * (x[1] - _constant(freedom)) - log_likelihood)

    from scipy import optimize

    none = optimize.minimize(plain, [1.5, 0.0], method="Nelder-Mead", options={"xatol": 1e-2, "fatol": 0.1})
    stay = float(np.log(FIRST_STAY - SHORTEST_STAY))
    tries = [
        np.array([none.x[0], none.x[1], quiet, np.log(shaking - quiet), stay, stay, low + at * span, half * span])
        for half in HALF_WIDTHS
        for at in np.linspace(0.0, 1.0, 1 + round(1.0 / half))
        for quiet, shaking in FIRST_SCALES
    ]
    # The best of each width: in a narrow band a few bursts may fit better than the first guess in the right one.
    starts = [min((x for x in tries if x[7] == half * span), key=loss) for half in HALF_WIDTHS]
    best = _refined(loss, min((_refined(loss, start, FIRST_EVALUATIONS) for start in starts), key=loss))
    gain = float(none.fun) - loss(best)
    on, off = _rates(best)
    smooth(probability, on, off)
    half_width = float(min(abs(best[7]), widest))
    inside = np.abs(speed - best[6]) < half_width
    return Bursts(
        max(gain, 0.0),
        float(np.exp(np.exp(best[3]))),
        float(best[6]),
        half_width,
        1.0 / off,
        1.0 / on,
        inside,
        inside & (probability > 0.5),
    )


def _refined(loss: Callable[[FloatArray], float], start: FloatArray, evaluations: int = MOST_EVALUATIONS) -> FloatArray:
    """Return the parameters at the minimum next to a start, or as near as so many evaluations come."""
    from scipy import optimize

    steps = np.array([0.5, 0.1, 0.2, 0.3, 0.7, 0.7, 0.3 * start[7], 0.3 * start[7]])
    simplex = np.vstack([start, start + np.diag(steps)])
    options = {"initial_simplex": simplex, "xatol": 1e-2, "fatol": 0.2, "maxfev": evaluations}
    found = optimize.minimize(loss, start, method="Nelder-Mead", options=options)  # type: ignore[call-overload]
    return np.asarray(found.x)


def _freedom(x: float) -> float:
    """Return degrees of freedom of their logarithm, kept between a variance that exists and a Gaussian."""
    return float(np.exp(np.clip(x, -20.0, GAUSSIAN_FROM))) + LEAST_FREEDOM


def _rates(x: FloatArray) -> tuple[float, float]:
    """Return the probabilities to begin and to end a burst in a slot."""
    quiet, burst = SHORTEST_STAY + np.exp(np.clip(x[4:6], -20.0, 12.0))
    return 1.0 / float(quiet), 1.0 / float(burst)


def _constant(freedom: float) -> float:
    """Return the constant of the logarithm of Student's density."""
    of_gamma = special.gammaln(0.5 * (freedom + 1.0)) - special.gammaln(0.5 * freedom)
    return float(of_gamma - 0.5 * np.log(np.pi * freedom))
