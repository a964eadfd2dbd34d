"""The offset that a system which never rests shares with the base dry friction (errata 10), integrated out.

Where a switching system never rests in the window, only the sum of its friction and the base dry friction is measured.
All splits of the sum are weighed, for all combinations of the anomalies concerned.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from rwa_monitor.diagnosis.features import Features
from rwa_monitor.diagnosis.history import Coefficient
from rwa_monitor.diagnosis.model import AnomalyModel, system_evidence
from rwa_monitor.kernels.order_statistics import sum_up
from rwa_monitor.samples import BoolArray, FloatArray, IntArray

OFFSET_STEPS: Final = 1024  # grid over which an unknown offset is integrated, from no offset to all of the dry friction


@dataclass(frozen=True, slots=True)
class BaseSystemAmbiguity:
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

        With several such systems the data do not show how they share it, and stage 3's split of them stays.
        """
        weights = self._weights(posterior, number)
        mean = sum_up(weights * self.base)
        std = math.sqrt(max(sum_up(weights * (self.base_variance + (self.base - mean) ** 2)), 0.0))
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

    def held_after(self, posterior: FloatArray, number: IntArray) -> float:
        """Return the probability after the window that the base is still the one of earlier windows."""
        return sum_up(self._weights(posterior, number) * self.held)

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
        What was learned of dry friction, and what earlier windows showed of it; None where nothing was.
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
            mean[number] = sum_up(weight * base) / mass
            variance[number] = sum_up(weight * (base - mean[number]) ** 2) / mass
            held[number] = sum_up(weight * held_of_base[bits[0]]) / mass
    return BaseSystemAmbiguity(log_likelihood, mean, variance, held, tuple(s for s, _ in unrested))


def _convolve(tables: Sequence[tuple[FloatArray, float]]) -> tuple[FloatArray, float]:
    """Convolve likelihoods over the grid of offsets; the log of what they were divided by adds up."""
    together, log_scale = tables[0]
    for table, scale in tables[1:]:
        together = np.convolve(together, table)[: together.size]
        log_scale += scale
    return together, float(log_scale)


def _scaled(log_values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return exp(row - its maximum) and the maxima: likelihoods of many sojourns would underflow."""
    top = log_values.max(axis=1)
    return np.exp(log_values - top[:, None]), top
