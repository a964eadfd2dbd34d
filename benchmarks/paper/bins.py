"""The paper's sweep of the number of histogram bins: misclassification of one switching system's anomaly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from benchmarks.accuracy.outcome import Outcome
from benchmarks.accuracy.splits import TRAINING_SHARE
from rwa_monitor.paper.classification import decide, train_svm
from rwa_monitor.samples import FloatArray

SWEPT: Final = (2, 5, 10, 20, 40, 80, 160)
SYSTEM: Final = "fss_1"  # the paper's subsystem 1


@dataclass(frozen=True, slots=True)
class BinsSweep:
    """Share of windows misclassified, by number of bins and split.

    Attributes
    ----------
    bins
        Numbers of bins.
    training, validation
        float64 (bins, splits).
    """

    bins: tuple[int, ...]
    training: FloatArray
    validation: FloatArray


def sweep(outcomes: Sequence[Outcome], features: str, seed: int, splits: int) -> BinsSweep:
    """Train and judge the paper's classifier of one system with each number of bins.

    Parameters
    ----------
    outcomes
        Windows with their features.
    features
        The method or oracle whose features are used.
    seed, splits
        Of the random splits of the paper's protocol.
    """
    values = [next(s for s in o.features[features].systems if s.name == SYSTEM).friction for o in outcomes]
    label = np.array([outcome.labels[SYSTEM] for outcome in outcomes], dtype=bool)
    rng, size = np.random.default_rng(seed), round(TRAINING_SHARE * len(outcomes))
    wrong = np.full((2, len(SWEPT), splits), np.nan)
    for split in range(splits):
        order = rng.permutation(len(outcomes))
        for b, bins in enumerate(SWEPT):
            svm = train_svm([values[i] for i in order[:size]], label[order[:size]], bins)
            if svm is None:  # too few windows of one class in this split
                continue
            error = np.array([(decide(svm, values[i])[0] > 0) != label[i] for i in order])
            wrong[:, b, split] = error[:size].mean(), error[size:].mean()
    return BinsSweep(SWEPT, wrong[0], wrong[1])
