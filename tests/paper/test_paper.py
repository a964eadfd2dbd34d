"""The paper's method by section: beside the default method's kernels, and where it fails as the errata state."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from rwa_monitor.changepoints.noise import FALSE_POSITIVE
from rwa_monitor.changepoints.stage_results import REJECTED, UNATTRIBUTED, Assignment, Estimate, Evidence, NoiseEstimate
from rwa_monitor.kernels.wglr import wglr as compiled
from rwa_monitor.paper.assignment import LOG_IMPOSSIBLE, assign, split
from rwa_monitor.paper.classification import classify, histogram, train_svm, with_classifiers
from rwa_monitor.paper.detection import SCALE, THRESHOLD, Signal, detect, maxima_of_runs, wglr
from rwa_monitor.paper.estimation import away_from_changepoints, estimate
from rwa_monitor.wheel.wheel import built_in_wheel
from tests.changepoints.test_evidence import _gather, _telemetry
from tests.diagnosis.test_classification import MODEL, MODELS, NAMES, features
from tests.diagnosis.test_training import labelled
from tests.switching.assignment_windows import evidence_at, record_of, window

WHEEL = built_in_wheel()


@pytest.mark.parametrize("w", [2, 50, 128])
@pytest.mark.parametrize("share", [1.0, 0.8])
def test_the_wglr_is_that_of_the_compiled_kernel(w: int, share: float) -> None:
    rng = np.random.default_rng(w)
    x, z = 0.6 + 0.3 * np.sin(np.arange(9000) / 700.0), 1.5 + 0.02 * rng.standard_normal(9000)
    used = rng.random(9000) < share
    expected, _ = compiled(x, z, used, w, 1e-4, 0.9)
    np.testing.assert_allclose(wglr(Signal(x, z, used), 0.9, w), expected, rtol=1e-6, atol=1e-9)


def test_a_signal_shorter_than_the_window_shows_nothing() -> None:
    signal = Signal(np.ones(2 * SCALE - 1), np.ones(2 * SCALE - 1), np.ones(2 * SCALE - 1, dtype=np.bool_))
    assert np.isnan(wglr(signal, 1.0)).all()
    assert maxima_of_runs(wglr(signal, 1.0), THRESHOLD).size == 0


def test_each_run_above_the_threshold_gives_its_maximum() -> None:
    assert maxima_of_runs(np.array([9.0, 0, 2, 3, 2, np.nan, 2, 0, 5, 5]), 1.0).tolist() == [0, 3, 6, 8]


def test_big_jumps_have_side_lobes() -> None:
    """Errata 4: jumps of 10 to 25 σ show again 20 to 30 slots away, where the speed changes."""
    jumps = [(k, 25.0 * (-1) ** i) for i, k in enumerate(range(2500, 40_000, 1000))]
    evidence, _ = _gather(*_telemetry(19, 40_000, jumps, crossing=True))
    assert evidence.candidates.index.tolist() == [index for index, _ in jumps]
    assert detect(Signal.of(evidence), evidence.noise, WHEEL, 50).size > len(jumps)


# ---- section IV-B: estimation ----------------------------------------------------------------------------------------


SIGMA = 0.024
NOISE = NoiseEstimate(SIGMA, np.array([SIGMA**2]), 1.0)
INDEX = np.array([700, 760, 1900])


def _signal(share: float = 1.0) -> Signal:
    return Signal(*record_of(3, 3000, zip(INDEX.tolist(), (0.4, -0.4, 0.6), strict=True), share))


@pytest.mark.parametrize("share", [1.0, 0.7])
def test_levels_and_slope_are_those_of_the_printed_matrix(share: float) -> None:
    signal = _signal(share=share)
    found, _ = estimate(signal, INDEX, NOISE)
    interval = np.searchsorted(INDEX, np.arange(3000), side="right")
    used = away_from_changepoints(signal.used, interval, INDEX, SCALE // 2)
    h = np.column_stack([np.equal.outer(interval[used], np.arange(4)), signal.x[used]])
    solution, covariance = np.linalg.lstsq(h, signal.z[used], rcond=None)[0], SIGMA**2 * np.linalg.inv(h.T @ h)
    assert [*found.level, found.viscous] == pytest.approx(solution, rel=1e-9)
    stds = [*found.level_std, found.viscous_std]
    assert stds == pytest.approx(np.sqrt(np.diag(covariance)), rel=1e-9)
    assert found.rmse == pytest.approx(np.sqrt(np.mean((signal.z[used] - h @ solution) ** 2)), rel=1e-9)
    steps = np.eye(5)[1:4] - np.eye(5)[:3]
    assert found.jump_std == pytest.approx(np.sqrt(np.diag(steps @ covariance @ steps.T)), rel=1e-9)


def test_samples_beside_a_misplaced_changepoint_do_not_count() -> None:
    signal = _signal()
    moved, true = (np.diff(estimate(signal, INDEX + off, NOISE)[0].level)[2] for off in (12, 0))
    assert abs(moved - true) < 0.01


def test_rejection_is_the_loss_of_likelihood_when_intervals_merge() -> None:
    """At the slope of the full fit (errata 7): -ΔSSE/2σ², from two squared errors written out."""
    signal = _signal()
    found, rejection = estimate(signal, INDEX, NOISE)
    edges, residual = np.concatenate([[0], INDEX, [3000]]), signal.z - found.viscous * signal.x
    margins = [min(SCALE // 2, length // 4) for length in np.diff(edges).tolist()]
    parts = [
        residual[begin + margin * (i > 0) : end - margin * (i < INDEX.size)]
        for i, (begin, end, margin) in enumerate(zip(edges[:-1], edges[1:], margins, strict=True))
    ]
    for i in range(INDEX.size):
        merged = np.concatenate(parts[i : i + 2])
        loss = sum(part.size * part.var() for part in parts[i : i + 2]) - merged.size * merged.var()
        assert rejection[i] == pytest.approx(loss / (2 * SIGMA**2) + np.log(FALSE_POSITIVE), rel=1e-9)


def test_colour_cheapens_rejection() -> None:
    colour = NoiseEstimate(SIGMA, SIGMA**2 * 0.5 ** np.arange(64), 3.0)
    index = np.array([1000, 2000])
    white, wide = (estimate(_signal(), index, noise)[1] - np.log(FALSE_POSITIVE) for noise in (NOISE, colour))
    np.testing.assert_allclose(white / wide, 3.0, rtol=0.02)


def test_at_one_speed_the_slope_is_not_shown() -> None:
    blind, _ = estimate(_signal()._replace(x=np.full(3000, 0.5)), INDEX, NOISE)
    assert blind.viscous == 0.0
    assert np.isinf(blind.viscous_std)
    assert np.isinf(blind.level_std).all()
    assert (blind.jump_std < SIGMA).all()  # jumps do not need the slope


def test_an_interval_without_samples_has_no_certainty() -> None:
    signal = _signal()
    signal.used[700:760] = False
    found, rejection = estimate(signal, INDEX, NOISE)
    assert found.level[1] == found.level[0]
    assert np.isinf(found.level_std[1])
    assert np.isinf(found.jump_std[:2]).all()
    assert rejection[:2].tolist() == [np.log(FALSE_POSITIVE)] * 2
    empty, _ = estimate(signal._replace(used=np.zeros(3000, dtype=np.bool_)), INDEX, NOISE)
    assert np.isfinite(empty.level).all()
    assert empty.rmse == 0.0


# ---- the paper's own assignment and Algorithm 1 ----------------------------------------------------------------------


def assigned(evidence: Evidence, **options: bool) -> tuple[Assignment, Estimate]:
    """Assign the candidates of a window as if they had been detected."""
    return assign(Signal.of(evidence), evidence.candidates.index, evidence.noise, WHEEL, **options)


def test_rejects_a_false_candidate():
    rng = np.random.default_rng(51)
    made = window(WHEEL, rng, false_candidates=0.0, jitter=0)
    assignment, levels = assigned(evidence_at(made.x, made.z, [*made.evidence.candidates.index, 5_000]))
    assert assignment.system[assignment.index == 5_000].tolist() == [REJECTED]
    assert 5_000 not in levels.index


def test_an_infeasible_window_pays_the_price():
    """Three steps up within 600 slots: no hard law allows them, so impossible durations get a price."""
    x = np.full(80_000, 0.5)
    z = 1.5 + 0.024 * np.random.default_rng(52).standard_normal(x.size)
    slots = [40_000, 40_300, 40_600]
    for k in slots:
        z[k:] += 0.5
    evidence = evidence_at(x, z, slots)
    assignment, _ = assigned(evidence)
    assert assignment.log_score < LOG_IMPOSSIBLE
    assert (assignment.direction[assignment.system >= 0] == 1).all()
    printed, levels = assigned(evidence, hard=True)
    assert (printed.system == UNATTRIBUTED).all()
    assert levels.index.tolist() == slots


def test_algorithm_1_takes_the_minimum_for_rest():
    """Where fss_2 never rests, the paper puts its lowest friction into the base: too high by a whole jump."""
    rng = np.random.default_rng(53)
    ambiguous = 0
    for _ in range(60):
        made = window(WHEEL, rng, false_candidates=0.0, jitter=0)
        assignment, levels = assigned(made.evidence)
        found = set(zip(assignment.index.tolist(), assignment.system.tolist(), strict=True))
        if not all((k, s) in found for k, s, _ in made.jumps):
            continue
        parts = split(assignment, levels, WHEEL)
        lowest = made.friction[1].min()
        assert parts.base_dry == pytest.approx(1.0 + lowest, abs=0.05)
        assert all(friction.min() == 0.0 for friction in parts.fss_friction)
        ambiguous += lowest > 0
    assert ambiguous >= 3


def test_what_no_jump_is_known_by_is_stated_as_unknown():
    """At one speed a jump may be known not at all: the lowest friction is 0 still, and no other is called certain."""
    made = window(WHEEL, np.random.default_rng(54), false_candidates=0.0, jitter=0)
    assignment, levels = assigned(made.evidence)
    blind = replace(assignment, jump_std=np.full_like(assignment.jump_std, np.inf))
    parts = split(blind, levels, WHEEL)
    for friction, std in zip(parts.fss_friction, parts.fss_friction_std, strict=True):
        assert np.array_equal(np.isinf(std), np.arange(std.size) != np.argmin(friction))


def test_a_window_without_candidates():
    x, z, _ = record_of(54, 5_000)
    assignment, levels = assigned(evidence_at(x, z, []))
    assert assignment.index.size == 0
    assert split(assignment, levels, WHEEL).base_dry == pytest.approx(1.0, abs=0.01)


def test_states_are_capped_and_that_is_reported(monkeypatch):
    monkeypatch.setattr("rwa_monitor.paper.assignment.BUDGET", 2)
    made = window(WHEEL, np.random.default_rng(55), false_candidates=8.0)
    assignment, _ = assigned(made.evidence)
    assert assignment.pruned


# ---- section IV-D: classification ------------------------------------------------------------------------------------


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
