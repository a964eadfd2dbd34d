"""Likelihoods of what a window shows under nominal and anomalous friction, for the joint classifier.

Measured values are compared with the learned bands (`model.Levels`), each with its own standard deviation.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from rwa_monitor.diagnosis.densities import level_densities
from rwa_monitor.diagnosis.features import SystemFeatures
from rwa_monitor.diagnosis.model import AnomalyModel, Levels
from rwa_monitor.samples import FloatArray, IntArray


def log_densities(levels: Levels, value: FloatArray, std: FloatArray) -> FloatArray:
    """Return the log density of measured values under nominal (row 0) and anomalous (row 1), float64 (2, …).

    `value` and `std` broadcast against each other to the shape behind the rows.

    Both classes share the stray values of earlier stages' errors: heavy tails (Lomax, shape 1) around the nominal
    band. The anomalous class also has values beyond the nominal bound that are no learned anomaly's.
    """
    if value.shape != std.shape:
        value, std = np.broadcast_arrays(value, std)
    return np.log(level_densities(value.ravel(), std.ravel(), levels.numbers)[:2]).reshape(2, *value.shape)


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
        nominal, anomalous, inside = level_densities(value[at], std[at], levels.numbers)
        everything = 0.5 * (nominal + anomalous)
        with np.errstate(divide="ignore", invalid="ignore"):
            outside = np.maximum(0.0, 1.0 - 0.5 * inside / everything)
        stray[at] = np.where(everything > 0.0, outside, 1.0)
        relative[at] = std[at] / levels.reach
    known = np.isfinite(stray)
    return stray[known], relative[known]
