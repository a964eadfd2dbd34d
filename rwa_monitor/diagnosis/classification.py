"""Stage 4: which anomalies are there, from the split friction, by Bayes' rule (method `joint`).

Each sojourn of a system, and each of dry and viscous friction, is a measurement with its own standard deviation of a
value that lies in the nominal or in the anomalous band (`model.Levels`). A large standard deviation makes both
densities equal and leaves the prior. Where a system never rests, its friction and the base dry friction share an
unknown offset (the base/system ambiguity, errata 10): all combinations of anomalies are compared with it integrated
out. So the healthy base, the ranges of friction and earlier windows jointly constrain the offset, and what remains
ambiguous is expressed by the probabilities.

Base dry and viscous friction, as known from earlier windows of a wheel, are each a `Coefficient`. A healthy wheel's
value keeps its place in the band, window after window, so a second measurement of it is no independent evidence: the
value x is carried, and whether it is anomalous is judged from x anew in each window. Before a window, the distribution
of x is a mixture (a hidden Markov model with renewal: Rabiner 1989; the same mixture as in Bayesian online changepoint
detection, Adams and MacKay 2007, reduced to two run lengths, long and none):

* *held*: nothing changed, and x follows a random walk from what earlier windows measured, N(m, d²);
* *changed*: since the last window that measured it, x changed (`CHANGE_PER_WINDOW`) and is as likely anomalous as that
  of any wheel (more likely if it was: `rate_after_change`).

With π the rate of the anomaly, p_c the density of healthy (c = 0) and anomalous (c = 1) values, a window that measures
z ± s, and m' ± s' the value with this measurement filtered in,

    p(c, z | held) = N(z; m, d² + s²) π_c p_c(m'; s') / Σ π p(m; d),        p(c, z | changed) = π'_c p_c(z; s),

where p_c(v; s) is the density of measuring v ± s and π' the rate after a change. A window that measures x well is
judged by its own value, whatever came before; one that does not leaves x as it was, with a probability that it has
changed unobserved.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple, TypeGuard

import numpy as np
from scipy import special

from rwa_monitor.diagnosis.features import Features
from rwa_monitor.diagnosis.model import AnomalyModel, Levels, Model, log_densities, stray_probabilities, system_evidence
from rwa_monitor.kernels.noise import SMALLEST_STD
from rwa_monitor.samples import BoolArray, FloatArray, IntArray
from rwa_monitor.switching.assignment import softmax
from rwa_monitor.switching.carried_state import CarriedState, Tracked, probability_before, rate_after_change

# A value is uninformative if its standard deviation exceeds this share of the distance between nominal and anomalous.
INFORMATIVE_STD: Final = 0.4
# A window alone decides on a coefficient if the middle between the two is two standard deviations away from either.
DECISIVE_STD: Final = 0.25
# Least probability that a value is still the one measured earlier for a window to rely on that: it was measured within
# the last ten windows.
MIN_HELD_PROBABILITY: Final = 0.8


class Coefficient(NamedTuple):
    """A coefficient before a window, in the features' unit.

    Attributes
    ----------
    levels, rate
        Its learned bands, and the rate of the anomaly.
    before
        The value known from earlier windows, predicted for this one; None where there is none.
    """

    levels: Levels
    rate: float
    before: Tracked | None

    @property
    def prior(self) -> float:
        """The probability of the anomaly before the window."""
        before = self.before
        if before is None:
            return self.rate
        return before.held * self._anomalous(before) + (1.0 - before.held) * self._rate_after_change(before)

    def log_evidence(self, value: FloatArray, std: FloatArray) -> FloatArray:
        """Return the log density of measuring `value` ± `std`, (n,) each, if nominal (row 0) or anomalous (row 1)."""
        if self.before is None:
            return log_densities(self.levels, value, std)
        prior = _clipped(self.prior)
        return np.asarray(np.logaddexp(*self.log_parts(value, std)) - np.log(np.array([[1.0 - prior], [prior]])))

    def log_parts(self, value: FloatArray, std: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the log of p(class, value, held) and of p(class, value, changed), float64 (2, n) each."""
        before = self.before
        assert before is not None, "without earlier windows nothing is held"
        changed = self._log_joint(value, std, self._rate_after_change(before))
        mean, narrowed, log_predicted = _filtered(before, value, std)
        held = log_predicted + self._log_joint(mean, narrowed, self.rate)
        held -= np.logaddexp(*self._log_joint(np.array([before.mean]), np.array([before.std]), self.rate))
        with np.errstate(divide="ignore"):
            return held + np.log(before.held), changed + np.log1p(-before.held)

    def _log_joint(self, value: FloatArray, std: FloatArray, rate: float) -> FloatArray:
        return np.asarray(log_densities(self.levels, value, std) + np.log(np.array([[1.0 - rate], [rate]])))

    def _anomalous(self, before: Tracked) -> float:
        """Return the probability that the value of earlier windows is anomalous."""
        joint = self._log_joint(np.array([before.mean]), np.array([before.std]), self.rate)[:, 0]
        return float(np.exp(joint[1] - np.logaddexp(joint[0], joint[1])))

    def _rate_after_change(self, before: Tracked) -> float:
        return rate_after_change(self._anomalous(before), self.rate)

    def informative(self, std: float) -> bool:
        """Return whether a measurement with this standard deviation can distinguish nominal from anomalous at all."""
        return std < INFORMATIVE_STD * self.levels.reach

    def relies_on_earlier(self, std: float) -> bool:
        """Return whether a window that measured the coefficient with `std` relies on earlier, better ones."""
        before = self.before
        return (
            before is not None
            and before.held > MIN_HELD_PROBABILITY
            and before.std < min(std, INFORMATIVE_STD * self.levels.reach)
            and not std < DECISIVE_STD * self.levels.reach
        )

    def after(self, value: float, std: float) -> Tracked | None:
        """Return the tracked value after a window that measured `value` ± `std`; None if there still is none.

        Where the window is informative, the mixture of held and changed is replaced by the Gaussian of the same mean
        and variance; otherwise the filtered earlier value is kept, with the probability that it still holds.
        """
        if not (math.isfinite(value) and math.isfinite(std)):
            return self.before
        measured = Tracked(mean=value, std=std, windows=1)
        if self.before is None:
            return measured if self.informative(std) else None
        at, spread = np.array([value]), np.array([std])
        held, changed = (float(np.logaddexp(*part[:, 0])) for part in self.log_parts(at, spread))
        share = math.exp(held - np.logaddexp(held, changed))
        mean, narrowed, _ = _filtered(self.before, at, spread)
        if not self.informative(std):
            return Tracked(mean=float(mean[0]), std=float(narrowed[0]), windows=self.before.windows + 1, held=share)
        both = share * float(mean[0]) + (1.0 - share) * value
        variance = share * (float(narrowed[0]) ** 2 + (float(mean[0]) - both) ** 2)
        variance += (1.0 - share) * (std**2 + (value - both) ** 2)
        return Tracked(mean=both, std=math.sqrt(variance), windows=self.before.windows + 1)


def coefficient(model: AnomalyModel | None, tracked: Tracked | None, unit: float = 1.0) -> Coefficient | None:
    """Return a coefficient before a window; None where nothing was learned about it.

    Parameters
    ----------
    model
        The learned model.
    tracked
        The value after earlier windows, or None.
    unit
        The features' unit in that of `tracked`.
    """
    if model is None or model.levels[0] is None:
        return None
    return Coefficient(model.levels[0], model.rate, None if tracked is None else tracked.drifted().scaled(1.0 / unit))


def _filtered(before: Tracked, value: FloatArray, std: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return mean and std of the earlier value updated by a measurement, and the latter's log predictive density."""
    total = np.maximum(np.hypot(before.std, std), SMALLEST_STD)
    mean = before.mean + (before.std / total) ** 2 * (value - before.mean)
    log_density = -0.5 * ((value - before.mean) / total) ** 2 - np.log(total * math.sqrt(2.0 * math.pi))
    return mean, before.std * std / total, log_density


UNKNOWN: Final = 0.5  # probability of an anomaly about which nothing is known
LEAST_PRIOR: Final = 1e-9  # no prior probability is nearer to 0 or 1: its logarithm stays finite
OFFSET_STEPS: Final = 1024  # grid over which an unknown offset is integrated, from no offset to all of the dry friction
PRIOR_ROUNDS: Final = 8  # each reduces the error of the marginal probabilities by about an order of magnitude
_History = tuple[Coefficient | None, Coefficient | None]  # dry and viscous before the window; None: nothing learned
MIN_STRAY_MEAN: Final = 0.9  # mean probability of being a stray beyond which values count as unlike anything learned


@dataclass(frozen=True, slots=True)
class Judged:
    """Judgement on one anomaly.

    Attributes
    ----------
    name
        Of the anomaly.
    probability
        That it is there.
    active
        Whether it is diagnosed.
    informative
        Whether this window, or recent ones, can detect it at all; otherwise the probability is that before the window.
    unfamiliar
        Whether its values are unlike everything learned, nominal or anomalous.
    relies_on_earlier
        Whether the judgement relies on earlier windows, this one alone not deciding it.
    known
        Whether anything was learned or stated of it; otherwise it is not judged.
    """

    name: str
    probability: float = UNKNOWN
    active: bool = False
    informative: bool = False
    unfamiliar: bool = False
    relies_on_earlier: bool = False
    known: bool = True


class Judgement(NamedTuple):
    """Judgement on all anomalies of a wheel.

    Attributes
    ----------
    anomalies
        One entry each, in the wheel's order.
    features
        The features at the most plausible split of base and systems; the given ones where nothing was ambiguous.
    next_prior
        For each anomaly the probability that the next window starts from.
    configurations
        For each system int64 (sojourns,): the likeliest configurations by all that was learned, its jumps being given.
    tracked
        Base dry and viscous friction as known after the window, in the features' unit; None where unknown.
    """

    anomalies: tuple[Judged, ...]
    features: Features
    next_prior: dict[str, float]
    configurations: tuple[IntArray, ...]
    tracked: tuple[Tracked | None, Tracked | None] = (None, None)


def assigned_configurations(features: Features) -> tuple[IntArray, ...]:
    """Return the configurations of each system's sojourns by the assignment, int64 (sojourns,) each."""
    return tuple(system.configuration for system in features.systems)


def unjudged(features: Features, names: Sequence[str]) -> Judgement:
    """Return the judgement where nothing is known: neither active nor not."""
    judged = tuple(Judged(name, known=False) for name in names)
    return Judgement(judged, features, {}, assigned_configurations(features))


def classify(
    features: Features,
    models: Sequence[AnomalyModel | None],
    names: Sequence[str],
    model: Model,
    carried: CarriedState,
    new_share: float = 1.0,
) -> Judgement:
    """Judge all anomalies together.

    Parameters
    ----------
    features
        Of the window.
    models
        What was learned about each anomaly of the wheel, None where nothing was.
    names
        The anomalies' names, in the wheel's order.
    model
        The whole model, for the probability of several anomalies at once.
    carried
        The state after earlier windows.
    new_share
        Share of the window's slots that no earlier window had; evidence is weighted by it in the carried state, so that
        overlapping windows do not count it twice.
    """
    history = (coefficient(models[0], carried.base_dry), coefficient(models[1], carried.viscous, features.viscous_unit))
    dry, viscous = history
    combinations = _all_combinations(len(names))
    conditional = features.by_path or (features,)
    weighed = [_log_likelihood(one, models, combinations, history) for one in conditional]
    log_likelihood = np.array([one.log_weight + found[0] for one, found in zip(conditional, weighed, strict=True)])
    prior = _prior(models, names, model, carried, history)
    log_prior = np.log(prior)
    by_path = softmax(log_prior + log_likelihood)
    posterior, weights = by_path.sum(axis=0), by_path.sum(axis=1)
    same_jumps = (s for s, one in enumerate(conditional) if one.same_jumps)
    likeliest = max(same_jumps, key=lambda s: float(weights[s]), default=None)
    configurations = assigned_configurations(features if likeliest is None else conditional[likeliest])
    ambiguity = None
    if not features.base_known:
        # Without alternative paths, the window's own features have been evaluated already.
        ambiguity = (_log_likelihood(features, models, combinations, history) if features.by_path else weighed[0])[1]
    if ambiguity is None:
        base = dry.after(features.base_dry, features.base_dry_std) if dry else None
    else:
        number = ambiguity.number(combinations)
        features = _widened(ambiguity.apply(features, posterior, number), conditional, weights)
        # The window identifies only the sum of the base and a system's friction: no new value replaces the old one.
        base = dry.before.changed(held=ambiguity.held_after(posterior, number)) if dry and dry.before else None

    judged, next_prior = [], {}
    shares, shares_before = shares_of(combinations, posterior), shares_of(combinations, prior)
    for a, (name, learned, share, before) in enumerate(zip(names, models, shares, shares_before, strict=True)):
        if not _is_known(learned):
            judged.append(Judged(name, known=False))
            continue
        # Rounding can raise a sum of shares above one: 1 + 2e-16 would be refused as a probability.
        probability = min(1.0, share)
        informative, unfamiliar = _quality(features, learned, a)
        relies_on_earlier = a == 1 and viscous is not None and viscous.relies_on_earlier(features.viscous_std)
        judged.append(
            Judged(
                name,
                probability,
                active=probability > 0.5,
                informative=informative or relies_on_earlier,
                unfamiliar=unfamiliar,
                relies_on_earlier=relies_on_earlier,
            )
        )
        # A coefficient that the window hardly measures is biased to the same side in each similar window.
        hardly = a < 2 and not informative and (a == 1 or ambiguity is None)
        repeated = hardly or _repeats(features, a)
        log_odds = _logit(before)
        gained = 0.0 if repeated else new_share * (_logit(probability) - log_odds)
        next_prior[name] = float(special.expit(log_odds + gained))
    tracked = (base, viscous.after(features.viscous, features.viscous_std) if viscous else None)
    return Judgement(tuple(judged), features, next_prior, configurations, tracked)


@functools.lru_cache(maxsize=16)
def _all_combinations(anomalies: int) -> BoolArray:
    """Return which anomalies are there in each combination of them, bool (2^anomalies, anomalies)."""
    combinations = np.array(list(itertools.product((False, True), repeat=anomalies)))
    combinations.setflags(write=False)
    return combinations


def shares_of(combinations: BoolArray, weights: FloatArray) -> list[float]:
    """Return the sum of the weights (combinations,) of all combinations that hold each anomaly."""
    return [float(np.sum(weights[there])) for there in combinations.T]


def _repeats(features: Features, a: int) -> bool:
    """Return whether the next window would repeat the evidence on this anomaly, so that it must not accumulate.

    A system that made no jump gives no information at rest; elsewhere only on the sum of its friction and the base's,
    and the two stay inseparable however long that lasts.
    """
    if a == 0:
        return any(not system.rests and system.unmoved for system in features.systems)
    return a > 1 and features.systems[a - 2].unmoved


def _widened(features: Features, conditional: Sequence[Features], weights: FloatArray) -> Features:
    """Return the features with the base's std widened by its scatter over the paths in which all systems rest.

    `weights` (paths,) are the paths' probabilities. A base higher by one step of a system, with the system one
    configuration lower, explains the same samples.
    """
    apart = [(one.base_dry - features.base_dry) * one.base_known for one in conditional]
    spread = math.sqrt(weights @ np.square(apart))
    return features._replace(base_dry_std=math.hypot(features.base_dry_std, spread))


def _log_likelihood(
    features: Features, models: Sequence[AnomalyModel | None], combinations: BoolArray, history: _History
) -> tuple[FloatArray, BaseSystemAmbiguity | None]:
    """Return the log likelihood of each combination, float64 (combinations,), and the ambiguity integrated for it."""
    # Systems that never rest are judged together with the base dry friction, all others alone.
    unrested = [
        (s, learned)
        for s, (system, learned) in enumerate(zip(features.systems, models[2:], strict=True))
        if not system.rests and _is_known(learned)
    ]
    log_likelihood = np.zeros(len(combinations))
    no_offset, alone = np.zeros(1), [np.zeros(2)] * combinations.shape[1]
    if not unrested:
        alone[0] = _value_evidence(history[0], features.base_dry, features.base_dry_std)
    alone[1] = _value_evidence(history[1], features.viscous, features.viscous_std)
    for a, (model, system) in enumerate(zip(models[2:], features.systems, strict=True), start=2):
        if system.rests:
            alone[a] = system_evidence(model, system, no_offset)[:, 0]
    for there, rows in zip(combinations.T, alone, strict=True):
        log_likelihood += np.where(there, rows[1], rows[0])
    if not unrested:
        return log_likelihood, None
    ambiguity = integrate_ambiguity(features, history[0], unrested)
    return log_likelihood + ambiguity.log_likelihood[ambiguity.number(combinations)], ambiguity


def _value_evidence(before: Coefficient | None, value: float, std: float) -> FloatArray:
    """Return the log likelihoods (2,) of a coefficient, nominal and anomalous; equal where nothing is known."""
    if before is None or not (math.isfinite(value) and math.isfinite(std)):
        return np.zeros(2)
    return before.log_evidence(np.array([value]), np.array([std]))[:, 0]


def _prior(
    models: Sequence[AnomalyModel | None], names: Sequence[str], model: Model, carried: CarriedState, history: _History
) -> FloatArray:
    """Return the probability of each combination before the window, float64 (combinations,).

    The distribution of the number of simultaneous anomalies is learned, all sets of one number being equally likely.
    Then each anomaly's odds are set to its rate, and its probability to that after earlier windows, the latter in turns
    until all agree (iterative proportional fitting): ruling out one anomaly must not, window after window, raise the
    others.
    """
    prior, rates = _learned_prior(model.simultaneous, tuple(learned and learned.rate for learned in models))
    wanted = _carried_probabilities(names, rates, carried, history)
    for _ in range(PRIOR_ROUNDS if wanted else 0):
        for a, now in wanted.items():
            there = _all_combinations(len(names))[:, a]
            so_far = float(prior[there].sum()) / float(prior.sum())
            prior = prior * np.where(there, now / so_far, (1.0 - now) / (1.0 - so_far))
    return np.asarray(prior / prior.sum(), dtype=np.float64)


@functools.lru_cache(maxsize=64)
def _learned_prior(
    simultaneous: tuple[float, ...], learned: tuple[float | None, ...]
) -> tuple[FloatArray, tuple[float, ...]]:
    """Return the probability of each combination by the learned model alone, and the rate of each anomaly in it.

    `learned`: the rates, None where none was learned. They never change while a model is in use, for months.
    """
    total = len(learned)
    combinations = _all_combinations(total)
    count = combinations.sum(axis=1)
    of_count = np.array([simultaneous[min(k, len(simultaneous) - 1)] / math.comb(total, k) for k in range(total + 1)])
    prior = of_count[count] / of_count[count].sum()
    log_prior = np.log(prior)
    shares = shares_of(combinations, prior)
    rates = tuple(share if rate is None else rate for rate, share in zip(learned, shares, strict=True))
    for there, rate, share in zip(combinations.T, rates, shares, strict=True):
        log_prior += there * (_logit(rate) - _logit(share))
    return softmax(log_prior), rates


def _carried_probabilities(
    names: Sequence[str], rates: Sequence[float], carried: CarriedState, history: _History
) -> dict[int, float]:
    """Return by anomaly its probability after earlier windows; no entry for those without information from them.

    That of a coefficient which they measured comes from its value; the others' from the last judgement, and the
    probability of a change since.
    """
    shown = {
        a: probability_before(carried.probability[name], rate)
        for a, (name, rate) in enumerate(zip(names, rates, strict=True))
        if name in carried.probability
    }
    shown |= {a: value.prior for a, value in enumerate(history) if value and value.before}
    return {a: _clipped(p) for a, p in sorted(shown.items())}


def _is_known(model: AnomalyModel | None) -> TypeGuard[AnomalyModel]:
    """Return whether anything is known of an anomaly's friction, learned or stated by the wheel file."""
    return model is not None and any(levels is not None for levels in model.levels)


def _quality(features: Features, model: AnomalyModel, a: int) -> tuple[bool, bool]:
    """Return whether the window is informative on an anomaly, and whether its values are unlike everything learned."""
    if a < 2:
        q, value, std = features.measured(a)
        found = np.array([q]), np.array([value]), np.array([std])
    else:
        found = features.systems[a - 2].active()
    stray, relative_std = stray_probabilities(model, *found)
    if stray.size == 0:
        return False, False
    return float(relative_std.min()) < INFORMATIVE_STD, float(stray.sum()) / stray.size > MIN_STRAY_MEAN


def _logit(probability: float) -> float:
    return float(special.logit(_clipped(probability)))


def _clipped(probability: float) -> float:
    """Return a probability away from 0 and 1, which would rule out an outcome for ever."""
    return min(max(probability, LEAST_PRIOR), 1.0 - LEAST_PRIOR)


# ---- the offset that a system which never rests shares with the base (errata 10) -------------------------------------


class BaseSystemAmbiguity(NamedTuple):
    """The unknown offset, integrated out, for each combination of dry and the k systems that never rest.

    Attributes
    ----------
    log_likelihood
        float64 (2^(k+1),), numbered by `number`.
    base, base_variance
        float64 (2^(k+1),), mean and variance of the base dry friction under each combination.
    held
        float64 (2^(k+1),), probability that the base is still the one of earlier windows.
    systems
        Indices of the systems.
    """

    log_likelihood: FloatArray
    base: FloatArray
    base_variance: FloatArray
    held: FloatArray
    systems: tuple[int, ...]

    def number(self, combinations: BoolArray) -> IntArray:
        """Number combinations of all anomalies (n, anomalies) by dry (the highest bit) and these systems; (n,)."""
        columns = combinations[:, [0, *(2 + s for s in self.systems)]]
        return np.asarray(columns @ (2 ** np.arange(columns.shape[1])[::-1]), dtype=np.int64)

    def apply(self, features: Features, posterior: FloatArray, number: IntArray) -> Features:
        """Return the features at the expected base; what the base loses, the system that never rests gains.

        With several such systems their shares are not identifiable: stage 3's split is kept, with a wider base.
        """
        weights = self._weights(posterior, number)
        mean = float(np.sum(weights * self.base))
        std = math.sqrt(max(np.sum(weights * (self.base_variance + (self.base - mean) ** 2)), 0.0))
        if len(self.systems) != 1:
            return features._replace(base_dry_std=max(std, features.base_dry_std))
        systems = list(features.systems)
        system = systems[self.systems[0]]
        systems[self.systems[0]] = system._replace(
            friction=system.friction + (features.base_dry - mean),
            friction_std=np.hypot(system.friction_std, std),
        )
        return features._replace(base_dry=mean, base_dry_std=std, systems=tuple(systems))

    def held_after(self, posterior: FloatArray, number: IntArray) -> float:
        """Return the probability after the window that the base is still the one of earlier windows."""
        return float(np.sum(self._weights(posterior, number) * self.held))

    def _weights(self, posterior: FloatArray, number: IntArray) -> FloatArray:
        return np.bincount(number, weights=posterior, minlength=self.base.size).astype(np.float64)


def integrate_ambiguity(
    features: Features,
    dry: Coefficient | None,
    unrested: Sequence[tuple[int, AnomalyModel]],
) -> BaseSystemAmbiguity:
    """Integrate the offset of each system that never rests, for all combinations of dry and these systems.

    With T the level at which every such system is in its first sojourn, base = T - Σ o_s, and the friction of sojourn i
    of system s is o_s + (f_i - f_0): the likelihood is the convolution of the systems' likelihoods with the density of
    the base.

    Parameters
    ----------
    features
        Of the window.
    dry
        Dry friction, learned bands and value after earlier windows; None where nothing was learned.
    unrested
        Index and model of each system that never rests.
    """
    systems = [features.systems[s] for s, _ in unrested]
    first = [float(system.friction[0]) for system in systems]
    total = features.base_dry + sum(first)
    step = max(total, 1e-3) / (OFFSET_STEPS - 1)
    grid = step * np.arange(OFFSET_STEPS, dtype=np.float64)
    tables = [
        _scaled(system_evidence(model, system, grid - start))
        for (_, model), system, start in zip(unrested, systems, first, strict=True)
    ]
    base = total - grid  # at each sum of offsets
    of_base, held_of_base = np.ones((2, OFFSET_STEPS)), np.zeros((2, OFFSET_STEPS))
    if dry is not None:
        steps = np.full(OFFSET_STEPS, step)
        of_base = np.exp(dry.log_evidence(base, steps))
        if dry.before is not None:
            log_held, log_changed = dry.log_parts(base, steps)
            held_of_base = np.exp(log_held - np.logaddexp(log_held, log_changed))

    count = 2 ** (len(unrested) + 1)
    log_likelihood, mean, variance = np.full(count, -np.inf), np.full(count, features.base_dry), np.zeros(count)
    held = np.zeros(count)
    for number, bits in enumerate(itertools.product((0, 1), repeat=len(unrested) + 1)):
        together, log_scale = _convolve(
            [(table[bit], top[bit]) for (table, top), bit in zip(tables, bits[1:], strict=True)]
        )
        weight = together * of_base[bits[0]]
        mass = float(weight.sum())
        if mass > 0:
            log_likelihood[number] = math.log(mass) + len(unrested) * math.log(step) + log_scale
            mean[number] = np.sum(weight * base) / mass
            variance[number] = np.sum(weight * (base - mean[number]) ** 2) / mass
            held[number] = np.sum(weight * held_of_base[bits[0]]) / mass
    return BaseSystemAmbiguity(log_likelihood, mean, variance, held, tuple(s for s, _ in unrested))


def _convolve(tables: Sequence[tuple[FloatArray, float]]) -> tuple[FloatArray, float]:
    """Convolve likelihoods over the grid of offsets; the logarithms of their scale factors add up."""
    together, log_scale = tables[0]
    for table, scale in tables[1:]:
        together = np.convolve(together, table)[: together.size]
        log_scale += scale
    return together, float(log_scale)


def _scaled(log_values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return exp(row - its maximum) and the maxima: likelihoods of many sojourns would underflow."""
    top = log_values.max(axis=1)
    return np.exp(log_values - top[:, None]), top
