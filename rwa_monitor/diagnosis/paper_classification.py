"""Stage 4 as the paper has it: one linear support vector machine per anomaly.

On the coefficient itself, or on the histogram of a system's friction (errata 13).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import special

from rwa_monitor.diagnosis.classification import UNKNOWN, Judged, Judgement, configurations_told
from rwa_monitor.diagnosis.features import Features, histogram
from rwa_monitor.diagnosis.model import AnomalyModel, LinearSvm
from rwa_monitor.samples import FloatArray


def svm_features(bins: int, low: float, high: float, values: FloatArray) -> FloatArray:
    """Return z: the value on the scale of the training data (0 bins), or the histogram of the values."""
    if bins:
        return histogram(values, low, high, bins)
    return (values - low) / (high - low)


def decide(svm: LinearSvm, values: FloatArray) -> tuple[float, float]:
    """Return w·z + b and the calibrated probability, for one coefficient (1,) or a system's friction (sojourns,)."""
    z = svm_features(svm.bins, svm.low, svm.high, values)
    decision = float(np.dot(np.asarray(svm.weights), z)) + svm.bias
    return decision, float(special.expit(svm.slope * decision + svm.offset))


def paper_values(features: Features) -> tuple[FloatArray, ...]:
    """Return the values that the paper classifies, one array per anomaly; a system gives all its sojourns."""
    return (
        np.array([features.base_dry]),
        np.array([features.viscous]),
        *(system.friction for system in features.systems),
    )


def classify_as_paper(features: Features, models: Sequence[AnomalyModel | None], names: Sequence[str]) -> Judgement:
    """Judge by one linear support vector machine per anomaly.

    Parameters
    ----------
    features
        Of the window.
    models
        What was learned about each anomaly, None where nothing was.
    names
        The anomalies' names, in the wheel's order.
    """
    judged = []
    for name, model, values in zip(names, models, paper_values(features), strict=True):
        if model is None or model.svm is None:
            rate = model.rate if model else UNKNOWN
            judged.append(Judged(name, rate, active=False, telling=False, unlike=False))
            continue
        decision, probability = decide(model.svm, values)
        # Active is what the paper says, the sign of the decision; the calibrated probability must not contradict it.
        probability = max(probability, 0.5) if decision > 0 else min(probability, 0.5)
        judged.append(Judged(name, probability, active=decision > 0, telling=True, unlike=False))
    to_carry = {entry.name: entry.probability for entry in judged}
    return Judgement(tuple(judged), features, to_carry, configurations_told(features))
