"""Runs one labelled window through the stages of both methods and returns the quantities of the paper's figures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from benchmarks.accuracy.outcome import Outcome, evaluate
from benchmarks.window import Window, window_of
from rwa_monitor.changepoints.estimation import estimate
from rwa_monitor.changepoints.stage_results import REJECTED, UNATTRIBUTED, Assignment, Estimate, Evidence
from rwa_monitor.diagnosis.features import features_of
from rwa_monitor.paper.method import split_friction
from rwa_monitor.samples import FloatArray, IntArray
from rwa_monitor.simulation.datasets import LabelledWindow
from rwa_monitor.switching.assignment import assign
from rwa_monitor.switching.carried_state import CarriedState

HARD: Final = "paper, hard laws"  # name of the features of the paper's method as published
ORACLE: Final = "oracle"  # is given the times of the jumps
ERROR_STEP: Final = 0.002  # of the histogram of absolute errors, normalised; the paper's figure ends at about 0.3
ERROR_BINS: Final = 151  # the last bin holds all larger errors


@dataclass(frozen=True, slots=True)
class Fitted:
    """How well levels and slope between given changepoints fit a window.

    Attributes
    ----------
    excess_rmse
        Root mean square residual less the noise's standard deviation, normalised.
    errors
        int64 (ERROR_BINS,), histogram of the absolute residuals in steps of `ERROR_STEP`.
    """

    excess_rmse: float
    errors: IntArray


@dataclass(frozen=True, slots=True)
class Work:
    """Work of a window's assignment: candidates, rejected ones, expanded states, and whether the search was pruned."""

    candidates: int
    rejected: int
    states: int
    pruned: bool


@dataclass(frozen=True, slots=True)
class Examined:
    """Results on one window.

    Attributes
    ----------
    outcome
        Features and jumps of both methods and the oracles, the paper's method with hard laws among them.
    naive_excess_rmse
        Excess RMSE of one dry and one viscous coefficient for the whole window.
    fitted
        By method, and `ORACLE`.
    work
        By method.
    possible
        Whether any sequence of jumps is possible under the hard duration laws of the paper.
    """

    outcome: Outcome
    naive_excess_rmse: float
    fitted: Mapping[str, Fitted]
    work: Mapping[str, Work]
    possible: bool


def examine(labelled: LabelledWindow) -> Examined:
    """Run one labelled window through the methods and the oracles."""
    window, wheel = window_of(labelled), labelled.wheel
    evidence = window.evidence()
    as_paper, _, _ = split_friction(evidence, wheel)
    hard, _, components = split_friction(evidence, wheel, hard=True)
    jointly, _ = assign(evidence, wheel, CarriedState.empty())
    features = features_of(components, hard, wheel)
    outcome = evaluate(labelled)
    naive = estimate(evidence, np.zeros(0, dtype=np.int64))
    true_jumps = np.unique(labelled.telemetry.truth.changepoints.index)
    return Examined(
        outcome=replace(outcome, features={**outcome.features, HARD: features}),
        naive_excess_rmse=naive.rmse - evidence.noise.std,
        fitted={
            "paper": _fitted(window, evidence, _accepted(as_paper)),
            "joint": _fitted(window, evidence, _accepted(jointly)),
            ORACLE: _fitted(window, evidence, true_jumps),
        },
        work={"paper": _work(as_paper, as_paper.index.size), "joint": _work(jointly, len(evidence.candidates))},
        possible=hard.index.size == 0 or not bool((hard.system == UNATTRIBUTED).all()),
    )


def _accepted(assignment: Assignment) -> IntArray:
    return np.unique(assignment.index[assignment.system != REJECTED])


def _work(assignment: Assignment, candidates: int) -> Work:
    rejected = int(np.count_nonzero(assignment.system == REJECTED))
    return Work(candidates, rejected, assignment.states, assignment.pruned)


def _fitted(window: Window, evidence: Evidence, index: IntArray) -> Fitted:
    """Fit levels and slope between changepoints; return excess RMSE and histogram of the residuals."""
    levels = estimate(evidence, index)
    residual = np.abs(window.z - levels.viscous * window.x - _level_of_slots(levels, window.z.size))
    bins = np.minimum((residual[window.moving] / ERROR_STEP).astype(np.int64), ERROR_BINS - 1)
    return Fitted(levels.rmse - evidence.noise.std, np.bincount(bins, minlength=ERROR_BINS))


def _level_of_slots(levels: Estimate, slots: int) -> FloatArray:
    lengths = np.diff(np.concatenate(([0], levels.index, [slots])))
    return np.repeat(levels.level, lengths)
