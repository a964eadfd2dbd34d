"""Likelihoods of what a window shows under nominal and anomalous friction, for the joint classifier.

Measured values are compared with the learned bands (`model.Levels`), each with its own standard deviation.
"""

from __future__ import annotations

import numpy as np

from rwa_monitor.diagnosis.features import SystemFeatures
from rwa_monitor.diagnosis.model import AnomalyModel, Levels
from rwa_monitor.kernels.laws import level_densities, sojourn_densities, strays
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
    configuration, friction, std = system.active()
    if model is None or friction.size == 0:
        return np.zeros((2, shift.size))
    log_density = np.log(sojourn_densities(configuration, friction, std, shift, model.numbers))
    # One after the other: the sum's last bit must not depend on how many there are.
    return np.asarray(np.cumsum(log_density, axis=1)[:, -1])


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
    stray, relative = strays(configuration, value, std, model.numbers)
    return stray, relative
