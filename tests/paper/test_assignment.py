"""The paper's own assignment and Algorithm 1: what it does, and where it fails as the errata state."""

from dataclasses import replace

import numpy as np
import pytest

from rwa_monitor.changepoints.stage_results import REJECTED, UNATTRIBUTED, Assignment, Estimate, Evidence
from rwa_monitor.paper.assignment import LOG_IMPOSSIBLE, assign, split
from rwa_monitor.paper.detection import Signal
from rwa_monitor.wheel.wheel import built_in_wheel
from tests.switching.assignment_windows import candidates_at, evidence_of, window

WHEEL = built_in_wheel()


def assigned(evidence: Evidence, **options: bool) -> tuple[Assignment, Estimate]:
    """Assign the candidates of a window as if they had been detected."""
    return assign(Signal.of(evidence), evidence.candidates.index, evidence.noise, WHEEL, **options)


def test_clean_windows_are_assigned_right():
    rng = np.random.default_rng(50)
    good = total = 0
    for _ in range(10):
        made = window(WHEEL, rng, false_candidates=0.0, jitter=0)
        assignment, _ = assigned(made.evidence)
        found = set(zip(assignment.index.tolist(), assignment.system.tolist(), strict=True))
        good += sum((k, s) in found for k, s, _ in made.jumps)
        total += len(made.jumps)
    assert good >= 0.9 * total


def test_rejects_a_false_candidate():
    rng = np.random.default_rng(51)
    made = window(WHEEL, rng, false_candidates=0.0, jitter=0)
    slots = np.append(made.evidence.candidates.index, 5_000)
    evidence = evidence_of(made.x, made.z, candidates_at(made.x, made.z, slots, 0.024, 1.0), 0.024)
    assignment, levels = assigned(evidence)
    assert assignment.system[assignment.index == 5_000].tolist() == [REJECTED]
    assert 5_000 not in levels.index


def test_an_infeasible_window_pays_the_price():
    """Three steps up within 600 slots: no hard law allows them, so impossible durations get a price."""
    x = np.full(80_000, 0.5)
    z = 1.5 + 0.024 * np.random.default_rng(52).standard_normal(x.size)
    slots = np.array([40_000, 40_300, 40_600])
    for k in slots:
        z[k:] += 0.5
    evidence = evidence_of(x, z, candidates_at(x, z, slots, 0.024, 1.0), 0.024)
    assignment, _ = assigned(evidence)
    assert assignment.log_score < LOG_IMPOSSIBLE
    assert (assignment.direction[assignment.system >= 0] == 1).all()
    printed, levels = assigned(evidence, hard=True)
    assert (printed.system == UNATTRIBUTED).all()
    assert levels.index.tolist() == slots.tolist()


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
    x = 0.5 + 0.3 * np.sin(np.arange(5_000) / 500.0)
    z = 1.0 + x + 0.024 * np.random.default_rng(54).standard_normal(x.size)
    evidence = evidence_of(x, z, candidates_at(x, z, np.zeros(0), 0.024, 1.0), 0.024)
    assignment, levels = assigned(evidence)
    assert assignment.index.size == 0
    assert split(assignment, levels, WHEEL).base_dry == pytest.approx(1.0, abs=0.01)


def test_states_are_capped_and_that_is_reported(monkeypatch):
    monkeypatch.setattr("rwa_monitor.paper.assignment.BUDGET", 2)
    made = window(WHEEL, np.random.default_rng(55), false_candidates=8.0)
    assignment, _ = assigned(made.evidence)
    assert assignment.pruned
