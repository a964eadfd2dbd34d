"""Noise effects: scored on their own likelihoods, after the mean effects (effects.md, step 5)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy import optimize, stats

from rwa_monitor.discrepancy.base_fit import Problem
from rwa_monitor.discrepancy.nulls import built_in_nulls
from rwa_monitor.discrepancy.result import FoundEffect, ParameterValue
from rwa_monitor.discrepancy.search import ACCEPT_GAIN, Model
from rwa_monitor.physics.effects.base import Channels, Effect
from rwa_monitor.physics.effects.catalogue import CATALOGUE, NOISE_EFFECTS
from rwa_monitor.physics.effects.likelihood import LikelihoodFit
from rwa_monitor.physics.effects.speed_dependent_noise import spread_factor
from rwa_monitor.samples import BoolArray, FloatArray

OUTLIER_AT: Final = 7.0  # standard deviations
FEW_OUTLIERS: Final = 12
QUANTISED: Final = "tachometer_quantisation"
COLOURED: Final = "coloured_noise"
HEAVY: Final = "heavy_tailed_noise"
CAGE: Final = "cage_instability"
SPEED: Final = "speed_dependent_noise"
BURST_BLOCK: Final = 16  # slots: shorter than a burst, long enough for a variance
FEWEST_BLOCKS: Final = 40  # for a rank correlation
BURST_SIGMAS: Final = 5.0  # of a rank correlation of blocks that have nothing to do with each other
CAGE_PREFERRED: Final = 0.5  # of the best gain
LATER_SHARE: Final = 0.05  # of an accepted gain that the next must reach: no law of noise is exact
BURST_SLOTS: Final = 400  # longest burst; longer ones are sojourns of a switching system
WEAK_BURST: Final = 6.0  # standard deviations
BURSTS_IN_BAND: Final = 0.7  # share of the time in short weak sojourns that a band of speeds must hold
FEWEST_BURSTS: Final = 6  # fewer short weak sojourns are a switching system's
MIN_WHITTLE: Final = 500  # samples
WHITTLE_BINS: Final = 200  # of frequency; a filter of 17 taps varies over a seventeenth
AROUND_JUMPS: Final = 3  # slots on each side of a jump whose residual depends on where exactly it was put


def noise_effects(problem: Problem, model: Model, *, explained: bool = True) -> list[FoundEffect]:
    """Return the noise effects that the residual shows, strongest first.

    Forward: what is found is taken out of the residual (whitened, scaled, …) before the next is looked for, since each
    of them makes the likelihood of the others rise. Where something is left unexplained, bursts of drag cannot be told
    from it and are not looked for.
    """
    views = [_view(problem, model, index) for index in range(len(problem.records))]
    measured = views
    if any(_is_quantised(problem, index, view) for index, view in enumerate(views)):
        # Rounding errors are not Gaussian and follow the speed: beside them no other noise can be judged.
        quantised = [_fit_noise(problem, index, view, QUANTISED) for index, view in enumerate(views)]
        return accepted(problem, {QUANTISED: quantised})
    found: list[FoundEffect] = []
    wall = ACCEPT_GAIN
    left = [name for name in NOISE_EFFECTS if name != QUANTISED and (explained or name != CAGE)]
    while left:
        fits = {name: [_fit_noise(problem, i, view, name) for i, view in enumerate(views)] for name in left}
        gains = {name: sum(fit.penalised_gain for fit in of) for name, of in fits.items()}
        name = max(gains, key=lambda n: gains[n])
        if name != COLOURED and CAGE in gains and gains[CAGE] > CAGE_PREFERRED * gains[name]:
            name = CAGE  # a band of noise alone explains the noise of a burst, but not its drag
        if gains[name] < wall:
            break
        if name == SPEED and CAGE in gains and _comes_in_bursts(measured, fits[name]):
            bursts = accepted(problem, {CAGE: _as_bursts(fits[name])})
            found += [replace(effect, equivalent=(SPEED,)) for effect in bursts]
            left.remove(CAGE)
        else:
            found += accepted(problem, {name: fits[name]})
        wall = max(wall, LATER_SHARE * gains[name])
        views = [_without(view, name, fit) for view, fit in zip(views, fits[name], strict=True)]
        left = [other for other in left if other != name and not (name == CAGE and other == HEAVY)]
    return sorted(found, key=lambda entry: -entry.delta_deviance)


@dataclass(frozen=True, slots=True)
class _View:
    """A record's residual as the noise effects see it; arrays over its slots."""

    residual: FloatArray
    with_bursts: FloatArray  # short weak sojourns left in
    channels: Channels
    good: BoolArray


def _view(problem: Problem, model: Model, index: int) -> _View:
    residual, good = residual_on_slots(problem, model, index)
    return _View(residual, residual + _weak_sojourns(problem, model, index), problem.records[index].channels, good)


def _weak_sojourns(problem: Problem, model: Model, index: int) -> FloatArray:
    """Return what short, weak excursions of the level add to it, as a torque on the slots [N m]: they may be bursts."""
    begin, end = int(problem.starts[index]), int(problem.starts[index + 1])
    level = model.fit.level[begin:end]
    edges = np.concatenate([[0], np.flatnonzero(np.diff(level)) + 1, [level.size]])
    extra, bursts = np.zeros(level.size), 0
    limit = WEAK_BURST * problem.noise.std
    for i in range(1, edges.size - 2):
        before, here, after = level[edges[i] - 1], level[edges[i]], level[edges[i + 1]]
        short = edges[i + 1] - edges[i] <= BURST_SLOTS
        if short and abs(before - after) < 0.5 * limit and abs(here - 0.5 * (before + after)) < limit:
            extra[edges[i] : edges[i + 1]] = here - 0.5 * (before + after)
            bursts += 1
    if bursts < FEWEST_BURSTS:
        extra[:] = 0.0
    on_slots = np.zeros(problem.records[index].used.size)
    on_slots[problem.slot[begin:end]] = extra * problem.sign[begin:end]
    return on_slots


def _is_quantised(problem: Problem, index: int, view: _View) -> bool:
    if not problem.records[index].friction_is_derived:
        return False
    fit = CATALOGUE[QUANTISED].fit(view.residual, view.channels, view.good)  # type: ignore[attr-defined]
    return bool(fit.penalised_gain >= ACCEPT_GAIN)


def _fit_noise(problem: Problem, index: int, view: _View, name: str) -> LikelihoodFit:
    if name == COLOURED and problem.records[index].friction_is_derived:
        return coloured_beyond_filter(view.residual, view.good, problem.derivative_taps)
    effect = NOISE_EFFECTS[name]
    if name == CAGE:
        fit = effect.fit(view.with_bursts, view.channels, view.good)
        burst = view.good & np.isfinite(view.residual) & (view.with_bursts != view.residual)
        off = np.abs(np.abs(view.channels.speed_rad_s) - fit.values["band_speed_rad_s"])
        inside = np.count_nonzero(burst & (off <= 1.5 * fit.values["band_half_width_rad_s"]))
        if inside >= BURSTS_IN_BAND * np.count_nonzero(burst):
            return fit  # else the sojourns are those of a switching system, at any speed
    return effect.fit(view.residual, view.channels, view.good)


def _comes_in_bursts(views: Sequence[_View], fits: Sequence[LikelihoodFit]) -> bool:
    """Say whether drag and noise rise and fall together where the noise is raised, as in bursts of a cage.

    Within a band levels take up the mean of the drag, but not its bursts: over short blocks, mean (along the motion)
    and variance of the residual then go together.
    """
    means, spreads = [], []
    for view, fit in zip(views, fits, strict=True):
        speed = np.abs(view.channels.speed_rad_s)
        centre, width = fit.values["band_speed_rad_s"], fit.values["band_width_rad_s"]
        raised = np.abs(speed - centre) < 2 * width if fit.values["band_strength"] > 0 else speed > np.nanmedian(speed)
        usable = raised & view.good & np.isfinite(view.with_bursts)
        along = np.where(usable, view.with_bursts * view.channels.direction, np.nan)
        blocks = along[: along.size - along.size % BURST_BLOCK].reshape(-1, BURST_BLOCK)
        whole = blocks[np.isfinite(blocks).all(axis=1)]
        means.append(whole.mean(axis=1))
        spreads.append(whole.var(axis=1))
    mean, spread = np.concatenate(means), np.concatenate(spreads)
    if mean.size < FEWEST_BLOCKS or np.ptp(mean) == 0 or np.ptp(spread) == 0:
        return False
    return bool(stats.spearmanr(mean, spread).statistic * np.sqrt(mean.size - 1) > BURST_SIGMAS)


def _as_bursts(fits: Sequence[LikelihoodFit]) -> list[LikelihoodFit]:
    """Return fits of a band of noise as those of bursts in it; how long they last is not fitted."""
    typical = CATALOGUE[CAGE].typical().values
    unknown = dict.fromkeys(typical, float("nan"))
    return [
        replace(
            fit,
            values={
                **typical,
                "noise_strength": fit.values["band_strength"],
                "band_speed_rad_s": fit.values["band_speed_rad_s"],
                "band_half_width_rad_s": 2 * fit.values["band_width_rad_s"],
            },
            std=unknown,
        )
        for fit in fits
    ]


def _without(view: _View, name: str, fit: LikelihoodFit) -> _View:
    """Return the residual with a noise effect taken out, as far as its likelihood knows it."""
    residual, bursts, good, values = view.residual.copy(), view.with_bursts.copy(), view.good, fit.values
    speed = np.abs(view.channels.speed_rad_s)
    if name == COLOURED:
        residual[1:] -= values["ar_coefficient"] * view.residual[:-1]
        bursts[1:] -= values["ar_coefficient"] * view.with_bursts[:-1]
        good = good & np.concatenate([[False], good[:-1]])
    elif name == HEAVY:
        nu = values["degrees_of_freedom"]
        usable = good & np.isfinite(residual)
        scale2 = float(np.mean(residual[usable] ** 2)) * max(nu - 2, 0.05) / nu
        bursts *= np.sqrt((nu + 1) / (nu + bursts**2 / max(scale2, 1e-300)))
        residual *= np.sqrt((nu + 1) / (nu + residual**2 / max(scale2, 1e-300)))
    elif name == SPEED:
        residual /= spread_factor(speed, values)
        bursts /= spread_factor(speed, values)
    elif name == CAGE:
        good = good & ~(np.abs(speed - values["band_speed_rad_s"]) < 1.5 * values["band_half_width_rad_s"])
    return replace(view, residual=residual, with_bursts=bursts, good=good)


def coloured_beyond_filter(residual: FloatArray, good: BoolArray, taps: FloatArray) -> LikelihoodFit:
    """Fit AR(1) noise beside the white speed noise that a known derivative filter colours.

    Whittle's likelihood (1953): the periodogram is exponential about S(f) = a·AR(f; φ) + b·|H(f)|², H the filter's
    transfer function. Compared with φ = 0.
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
    lag = np.arange(taps.size) - taps.size // 2
    transfer = np.abs(np.exp(-2j * np.pi * np.outer(at, lag)) @ taps) ** 2
    transfer /= max(float(np.sum(taps**2)), 1e-300)
    scale = float(np.mean(mean))

    def log_likelihood(x: FloatArray) -> float:
        phi = float(x[2])
        colour = (1 - phi**2) / (1 + phi**2 - 2 * phi * np.cos(2 * np.pi * at))
        spectrum = np.exp(x[0]) * colour + np.exp(x[1]) * transfer
        return -float(np.sum(weight * (np.log(spectrum) + mean / spectrum)))

    def loss(x: FloatArray) -> float:
        return -log_likelihood(x)

    start = np.log([0.5 * scale, 0.5 * scale])
    limits = [(np.log(1e-4 * scale), np.log(10 * scale))] * 2

    def best(low: float, high: float) -> tuple[float, FloatArray]:
        begin = np.append(start, 0.5 * (low + high))
        found = optimize.minimize(loss, begin, bounds=[*limits, (low, high)])
        return -float(found.fun), found.x

    plain, _ = best(0.0, 0.0)
    coloured, at_best = best(0.0, 0.99)
    phi = float(at_best[2])
    return LikelihoodFit(
        {"ar_coefficient": phi},
        {"ar_coefficient": float(np.sqrt((1 - phi**2) / count))},
        max(coloured - plain, 0.0),
        1,
        count,
    )


def largest_noise_gain(problem: Problem, model: Model) -> float:
    """Return the largest penalised gain of all noise effects on the residual of a model, whether accepted or not."""
    views = [_view(problem, model, index) for index in range(len(problem.records))]
    names = [name for name in NOISE_EFFECTS if name != QUANTISED or problem.records[0].friction_is_derived]
    return max(sum(_fit_noise(problem, i, view, name).penalised_gain for i, view in enumerate(views)) for name in names)


def residual_on_slots(
    problem: Problem, model: Model, index: int, keep_jumps: bool = False
) -> tuple[FloatArray, BoolArray]:
    """Return a record's residual along the rotation on its slots [N m], NaN elsewhere, and which slots count."""
    record = problem.records[index]
    begin, end = int(problem.starts[index]), int(problem.starts[index + 1])
    slots = problem.slot[begin:end]
    residual = np.full(record.used.size, np.nan)
    measured = model.fit.residual[begin:end] + (problem.z_measured - problem.z)[begin:end]
    residual[slots] = measured * problem.sign[begin:end]
    good = record.used.copy()
    if not keep_jumps:
        # A few far outliers are sojourns too short to be segmented; many are heavy tails.
        outlier = good & (np.abs(np.nan_to_num(residual)) > OUTLIER_AT * problem.noise.std)
        if np.count_nonzero(outlier) <= FEW_OUTLIERS:
            good &= ~outlier
        for jump in model.fit.jumps[(model.fit.jumps >= begin) & (model.fit.jumps < end)]:
            at = int(problem.slot[jump])
            good[max(at - AROUND_JUMPS, 0) : at + AROUND_JUMPS] = False
    return residual, good


def accepted(problem: Problem, fits: dict[str, list[LikelihoodFit]]) -> list[FoundEffect]:
    """Return the effects whose gain over all records is worth a name, strongest first."""
    found = []
    for name, of_records in fits.items():
        gain = float(sum(fit.penalised_gain for fit in of_records))
        if gain < ACCEPT_GAIN:
            continue
        effect = CATALOGUE[name]
        best = max(of_records, key=lambda fit: fit.penalised_gain)
        found.append(_describe(effect, best, gain, problem))
    return sorted(found, key=lambda entry: -entry.delta_deviance)


def _describe(effect: type[Effect], fit: LikelihoodFit, gain: float, problem: Problem) -> FoundEffect:
    parameters = {
        parameter.name: ParameterValue(
            float(fit.values[parameter.name]),
            float(fit.std[parameter.name]) if np.isfinite(fit.std[parameter.name]) else None,
            parameter.unit,
        )
        for parameter in effect.parameters
    }
    derived = problem.friction_is_derived
    p_value = built_in_nulls().p_value(effect.family, gain, problem.log_size, derived=derived)
    return FoundEffect(effect.name, effect.family, (), effect.separate_by, parameters, p_value, gain)
