"""The half-width w of the paper's detector, chosen as its section V-A does: a sweep on windows of its own recipe."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy import special

from benchmarks.accuracy.outcome import Outcome
from benchmarks.accuracy.splits import Accuracy, measure
from benchmarks.paper.peers import score
from benchmarks.paper.run_length import JUMP_SIGMAS, MISSED
from benchmarks.window import window_of
from rwa_monitor.changepoints.stage_results import REJECTED
from rwa_monitor.diagnosis.features import Features, features_of
from rwa_monitor.paper.assignment import assign, split
from rwa_monitor.paper.detection import THRESHOLD, Signal, detect
from rwa_monitor.simulation.datasets import LabelledWindow
from rwa_monitor.wheel.wheel import built_in_wheel

WIDTHS: Final = (10, 15, 20, 25, 30, 50, 70, 100)  # w [samples]


def threshold_of(w: int) -> float:
    """Return GLR_thr / σ² at which a jump of 3σ is missed in 0.1 %, speed steady (paper, section V-A)."""
    return float(special.chndtrix(MISSED, 1, JUMP_SIGMAS**2 * w / 2))


AS_IT_IS: Final = "1e-9 false a sample"  # the threshold of `paper.detection`
THRESHOLDS: Final[dict[str, Callable[[int], float]]] = {
    AS_IT_IS: lambda _: THRESHOLD,
    "0.1 % missed at 3 σ": threshold_of,
}

Key = tuple[str, int]


@dataclass(frozen=True, slots=True)
class Tried:
    """Result of the paper's method on one window at one w: visible jumps, found ones, false and rejected candidates."""

    visible: int
    found: int
    false: int
    rejected: int
    features: Features


def try_widths(labelled: LabelledWindow) -> dict[Key, Tried]:
    """Run the paper's method on a window at every threshold and w."""
    window, wheel = window_of(labelled), labelled.wheel
    evidence = window.evidence()
    signal, noise = Signal.of(evidence), evidence.noise
    tried: dict[Key, Tried] = {}
    for name, threshold in THRESHOLDS.items():
        for w in WIDTHS:
            index = detect(signal, noise, wheel, w, threshold(w))
            assignment, levels = assign(signal, index, noise, wheel, w=w)
            visible, found, false = score(index, labelled.telemetry.truth.changepoints)
            rejected = int(np.count_nonzero(assignment.system == REJECTED))
            features = features_of(split(assignment, levels, wheel), assignment, wheel)
            tried[name, w] = Tried(visible, found, false, rejected, features)
    return tried


@dataclass(frozen=True, slots=True)
class Width:
    """The paper's method at one threshold and w.

    Attributes
    ----------
    threshold, w
        The threshold and w [samples].
    found
        Share of the visible jumps that have a candidate.
    false
        False candidates per window.
    rejecting
        Share of the windows in which the assignment rejects a candidate.
    accuracy
        Accuracy of the diagnosis, over random splits.
    """

    threshold: str
    w: int
    found: float
    false: float
    rejecting: float
    accuracy: Accuracy


def sweep_widths(
    outcomes: Sequence[Outcome], windows: Sequence[Mapping[Key, Tried]], seed: int, splits: int
) -> tuple[Width, ...]:
    """Return the paper's method at each threshold and w; `outcomes` have status and labels of the windows."""
    rows = []
    for name, w in windows[0]:
        tried = [one[name, w] for one in windows]
        as_paper = [
            replace(outcome, features={"paper": one.features}) for outcome, one in zip(outcomes, tried, strict=True)
        ]
        rows.append(
            Width(
                name,
                w,
                sum(one.found for one in tried) / sum(one.visible for one in tried),
                float(np.mean([one.false for one in tried])),
                float(np.mean([one.rejected > 0 for one in tried])),
                measure(as_paper, "paper", "paper", built_in_wheel(), seed, splits),
            )
        )
    return tuple(rows)
