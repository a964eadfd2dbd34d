"""Section IV-D: the histogram of errata 13, the support vector machine and the decision."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from rwa_monitor.paper.classification import classify, histogram, train_svm, with_classifiers
from tests.diagnosis.test_classification import MODEL, MODELS, NAMES, features
from tests.diagnosis.test_training import labelled


def test_values_outside_count_in_the_end_bins() -> None:
    assert histogram(np.array([-5.0, 5.0, 7.0]), 0.0, 1.0, 4).tolist() == pytest.approx([1 / 3, 0, 0, 2 / 3])


@given(hnp.arrays(np.float64, 20, elements=st.floats(0.01, 0.99)), st.integers(1, 40))
def test_histogram_agrees_with_numpy_inside_the_range(values: np.ndarray, bins: int) -> None:
    expected, edges = np.histogram(values, bins=bins, range=(0.0, 1.0))
    if np.abs(values[:, None] - edges).min() > 1e-9:  # on an edge rounding decides
        assert np.allclose(histogram(values, 0.0, 1.0, bins), expected / 20)


def test_the_linear_machine_separates_what_a_line_separates() -> None:
    rng = np.random.default_rng(5)
    anomalous = np.arange(60) % 2 == 0
    values = [np.array([1.3 if ill else 1.0]) + 0.02 * rng.standard_normal(1) for ill in anomalous]
    svm = train_svm(values, anomalous, bins=0)
    threshold = svm.low - svm.bias / svm.weights[0] * (svm.high - svm.low)
    assert 1.05 < threshold < 1.25
    assert train_svm(values, np.zeros(60, dtype=bool), bins=0) is None


def test_what_was_not_shown_has_no_machine() -> None:
    healthy = [window for window in labelled() if not any(window.labels.values())]
    assert all(anomaly.svm is None for anomaly in with_classifiers(MODEL, healthy).anomalies)
    assert all(anomaly.svm is not None for anomaly in with_classifiers(MODEL, labelled()).anomalies)


def test_no_machine_leaves_an_anomaly_open() -> None:
    judged = classify(features(factor_2=3.0), [*MODELS[:3], None], NAMES).anomalies[3]
    assert not judged.informative
    assert not judged.active


def test_active_is_exactly_where_the_decision_is_positive() -> None:
    for factor in (1.0, 1.6):
        judgement = classify(features(factor_1=factor), MODELS, NAMES)
        for entry in judgement.anomalies:
            assert entry.active == (entry.probability > 0.5) or entry.probability == 0.5
