"""Section IV-D, anomaly classification: one linear support vector machine for each anomaly.

On the coefficient itself, or on the histogram of a system's friction (errata 13). scikit-learn is needed for training
only: a diagnosis takes no more than an inner product.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np
from scipy import special

from rwa_monitor.diagnosis.classification import UNKNOWN, Judged, Judgement, assigned_configurations
from rwa_monitor.diagnosis.features import Features
from rwa_monitor.diagnosis.model import AnomalyModel, LinearSvm, Model
from rwa_monitor.diagnosis.training import MIN_WINDOWS, LabelledFeatures
from rwa_monitor.samples import BoolArray, FloatArray

BINS: Final = 40  # errata 13
# Cost of a margin violation. Both kinds of feature lie in [0, 1]; histograms of 40 bins need a large cost to use them.
SVM_COST: Final = 100.0
SVM_TOLERANCE: Final = 1e-10  # of its stopping criterion
SVM_ITERATIONS: Final = 100_000
CALIBRATION_WEIGHT: Final = 1e-3  # of the squared slope: finite where the classes are separable


def classified_values(features: Features) -> tuple[FloatArray, ...]:
    """Return the values that the paper classifies, one array per anomaly; a system gives all its sojourns."""
    return (
        np.array([features.base_dry]),
        np.array([features.viscous]),
        *(system.friction for system in features.systems),
    )


def histogram(values: FloatArray, low: float, high: float, bins: int) -> FloatArray:
    """Return the normalised histogram of a system's friction, float64 (bins,).

    Bins are half-open and cover [low, high]; values outside count in the end bins. All zero without values.
    """
    values = values[np.isfinite(values)]
    if values.size == 0 or high <= low:
        return np.zeros(bins)
    bin_of = np.clip(np.floor((values - low) / (high - low) * bins), 0, bins - 1).astype(np.int64)
    return np.bincount(bin_of, np.full(values.size, 1.0 / values.size), bins).astype(np.float64)


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


def classify(features: Features, models: Sequence[AnomalyModel | None], names: Sequence[str]) -> Judgement:
    """Judge by one linear support vector machine per anomaly.

    Parameters
    ----------
    features
        Of the window.
    models
        The model of each anomaly, None where there is none.
    names
        The anomalies' names, in the wheel's order.
    """
    judged = []
    for name, model, values in zip(names, models, classified_values(features), strict=True):
        if model is None or model.svm is None:
            rate = model.rate if model else UNKNOWN
            judged.append(Judged(name, rate, active=False, informative=False, unfamiliar=False))
            continue
        decision, probability = decide(model.svm, values)
        # Active is the sign of the decision, as printed; the calibrated probability must not contradict it.
        probability = max(probability, 0.5) if decision > 0 else min(probability, 0.5)
        judged.append(Judged(name, probability, active=decision > 0, informative=True, unfamiliar=False))
    next_prior = {entry.name: entry.probability for entry in judged}
    return Judgement(tuple(judged), features, next_prior, assigned_configurations(features))


# ---- training --------------------------------------------------------------------------------------------------------


def with_classifiers(model: Model, windows: Sequence[LabelledFeatures]) -> Model:
    """Return a model with the support vector machine of each anomaly, trained on labelled windows.

    Parameters
    ----------
    model
        The model without these; names the anomalies.
    windows
        Features by this method, and labels, of the training windows.
    """
    anomalies = []
    for a, anomaly in enumerate(model.anomalies):
        label = np.array([window.labels[anomaly.name] for window in windows], dtype=np.bool_)
        values = [classified_values(window.features)[a] for window in windows]
        svm = train_svm(values, label, bins=0 if a < 2 else BINS)
        anomalies.append(anomaly.model_copy(update={"svm": svm}))
    return model.model_copy(update={"anomalies": tuple(anomalies)})


def train_svm(values: Sequence[FloatArray], anomalous: BoolArray, bins: int) -> LinearSvm | None:
    """Train a linear support vector machine; None where a class has too few windows.

    Parameters
    ----------
    values
        For each window the coefficient (1,), or the friction of a system's sojourns.
    anomalous
        bool (windows,).
    bins
        Of the histogram; 0 for a coefficient.
    """
    if min(int(anomalous.sum()), int((~anomalous).sum())) < MIN_WINDOWS:
        return None
    everything = np.concatenate(list(values))
    everything = everything[np.isfinite(everything)]
    if everything.size == 0 or np.ptp(everything) == 0:
        return None
    low, high = float(everything.min()), float(everything.max())
    features = np.stack([svm_features(bins, low, high, value) for value in values])
    from sklearn.svm import LinearSVC  # takes a second to import

    # The primal problem with squared hinge loss is strictly convex: one optimum, on every machine.
    machine = LinearSVC(C=SVM_COST, dual=False, tol=SVM_TOLERANCE, max_iter=SVM_ITERATIONS).fit(features, anomalous)
    weights, bias = machine.coef_[0], float(machine.intercept_[0])
    slope, offset = _calibrate(features @ weights + bias, anomalous)
    return LinearSvm(
        bins=bins,
        low=low,
        high=high,
        weights=tuple(float(weight) for weight in weights),
        bias=bias,
        slope=slope,
        offset=offset,
    )


def _calibrate(decision: FloatArray, anomalous: BoolArray) -> tuple[float, float]:
    """Return slope and offset of Platt's calibration (1999), with his smoothed targets.

    Each window enters as positive with its target as weight, and as negative with the rest. The small penalty on the
    slope matters only where all decisions are equal and the slope is not identifiable.
    """
    from sklearn.linear_model import LogisticRegression

    positive, negative = int(anomalous.sum()), int((~anomalous).sum())
    target = np.where(anomalous, (positive + 1.0) / (positive + 2.0), 1.0 / (negative + 2.0))
    # A convex problem, solved to more than the 12 digits that a model keeps.
    machine = LogisticRegression(C=1.0 / CALIBRATION_WEIGHT, solver="newton-cholesky", tol=1e-14)
    twice = np.concatenate([decision, decision])[:, None]
    machine.fit(twice, np.repeat([True, False], decision.size), np.concatenate([target, 1.0 - target]))
    return float(machine.coef_[0, 0]), float(machine.intercept_[0])
