"""The paper's protocol: train on 20 % of the windows, validate on the other 80 %, for 30 random splits.

Each split gives the matrix of the paper's results: of the windows with a status (row), the share in which each
anomaly is diagnosed (column). Calibration is measured on all validation windows of all splits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import special

from benchmarks.accuracy.outcome import Outcome
from benchmarks.page import wilson
from rwa_monitor.diagnosis.classification import Judged, classify
from rwa_monitor.diagnosis.model import Model, models_for
from rwa_monitor.diagnosis.training import train
from rwa_monitor.messages import Method
from rwa_monitor.paper.classification import classify as classify_as_paper
from rwa_monitor.paper.classification import with_classifiers
from rwa_monitor.samples import BoolArray, FloatArray
from rwa_monitor.switching.carried_state import CarriedState
from rwa_monitor.wheel.wheel import Wheel

TRAINING_SHARE: Final = 0.2
SPLITS: Final = 30
COVERAGES: Final = (1.0, 0.995, 0.99, 0.98, 0.95, 0.9)  # shares of the windows, the surest first
CALIBRATION_BINS: Final = 10


@dataclass(frozen=True, slots=True)
class Calibration:
    """Calibration of the probabilities of one anomaly.

    Attributes
    ----------
    log_score, brier
        Mean of -log p(truth) and of (p - truth)²; `_base`: the same of a forecast that always gives the base rate.
    expected_error
        Expected calibration error over ten bins.
    """

    log_score: float
    log_score_base: float
    brier: float
    brier_base: float
    expected_error: float


@dataclass(frozen=True, slots=True)
class Accuracy:
    """Detection over the splits.

    Attributes
    ----------
    statuses, anomalies
        Names of rows and columns.
    matrix
        float64 (splits, statuses, anomalies): share of windows with the status in which the anomaly is diagnosed.
    windows
        Validation windows of each status in one split, float64 (statuses,), on average.
    inconclusive
        float64 (splits,), share of validation windows with that verdict.
    risk
        float64 (coverages,): share of windows with a wrong anomaly among the shares COVERAGES of all windows with the
        least uncertainty; the uncertainty of a window is that of its most uncertain anomaly.
    calibration
        By anomaly.
    diagnosed, truth
        bool (windows, anomalies): anomalies diagnosed and present in the validation windows of all splits.
    """

    statuses: tuple[str, ...]
    anomalies: tuple[str, ...]
    matrix: FloatArray
    windows: FloatArray
    inconclusive: FloatArray
    risk: FloatArray
    calibration: dict[str, Calibration]
    diagnosed: BoolArray
    truth: BoolArray

    def interval(self, status: int, anomaly: int) -> tuple[float, float]:
        """Return the 95 % interval (Wilson) of a rate, as if all windows of the status had been judged once."""
        rate = float(np.nanmean(self.matrix[:, status, anomaly]))
        total = float(self.windows[status]) / (1.0 - TRAINING_SHARE)
        return wilson(rate, total)


def judge(outcomes: Sequence[Outcome], features: str, method: Method, model: Model, wheel: Wheel) -> FloatArray:
    """Return the probabilities, float64 (windows, anomalies); see `judge_windows`."""
    return judge_windows(outcomes, features, method, model, wheel)[0]


def judge_windows(
    outcomes: Sequence[Outcome], features: str, method: Method, model: Model, wheel: Wheel
) -> tuple[FloatArray, BoolArray]:
    """Return probabilities, float64 (windows, anomalies), and whether the verdict is inconclusive, bool (windows,).

    Parameters
    ----------
    outcomes
        Windows to judge.
    features
        The features to use: joint, paper, oracle A or oracle B.
    method
        Which classifier.
    model, wheel
        The model, and a wheel with the systems that it was trained for.
    """
    models, names, empty = models_for(wheel, model), wheel.anomalies, CarriedState.empty()
    rows, open_ones = [], []
    for outcome in outcomes:
        seen = outcome.features[features]
        if method == "paper":
            judgement = classify_as_paper(seen, models, names)
            # The paper decides by the sign of the decision function, whatever the calibrated probability is.
            rows.append([_on_side(entry.probability, active=entry.active) for entry in judgement.anomalies])
            open_ones.append(False)
        else:
            judgement = classify(seen, models, names, model, empty)
            rows.append([entry.probability for entry in judgement.anomalies])
            open_ones.append(not _conclusive(judgement.anomalies, *model.undecided))
    return np.array(rows), np.array(open_ones, dtype=np.bool_)


def _conclusive(anomalies: Sequence[Judged], low: float, high: float) -> bool:
    """Return whether a verdict can be given.

    Either an anomaly is certain, or every anomaly is decided, observable, and similar to the training windows.

    Parameters
    ----------
    anomalies
        The judgement on each.
    low, high
        An anomaly is undecided between these probabilities.
    """
    if any(entry.active and entry.probability >= high for entry in anomalies):
        return True
    return not any(low < entry.probability < high or entry.unfamiliar or not entry.informative for entry in anomalies)


def _on_side(probability: float, *, active: bool) -> float:
    least = np.nextafter(0.5, 1.0)
    return max(probability, float(least)) if active else min(probability, 0.5)


def measure(
    outcomes: Sequence[Outcome], features: str, method: Method, wheel: Wheel, seed: int, splits: int = SPLITS
) -> Accuracy:
    """Measure detection by the paper's protocol.

    Parameters
    ----------
    outcomes
        All windows of a data set.
    features, method
        See `judge`; the classifiers are trained on the same kind of features.
    wheel
        A wheel with the systems of the data set.
    seed
        Of the random splits.
    splits
        Number of random splits.
    """
    names = wheel.anomalies
    labels = np.array([[outcome.labels[name] for name in names] for outcome in outcomes], dtype=bool)
    statuses = tuple(dict.fromkeys(("nominal", *sorted(outcome.status for outcome in outcomes))))
    row_of = np.array([statuses.index(outcome.status) for outcome in outcomes])
    rng = np.random.default_rng(seed)
    size = round(TRAINING_SHARE * len(outcomes))
    matrices, inconclusive, windows = [], [], np.zeros(len(statuses))
    probabilities, truths, diagnosed = [], [], []
    for _ in range(splits):
        order = rng.permutation(len(outcomes))
        training, validation = order[:size], order[size:]
        windows_learned = [outcomes[i].labelled(features) for i in training]
        model = with_classifiers(train(windows_learned, wheel, "split", "benchmark"), windows_learned)
        probability, is_open = judge_windows([outcomes[i] for i in validation], features, method, model, wheel)
        rows = row_of[validation]
        # An undecided anomaly counts as not diagnosed; the paper's method always decides.
        least = model.undecided[1] if method == "joint" else np.nextafter(0.5, 1.0)
        diagnosed.append(probability >= least)
        matrices.append(_shares(diagnosed[-1], rows, len(statuses)))
        inconclusive.append(float(is_open.mean()))
        windows += np.bincount(rows, minlength=len(statuses)) / splits
        probabilities.append(probability)
        truths.append(labels[validation])
    everything, truth = np.concatenate(probabilities), np.concatenate(truths)
    return Accuracy(
        statuses,
        names,
        np.stack(matrices),
        windows,
        np.array(inconclusive),
        _risk(everything, truth),
        {name: calibrate(everything[:, a], truth[:, a]) for a, name in enumerate(names)},
        np.concatenate(diagnosed),
        truth,
    )


def _shares(diagnosed: BoolArray, rows: FloatArray, statuses: int) -> FloatArray:
    """Return the share of windows diagnosed, by status; NaN where a status does not occur."""
    shares = np.full((statuses, diagnosed.shape[1]), np.nan)
    for row in range(statuses):
        if (rows == row).any():
            shares[row] = diagnosed[rows == row].mean(axis=0)
    return shares


def _risk(probability: FloatArray, truth: BoolArray) -> FloatArray:
    """Return the share of windows with an error among those of least uncertainty, float64 (coverages,)."""
    uncertainty = np.minimum(probability, 1.0 - probability).max(axis=1)
    wrong = ((probability > 0.5) != truth).any(axis=1)[np.argsort(uncertainty, kind="stable")]
    return np.array([float(wrong[: max(round(coverage * wrong.size), 1)].mean()) for coverage in COVERAGES])


def calibrate(probability: FloatArray, truth: BoolArray) -> Calibration:
    """Return the calibration of the probabilities of one anomaly, float64 (n,), given the truth, bool (n,)."""
    p = np.clip(probability, 1e-6, 1.0 - 1e-6)
    base = float(np.clip(truth.mean(), 1e-6, 1.0 - 1e-6))
    log_score = -float(np.where(truth, np.log(p), np.log1p(-p)).mean())
    bin_of = np.minimum((p * CALIBRATION_BINS).astype(np.int64), CALIBRATION_BINS - 1)
    error = sum(
        abs(float(p[bin_of == b].mean()) - float(truth[bin_of == b].mean())) * float((bin_of == b).mean())
        for b in np.unique(bin_of)
    )
    entropy = float(special.entr(base) + special.entr(1.0 - base))
    return Calibration(log_score, entropy, float(((p - truth) ** 2).mean()), base * (1.0 - base), error)
