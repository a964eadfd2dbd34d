"""Noise effects: scored on their own likelihoods, after the mean effects (docs/theory.md, "Discrepancy search", 6)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy import optimize
from scipy.ndimage import binary_dilation, correlate1d

from rwa_monitor.discrepancy.base_fit import REVERSAL_REACH
from rwa_monitor.discrepancy.found_effects import as_found
from rwa_monitor.discrepancy.likelihood import ACCEPT_GAIN, NoiseLaw, Series
from rwa_monitor.discrepancy.problem import Problem
from rwa_monitor.discrepancy.record import FEWEST_FOR_JUMPS, Record
from rwa_monitor.discrepancy.result import FoundEffect, ParameterValue
from rwa_monitor.discrepancy.score import scored, with_law
from rwa_monitor.discrepancy.terms import Model
from rwa_monitor.samples import TINY, BoolArray, FloatArray
from rwa_monitor.wheel.effects.base import Channels, LikelihoodFit, curvature_std
from rwa_monitor.wheel.effects.cage_instability import CageInstability
from rwa_monitor.wheel.effects.catalogue import CATALOGUE, NOISE_EFFECTS
from rwa_monitor.wheel.effects.noise_laws import OF_BAND, SpeedDependentNoise, spread_factor

OUTLIER_AT: Final = 7.0  # standard deviations
FEW_OUTLIERS: Final = 12  # in a record: sojourns too short to be segmented; more are heavy tails
QUANTISED: Final = "tachometer_quantisation"
COLOURED: Final = "coloured_noise"
HEAVY: Final = "heavy_tailed_noise"
CAGE: Final = CageInstability.name
SPEED: Final = "speed_dependent_noise"
LATER_SHARE: Final = 0.05  # of an accepted gain that every later one must reach: no law of noise is exact
MIN_WHITTLE: Final = 500  # samples
EM_ROUNDS: Final = 5  # of weights and spread in turn; the first two achieve nearly all
WHITTLE_LAGS: Final = 400  # slots: the autocorrelation of an AR(1) with φ = 0.99 has decayed to 2 %
GROWTH_STEP: Final = 0.05  # in the logarithm of the spread's growth, for the curvature of the likelihood
WHITTLE_BINS: Final = 200  # of frequency; the transfer function of 17 taps varies over a seventeenth of the range
AROUND_JUMPS: Final = 3  # slots on each side of a jump whose residual depends on where exactly the jump was placed


def noise_effects(
    problem: Problem,
    model: Model,
    *,
    in_band: Sequence[BoolArray] = (),
    by_law: bool = False,
) -> list[FoundEffect]:
    """Return the noise effects that the residual shows, strongest first.

    Forward selection: each effect found is removed from the residual (whitened, scaled, …) before the next is tested,
    since each raises the likelihood of the others.

    Parameters
    ----------
    problem, model
        The data and a fit.
    in_band
        For each record bool (slots,), the band of a cage whose bursts were found before: samples in it do not count.
    by_law
        Whether effects that the law of the model's noise contains are judged by the score, all others on innovations.
    """
    views = views_of(problem, model, turns=False)
    found: list[FoundEffect] = []
    if any(_is_quantised(problem, view) for view in views):
        # Rounding errors are not Gaussian and follow the speed: in their presence no other noise can be judged.
        return accepted(problem, {QUANTISED: [fit_noise(problem, view, QUANTISED) for view in views]})
    if in_band:
        views = [replace(view, good=view.good & ~band) for view, band in zip(views, in_band, strict=True)]
    if by_law:
        found, views = _effects_of_law(problem, model), _whitened(problem, model, views)
    threshold = ACCEPT_GAIN
    with_tails: Sequence[_View] = ()  # once heavy tails are accepted: the residual that still contains them
    judged = {QUANTISED, CAGE, *([COLOURED] if by_law else []), *(effect.name for effect in found)}
    remaining = [name for name in NOISE_EFFECTS if name not in judged]
    while remaining:
        fits = {name: [fit_noise(problem, view, name) for view in views] for name in remaining}
        if SPEED in remaining and with_tails:
            fits[SPEED] = [_speed_with_tails(view) for view in with_tails]
        gains = {name: sum(fit.penalised_gain for fit in of) for name, of in fits.items()}
        name = max(gains, key=lambda n: gains[n])
        if gains[name] < (ACCEPT_GAIN if name == SPEED and with_tails else threshold):
            break
        found += accepted(problem, {name: fits[name]})
        threshold = max(threshold, LATER_SHARE * gains[name])
        # Empty until heavy tails are accepted.
        with_tails = [_without(view, name, fit) for view, fit in zip(with_tails, fits[name], strict=False)]
        if name == HEAVY:
            with_tails = views
        views = [_without(view, name, fit) for view, fit in zip(views, fits[name], strict=True)]
        remaining.remove(name)
    return sorted(found, key=lambda entry: -entry.delta_deviance)


def with_even_noise(problem: Problem, model: Model, found: Sequence[FoundEffect]) -> Model:
    """Return the model with a residual that is as noisy everywhere as at the median, where a found effect raises it."""
    for effect in found:
        if effect.name == SPEED:
            fitted = {name: parameter.value for name, parameter in effect.parameters.items()}
            spread = spread_factor(problem.speed, {**SpeedDependentNoise().values, **fitted})
            residual = model.fit.residual / np.maximum(spread / np.median(spread), 1.0)
            return replace(model, fit=replace(model.fit, residual=residual))
    return model


def _effects_of_law(problem: Problem, model: Model) -> list[FoundEffect]:
    """Return the noise effects that the law of a model's noise contains, with the gain of each over the law without."""
    law, fits = model.law, {}
    if law.correlation > 0.0:
        phi = min(law.correlation, CATALOGUE[COLOURED].parameters[0].high)
        gain = _gain_over(problem, model, replace(law, white=1.0, correlation=0.0))
        fits[COLOURED] = [_coloured_fit(phi, gain, problem.size)]
    if law.growth > 0.0:
        gain = _gain_over(problem, model, replace(law, growth=0.0))
        std = curvature_std(
            lambda growth: -0.5 * with_law(problem, model.terms, model.fit.jumps, replace(law, growth=growth)).score,
            law.growth,
            GROWTH_STEP,
        )
        values = {**SpeedDependentNoise().values, "strength_s_rad": float(np.expm1(law.growth)) / problem.top_speed}
        errors = dict.fromkeys(values, np.nan) | {"strength_s_rad": float(np.exp(law.growth)) / problem.top_speed * std}
        fits[SPEED] = [LikelihoodFit(values, errors, gain, 1, problem.size, OF_BAND)]
    return accepted(problem, fits)


def _coloured_fit(phi: float, gain: float, count: int) -> LikelihoodFit:
    """Return the fit of AR(1) noise with a log-likelihood gain over white noise in so many samples."""
    std = float(np.sqrt((1 - phi**2) / count))
    return LikelihoodFit({"ar_coefficient": phi}, {"ar_coefficient": std}, gain, 1, count)


def _gain_over(problem: Problem, model: Model, plainer: NoiseLaw) -> float:
    """Return the log-likelihood gain of a model's noise law over one with a parameter less, the penalty added back.

    `accepted` subtracts it.
    """
    lost = scored(problem, model.terms, model.fit.jumps, plainer, again=True).score - model.score
    return max(0.5 * (lost + problem.log_size), 0.0)


def _whitened(problem: Problem, model: Model, views: Sequence[_View]) -> list[_View]:
    """Return the views with the innovations of a model's noise law in place of the residual."""
    law = model.law
    residual = model.fit.residual + problem.z_measured - problem.z
    innovations = Series.of(problem).whitened(residual * problem.sign, law)[0][0]
    return [
        replace(view, residual=values) for view, values in zip(views, problem.spread(innovations, np.nan), strict=True)
    ]


@dataclass(frozen=True, slots=True)
class _View:
    """A record's residual as the noise effects use it; arrays over its slots.

    `averaged`: where friction is derived, the residual averaged with the weights by which the filter averages dω/dt.
    Changes of the torque that are too fast for the derivative are not noise, and are not in it.
    """

    residual: FloatArray
    channels: Channels
    good: BoolArray
    averaged: FloatArray | None = None


def views_of(problem: Problem, model: Model, *, turns: bool = True) -> list[_View]:
    """Return each record's residual along the rotation on its slots [N m], and which slots count.

    `turns`: count slots near a change of direction, too. Without, they count only where they are half of all or more:
    outliers that occur only there are friction that no law describes exactly.
    """
    residuals = problem.spread((model.fit.residual + (problem.z_measured - problem.z)) * problem.sign, np.nan)
    turning = problem.to_reversal <= REVERSAL_REACH
    turning &= not turns and 2 * np.count_nonzero(turning) < problem.size
    views = []
    for record, residual, part in zip(problem.records, residuals, problem.parts, strict=True):
        good = record.used if record.corrected is None else record.used & ~record.corrected
        # A few far outliers are sojourns too short to be segmented; many are heavy tails.
        outlier = good & (np.abs(np.nan_to_num(residual)) > OUTLIER_AT * problem.noise.std)
        good = good & ~outlier if np.count_nonzero(outlier) <= FEW_OUTLIERS else good.copy()
        good[problem.slot[part][turning[part]]] = False
        for jump in model.fit.jumps[(model.fit.jumps >= part.start) & (model.fit.jumps < part.stop)]:
            at = int(problem.slot[jump])
            good[max(at - AROUND_JUMPS, 0) : at + AROUND_JUMPS] = False
        averaged = record.filter_error_Nm
        if averaged is not None:
            known = np.where(good, residual, np.nan)
            averaged = averaged + correlate1d(known, problem.averaging_taps, mode="constant", cval=np.nan)
        views.append(_View(residual, record.channels, good, averaged))
    return views


def _is_quantised(problem: Problem, view: _View) -> bool:
    """Return whether the residual of a record contains the rounding errors of a tachometer."""
    return view.averaged is not None and fit_noise(problem, view, QUANTISED).penalised_gain >= ACCEPT_GAIN


def fit_noise(problem: Problem, view: _View, name: str) -> LikelihoodFit:
    """Fit a noise effect to a record's residual, allowing for the autocorrelation that the derivative's filter adds."""
    if name == COLOURED and view.averaged is not None:
        return coloured_beyond_filter(view.averaged, view.good, problem.averaging_taps)
    inflation = variance_inflation(view.residual, view.good, problem.derivative_taps.size - 1) if name == SPEED else 1.0
    residual = view.averaged if name == HEAVY and view.averaged is not None else view.residual
    return NOISE_EFFECTS[name].fit(residual, view.channels, view.good, inflation)


def variance_inflation(residual: FloatArray, good: BoolArray, lags: int) -> float:
    """Return how many autocorrelated residuals inform as much about the variance as one independent residual.

    That is Σ ρ² over all lags, 1 for white noise: the variance of a mean square of Gaussian noise of autocorrelation ρ
    is 2σ⁴/n · Σ ρ² (M. S. Bartlett, JRSS Supplement 8, 1946). Friction derived with a filter of 17 slots has up to 7.

    Parameters
    ----------
    residual, good
        float64 and bool (n,).
    lags
        Lag beyond which the noise is known to be uncorrelated.
    """
    usable = good & np.isfinite(residual)
    values = np.where(usable, residual, 0.0)
    power = float(values @ values)
    if power == 0.0:
        return 1.0
    count = int(np.count_nonzero(usable))
    total = 1.0
    for lag in range(1, min(lags, values.size - 1) + 1):
        pairs = max(int(np.count_nonzero(usable[lag:] & usable[:-lag])), 1)
        correlation = float(values[lag:] @ values[:-lag]) / pairs / (power / count)
        # A correlation estimated from n pairs has a variance of 1/n of its own.
        total += 2.0 * max(correlation**2 - 1.0 / pairs, 0.0)
    return total


def _speed_with_tails(view: _View) -> LikelihoodFit:
    """Fit speed-dependent noise with heavy tails: both in one likelihood, compared with heavy tails alone.

    Weights that shrink the tails turn Student's law into a Gaussian one; spread and weights are found alternately (the
    EM of K. L. Lange, R. J. A. Little, J. M. G. Taylor, JASA 84, 1989).
    """
    effect, tails = NOISE_EFFECTS[SPEED], NOISE_EFFECTS[HEAVY]
    speed, usable = np.abs(view.channels.speed_rad_s), view.good & np.isfinite(view.residual)
    count = int(usable.sum())
    if count < MIN_WHITTLE:
        return effect.nothing_found(count)
    alone = tails.fit(view.residual, view.channels, view.good)
    fit, both, scaled, factor = effect.nothing_found(count), alone, view.residual, np.ones(speed.size)
    for _ in range(EM_ROUNDS):
        fit = effect.fit(view.residual * _tail_weight(scaled, usable, both), view.channels, view.good)
        factor = spread_factor(speed, fit.values)
        scaled = view.residual / factor
        both = tails.fit(scaled, view.channels, view.good)
    # Each gain is over a Gaussian law with the variance of its own residual.
    variance_ratio = float(np.mean(view.residual[usable] ** 2)) / max(float(np.mean(scaled[usable] ** 2)), TINY)
    scale_gain = 0.5 * count * float(np.log(max(variance_ratio, TINY))) - float(np.sum(np.log(factor[usable])))
    gain = both.log_likelihood_gain - alone.log_likelihood_gain + scale_gain
    return replace(fit, log_likelihood_gain=max(gain, 0.0))


def _tail_weight(residual: FloatArray, usable: BoolArray, tails: LikelihoodFit) -> FloatArray:
    """Return the factors that turn a residual of Student's law into a Gaussian one."""
    nu = tails.values["degrees_of_freedom"]
    scale2 = float(np.mean(residual[usable] ** 2)) * max(nu - 2, 0.05) / nu
    return np.asarray(np.sqrt((nu + 1) / (nu + residual**2 / max(scale2, TINY))), dtype=np.float64)


def _without(view: _View, name: str, fit: LikelihoodFit) -> _View:
    """Return the view with a noise effect removed from its residual, as far as its likelihood determines it."""
    values = fit.values
    good = view.good & np.append(False, view.good[:-1]) if name == COLOURED else view.good

    def remaining(residual: FloatArray) -> FloatArray:
        if name == COLOURED:
            return residual - values["ar_coefficient"] * np.append(0.0, residual[:-1])
        if name == HEAVY:
            return residual * _tail_weight(residual, view.good & np.isfinite(residual), fit)
        return residual / spread_factor(np.abs(view.channels.speed_rad_s), values) if name == SPEED else residual

    averaged = None if view.averaged is None else remaining(view.averaged)
    return replace(view, residual=remaining(view.residual), averaged=averaged, good=good)


def coloured_beyond_filter(residual: FloatArray, good: BoolArray, taps: FloatArray) -> LikelihoodFit:
    """Fit AR(1) noise of the torque and white noise of the speed, both passed through the derivative's filter.

    Whittle's likelihood (1953): the periodogram is exponential with mean (a·AR(f; φ) + c·W(f))·|M(f)|² + b·|H(f)|² +
    d·W(f) + e, M the transfer function of the filter's average over the torque, H that of its derivative, and W the
    spectrum of a random walk, which missed jumps resemble; d and e are its leakage at the ends and at gaps. The mean
    allows for missing slots, through which strong noise leaks (the debiased likelihood of A. M. Sykulski, S. C.
    Olhede, A. P. Guillaumin, J. M. Lilly, J. J. Early, Biometrika 106, 2019). The gain is over φ = 0.

    Parameters
    ----------
    residual, good
        float64 and bool (n,): averaged over the filter's window, and which slots count.
    taps
        The weights of that average, float64 (2h + 1,).
    """
    usable = good & np.isfinite(residual)
    count = int(usable.sum())
    effect = NOISE_EFFECTS[COLOURED]
    if count < MIN_WHITTLE:
        return effect.nothing_found(count)
    values = np.where(usable, residual, 0.0)
    power = np.abs(np.fft.rfft(values)) ** 2 / count
    frequency = np.arange(power.size) / values.size
    bins = np.minimum((frequency * 2 * WHITTLE_BINS).astype(np.int64), WHITTLE_BINS - 1)
    weight = np.bincount(bins, minlength=WHITTLE_BINS).astype(np.float64)
    mean = np.bincount(bins, power, WHITTLE_BINS) / weight
    at = np.bincount(bins, frequency, WHITTLE_BINS) / weight
    expected = _expected_periodogram(usable, at)
    lags, reach = np.arange(WHITTLE_LAGS), np.arange(1 - taps.size, taps.size)
    slope = np.arange(taps.size) - taps.size // 2
    averaging, derivative = (np.correlate(one, one, "full") / float(one @ one) for one in (taps, slope))
    transfer = expected[:, : taps.size] @ derivative[taps.size - 1 :][:WHITTLE_LAGS]  # as many lags as there are
    ends = 1.0 / (2.0 - 2.0 * np.cos(2 * np.pi * at))
    walk = ends * (np.cos(2 * np.pi * np.outer(at, reach)) @ averaging)
    known = np.stack((transfer, walk, ends, np.ones(at.size)))
    scale = float(np.mean(mean))

    def loss(x: FloatArray) -> float:
        colour = expected @ (np.power(x[5], np.abs(lags[:, np.newaxis] - reach)) @ averaging)
        spectrum = np.exp(x[0]) * colour + np.exp(x[1:5]) @ known
        return float(np.sum(weight * (np.log(spectrum) + mean / spectrum)))

    start = np.log(np.array([0.5, 0.5, 1e-5, 1e-6, 1e-6]) * scale)
    limits = [(np.log(1e-4 * scale), np.log(10 * scale))] * 2 + [(np.log(1e-9 * scale), np.log(scale))] * 3
    plain, coloured = (
        optimize.minimize(loss, np.append(start, 0.5 * high), bounds=[*limits, (0.0, high)]) for high in (0.0, 0.99)
    )
    return _coloured_fit(float(coloured.x[5]), max(float(plain.fun - coloured.fun), 0.0), count)


def _expected_periodogram(usable: BoolArray, frequency: FloatArray) -> FloatArray:
    """Return the matrix from autocovariance at WHITTLE_LAGS lags to the expected periodogram, (frequencies, lags).

    Pairs with a missing slot do not count: Σ_h R_h c_h cos 2πfh over both signs of h, c_h the share of complete pairs.
    Averaged over a bin about f, since the zeros of a filter are narrow.
    """
    padded = np.abs(np.fft.rfft(usable.astype(np.float64), 2 * usable.size)) ** 2
    share = np.fft.irfft(padded)[:WHITTLE_LAGS] / np.count_nonzero(usable)
    lags = np.arange(WHITTLE_LAGS)
    both = np.where(lags == 0, 1.0, 2.0) * np.sinc(lags / (2 * WHITTLE_BINS))
    return np.asarray(both * share * np.cos(2 * np.pi * np.outer(frequency, lags)))


def accepted(problem: Problem, fits: dict[str, list[LikelihoodFit]]) -> list[FoundEffect]:
    """Return the effects whose gain over all records reaches ACCEPT_GAIN, strongest first."""
    found = []
    for name, of_records in fits.items():
        gain = float(sum(fit.penalised_gain for fit in of_records))
        if gain < ACCEPT_GAIN:
            continue
        effect = CATALOGUE[name]
        best = max(of_records, key=lambda fit: fit.penalised_gain)
        parameters = {
            p.name: ParameterValue.of(float(best.values[p.name]), float(best.std[p.name]), p.unit, p.low, p.high)
            for p in effect.parameters
            if p.name not in best.undetermined  # those are not reported
        }
        found.append(as_found(problem, effect, parameters, gain, effect.family))
    return sorted(found, key=lambda entry: -entry.delta_deviance)


# ---- bursts of a cage: found after the first search, then excluded from the second, which they would mislead ---------
# Drag that comes and goes in a band of speeds mimics jumps, another switching system and a law of speed. Its noise
# identifies it: neither a level nor a slow effect makes neighbouring samples differ in bursts. Once found, slots in
# bursts are excluded from all other fits, and the search starts again without them.


MARGIN: Final = 8  # slots on each side of a burst: its exact beginning is not known
BAND_MARGIN: Final = 1.2  # times the band's half width, in which bursts too short to be detected may remain


@dataclass(frozen=True, slots=True)
class CageBursts:
    """Bursts of a cage.

    Attributes
    ----------
    effect
        The effect as it is reported.
    in_burst, in_band
        For each record bool (slots,): slots in or near a burst, and slots in the band.
    """

    effect: FoundEffect
    in_burst: tuple[BoolArray, ...]
    in_band: tuple[BoolArray, ...]

    def quiet(self, records: Sequence[Record]) -> list[Record]:
        """Return the records without the slots in bursts."""
        return [
            replace(record, used=record.used & ~burst) for record, burst in zip(records, self.in_burst, strict=True)
        ]


def cage_bursts(problem: Problem, model: Model) -> CageBursts | None:
    """Return the bursts of a cage that a model's residual contains, or None; enough samples are outside of them."""
    if any(_is_quantised(problem, view) for view in views_of(problem, model)):
        return None  # rounding errors come and go with the acceleration
    fits, bursts, bands = [], [], []
    for record, (fitted, on) in zip(problem.records, fit_bursts_of(problem, model), strict=True):
        off_centre = np.abs(np.abs(record.channels.speed_rad_s) - fitted.values["band_speed_rad_s"])
        inside = off_centre < BAND_MARGIN * fitted.values["band_half_width_rad_s"]
        shown = fitted.penalised_gain > 0.0
        fits.append(fitted)
        bursts.append(binary_dilation(on, iterations=MARGIN) & shown)
        bands.append(inside & shown)
    found = accepted(problem, {CAGE: fits})
    if not found:
        return None
    cage = CageBursts(found[0], tuple(bursts), tuple(bands))
    left = sum(np.count_nonzero(record.used) for record in cage.quiet(problem.records))
    return cage if left >= FEWEST_FOR_JUMPS else None


def fit_bursts_of(problem: Problem, model: Model) -> list[tuple[LikelihoodFit, BoolArray]]:
    """Fit bursts to each record's friction less slope and effects: levels stay in, since they may be bursts."""
    remaining = model.fit.level + model.fit.residual + problem.z_measured - problem.z
    views = zip(problem.spread(remaining * problem.sign, np.nan), views_of(problem, model, turns=False), strict=True)
    return [CageInstability.fit_bursts(along, view.channels, view.good) for along, view in views]
