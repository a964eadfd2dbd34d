"""Cage instability: in a band of speeds the cage whirls in bursts, which add drag and noise together."""

from collections.abc import Callable
from typing import Final

import numpy as np
from scipy import linalg, special

from rwa_monitor.kernels.effects import forward, smooth
from rwa_monitor.samples import BoolArray, FloatArray
from rwa_monitor.wheel.effects.base import Channels, LikelihoodFit, NoiseEffect, Parameter, usable_residuals
from rwa_monitor.wheel.effects.noise_laws import HeavyTailedNoise

FEWEST_BURSTS: Final = 2  # one is an event
BESIDE_BURST: Final = 32  # slots before and after a burst with which its drag is compared
FEWEST_BESIDE: Final = 4  # slots in a burst, and around it, for a mean
DRAG_BY_CHANCE: Final = 0.01  # largest p-value of the drag; that there are bursts is tested separately
SHIFTS: Final = 199  # of the bursts in time, among which the drag is to be exceptional
EFFICIENCY_OF_MEDIAN: Final = 1.2533  # standard deviation of a median over that of a mean, √(π/2)


class CageInstability(NoiseEffect):
    """Bursts of extra drag and extra noise while the speed is in a band.

    The ball cage leaves its smooth path and whirls: friction and noise rise together, come in bursts, and do so only in
    a band of speeds (and of lubricant states).

    What shows it
    -------------
    Mean and variance of the residual rise together in a band of speeds.

    See Also
    --------
    speed_dependent_noise, extra_switching_system, heavy_tailed_noise

    References
    ----------
    E. A. Boesiger, M. H. Warner, Spin Bearing Retainer Design Optimization, Aerospace Mechanisms Symposium 1991
    (torque, temperature and noise rise, at certain speeds and conditions); P. K. Gupta, Advanced Dynamics of Rolling
    Elements, Springer 1984. Sizes are a working assumption.
    """

    name = "cage_instability"
    comes_and_goes = True
    formula = (
        r"\tau = g(t)\, m \operatorname{sign}(\omega), \quad \sigma = \sigma_0 \left(1 + g(t)\, b\right), \qquad "
        r"g(t) \in \{0, 1\} \text{ where } \left||\omega| - \omega_c\right| < w, \text{ else } 0"
    )
    separate_by = "Dwells below, in and above the band, in both directions."
    not_exported = "it comes in bursts at random, with noise; its drag is the strength, in the band and in a burst"
    parameters = (
        Parameter("strength_Nm", "N m", 0.0, np.inf, 2.0e-4),
        Parameter("noise_strength", "-", 0.0, 100.0, 2.0),
        Parameter("band_speed_rad_s", "rad/s", 0.0, 2000.0, 100.0),
        Parameter("band_half_width_rad_s", "rad/s", 1e-3, 500.0, 15.0),
        Parameter("burst_s", "s", 1e-3, 1e5, 30.0, default=30.0),
        Parameter("quiet_s", "s", 0.0, 1e5, 30.0, default=30.0),
    )

    def apply(self, noise_Nm: FloatArray, channels: Channels, rng: np.random.Generator) -> FloatArray:
        values = self.values
        inside = np.abs(np.abs(channels.speed_rad_s) - values["band_speed_rad_s"]) < values["band_half_width_rad_s"]
        burst = inside & _bursts(noise_Nm.size, channels.sample_period_s, values["burst_s"], values["quiet_s"], rng)
        drag = np.where(burst, values["strength_Nm"] * channels.direction, 0.0)
        return drag + noise_Nm * np.where(burst, 1.0 + values["noise_strength"], 1.0)

    @classmethod
    def fit_bursts(
        cls, residual_Nm: FloatArray, channels: Channels, good: BoolArray
    ) -> tuple[LikelihoodFit, BoolArray]:
        """Fit bursts of noise in a band of speeds, with drag in them, and return which slots are in a burst.

        The residual may still hold levels. The gain is that of the noise alone, over noise that follows the speed.
        """
        from scipy import stats

        usable = usable_residuals(residual_Nm, channels, good) & (channels.direction != 0)
        count = int(usable.sum())
        nothing = cls.nothing_found(count), np.zeros(residual_Nm.size, dtype=np.bool_)
        found = find_bursts(residual_Nm, np.abs(channels.speed_rad_s), usable)
        if found is None:
            return nothing
        gain, noise, on = found
        along = residual_Nm * channels.direction
        drag = _drag_of_bursts(along, usable, on)
        if drag.size < FEWEST_BURSTS or _by_chance(along, usable, on) > DRAG_BY_CHANCE:
            return nothing  # noise without drag is no cage instability
        spread = float(stats.median_abs_deviation(drag, scale="normal"))
        bursts, shaking = float(np.sqrt(drag.size)), int(np.count_nonzero(on))
        values = {"strength_Nm": float(np.median(drag)), **noise}
        for name in ("burst_s", "quiet_s"):
            values[name] *= channels.sample_period_s
        std = dict.fromkeys(values, float("nan")) | {
            "strength_Nm": EFFICIENCY_OF_MEDIAN * spread / bursts,
            "noise_strength": (1.0 + values["noise_strength"]) / float(np.sqrt(2.0 * shaking)),
            "burst_s": values["burst_s"] / bursts,
            "quiet_s": values["quiet_s"] / bursts,
        }
        # The likelihood has as many: two scales, two mean durations, place and width of the band; no drag.
        return LikelihoodFit(values, std, gain, len(cls.parameters), count), on

    @classmethod
    def fitted(
        cls, residual_Nm: FloatArray, channels: Channels, usable: BoolArray, variance_inflation: float
    ) -> LikelihoodFit:
        """Fit bursts, see `fit_bursts`; drag in a band without pauses is not fitted: it is a law of the speed."""
        return cls.fit_bursts(residual_Nm, channels, usable)[0]


def _drag_of_bursts(along: FloatArray, usable: BoolArray, on: BoolArray) -> FloatArray:
    """Return the drag of each burst [N m]: its mean less that of the quiet slots around it, which removes the level."""
    from scipy.ndimage import find_objects, label

    drag = []
    for (burst,) in find_objects(label(on)[0]):
        near = slice(max(burst.start - BESIDE_BURST, 0), burst.stop + BESIDE_BURST)
        around, within = along[near][usable[near] & ~on[near]], along[burst][usable[burst]]
        if min(around.size, within.size) >= FEWEST_BESIDE:
            drag.append(float(within.mean() - around.mean()))
    return np.array(drag)


def _by_chance(along: FloatArray, usable: BoolArray, on: BoolArray) -> float:
    """Return the p-value of the bursts' drag: among that of the same bursts shifted in time, which meet other jumps."""
    shifts = np.linspace(0, on.size, SHIFTS + 1, endpoint=False).astype(np.int64)
    shifted = [_drag_of_bursts(along, usable, np.roll(on, shift)) for shift in shifts]
    drag = np.array([np.median(of) for of in shifted if of.size])
    return float(np.mean(drag >= drag[0]))


def _bursts(slots: int, period_s: float, burst_s: float, quiet_s: float, rng: np.random.Generator) -> BoolArray:
    """Return a random telegraph signal of exponential bursts and pauses of given means; always on without pauses."""
    if quiet_s == 0.0:
        return np.ones(slots, dtype=np.bool_)
    on = np.zeros(slots, dtype=np.bool_)
    active = rng.random() < burst_s / (burst_s + quiet_s)
    begin_s = 0.0
    while begin_s < slots * period_s:
        end_s = begin_s + rng.exponential(burst_s if active else quiet_s)
        on[int(np.ceil(begin_s / period_s)) : int(np.ceil(end_s / period_s))] = active
        begin_s, active = end_s, not active
    return on


# ---- bursts of noise in a band of speeds: a hidden Markov chain of two states, quiet and shaking ---------------------
# It is fitted to the scatter of blocks of neighbouring residuals about their means, from which levels and slow effects
# cancel. A block's contrasts are jointly Student-t with a scale that is a nonparametric function of |ω|; inside the
# band, the scale also depends on the state. The gain is over the same law without states, so that it is due neither to
# a law of the speed nor to heavy tails, neither of which has states that last. The likelihood is the forward recursion
# of L. R. Rabiner, A tutorial on hidden Markov models, Proceedings of the IEEE 77(2), 1989.


BLOCK: Final = 4  # slots: far shorter than a burst, and three quarters of the information are kept
CONTRASTS: Final = BLOCK - 1  # of a block, that its mean does not enter
BINS: Final = 40  # of |ω|; each has its own scale of the scatter
FEWEST_IN_BIN: Final = 20  # contrasts for a scale
CLIP_AT: Final = 4.0  # robust standard deviations, for that scale
SHORTEST_STAY: Final = 16.0  # slots, mean duration of a state: shorter bursts cannot be distinguished from heavy tails
FIRST_STAY: Final = 100.0  # slots, mean duration at which the fit begins
HALF_WIDTHS: Final = (0.03, 0.06, 0.12, 0.25)  # of bands tried, as shares of the speeds' range
WIDEST_BAND: Final = 0.3  # half width as a share of the speeds' range: wider is no band
FIRST_SCALES: Final = ((-0.25, 0.25), (-0.5, 0.4))  # logarithms of the quiet and the shaking scale over the bin's
LEAST_FREEDOM: Final = HeavyTailedNoise.parameters[0].low  # degrees of freedom: a variance exists
GAUSSIAN_FROM: Final = float(np.log(400.0))  # log of degrees of freedom from which the law is Gaussian
LARGEST_GROWTH: Final = float(np.log(np.log1p(CageInstability.parameters[1].high)))  # as the fit has it
MOST_EVALUATIONS: Final = 800  # of the likelihood, in the final fit
FIRST_EVALUATIONS: Final = 120  # for each width: enough to find the best one


def find_bursts(
    residual: FloatArray, speed: FloatArray, usable: BoolArray
) -> tuple[float, dict[str, float], BoolArray] | None:
    """Fit bursts of noise in a band of speeds.

    Parameters
    ----------
    residual
        float64 (n,), on consecutive slots.
    speed
        float64 (n,), |ω|.
    usable
        bool (n,), slots to use.

    Returns
    -------
    None where the speed does not vary or too few slots are usable, else at the maximum of the likelihood:

    log_likelihood_gain
        Over a scatter whose scale depends on the speed alone.
    values
        Of the effect's parameters except the drag; durations in slots.
    on
        bool (n,), slots that are in a burst with a probability above one half.
    """
    whole = residual.size // BLOCK * BLOCK
    known = np.logical_and.reduce(usable[:whole].reshape(-1, BLOCK), axis=1)
    middle = speed[:whole].reshape(-1, BLOCK).mean(axis=1)
    if np.count_nonzero(known) < FEWEST_IN_BIN or np.ptp(middle[known]) == 0.0:
        return None
    # Orthonormal contrasts: of white noise they are independent, with the variance of a residual.
    contrasts = np.where(known[:, None], residual[:whole].reshape(-1, BLOCK), 0.0) @ linalg.helmert(BLOCK).T
    scale = _scale_by_speed(contrasts, middle, known)
    if scale is None:
        return None
    gain, values, in_burst = _fit(np.where(known, np.square(contrasts).sum(axis=1) / scale**2, np.nan), middle, known)
    on = np.zeros(residual.size, dtype=np.bool_)
    on[:whole] = np.repeat(in_burst, BLOCK)
    return gain, values, on


def _scale_by_speed(contrasts: FloatArray, speed: FloatArray, known: BoolArray) -> FloatArray | None:
    """Return the scale of contrasts (blocks, 3) as a function of the speed, (blocks,); None if no bin has a scale."""
    edges = np.linspace(speed[known].min(), speed[known].max(), BINS + 1)
    at = np.clip(np.searchsorted(edges, speed, side="right") - 1, 0, BINS - 1)
    scale = np.zeros(BINS)
    for i in range(BINS):
        values = contrasts[known & (at == i)].ravel()
        if values.size >= FEWEST_IN_BIN:
            limit = CLIP_AT * float(np.median(np.abs(values))) / 0.6745
            scale[i] = np.sqrt(np.mean(np.clip(values, -limit, limit) ** 2))
    found = scale > 0
    if not found.any():
        return None
    middle = 0.5 * (edges[1:] + edges[:-1])
    return np.exp(np.interp(speed, middle[found], np.log(scale[found])))


def _fit(squares: FloatArray, speed: FloatArray, known: BoolArray) -> tuple[float, dict[str, float], BoolArray]:
    from scipy import optimize

    count = int(np.count_nonzero(known))
    probability = np.zeros(squares.size)
    low, span = float(speed[known].min()), float(np.ptp(speed[known]))

    def half_width(x: FloatArray) -> float:
        return float(min(abs(x[7]), WIDEST_BAND * span))

    def loss(x: FloatArray) -> float:
        inside = np.abs(speed - x[6]) < half_width(x)
        freedom, (on, off) = _freedom(x[0]), _rates(x)
        shaking = x[2] + _growth(x)
        scaled = squares * np.exp(-2.0 * x[1])
        log_likelihood = forward(scaled, inside, CONTRASTS, x[2], shaking, freedom, on, off, probability)
        return float(count * (CONTRASTS * x[1] - _constant(freedom)) - log_likelihood)

    stay = float(np.log(FIRST_STAY - SHORTEST_STAY))

    def without_band(x: FloatArray) -> float:
        return loss(np.array([*x, 0.0, 0.0, stay, stay, low, 0.0]))

    none = optimize.minimize(without_band, [1.5, 0.0], method="Nelder-Mead", options={"xatol": 1e-2, "fatol": 0.1})
    # The best start of each width: a few bursts in a narrow band may fit better than the first guess in the true one.
    starts = []
    for half in HALF_WIDTHS:
        tries = [
            np.array([none.x[0], none.x[1], quiet, np.log(shaking - quiet), stay, stay, low + at * span, half * span])
            for at in np.linspace(0.0, 1.0, 1 + round(1.0 / half))
            for quiet, shaking in FIRST_SCALES
        ]
        starts.append(_refined(loss, min(tries, key=loss), FIRST_EVALUATIONS))
    best = _refined(loss, min(starts, key=loss))
    best = min(best, _refined(loss, _with_other_edges(loss, best, low, span)), key=loss)
    gain = float(none.fun) - loss(best)
    on, off = _rates(best)
    smooth(probability, on, off)
    values = {
        "noise_strength": float(np.expm1(_growth(best))),
        "band_speed_rad_s": float(best[6]),
        "band_half_width_rad_s": half_width(best),
        "burst_s": BLOCK / off,
        "quiet_s": BLOCK / on,
    }
    return max(gain, 0.0), values, (np.abs(speed - best[6]) < half_width(best)) & (probability > 0.5)


def _refined(loss: Callable[[FloatArray], float], start: FloatArray, evaluations: int = MOST_EVALUATIONS) -> FloatArray:
    """Return the parameters at the minimum next to a start, or the best ones within a number of evaluations."""
    from scipy import optimize

    steps = np.array([0.5, 0.1, 0.2, 0.3, 0.7, 0.7, 0.3 * start[7], 0.3 * start[7]])
    simplex = np.vstack([start, start + np.diag(steps)])
    options = {"initial_simplex": simplex, "xatol": 1e-2, "fatol": 0.2, "maxfev": evaluations}
    found = optimize.minimize(loss, start, method="Nelder-Mead", options=options)  # type: ignore[call-overload]
    return np.asarray(found.x)


def _with_other_edges(loss: Callable[[FloatArray], float], best: FloatArray, low: float, span: float) -> FloatArray:
    """Return parameters with either edge of the band at its best grid point: the likelihood has steps in the edges."""
    for side in (1.0, -1.0):
        fixed = best[6] - side * abs(best[7])
        tried = low + span * np.linspace(0.0, 1.0, 2 * BINS + 1)
        tried = tried[side * (tried - fixed) > 0.0]
        bands = (np.array([*best[:6], 0.5 * (fixed + edge), 0.5 * abs(edge - fixed)]) for edge in tried.tolist())
        best = min((best, *bands), key=loss)
    return best


def _freedom(x: float) -> float:
    """Return degrees of freedom from their logarithm, limited from the lowest with a variance to a Gaussian."""
    return float(np.exp(np.clip(x, -20.0, GAUSSIAN_FROM))) + LEAST_FREEDOM


def _growth(x: FloatArray) -> float:
    """Return the logarithm of the noise in a burst over that outside, limited to what the parameter allows."""
    return float(np.exp(min(x[3], LARGEST_GROWTH)))


def _rates(x: FloatArray) -> tuple[float, float]:
    """Return the probabilities to begin and to end a burst in a block."""
    quiet, burst = SHORTEST_STAY + np.exp(np.clip(x[4:6], -20.0, 12.0))
    return BLOCK / float(quiet), BLOCK / float(burst)


def _constant(freedom: float) -> float:
    """Return the constant of the logarithm of Student's joint density of a block's contrasts."""
    of_gamma = special.gammaln(0.5 * (freedom + CONTRASTS)) - special.gammaln(0.5 * freedom)
    return float(of_gamma - 0.5 * CONTRASTS * np.log(np.pi * freedom))
