"""Likelihoods of what a window shows under nominal and anomalous friction, for the joint classifier.

Measured values are compared with the learned bands (`model.Levels`), each with its own standard deviation. Where a
switching system never rests in the window, its friction and the base dry friction share an unknown shift (errata 10),
which `integrate_shift` integrates out for all combinations of the anomalies concerned.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy import special

from rwa_monitor.diagnosis.features import Features, SystemFeatures
from rwa_monitor.diagnosis.model import AnomalyModel, Levels
from rwa_monitor.diagnosis.state import Tracked
from rwa_monitor.samples import BoolArray, FloatArray, IntArray

# Share of anomalies that have another size than those learned. A wheel that is a third of the way to the learned
# anomaly, or far beyond it, is anomalous too.
OTHER_SIZE: Final = 0.05
# From one window to the next everything may have changed with this probability (one in fifty windows, six days of
# windows of 10,000 s): then the wheel is as likely anomalous as any. It keeps what is carried from becoming certain.
CHANGE_PER_WINDOW: Final = 0.02
SHIFT_STEPS: Final = 1024  # grid over which an unknown shift is integrated, from no shift to all of the dry friction


def log_densities(levels: Levels, value: FloatArray, std: FloatArray) -> FloatArray:
    """Return the log density of measured values under nominal (row 0) and anomalous (row 1), float64 (2, …).

    `value` and `std` broadcast against each other to the shape behind the rows.

    Both classes share the stray values of earlier stages' errors: heavy tails (Lomax, shape 1) around the nominal
    band. The anomalous class also has values beyond the nominal bound that are no learned anomaly's.
    """
    reach = np.hypot(levels.reach, std)
    distance = np.abs(value - levels.nominal.middle)
    stray = 0.5 / reach / (1.0 + distance / reach) ** 2
    excess = value - levels.nominal_high
    other = special.ndtr(excess / np.hypot(levels.nominal.soft, std)) / reach
    other /= (1.0 + np.maximum(excess, 0.0) / reach) ** 2
    nominal = (1.0 - levels.stray) * levels.nominal.density(value, std) + levels.stray * stray
    learned = levels.anomalous.density(value, std) if levels.anomalous else other
    anomalous = (1.0 - levels.stray - OTHER_SIZE) * learned + OTHER_SIZE * other + levels.stray * stray
    return np.log(np.stack([nominal, anomalous]))


def value_evidence(model: AnomalyModel | None, value: float, std: float) -> FloatArray:
    """Return the log likelihoods (2,) of a coefficient, nominal and anomalous; equal where nothing is known."""
    if model is None or model.levels[0] is None or not (math.isfinite(value) and math.isfinite(std)):
        return np.zeros(2)
    return log_densities(model.levels[0], np.array([value]), np.array([std]))[:, 0]


def system_evidence(model: AnomalyModel | None, system: SystemFeatures, shift: FloatArray) -> FloatArray:
    """Return the log likelihoods (2, shifts) of a system's sojourns above q = 0, with a shift added to all of them."""
    total = np.zeros((2, shift.size))
    if model is None:
        return total
    configuration, friction, std = system.active()
    log_density = np.zeros((2, friction.size, shift.size))
    for levels, at in _sojourns_known(model, configuration, friction, std):
        log_density[:, at] = log_densities(levels, friction[at, None] + shift, std[at, None])
    for k in range(friction.size):  # one after the other: the sum's last bit must not depend on how many there are
        total += log_density[:, k]
    return total


def _sojourns_known(
    model: AnomalyModel, configuration: IntArray, friction: FloatArray, std: FloatArray
) -> Iterator[tuple[Levels, IntArray]]:
    """Yield for each configuration that was learned its levels and which sojourns, finite ones, are in it."""
    finite = np.isfinite(friction) & np.isfinite(std)
    for q, levels in enumerate(model.levels):
        at = np.flatnonzero(finite & (configuration == q))
        if levels is not None and at.size:
            yield levels, at


def stray_probabilities(
    model: AnomalyModel, configuration: IntArray, value: FloatArray, std: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the probability that each value lies in none of the learned bands, and its standard deviation over reach.

    Parameters
    ----------
    model
        What was learned.
    configuration, value, std
        (n,); values of configurations that were not learned, and those that are not finite, are left out.
    """
    stray, relative = np.full(value.size, np.nan), np.full(value.size, np.nan)
    for levels, at in _sojourns_known(model, configuration, value, std):
        inside = levels.nominal.density(value[at], std[at])
        if levels.anomalous is not None:
            inside = inside + levels.anomalous.density(value[at], std[at])
        nominal, anomalous = np.exp(log_densities(levels, value[at], std[at]))
        everything = 0.5 * (nominal + anomalous)
        with np.errstate(divide="ignore", invalid="ignore"):
            outside = np.maximum(0.0, 1.0 - 0.5 * inside / everything)
        stray[at] = np.where(everything > 0.0, outside, 1.0)
        relative[at] = std[at] / levels.reach
    known = np.isfinite(stray)
    return stray[known], relative[known]


@dataclass(frozen=True, slots=True)
class Shift:
    """The unknown shift, integrated out, for each combination of dry and the k systems that never rest.

    Attributes
    ----------
    log_likelihood
        float64 (2^(k+1),), numbered by `number`.
    base, base_variance
        float64 (2^(k+1),), mean and variance of the base dry friction under each combination.
    systems
        Indices of the systems.
    """

    log_likelihood: FloatArray
    base: FloatArray
    base_variance: FloatArray
    systems: tuple[int, ...]

    def number(self, combinations: BoolArray) -> IntArray:
        """Number combinations of all anomalies (n, anomalies) by dry (the highest bit) and these systems; (n,)."""
        columns = combinations[:, [0, *(2 + s for s in self.systems)]]
        return np.asarray(columns @ (2 ** np.arange(columns.shape[1])[::-1]), dtype=np.int64)

    def apply(self, features: Features, posterior: FloatArray, number: IntArray) -> Features:
        """Return the features at the expected base; what the base loses, the system that never rests gains.

        With several such systems the data do not say how they share it, and stage 3's split of them stays.
        """
        weights = np.bincount(number, weights=posterior, minlength=self.base.size)
        mean = float(weights @ self.base)
        std = math.sqrt(max(float(weights @ (self.base_variance + (self.base - mean) ** 2)), 0.0))
        if len(self.systems) != 1:
            return replace(features, base_dry_std=max(std, features.base_dry_std))
        systems = list(features.systems)
        system = systems[self.systems[0]]
        systems[self.systems[0]] = replace(
            system,
            friction=system.friction + (features.base_dry - mean),
            friction_std=np.hypot(system.friction_std, std),
        )
        return replace(features, base_dry=mean, base_dry_std=std, systems=tuple(systems))


def integrate_shift(
    features: Features,
    dry: AnomalyModel | None,
    unrested: Sequence[tuple[int, AnomalyModel]],
    carried_base: Tracked | None,
) -> Shift:
    """Integrate the shift of each system that never rests, for all combinations of dry and these systems.

    With T the level at which every such system is in its first sojourn, base = T - Σ o_s, and the friction of sojourn i
    of system s is o_s + (f_i - f_0): the likelihood is the convolution of the systems' likelihoods with the density of
    the base.

    Parameters
    ----------
    features
        Of the window.
    dry
        What was learned about dry friction, None where nothing was.
    unrested
        Index and model of each system that never rests.
    carried_base
        The base of earlier windows, if any.
    """
    systems = [features.systems[s] for s, _ in unrested]
    first = [float(system.friction[0]) for system in systems]
    total = features.base_dry + sum(first)
    step = max(total, 1e-3) / (SHIFT_STEPS - 1)
    grid = step * np.arange(SHIFT_STEPS, dtype=np.float64)
    tables = [
        _scaled(system_evidence(model, system, grid - start))
        for (_, model), system, start in zip(unrested, systems, first, strict=True)
    ]
    base = total - grid  # at each sum of shifts
    of_base = np.ones((2, SHIFT_STEPS))
    if dry is not None and dry.levels[0] is not None:
        of_base = np.exp(log_densities(dry.levels[0], base, np.full(SHIFT_STEPS, step)))
    of_base = of_base * density_of_carried(carried_base, base, step, total)

    count = 2 ** (len(unrested) + 1)
    log_likelihood, mean, variance = np.full(count, -np.inf), np.full(count, features.base_dry), np.zeros(count)
    for number, bits in enumerate(itertools.product((0, 1), repeat=len(unrested) + 1)):
        together, log_scale = _convolve(
            [(table[bit], top[bit]) for (table, top), bit in zip(tables, bits[1:], strict=True)]
        )
        weight = together * of_base[bits[0]]
        mass = float(weight.sum())
        if mass > 0:
            log_likelihood[number] = math.log(mass) + len(unrested) * math.log(step) + log_scale
            mean[number] = float(weight @ base) / mass
            variance[number] = float(weight @ (base - mean[number]) ** 2) / mass
    return Shift(log_likelihood, mean, variance, tuple(s for s, _ in unrested))


def _convolve(tables: Sequence[tuple[FloatArray, float]]) -> tuple[FloatArray, float]:
    """Convolve likelihoods over the grid of shifts; the log of what they were divided by adds up."""
    together, log_scale = tables[0]
    for table, scale in tables[1:]:
        together = np.convolve(together, table)[: together.size]
        log_scale += scale
    return together, float(log_scale)


def _scaled(log_values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return exp(row - its maximum) and the maxima: likelihoods of many sojourns would underflow."""
    top = log_values.max(axis=1)
    return np.exp(log_values - top[:, None]), top


def density_of_carried(carried: Tracked | None, base: FloatArray, std: float, span: float) -> FloatArray:
    """Return what earlier windows say about a base measured with `std`, float64 as `base`; 1 without any.

    The base may also have jumped since: then it is anywhere in `span`.
    """
    if carried is None:
        return np.ones(base.size)
    std = math.hypot(carried.drifted().std, std)
    stayed = np.exp(-0.5 * ((base - carried.mean) / std) ** 2) / (std * math.sqrt(2.0 * math.pi))
    return np.asarray((1.0 - CHANGE_PER_WINDOW) * stayed + CHANGE_PER_WINDOW / max(span, std))
