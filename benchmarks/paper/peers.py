"""Compares changepoints of this project with those of other packages and of a dummy, on the same windows.

The other packages are given what a monitor does not know: the noise's true long-run standard deviation, which allows
for its autocorrelation, and friction less viscous friction of the true slope. Ours are given the samples.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from benchmarks.speed.peers import Peer
from benchmarks.window import Window, window_of
from rwa_monitor.changepoints.stage_results import REJECTED
from rwa_monitor.discrepancy.diagnosis_gain import PLACED_WITHIN
from rwa_monitor.paper.detection import SCALE, Signal, detect
from rwa_monitor.samples import IntArray
from rwa_monitor.simulation.datasets import LabelledWindow
from rwa_monitor.simulation.record import Changepoints
from rwa_monitor.switching.assignment import assign
from rwa_monitor.switching.carried_state import CarriedState

FPOP: Final = "skchange FPOP"
WARM_UP: Final = 4000  # slots
DUMMY_EVERY: Final = 3000  # samples: about as often as the windows of recipe `paper` jump

Detector = Callable[[Window], IntArray]


@dataclass(frozen=True, slots=True)
class Detected:
    """Score of a detector over all windows.

    Attributes
    ----------
    name
        Name of the detector.
    given
        The true values that it is given.
    visible, found
        Visible true jumps, and those with a changepoint within 5 samples.
    false
        Changepoints without a true jump within 5 samples, and duplicates for one jump.
    seconds
        Median time of a window [s].
    windows
        Number of windows.
    """

    name: str
    given: str
    visible: int
    found: int
    false: int
    seconds: float
    windows: int


def compare(windows: Sequence[LabelledWindow], peers: Sequence[Peer]) -> list[Detected]:
    """Run every detector over the windows, one after the other in this process.

    Parameters
    ----------
    windows
        Labelled windows.
    peers
        Detectors of the other packages that are installed.
    """
    pairs = [(whitened(labelled), labelled.telemetry.truth.changepoints) for labelled in windows]
    return [
        _run("ours, `joint`: candidates", "samples", candidates, pairs),
        _run("ours, `joint`: accepted", "samples, switching laws", accepted, pairs),
        _run(f"the paper's wGLR, w = {SCALE}", "samples", of_the_paper, pairs),
        *(_run(peer.name, "slope, noise", peer_detector(peer), pairs) for peer in peers),
        _run(f"dummy: every {DUMMY_EVERY} samples", "nothing", dummy, pairs),
    ]


def whitened(labelled: LabelledWindow) -> Window:
    """Return a window whose stated noise is the long-run one: few false alarms of peers in autocorrelated noise too."""
    return replace(
        window_of(labelled), noise_std=labelled.telemetry.truth.long_run_std_Nm / labelled.wheel.torque_unit_Nm
    )


def candidates(window: Window) -> IntArray:
    """Return the candidates of stage 1, int64 (m,)."""
    return window.evidence().candidates.index


def of_the_paper(window: Window) -> IntArray:
    """Return the changepoints of the paper's method, int64 (m,)."""
    evidence = window.evidence()
    return detect(Signal.of(evidence), evidence.noise, window.wheel)


def accepted(window: Window) -> IntArray:
    """Return the changepoints that the joint assignment accepts, int64 (m,)."""
    assignment, _ = assign(window.evidence(), window.wheel, CarriedState.empty())
    return np.unique(assignment.index[assignment.system != REJECTED])


def peer_detector(peer: Peer) -> Detector:
    """Return another package's detector, its indices converted to the window's slots."""

    def detect(window: Window) -> IntArray:
        series = window.series()
        found = np.asarray(peer.search(series), dtype=np.int64)
        moving = np.flatnonzero(window.moving)
        return moving[found[found < series.size]]  # ruptures returns the end of the series as well

    return detect


def dummy(window: Window) -> IntArray:
    """Return a changepoint every `DUMMY_EVERY` samples."""
    return np.arange(DUMMY_EVERY, window.speed_rad_s.size, DUMMY_EVERY, dtype=np.int64)


def _run(name: str, given: str, detector: Detector, pairs: Sequence[tuple[Window, Changepoints]]) -> Detected:
    detector(_beginning(pairs[0][0]))  # compiles
    visible = found = false = 0
    seconds = []
    for window, truth in pairs:
        begin = time.perf_counter()
        index = detector(window)
        seconds.append(time.perf_counter() - begin)
        jumps, hits, wrong = score(index, truth)
        visible, found, false = visible + jumps, found + hits, false + wrong
    return Detected(name, given, visible, found, false, float(np.median(seconds)), len(pairs))


def _beginning(window: Window) -> Window:
    head = slice(0, WARM_UP)
    return replace(
        window, speed_rad_s=window.speed_rad_s[head], torque_Nm=window.torque_Nm[head], good=window.good[head]
    )


@dataclass(frozen=True, slots=True)
class SecondSource:
    """Benefit of another detector's changepoints in addition to our candidates.

    Attributes
    ----------
    visible, missed
        Visible true jumps, and those that our candidates miss.
    recovered
        Missed jumps that the other detector finds.
    false_ours, false_both
        False candidates of ours alone, and of both together.
    """

    visible: int
    missed: int
    recovered: int
    false_ours: int
    false_both: int


def add_second_source(windows: Sequence[LabelledWindow], peer: Peer) -> SecondSource:
    """Count the jumps that a peer's changepoints add to our candidates; those within 5 samples of ours are the same."""
    detect = peer_detector(peer)
    counts = np.zeros(5, dtype=np.int64)
    for labelled in windows:
        window, truth = whitened(labelled), labelled.telemetry.truth.changepoints
        ours, theirs = candidates(window), detect(window)
        apart = (np.abs(theirs[:, None] - ours[None, :]) > PLACED_WITHIN).all(axis=1)
        visible, found, false = score(ours, truth)
        _, both, false_both = score(np.sort(np.concatenate([ours, theirs[apart]])), truth)
        counts += (visible, visible - found, both - found, false, false_both)
    return SecondSource(*(int(count) for count in counts))


def score(index: IntArray, truth: Changepoints) -> tuple[int, int, int]:
    """Return how many jumps are visible, how many of them were found, and how many changepoints are false.

    Changepoints and jumps are matched one to one, the nearest first; a changepoint at a jump too small to be visible is
    neither right nor false. Two simultaneous jumps count as one.
    """
    slots, where = np.unique(truth.index, return_inverse=True)
    visible = np.zeros(slots.size, dtype=np.bool_)
    np.logical_or.at(visible, where, truth.visible)
    distance = np.abs(index[:, None] - slots[None, :])
    free, taken = np.ones(index.size, dtype=np.bool_), np.zeros(slots.size, dtype=np.bool_)
    near = np.argwhere(distance <= PLACED_WITHIN)
    for i, j in near[np.argsort(distance[near[:, 0], near[:, 1]], kind="stable")]:
        if free[i] and not taken[j]:
            free[i], taken[j] = False, True
    return int(visible.sum()), int((taken & visible).sum()), int(free.sum())
